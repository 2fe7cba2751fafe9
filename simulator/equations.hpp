// Motor, inertia, friction and load as one system of differential equations, integrated by fixed steps of order 4: RK4, or
// Nystrom's method (Hairer, Norsett, Wanner: Solving ordinary differential equations I, section II.14). Nystrom's differs
// in the angle only: both stages at the middle of a step have the same one, and share all that depends on it. Where that is
// cheap to compute, RK4 is faster, whose angles need not wait for the stage before.
//
// For one motor, or for several at once with a Real of as many lanes (wide.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

#include "angle_functions.hpp"
#include "load.hpp"
#include "pmsm.hpp"
#include "wide.hpp"

namespace cogless {

struct MechanicsConfig {
    double inertia;             // kg m^2
    double viscous_friction;    // N m s/rad
    double coulomb_friction;    // N m, while moving
    double breakaway_friction;  // N m, at standstill; not below coulomb_friction
};

// Voltage in the stationary frame, held during a step, V.
template <class Real = double>
struct Voltage {
    Real alpha, beta;
};

// Parts of the state that are integrated. mechanics: speed and angle, with given, constant currents; currents: these and the
// currents; energies: these and the energies.
enum class Detail { mechanics, currents, energies };

// Integrated powers since the start, J.
template <class Real = double>
struct Energy {
    Real electrical, copper, friction, load;
};

template <class Real = double>
struct PlantState {
    Currents<Real> i{};           // A
    Real omega_m{};               // rad/s
    Real theta_m{};               // rad, not wrapped
    LoadState<Real> load{};
    MaskOf<Real> stuck{};         // held by friction at standstill
    Real direction{};             // direction of sliding, 1 or -1; friction acts against it
    Energy<Real> energy{};        // integrated only with Detail::energies
};

template <class Real = double>
struct Torques {
    Real electromagnetic, cogging, load;  // N m

    Real driving() const { return electromagnetic + cogging - load; }  // on the rotor, without friction
};

template <class Real = double>
class Equations {
public:
    Equations(const PmsmConfig& motor, const MechanicsConfig& mechanics, const LoadConfig& load, double nominal_step)
        : angle_(motor, load), motor_(motor), inertia_(mechanics.inertia), per_inertia_(1.0 / mechanics.inertia),
          viscous_friction_(mechanics.viscous_friction), coulomb_friction_(mechanics.coulomb_friction),
          breakaway_friction_(mechanics.breakaway_friction), sticks_(mechanics.breakaway_friction > 0.0),
          plain_(!sticks_ && !motor_.saturates()),
          load_(load, nominal_step) {}

    // Those of several motors that are alike, one for each lane.
    explicit Equations(const Each<Equations<double>, Real>& of)
        requires is_wide<Real>
        : angle_(members(of, &Equations<double>::angle_)), motor_(members(of, &Equations<double>::motor_)),
          inertia_(each<Real>(of, &Equations<double>::inertia_)),
          per_inertia_(each<Real>(of, &Equations<double>::per_inertia_)),
          viscous_friction_(each<Real>(of, &Equations<double>::viscous_friction_)),
          coulomb_friction_(each<Real>(of, &Equations<double>::coulomb_friction_)),
          breakaway_friction_(each<Real>(of, &Equations<double>::breakaway_friction_)), sticks_(of[0]->sticks_), plain_(of[0]->plain_),
          load_(members(of, &Equations<double>::load_)) {}

    // Whether lanes can hold both.
    bool alike(const Equations& other) const {
        return angle_.alike(other.angle_) && motor_.alike(other.motor_) && sticks_ == other.sticks_ &&
               !load_.has_tables() && !other.load_.has_tables();
    }

    void warm(const Equations& of, const Warmth& by) {
        motor_.warm(of.motor_, by);
        angle_.scale(of.angle_, by.flux);
    }

    const AngleFunctions<Real>& angle() const { return angle_; }
    const Pmsm<Real>& motor() const { return motor_; }
    const Load<Real>& load() const { return load_; }
    bool sticks() const { return sticks_; }
    // Whether each step is one step(), without friction that sticks, of a motor that does not saturate.
    bool plain() const { return plain_; }
    Real breakaway_friction() const { return breakaway_friction_; }

    // here, in these and below: what depends on the angle, at x.theta_m.
    [[gnu::always_inline]] Torques<Real> torques(const PlantState<Real>& x, const AtAngle<Real>& here, double time) const {
        Linkage<Real> e = motor_.linkage(here.ripple, x.i);
        if constexpr (std::is_same_v<Real, double>) {
            if (motor_.saturates()) e = motor_.template linkage<true>(here.ripple, x.i);
        }
        return {motor_.torque(e, x.i), here.cogging,
                x.load.torque + part_of_angle_and_time(here, x.theta_m, time)};
    }

    // Magnetic, kinetic, and of cogging, J.
    Real stored_energy(const PlantState<Real>& x) const {
        return motor_.magnetic_energy(x.i) + 0.5 * inertia_ * x.omega_m * x.omega_m + angle_.cogging_energy(x.theta_m);
    }

    // What a step changes in a state, and what depends on the new angle.
    template <Detail detail>
    struct Step {
        // omega_m, then i_d, i_q and the energies if they are integrated
        using Vector = std::array<Real, detail == Detail::mechanics ? 1 : detail == Detail::currents ? 3 : 7>;

        Vector y;
        Real theta_m, load_torque;
        AtAngle<Real> here;

