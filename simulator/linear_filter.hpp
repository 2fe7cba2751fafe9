// A digital filter in the transposed direct form II.
#pragma once

#include <cstddef>

namespace cogless {

// Puts x through b(1/z) / a(1/z), whose a[0] is one, in place; all have order + 1 coefficients. state: where it starts, one
// entry fewer; where it ends, on return.
inline void filter(const double* b, const double* a, double* state, std::size_t order, double* x, std::size_t count) {
    for (std::size_t n = 0; n < count; ++n) {
        const double in = x[n], out = state[0] + b[0] * in;
        for (std::size_t k = 1; k < order; ++k) state[k - 1] = state[k] + in * b[k] - out * a[k];
        state[order - 1] = in * b[order] - out * a[order];
        x[n] = out;
    }
}

}  // namespace cogless
