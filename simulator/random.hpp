// Random numbers that are the same on every machine: SplitMix64 and the polar method.
#pragma once

#include <cmath>
#include <cstdint>

#include "maths.hpp"

namespace cogless {

class Random {
public:
    explicit Random(std::uint64_t seed) : state_(seed) {}

    // Normally distributed, mean 0, standard deviation 1.
    double normal() {
        if (has_spare_) {
            has_spare_ = false;
            return spare_;
        }
        double x, y, s;
        do {
            x = 2.0 * uniform() - 1.0;
            y = 2.0 * uniform() - 1.0;
            s = x * x + y * y;
        } while (s >= 1.0 || s == 0.0);
        const double factor = std::sqrt(-2.0 * logarithm(s) / s);
        spare_ = y * factor;
        has_spare_ = true;
        return x * factor;
    }

private:
    double uniform() {
        state_ += 0x9e3779b97f4a7c15U;
        std::uint64_t z = state_;
        z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
        z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
        z ^= z >> 31U;
        return static_cast<double>(z >> 11U) * 0x1.0p-53;
    }

    std::uint64_t state_;
    double spare_ = 0.0;
    bool has_spare_ = false;
};

}  // namespace cogless