        [[gnu::always_inline]] void take(PlantState<Real>& x) const {
            x.omega_m = y[0];
            x.theta_m = theta_m;
            x.load.torque = load_torque;
            if constexpr (detail != Detail::mechanics) x.i = {y[1], y[2]};
            if constexpr (detail == Detail::energies) x.energy = {y[3], y[4], y[5], y[6]};
        }
    };

    // One step, within which the rotor neither stops nor breaks away. angle(theta) returns what depends on an angle,
    // angle.both() on two, and share_angles says whether it is dear: then by Nystrom's method. The voltage has no effect if
    // the currents are given. With lanes, h is the nominal step.
    template <Detail detail, bool saturated = false, class Angle>
    [[gnu::always_inline]] Step<detail> step(const PlantState<Real>& x, const AtAngle<Real>& here, Voltage<Real> u,
                                             double time, double h, Angle&& angle) const {
        const auto load = load_.later(x.load, h);
        // grouped for the shortest chain from one stage's state to the next
        const Real per_inertia = select(x.stuck, Real(0.0), per_inertia_);
        const Real coulomb = coulomb_friction_ * x.direction;
        const auto slope = [&](const Vector<detail>& y, Real theta_m, const AtAngle<Real>& there, Real load_constant,
                               double when) __attribute__((always_inline)) {
            const Currents<Real> i = detail == Detail::mechanics ? x.i : Currents<Real>{y[1], y[2]};
            const Real omega_m = y[0];
            const Linkage<Real> e = motor_.template linkage<saturated>(there.ripple, i);
            const Real load_torque = load_constant + part_of_angle_and_time(there, theta_m, when);
            const Real friction = viscous_friction_ * omega_m + coulomb;
            Vector<detail> d;
            d[0] = motor_.torque(e, i) * per_inertia + ((there.cogging - load_torque) - friction) * per_inertia;
            if constexpr (detail != Detail::mechanics) {
                const Real u_d = there.axis.re * u.alpha + there.axis.im * u.beta;
                const Real u_q = there.axis.re * u.beta - there.axis.im * u.alpha;
                const Currents<Real> di = motor_.template derivative<saturated>(e, i, u_d, u_q, omega_m);
                d[1] = di.d;
                d[2] = di.q;
                if constexpr (detail == Detail::energies) {
                    d[3] = motor_.power_factor() * (u_d * i.d + u_q * i.q);
                    d[4] = motor_.copper_loss(i);
                    d[5] = friction * omega_m;
                    d[6] = load_torque * omega_m;
                }
            }
            return d;
        };
        Vector<detail> start;
        start[0] = x.omega_m;
        if constexpr (detail != Detail::mechanics) {
            start[1] = x.i.d;
            start[2] = x.i.q;
        }
        if constexpr (detail == Detail::energies) {
            start[3] = x.energy.electrical;
            start[4] = x.energy.copper;
            start[5] = x.energy.friction;
            start[6] = x.energy.load;
        }
        const Vector<detail> k1 = slope(start, x.theta_m, here, x.load.torque, time);
        constexpr bool share = std::remove_cvref_t<Angle>::share_angles;
        const Real angle_2 = share ? x.theta_m + 0.5 * h * x.omega_m + 0.125 * h * h * k1[0] : x.theta_m + 0.5 * h * x.omega_m;
        const AtAngle<Real> at_2 = angle(angle_2);
        const Vector<detail> k2 = slope(plus(start, 0.5 * h, k1), angle_2, at_2, load.middle, time + 0.5 * h);
        const Real angle_3 = share ? angle_2 : angle_2 + 0.25 * h * h * k1[0];
        const AtAngle<Real> at_3 = share ? at_2 : angle(angle_3);
        const Vector<detail> k3 = slope(plus(start, 0.5 * h, k2), angle_3, at_3, load.middle, time + 0.5 * h);
        const Real angle_4 = x.theta_m + h * x.omega_m + 0.5 * h * h * (share ? k3[0] : k2[0]);

        const Real theta_m = x.theta_m + h * x.omega_m + h * h / 6.0 * (k1[0] + k2[0] + k3[0]);
        const auto [at_4, at_end] = angle.both(angle_4, theta_m);
        const Vector<detail> k4 = slope(plus(start, h, k3), angle_4, at_4, load.end, time + h);
        Vector<detail> y;
#pragma GCC unroll 8
        for (std::size_t n = 0; n < y.size(); ++n) {
            y[n] = (start[n] + h / 6.0 * (k1[n] + 2.0 * (k2[n] + k3[n]))) + h / 6.0 * k4[n];
        }
        return {y, theta_m, load.end, at_end};
    }

private:
    template <class>
    friend class Equations;

    template <Detail detail>
    using Vector = typename Step<detail>::Vector;

    template <std::size_t count>
    [[gnu::always_inline]] static std::array<Real, count> plus(std::array<Real, count> y, double h,
                                                               const std::array<Real, count>& slope) {
#pragma GCC unroll 8
        for (std::size_t n = 0; n < count; ++n) y[n] += h * slope[n];
        return y;
    }

    [[gnu::always_inline]] Real part_of_angle_and_time(const AtAngle<Real>& there, Real theta_m, double time) const {
        if constexpr (std::is_same_v<Real, double>) {
            if (load_.has_tables()) return there.load + load_.of_tables(theta_m, time);
        }
        return there.load;
    }

    AngleFunctions<Real> angle_;
    Pmsm<Real> motor_;
    Real inertia_, per_inertia_;  // a product costs less than a quotient
    Real viscous_friction_, coulomb_friction_, breakaway_friction_;
    bool sticks_, plain_;
    Load<Real> load_;
};

}  // namespace cogless
