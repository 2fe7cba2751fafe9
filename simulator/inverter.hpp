// Two-level inverter: averaged over a period, or switched with centre-aligned pulses at their exact edges.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "plant.hpp"

namespace cogless {

using Phases = std::array<double, 3>;

struct InverterConfig {
    bool switched = false;
    double bus_voltage;          // V
    double dead_time = 0.0;      // s
    bool computation_delay = true;  // the duty cycles act one period after they were computed
};

inline Voltage stationary(const Phases& u) {
    return {(2.0 * u[0] - u[1] - u[2]) / 3.0, (u[1] - u[2]) * 0.57735026918962576};
}

// Line currents of the star equivalent from the rotor's frame.
inline Phases phase_currents(Currents i, Complex axis) {
    const double alpha = axis.re * i.d - axis.im * i.q;
    const double beta = axis.im * i.d + axis.re * i.q;
    return {alpha, -0.5 * alpha + 0.86602540378443865 * beta, -0.5 * alpha - 0.86602540378443865 * beta};
}

// A stretch of a period with constant voltage.
struct Stretch {
    double until;  // s from the start of the period
    Voltage u;
};

// The stretches of one period, in order.
struct Pulses {
    std::array<Stretch, 7> stretch;
    std::size_t count;
};

// While a leg's two transistors are both off, its current flows through a diode: out of the leg through the lower one, so
// that a positive current delays the rising edge by the dead time, and a negative current the falling edge. The sign is
// taken at the start of the period.
inline Pulses pulses(const InverterConfig& config, const Phases& duty, const Phases& current, double period) {
    Phases rise, fall;
    for (std::size_t x = 0; x < 3; ++x) {
        if (duty[x] <= 0.0 || duty[x] >= 1.0) {  // no edge, no dead time
            rise[x] = 0.0;
            fall[x] = duty[x] >= 1.0 ? period : 0.0;
            continue;
        }
        rise[x] = 0.5 * period * (1.0 - duty[x]) + (current[x] >= 0.0 ? config.dead_time : 0.0);
        fall[x] = std::min(0.5 * period * (1.0 + duty[x]) + (current[x] < 0.0 ? config.dead_time : 0.0), period);
        rise[x] = std::min(rise[x], fall[x]);
    }
    std::array<double, 7> edges{rise[0], rise[1], rise[2], fall[0], fall[1], fall[2], period};
    std::sort(edges.begin(), edges.end());

    Pulses result;
    result.count = 0;
    double from = 0.0;
    for (const double edge : edges) {
        if (edge <= from) continue;
        const double middle = 0.5 * (from + edge);
        Phases u;
        for (std::size_t x = 0; x < 3; ++x) {
            u[x] = middle > rise[x] && middle < fall[x] ? config.bus_voltage : 0.0;
        }
        result.stretch[result.count++] = {edge, stationary(u)};
        from = edge;
    }
    return result;
}

// The mean of the same pulses over the period.
inline Voltage averaged(const InverterConfig& config, const Phases& duty, const Phases& current, double period) {
    const double dead_share = config.dead_time / period;
    Phases u;
    for (std::size_t x = 0; x < 3; ++x) {
        double share = duty[x];
        if (duty[x] > 0.0 && duty[x] < 1.0) {
            // a delayed rise meets the fall at the earliest, a delayed fall the period's end
            share += current[x] >= 0.0 ? -std::min(dead_share, share) : std::min(dead_share, 0.5 * (1.0 - share));
        }
        u[x] = config.bus_voltage * share;
    }
    return stationary(u);
}

}  // namespace cogless
