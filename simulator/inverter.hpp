// Two-level inverter: averaged over a period of the current loop, or switched with exact edges. Three legs for three phases in
// a star, or an H-bridge of two legs for each of two phases.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "plant.hpp"
#include "wide.hpp"

namespace cogless {

// One number for each phase; two-phase machines leave the third one at zero.
template <class Real>
using InPhases = std::array<Real, 3>;
using Phases = InPhases<double>;

// One number for each leg.
template <std::size_t count, class Real = double>
using Legs = std::array<Real, count>;

constexpr std::size_t star_legs = 3, bridge_legs = 4;

// Where the pulses lie: in the middle of a current-loop period, or at its begin. With two updates, two current-loop periods are one
// PWM period: in the first, of an even tick, a leg's pulse lies at the end, and in the second at the begin.
enum class Pwm { centre, edge, two_updates };

// Place of the pulses in a current-loop period, whose length is 1 here. A leg with duty cycle d becomes high at before * (1 - d) and
// stays high for d.
struct Carrier {
    double before;
    bool rises, falls;  // false: the leg is high already at the period's begin, or still at its end, so there is no edge

    // Whether a leg is high across the period's begin without an edge. last: its duty cycle in the period before.
    bool stays(double last) const { return before <= 0.0 && last >= 1.0; }
};

inline Carrier carrier(Pwm pwm, std::int64_t tick) {
    switch (pwm) {
        case Pwm::edge: return {0.0, true, true};
        case Pwm::two_updates: return tick % 2 == 0 ? Carrier{1.0, true, false} : Carrier{0.0, false, true};
        default: return {0.5, true, true};
    }
}

struct InverterConfig {
    bool switched = false;
    Pwm pwm = Pwm::centre;
    double bus_voltage;          // V
    double dead_time = 0.0;      // s
    double minimum_pulse = 0.0;  // s, shortest time for which a transistor is on in half a PWM period (edge: a whole one); 0: no limit
    double device_drop = 0.0;    // V, across the transistor or diode that conducts
    bool computation_delay = true;  // true: the duty cycles act one period after they were computed
};

// The duty cycle below which a leg's upper transistor stays off, and its lower one on, for a whole period. Above 1 minus this duty
// cycle the upper one stays on and the lower one off. Each half of a PWM period must hold a dead time and a shortest pulse of its
// own, since a pulse that goes on into the next half may end there at once.
inline double least_duty(const InverterConfig& inverter, double period) {
    if (inverter.minimum_pulse <= 0.0) return 0.0;
    return (inverter.minimum_pulse + inverter.dead_time) / (inverter.pwm == Pwm::centre ? 0.5 * period : period);
}

inline double without_short_pulses(double duty, double least) {
    return duty < least ? 0.0 : (duty > 1.0 - least ? 1.0 : duty);
}

// Drop of a leg's voltage across the conducting device, V. A positive current flows out of the leg.
template <class Real>
[[gnu::always_inline]] inline Real dropped(const Real& device_drop, const Real& current) {
    return select(current >= Real(0.0), device_drop, -device_drop);
}

// Voltage in the stationary frame from the voltages of the legs.
template <class Real>
[[gnu::always_inline]] inline Voltage<Real> stationary(const Legs<star_legs, Real>& u) {
    return {(2.0 * u[0] - u[1] - u[2]) * (1.0 / 3.0), (u[1] - u[2]) * 0.57735026918962576};
}

template <class Real>
[[gnu::always_inline]] inline Voltage<Real> stationary(const Legs<bridge_legs, Real>& u) {
    return {u[0] - u[1], u[2] - u[3]};
}

// Duty cycles of the legs from those of the phases. Unipolar: the second leg of a bridge has the complement of the first, on
// the same carrier, so the mean voltage of a phase is bus_voltage (2 duty - 1), in two pulses per period.
template <std::size_t count, class Real>
[[gnu::always_inline]] inline decltype(auto) leg_duties(const InPhases<Real>& duty) {
    if constexpr (count == star_legs) {
        return (duty);
    } else {
        return Legs<count, Real>{duty[0], 1.0 - duty[0], duty[1], 1.0 - duty[1]};
    }
}

// The currents out of the legs.
template <std::size_t count, class Real>
[[gnu::always_inline]] inline decltype(auto) leg_currents(const InPhases<Real>& i) {
    if constexpr (count == star_legs) {
        return (i);
    } else {
        return Legs<count, Real>{i[0], -i[0], i[1], -i[1]};
    }
}

// The phases' values of a vector in the stationary frame.
template <std::size_t legs, class Real>
[[gnu::always_inline]] inline InPhases<Real> in_phases(const Real& alpha, const Real& beta) {
    if constexpr (legs == bridge_legs) return {alpha, beta, Real(0.0)};
    return {alpha, -0.5 * alpha + 0.86602540378443865 * beta, -0.5 * alpha - 0.86602540378443865 * beta};
}

// Phase currents from the currents in the rotor's frame. With three legs they are the line currents of the equivalent star.
template <std::size_t legs, class Real>
[[gnu::always_inline]] inline InPhases<Real> phase_currents(const Currents<Real>& i, const Complex<Real>& axis) {
    const Real alpha = axis.re * i.d - axis.im * i.q;
    const Real beta = axis.im * i.d + axis.re * i.q;
    return in_phases<legs>(alpha, beta);
}

// An interval of a period with constant voltage.
struct Stretch {
    double until;  // s from the start of the period
    Voltage<> u;
};

// The intervals of one period, in order.
template <std::size_t legs>
struct Pulses {
    std::array<Stretch, 2 * legs + 1> stretch;
    std::size_t count;
};

// The intervals of one period with these duty cycles. While both transistors of a leg are off, its current flows through a diode.
// A positive current, out of the leg, takes the lower diode, which delays the rising edge by the dead time; a negative current
// delays the falling edge. The sign is taken at the start of the period. last: the duty cycles of the period before.
template <std::size_t legs>
Pulses<legs> pulses(double bus_voltage, double dead_time, double device_drop, const Legs<legs>& duty, const Legs<legs>& last,
                    const Legs<legs>& current, const Carrier& carrier, double period) {
    const double rise_delay = carrier.rises ? dead_time : 0.0, fall_delay = carrier.falls ? dead_time : 0.0;
    Legs<legs> rise, fall, drop;
    std::array<double, 2 * legs> edge;  // s, sorted
#pragma GCC unroll 4
    for (std::size_t x = 0; x < legs; ++x) {
        rise[x] = 0.0;
        drop[x] = dropped(device_drop, current[x]);
        fall[x] = duty[x] >= 1.0 ? period : 0.0;
        if (duty[x] > 0.0 && duty[x] < 1.0) {  // otherwise no edge, no dead time
            const bool out = current[x] >= 0.0;
            const double begin = carrier.before * period * (1.0 - duty[x]);
            fall[x] = std::min(begin + period * duty[x] + (out ? 0.0 : fall_delay), period);
            rise[x] = std::min(begin + (out && !carrier.stays(last[x]) ? rise_delay : 0.0), fall[x]);
        }
        edge[x] = rise[x];
        edge[legs + x] = fall[x];
    }
    // sorts by exchanging neighbours, even and odd pairs in turn: no branch depends on the duty cycles
#pragma GCC unroll 8
    for (std::size_t round = 0; round < edge.size(); ++round) {
#pragma GCC unroll 4
        for (std::size_t n = round % 2; n + 1 < edge.size(); n += 2) {
            const double a = edge[n], b = edge[n + 1];
            edge[n] = std::min(a, b);
            edge[n + 1] = std::max(a, b);
        }
    }

    const Four rises = four_of(rise), falls = four_of(fall), drops = four_of(drop);
    Pulses<legs> result;
    result.count = 0;
    double from = 0.0;
    const auto hold = [&](double until) __attribute__((always_inline)) {
        if (!(until > from)) return;
        const Four u = select(rises > from, 0.0, select(falls > from, bus_voltage, 0.0)) - drops;
        result.stretch[result.count++] = {until, stationary(array_of<legs>(u))};
        from = until;
    };
#pragma GCC unroll 8
    for (const double until : edge) hold(until);
    hold(period);
    return result;
}

template <class Real>
[[gnu::always_inline]] inline Real least(const Real& a, const Real& b) {
    return select(a > b, b, a);
}

// The mean voltage over a period of the pulses that pulses() returns. dead_share: the dead time's share of the period.
template <std::size_t legs, class Real>
[[gnu::always_inline]] inline Voltage<Real> averaged(const Real& bus_voltage, const Real& dead_share, const Real& device_drop,
                                                     const Legs<legs, Real>& duty, const Legs<legs, Real>& last,
                                                     const Legs<legs, Real>& current, const Carrier& carrier) {
    const Real none(0.0), rise_share = carrier.rises ? dead_share : none, fall_share = carrier.falls ? dead_share : none;
    Legs<legs, Real> u;
    for (std::size_t x = 0; x < legs; ++x) {
        // a rising edge is delayed to the falling edge at most, a falling edge to the end of the period
        const Real stays = carrier.before <= 0.0 ? select(last[x] >= Real(1.0), none, rise_share) : rise_share;
        const Real later = least(fall_share, (1.0 - carrier.before) * (1.0 - duty[x]));
        const Real delayed = duty[x] + select(current[x] >= none, -least(stays, duty[x]), later);
        const Real share = select((duty[x] > none) & (Real(1.0) > duty[x]), delayed, duty[x]);
        u[x] = bus_voltage * share - dropped(device_drop, current[x]);
    }
    return stationary<Real>(u);
}

}  // namespace cogless
