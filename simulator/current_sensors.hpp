// Phase-current sensors: gain error, offset, noise, and an analogue-to-digital converter.
#pragma once

#include <algorithm>
#include <cmath>

#include "inverter.hpp"
#include "random.hpp"

namespace cogless {

struct CurrentSensorsConfig {
    Phases offset{};      // A
    Phases gain_error{};  // relative: measured = (1 + gain_error) i + offset
    double noise = 0.0;   // A, standard deviation
    int bits = 0;         // of the converter; 0: none
    double range = 0.0;   // A, the converter spans +-range
    int sensors = 3;      // 2: the third current is calculated
};

inline Phases measure(const CurrentSensorsConfig& config, Phases i, Random& random) {
    for (int x = 0; x < config.sensors; ++x) {
        const auto n = static_cast<std::size_t>(x);
        i[n] += config.gain_error[n] * i[n] + config.offset[n];
        if (config.noise > 0.0) i[n] += config.noise * random.normal();
        if (config.bits > 0) {
            const double step = std::ldexp(config.range, 1 - config.bits);
            i[n] = std::clamp(step * std::round(i[n] / step), -config.range, config.range - step);
        }
    }
    if (config.sensors == 2) i[2] = -i[0] - i[1];
    return i;
}

}  // namespace cogless
