// Compiled once for each type of lane_step.hpp, with COGLESS_LANES as the type and the type's instructions enabled.
#include "lane_step.hpp"

#include <cstring>

namespace cogless {

namespace {

using Real = COGLESS_LANES;

struct Exact {
    static constexpr bool share_angles = true;
    static constexpr bool brief = false;
    const AngleFunctions<Real>& angle;
    bool needed;

    [[gnu::always_inline]] AtAngle<Real> operator()(const Real& theta_m) const {
        return needed ? angle.at(theta_m) : AtAngle<Real>{};
    }
    [[gnu::always_inline]] std::array<AtAngle<Real>, 2> both(const Real& a, const Real& b) const {
        return {(*this)(a), (*this)(b)};
    }
};

// A state consists of Reals and masks of the same size, each with an entry of 8 bytes for each lane.
void copy_lane(std::size_t lane, const LaneStates<Real>& from, LaneStates<Real>& to) {
    static_assert(std::is_trivially_copyable_v<LaneStates<Real>> && sizeof(Real) == sizeof(Real::Mask));
    for (std::size_t at = 8 * lane; at < sizeof from; at += sizeof(Real)) {
        std::memcpy(reinterpret_cast<char*>(&to) + at, reinterpret_cast<const char*>(&from) + at, 8);
    }
}

template <Detail detail>
std::uint32_t step(const Equations<Real>& equations, LaneStates<Real>& s, const Voltage<Real>& u, double h) {
    const Exact exact{equations.angle(), detail != Detail::mechanics || equations.angle().ripples()};
    const auto next = equations.step<detail>(s.x, s.here, u, 0.0, h, exact);
    if (equations.sticks()) {
        // above zero if friction must change, as Plant::beyond()
        Real beyond = -s.x.direction * next.y[0];
        if (s.x.stuck.any()) {
            PlantState<Real> then = s.x;
            next.take(then);
            const Real torque = equations.torques(then, next.here, 0.0).driving();
            beyond = select(s.x.stuck, magnitude(torque) - equations.breakaway_friction(), beyond);
        }
        if (const auto stays = beyond > Real(0.0); stays.any()) {
            LaneStates<Real> then = s;
            next.take(then.x);
            then.here = next.here;
            const std::uint32_t stay = stays.packed();
            for (std::size_t lane = 0; lane < Real::lanes; ++lane) {
                if ((stay >> lane & 1U) != 0U) copy_lane(lane, s, then);
            }
            s = then;
            return stay;
        }
    }
    next.take(s.x);
    s.here = next.here;
    return 0;
}

template <std::size_t legs>
Voltage<Real> voltage(const LaneInverter<Real>& v, const Carrier& carrier) {
    return averaged<legs>(v.bus_voltage, v.dead_share, v.device_drop, leg_duties<legs>(v.duty), leg_duties<legs>(v.last),
                          leg_currents<legs>(v.current), carrier);
}

}  // namespace

void lane_currents(const LaneStates<Real>& s, LaneInverter<Real>& v, std::size_t legs) {
    v.current = legs == star_legs ? phase_currents<star_legs>(s.x.i, s.here.axis) : phase_currents<bridge_legs>(s.x.i, s.here.axis);
}

void lane_voltage(const LaneInverter<Real>& v, Voltage<Real>& u, const Carrier& carrier, std::size_t legs) {
    u = legs == star_legs ? voltage<star_legs>(v, carrier) : voltage<bridge_legs>(v, carrier);
}

std::uint32_t lane_step(const Equations<Real>& equations, LaneStates<Real>& s, const Voltage<Real>& u, double h,
                        Detail detail) {
    switch (detail) {
        case Detail::mechanics: return step<Detail::mechanics>(equations, s, u, h);
        case Detail::currents: return step<Detail::currents>(equations, s, u, h);
        case Detail::energies: return step<Detail::energies>(equations, s, u, h);
    }
    return 0;
}

}  // namespace cogless
