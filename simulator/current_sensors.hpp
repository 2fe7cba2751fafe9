// Phase-current sensors: gain error, offset, noise, and an analogue-to-digital converter.
#pragma once

#include <cmath>
#include <cstdint>

#include "current_converter.hpp"
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
        i = with_gain(i, gain_error_, offset_);
        if (config_.noise > 0.0) {
            const double a = normal_.draw(random), b = normal_.draw(random);
            i += Four(config_.noise) * four_of<3>({a, b, config_.sensors == 3 ? normal_.draw(random) : 0.0});
        }
        if (config_.bits > 0) i = converted(i, Four(-config_.range), Four(highest_), Four(step_), Four(per_step_));
        Phases measured = array_of<3>(i);
        if (config_.sensors == 2) measured[2] = -measured[0] - measured[1];
        return measured;
    }

    const CurrentSensorsConfig& config() const { return config_; }
    double step() const { return step_; }        // of the converter, A
    double highest() const { return highest_; }  // output of the converter, A
    static const Normal& normal() { return normal_; }

private:
    CurrentSensorsConfig config_;
    inline static const Normal normal_;  // its tables are read at random: one copy for all drives stays in the cache
    Four offset_, gain_error_;
    double step_, per_step_, highest_;  // step of the converter, its inverse, and its highest output: A, 1/A, A
};

}  // namespace cogless
