// Speed references as functions of time.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "table.hpp"

namespace cogless {

enum class ReferenceKind { constant, ramp, profile, sine };

struct ReferenceConfig {
    ReferenceKind kind = ReferenceKind::constant;
    double speed = 0.0;      // rad/s: constant, and the end of a ramp
    double ramp = 0.0;       // rad/s^2, from the initial speed
    Table profile;           // rad/s over s
    double offset = 0.0, amplitude = 0.0, frequency = 0.0;  // sine: rad/s, rad/s, Hz
};

inline double reference(const ReferenceConfig& r, double initial_speed, double time) {
    switch (r.kind) {
        case ReferenceKind::constant:
            return r.speed;
        case ReferenceKind::ramp: {
            const double change = r.speed - initial_speed;
            return initial_speed + std::copysign(std::min(std::abs(change), r.ramp * time), change);
        }
        case ReferenceKind::profile:
            return r.profile.held(time);
        case ReferenceKind::sine:
            return r.offset + r.amplitude * std::sin(2.0 * std::numbers::pi * r.frequency * time);
    }
    return 0.0;
}

}  // namespace cogless
