// An inverter whose transistors are all off, as when the controller has switched it off. Currents decay through the diodes against
// the bus voltage. Then none flows again unless the motor's induced voltage exceeds the bus voltage.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "inverter.hpp"
#include "pmsm.hpp"

namespace cogless {

// The diode that carries a leg's current: the lower one for a current out of the leg, the upper one for a current into it.
enum class Diode { none, lower, upper };

// The diodes that conduct, and the resulting voltages, for a short interval.
template <std::size_t legs>
struct OpenBridge {
    std::array<Diode, 3> diode{};  // diode of each phase; of an H-bridge, in its first leg, out of which a positive current flows
    Voltage<> u;                   // V, on the phases
};

inline Diode diode_of(double current) {
    constexpr double nothing = 1e-9;  // A, currents below this are rounding errors of zero
    return current > nothing ? Diode::lower : current < -nothing ? Diode::upper : Diode::none;
}

// Voltages induced by the magnets, in the stationary frame, V.
inline Voltage<> induced(const Pmsm<>& motor, const AtAngle<double>& here, double omega_m) {
    const Linkage<> e = motor.linkage(here.ripple, {0.0, 0.0});
    const Complex<double> axis = here.axis;
    const double omega_e = motor.pole_pairs() * omega_m;
    return {omega_e * (axis.re * e.d - axis.im * e.q), omega_e * (axis.im * e.d + axis.re * e.q)};
}

// Diodes and voltages of three legs. If no leg carries a current, each leg floats at the star point's voltage plus its induced voltage,
// unless two of these voltages differ by more than the bus voltage. If two legs carry a current, the third floats if its
// voltage is within the bus.
inline OpenBridge<star_legs> open_bridge(double bus, const Phases& i, Voltage<> e, OpenBridge<star_legs> at = {}) {
    const Phases in_phase{e.alpha, -0.5 * e.alpha + 0.86602540378443865 * e.beta,
                          -0.5 * e.alpha - 0.86602540378443865 * e.beta};
    for (std::size_t x = 0; x < 3; ++x) at.diode[x] = diode_of(i[x]);
    if (std::count(at.diode.begin(), at.diode.end(), Diode::none) == 3) {
        const auto high = std::max_element(in_phase.begin(), in_phase.end()) - in_phase.begin();
        const auto low = std::min_element(in_phase.begin(), in_phase.end()) - in_phase.begin();
        if (!(in_phase[high] - in_phase[low] > bus)) {
            at.u = e;
            return at;
        }
        at.diode[high] = Diode::upper;
        at.diode[low] = Diode::lower;
    }
    Legs<star_legs> u;
    double sum = 0.0;
    for (std::size_t x = 0; x < 3; ++x) sum += u[x] = at.diode[x] == Diode::upper ? bus : 0.0;
    for (std::size_t x = 0; x < 3; ++x) {
        if (at.diode[x] != Diode::none) continue;
        u[x] = 0.5 * sum + 1.5 * in_phase[x];
        if (u[x] > bus) at.diode[x] = Diode::upper;
        if (u[x] < 0.0) at.diode[x] = Diode::lower;
        u[x] = std::clamp(u[x], 0.0, bus);
    }
    at.u = stationary(u);
    return at;
}

// Diodes and voltages of two H-bridges; each depends on its own phase only.
inline OpenBridge<bridge_legs> open_bridge(double bus, const Phases& i, Voltage<> e, OpenBridge<bridge_legs> at = {}) {
    const std::array<double, 2> in_phase{e.alpha, e.beta};
    std::array<double, 2> u;
    for (std::size_t x = 0; x < 2; ++x) {
        at.diode[x] = diode_of(i[x]);
        if (at.diode[x] == Diode::none && std::abs(in_phase[x]) > bus) {
            at.diode[x] = in_phase[x] > 0.0 ? Diode::upper : Diode::lower;
        }
        u[x] = at.diode[x] == Diode::none ? in_phase[x] : at.diode[x] == Diode::upper ? bus : -bus;
    }
    at.u = {u[0], u[1]};
    return at;
}

// The phases' currents; those that the diodes block are set to zero.
template <std::size_t legs>
Phases let_through(const OpenBridge<legs>& bridge, Phases i) {
    constexpr std::size_t phases = legs == star_legs ? 3 : 2;
    std::size_t carry = 0, blocked = 0;
    for (std::size_t x = 0; x < phases; ++x) {
        if (diode_of(i[x]) == bridge.diode[x] && bridge.diode[x] != Diode::none) {
            ++carry;
        } else {
            i[x] = 0.0;
            blocked = x;
        }
    }
    if constexpr (legs == star_legs) {
        if (carry < 2) return {};
        if (carry == 2) {  // the current out of one leg enters the other
            const std::size_t y = (blocked + 1) % 3, z = (blocked + 2) % 3;
            i[y] = 0.5 * (i[y] - i[z]);
            i[z] = -i[y];
        }
    }
    return i;
}

// Currents in the rotor's frame, from the result of phase_currents().
template <std::size_t legs>
Currents<> rotor_frame(const Phases& i, Complex<double> axis) {
    const double alpha = i[0], beta = legs == bridge_legs ? i[1] : (i[1] - i[2]) * 0.57735026918962576;
    return {axis.re * alpha + axis.im * beta, axis.re * beta - axis.im * alpha};
}

}  // namespace cogless
