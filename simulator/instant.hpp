// The instant within a step at which something changes, such as that a rotor stops.
#pragma once

#include <cmath>

namespace cogless {

// The time in (0, h] at which value_at(time) reaches zero from below, by the Illinois form of regula falsi. at_start: value at
// zero. at_end: value at h, which is above zero.
template <class Value>
double instant(double h, double at_start, double at_end, const Value& value_at) {
    double low = 0.0, high = h, below = at_start, above = at_end;
    for (int n = 0; n < 160 && high - low > 1e-15 * h; ++n) {
        // a bisection now and then, since rounding errors near zero can mislead the other steps for long
        const bool bisect = n % 3 == 2 || !(below < 0.0);
        const double middle = bisect ? 0.5 * (low + high) : low + (high - low) * below / (below - above);
        if (!(middle > low && middle < high)) break;
        const double value = value_at(middle);
        if (std::abs(value) <= 1e-15 * (at_end - at_start)) return middle;
        if (value > 0.0) {
            if (high - middle < 0.5 * (high - low)) below *= 0.5;
            high = middle;
            above = value;
        } else {
            if (middle - low < 0.5 * (high - low)) above *= 0.5;
            low = middle;
            below = value;
        }
    }
    return high;
}

}  // namespace cogless
