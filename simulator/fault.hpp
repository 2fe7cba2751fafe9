// Faults of sensors and supply that a scenario applies to a drive.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "inverter.hpp"
#include "position_sensor.hpp"

namespace cogless {

enum class FaultKind {
    angle_missing,    // angle and speed are NaN
    angle_jump,       // the sensor's angle is shifted by `size` rad
    angle_stuck,      // the sensor keeps its last angle
    current_missing,  // the current of `phase` is NaN
    current_zero,     // the current of `phase` reads zero
    bus_voltage,      // the bus has `size` V
};

// A fault, active for from <= tick < until.
struct Fault {
    FaultKind kind;
    std::int64_t from, until;
    double size;
    std::size_t phase;
};

// The combined faults of one tick, which stay the same until before the tick `until`.
struct Faults {
    std::int64_t until = std::numeric_limits<std::int64_t>::max();
    bool missing = false, stuck = false, currents = false;
    double jump = 0.0;  // rad
    double bus_voltage;
    Phases factor{1.0, 1.0, 1.0};  // factors on the measured currents: 1, 0 or NaN

    Faults(const std::vector<Fault>& all, std::int64_t tick, double nominal_voltage) : bus_voltage(nominal_voltage) {
        for (const Fault& f : all) {
            const std::int64_t change = tick < f.from ? f.from : f.until;
            if (tick < change) until = std::min(until, change);
            if (tick < f.from || tick >= f.until) continue;
            currents |= f.kind == FaultKind::current_missing || f.kind == FaultKind::current_zero;
            switch (f.kind) {
                case FaultKind::angle_missing: missing = true; break;
                case FaultKind::angle_jump: jump += f.size; break;
                case FaultKind::angle_stuck: stuck = true; break;
                case FaultKind::current_missing: factor[f.phase] = std::numeric_limits<double>::quiet_NaN(); break;
                case FaultKind::current_zero: factor[f.phase] = 0.0; break;
                case FaultKind::bus_voltage: bus_voltage = f.size; break;
            }
        }
    }

    Measurement spoilt(Measurement m) const {
        constexpr double none = std::numeric_limits<double>::quiet_NaN();
        return missing ? Measurement{none, none} : m;
    }

    // sensors: number of measured phases; with two sensors on three phases the third current is computed from the others.
    Phases spoilt(Phases i, int sensors, bool star) const {
        if (!currents) return i;
        for (std::size_t n = 0; n < static_cast<std::size_t>(sensors); ++n) i[n] *= factor[n];
        if (star && sensors == 2) i[2] = -i[0] - i[1];
        return i;
    }
};

}  // namespace cogless
