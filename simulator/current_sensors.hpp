// Phase-current sensors: gain error, offset, noise, and an analogue-to-digital converter.
#pragma once

#include <cmath>
#include <cstdint>

#include "inverter.hpp"
#include "random.hpp"
#include "wide.hpp"

namespace cogless {

struct CurrentSensorsConfig {
    Phases offset{};      // A
    Phases gain_error{};  // relative: measured = (1 + gain_error) i + offset
    double noise = 0.0;   // A, standard deviation
    int bits = 0;         // bits of the converter; 0: no converter
    double range = 0.0;   // A, the converter spans +-range
    int sensors = 3;      // 2: the third current, if there is one, is computed from the other two
};

class CurrentSensors {
public:
    explicit CurrentSensors(const CurrentSensorsConfig& config)
        : config_(config), offset_(four_of(config.offset)), gain_error_(four_of(config.gain_error)),
          step_(std::ldexp(config.range, 1 - config.bits)), per_step_(1.0 / step_), highest_(config.range - step_) {}

    [[gnu::always_inline]] Phases measure(const Phases& currents, Random& random) const {
        Four i = four_of(currents);
        i += gain_error_ * i + offset_;
        if (config_.noise > 0.0) {
            const double a = normal_.draw(random), b = normal_.draw(random);
            i += Four(config_.noise) * four_of<3>({a, b, config_.sensors == 3 ? normal_.draw(random) : 0.0});
        }
        if (config_.bits > 0) i = converted(i);
        Phases measured = array_of<3>(i);
        if (config_.sensors == 2) measured[2] = -measured[0] - measured[1];
        return measured;
    }

private:
    // Rounds to the nearest step, halves away from zero. NaN becomes the lowest step.
    [[gnu::always_inline]] Four converted(const Four& i) const {
        const Four below = select(i > highest_, highest_, i), lowest = -config_.range;
        const Four steps = select(below > lowest, below, lowest) * per_step_;
        return step_ * truncated(steps + select(0.0 > steps, -0.5, 0.5));
    }

    CurrentSensorsConfig config_;
    inline static const Normal normal_;  // its tables are read at random: one copy for all drives stays in the cache
    Four offset_, gain_error_;
    double step_, per_step_, highest_;  // step of the converter, its inverse, and its highest output: A, 1/A, A
};

}  // namespace cogless
