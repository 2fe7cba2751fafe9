// Phase-current sensors: gain error, offset, noise, and an analogue-to-digital converter.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "inverter.hpp"
#include "random.hpp"

namespace cogless {

struct CurrentSensorsConfig {
    Phases offset{};      // A
    Phases gain_error{};  // relative: measured = (1 + gain_error) i + offset
    double noise = 0.0;   // A, standard deviation
    int bits = 0;         // of the converter; bits of the converter; 0: no converter
    double range = 0.0;   // A, the converter spans +-range
    int sensors = 3;      // 2: the third current, if there is one, is computed from the other two
};

class CurrentSensors {
public:
    explicit CurrentSensors(const CurrentSensorsConfig& config)
        : config_(config), step_(std::ldexp(config.range, 1 - config.bits)), per_step_(1.0 / step_), highest_(config.range - step_) {}

    [[gnu::always_inline]] Phases measure(Phases i, Random& random) const {
        for (std::size_t n = 0; n < i.size(); ++n) i[n] += config_.gain_error[n] * i[n] + config_.offset[n];
        if (config_.noise > 0.0) {
            for (std::size_t n = 0; n < static_cast<std::size_t>(config_.sensors); ++n) i[n] += config_.noise * normal_.draw(random);
        }
        if (config_.bits > 0) {
            for (double& x : i) x = converted(x);
        }
        if (config_.sensors == 2) i[2] = -i[0] - i[1];
        return i;
    }

private:
    // Rounds to the nearest step, halves away from zero. Within the range the step number fits an integer, which is much
    // faster than std::round. NaN becomes the lowest step.
    double converted(double i) const {
        const double steps = std::max(-config_.range, std::min(i, highest_)) * per_step_;
        return step_ * static_cast<double>(static_cast<std::int64_t>(steps + std::copysign(0.5, steps)));
    }

    CurrentSensorsConfig config_;
    Normal normal_;
    double step_, per_step_, highest_;  // step of the converter, its inverse, and its highest output: A, 1/A, A
};

}  // namespace cogless
