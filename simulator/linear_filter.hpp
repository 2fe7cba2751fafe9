// Digital filters in the transposed direct form II.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace cogless {

constexpr std::size_t FILTER_LANES = 8, FILTER_BLOCK = 128;

// Filters each row of x, in place, by the row's own b(1/z) / a(1/z), whose a[0] is one. x has `rows` rows of `count` samples, at
// most FILTER_LANES. A row of b and of a has order + 1 coefficients; a row of `state`, the filter's initial state, has `order`.
// All rows advance together, sample by sample: a sample depends on earlier samples of its own row only. Blocks of samples are
// transposed first: a vector that is read just after its elements were written waits for them.
inline void filter_rows(const double* b, const double* a, const double* state, std::size_t order, double* x, std::size_t rows,
                        std::size_t count) {
    using Lanes = double __attribute__((vector_size(FILTER_LANES * sizeof(double))));
    std::vector<Lanes> forward(order + 1), back(order + 1), s(order), signal(FILTER_BLOCK);
    for (std::size_t row = 0; row < rows; ++row) {
        for (std::size_t k = 0; k <= order; ++k) {
            forward[k][row] = b[row * (order + 1) + k];
            back[k][row] = a[row * (order + 1) + k];
        }
        for (std::size_t k = 0; k < order; ++k) s[k][row] = state[row * order + k];
    }
    for (std::size_t begin = 0; begin < count; begin += FILTER_BLOCK) {
        const std::size_t samples = std::min(FILTER_BLOCK, count - begin);
        for (std::size_t row = 0; row < rows; ++row) {
            for (std::size_t n = 0; n < samples; ++n) signal[n][row] = x[row * count + begin + n];
        }
        for (std::size_t n = 0; n < samples; ++n) {
            const Lanes in = signal[n], out = s[0] + forward[0] * in;
            for (std::size_t k = 1; k < order; ++k) s[k - 1] = s[k] + in * forward[k] - out * back[k];
            s[order - 1] = in * forward[order] - out * back[order];
            signal[n] = out;
        }
        for (std::size_t row = 0; row < rows; ++row) {
            for (std::size_t n = 0; n < samples; ++n) x[row * count + begin + n] = signal[n][row];
        }
    }
}

}  // namespace cogless
