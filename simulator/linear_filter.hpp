// A digital filter in the transposed direct form II.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <vector>

namespace cogless {

// Puts x through b(1/z) / a(1/z), whose a[0] is one, in place. state: where it starts, one entry fewer than b and a.
inline void filter(const std::vector<double>& b, const std::vector<double>& a, std::vector<double> state, double* x,
                   std::size_t count) {
    const std::size_t order = state.size();
    if (order < 1 || b.size() != order + 1 || a.size() != order + 1) {
        throw std::invalid_argument("filter: expected b and a of one length, and a state of one entry fewer");
    }
    for (std::size_t n = 0; n < count; ++n) {
        const double in = x[n], out = state[0] + b[0] * in;
        for (std::size_t k = 1; k < order; ++k) state[k - 1] = state[k] + in * b[k] - out * a[k];
        state[order - 1] = in * b[order] - out * a[order];
        x[n] = out;
    }
}

}  // namespace cogless
