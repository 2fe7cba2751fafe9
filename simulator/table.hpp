// Linear interpolation in a table, by time (ends held) or by angle (periodic in one revolution).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace cogless {

struct Table {
    std::vector<double> at, value;  // at: increasing; both empty for no table

    bool empty() const { return at.empty(); }

    double held(double x) const {
        if (x <= at.front()) return value.front();
        if (x >= at.back()) return value.back();
        const auto upper = static_cast<std::size_t>(std::upper_bound(at.begin(), at.end(), x) - at.begin());
        return between(upper - 1, upper, x, at[upper] - at[upper - 1]);
    }

    // The derivative of held(). At a point it is the slope of the segment after the point.
    double held_slope(double x) const {
        if (x < at.front() || x >= at.back()) return 0.0;
        const std::size_t from = place(x);
        return (value[from + 1] - value[from]) / (at[from + 1] - at[from]);
    }

    // Index of the last point that is not beyond x; x must not be before the first point.
    std::size_t place(double x) const {
        return static_cast<std::size_t>(std::upper_bound(at.begin(), at.end(), x) - at.begin()) - 1;
    }

    double periodic(double theta) const {
        constexpr double turn = 2.0 * std::numbers::pi;
        double x = theta - turn * std::floor((theta - at.front()) / turn);  // in [at.front(), at.front() + turn)
        const auto upper = static_cast<std::size_t>(std::upper_bound(at.begin(), at.end(), x) - at.begin());
        if (upper < at.size()) return between(upper - 1, upper, x, at[upper] - at[upper - 1]);
        return between(at.size() - 1, 0, x, at.front() + turn - at.back());
    }

private:
    double between(std::size_t lower, std::size_t upper, double x, double width) const {
        return width > 0.0 ? value[lower] + (value[upper] - value[lower]) * (x - at[lower]) / width : value[lower];
    }
};

}  // namespace cogless
