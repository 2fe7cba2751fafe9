// Compiled once for each type of lane_step.hpp, with COGLESS_LANES as the type and the type's instructions enabled.
#include "lane_step.hpp"

#include <cstring>
#include <utility>

#include "current_converter.hpp"
#include "random.hpp"

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

typedef std::uint64_t Words __attribute__((vector_size(sizeof(Real::Register))));
constexpr std::size_t width = sizeof(Words) / sizeof(std::uint64_t);

// Numbers below 2^53, each exactly: first the upper half times 2^32, then the lower half.
[[gnu::always_inline]] inline Real::Register as_doubles(Words n) {
    const auto upper = reinterpret_cast<Real::Register>((n >> 32U) | 0x4530000000000000U);  // 2^84 + 2^32 times the upper half
    const auto lower = reinterpret_cast<Real::Register>((n & 0xffffffffU) | 0x4330000000000000U);  // 2^52 + the lower half
    return (upper - 0x1.00000001p84) + lower;
}

// Numbers of a table, at these places.
template <std::size_t... lane>
[[gnu::always_inline]] inline Real::Register looked_up(const double* table, const std::uint64_t* place, std::index_sequence<lane...>) {
    return Real::Register{table[place[lane]]...};
}

// Draws of the normal distribution, as Normal::draw(), for these lanes. The other lanes' generators stay as they are.
[[gnu::always_inline]] inline Real draws(LaneSensors<Real>& sensors, const Real::Mask& of) {
    Real x, next_edge;
    std::uint64_t layer[Real::lanes];
    for (std::size_t r = 0; r < Real::lanes / width; ++r) {
        Words& random = *reinterpret_cast<Words*>(sensors.random + r * width);
        Words next = random;
        const Words all = next_bits(next), in = all % Normal::layers;
        random = of.bits[r] ? next : random;
        std::memcpy(layer + r * width, &in, sizeof in);
        constexpr auto each = std::make_index_sequence<width>();
        const Real::Register edge = looked_up(sensors.edges, layer + r * width, each);
        next_edge.part[r] = looked_up(sensors.edges + 1, layer + r * width, each);
        x.part[r] = Normal::x_of(as_doubles(all >> 11U), edge);
    }
    if (const auto beyond = of & (magnitude(x) >= next_edge); beyond.any()) {
        for (std::size_t lane = 0; lane < Real::lanes; ++lane) {
            if (beyond[lane]) x.set(lane, draw_at_edge(sensors.random[lane], layer[lane], x[lane]));
        }
    }
    return x;
}

template <std::size_t legs>
Voltage<Real> voltage(const LaneInverter<Real>& v, const Carrier& carrier) {
    return averaged<legs>(v.bus_voltage, v.dead_share, v.device_drop, leg_duties<legs>(v.duty), leg_duties<legs>(v.last),
                          leg_currents<legs>(v.current), carrier);
}

}  // namespace

void lane_currents(const LaneStates<Real>& s, LaneInverter<Real>& v, LaneSensors<Real>& sensors, std::size_t legs) {
    const Real zero = 0.0;
    v.current = legs == star_legs ? phase_currents<star_legs>(s.x.i, s.here.axis) : phase_currents<bridge_legs>(s.x.i, s.here.axis);
    const auto noisy = sensors.noise > zero, converts = sensors.converts > zero, two = sensors.two > zero;
    for (std::size_t n = 0; n < 3; ++n) {
        Real i = with_gain(v.current[n], sensors.gain_error[n], sensors.offset[n]);
        if (sensors.noisy) {
            const Real x = select(n == 2 ? two : Real::Mask{}, zero, draws(sensors, n == 2 ? noisy & !two : noisy));
            i = select(noisy, i + sensors.noise * x, i);
        }
        sensors.measured[n] = select(converts, converted(i, sensors.lowest, sensors.highest, sensors.step, sensors.per_step), i);
    }
    sensors.measured[2] = select(two, -sensors.measured[0] - sensors.measured[1], sensors.measured[2]);
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
