// Motor, inertia, friction and load as one system of differential equations, integrated by fixed steps of order 4: RK4, or
// Nystrom's method (Hairer, Norsett, Wanner: Solving ordinary differential equations I, section II.14). Nystrom's differs
// in the angle only: both stages at the middle of a step have one angle, so what depends on the angle is computed once. Where that
// is cheap to compute, RK4 is faster, because its angles need not wait for the stage before. A brief step, at most a quarter of the
// nominal one, is taken by Kutta's method of order 3, which has one stage less.
//
// Real is double for one motor, or a Wide for one motor in each lane (wide.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <type_traits>

#include "angle_functions.hpp"
#include "drive_train.hpp"
#include "load.hpp"
#include "pmsm.hpp"
#include "wide.hpp"

namespace cogless {

// Voltage in the stationary frame, held during a step, V.
template <class Real = double>
struct Voltage {
    Real alpha, beta;
};

// Parts of the state that are integrated. mechanics: speed and angle, while the currents are given and constant; currents: also
// the currents; energies: also the energies.
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
    struct None {};
    [[no_unique_address]] std::conditional_t<is_wide<Real>, None, LoadSideState> side{};  // used if there is a load side
};

template <class Real = double>
struct Torques {
    Real electromagnetic, cogging, load;  // N m
    Real opposing;                        // N m, against the rotor: of the load, or of the shaft to a load side
    Real shaft = 0.0;                     // N m, of a soft shaft on the load side

    Real driving() const { return electromagnetic + cogging - opposing; }  // on the rotor, without friction
    Real driving_load() const { return shaft - load; }                     // on the load side, without friction
};

template <class Real = double>
class Equations {
public:
    Equations(const PmsmConfig& motor, const MechanicsConfig& mechanics, const LoadConfig& load, double nominal_step)
        : angle_(motor, on_the_rotor(mechanics, load)), motor_(motor), inertia_(mechanics.inertia),
          per_inertia_(1.0 / mechanics.inertia), viscous_friction_(mechanics.friction.viscous),
          coulomb_friction_(mechanics.friction.coulomb), breakaway_friction_(mechanics.friction.breakaway),
          sticks_(mechanics.friction.breakaway > 0.0), load_(load, nominal_step), train_(DriveTrain::of(mechanics, load)) {}

    // The equations of several motors that are alike, with one motor's numbers in each lane.
    explicit Equations(const Each<Equations<double>, Real>& of)
        requires is_wide<Real>
        : angle_(members(of, &Equations<double>::angle_)), motor_(members(of, &Equations<double>::motor_)),
          inertia_(each<Real>(of, &Equations<double>::inertia_)),
          per_inertia_(each<Real>(of, &Equations<double>::per_inertia_)),
          viscous_friction_(each<Real>(of, &Equations<double>::viscous_friction_)),
          coulomb_friction_(each<Real>(of, &Equations<double>::coulomb_friction_)),
          breakaway_friction_(each<Real>(of, &Equations<double>::breakaway_friction_)), sticks_(of[0]->sticks_),
          load_(members(of, &Equations<double>::load_)) {}

    // Whether this and `other` can be lanes of one object.
    bool alike(const Equations& other) const {
        return angle_.alike(other.angle_) && motor_.alike(other.motor_) && sticks_ == other.sticks_ &&
               !load_.has_tables() && !other.load_.has_tables() && !train_ && !other.train_;
    }

    void warm(const Equations& of, const Warmth& by) {
        motor_.warm(of.motor_, by);
        angle_.scale(of.angle_, by.flux);
    }

    const AngleFunctions<Real>& angle() const { return angle_; }
    const Pmsm<Real>& motor() const { return motor_; }
    const Load<Real>& load() const { return load_; }
    bool sticks() const { return sticks_; }
    Real breakaway_friction() const { return breakaway_friction_; }
    // What the mechanics have beyond one mass with Coulomb friction, or null.
    const DriveTrain* train() const { return train_ ? &*train_ : nullptr; }
    const LoadSide* load_side() const { return train_ && train_->load_side ? &*train_->load_side : nullptr; }

    // `here`, in this function and in step(): what depends on the angle, at x.theta_m.
    [[gnu::always_inline]] Torques<Real> torques(const PlantState<Real>& x, const AtAngle<Real>& here, double time) const {
        Linkage<Real> linkage = motor_.linkage(here.ripple, x.i);
        if constexpr (std::is_same_v<Real, double>) {
            if (motor_.saturates()) linkage = motor_.template linkage<true>(here.ripple, x.i);
        }
        const Real e = motor_.torque(linkage, x.i);
        if constexpr (std::is_same_v<Real, double>) {
            if (const LoadSide* side = load_side()) {
                const LoadSide::Shaft shaft = side->shaft(x.side.contact, x.theta_m, x.omega_m, x.side.theta, x.side.omega);
                return {e, here.cogging, x.load.torque + part_of_load_side(x.side.theta, time), shaft.on_motor, shaft.torque};
            }
        }
        const Real load = x.load.torque + part_of_angle_and_time(here, x.theta_m, time);
        return {e, here.cogging, load, load};
    }

    // Sum of the magnetic, kinetic and cogging energy and of the energy in a shaft's twist, J.
    Real stored_energy(const PlantState<Real>& x) const {
        const Real of_motor = motor_.magnetic_energy(x.i) + 0.5 * inertia_ * x.omega_m * x.omega_m + angle_.cogging_energy(x.theta_m);
        if constexpr (std::is_same_v<Real, double>) {
            if (const LoadSide* side = load_side()) {
                return of_motor + side->kinetic_energy(x.side) + side->twist_energy(x.side, x.theta_m);
            }
        }
        return of_motor;
    }

    // A step's result: the changed members of the state, and what depends on the new angle. with_train: as well for what train()
    // describes.
    template <Detail detail, bool with_train = false>
    struct Step {
        // omega_m, then i_d, i_q and the energies if they are integrated, then the load side's speed
        static constexpr std::size_t of_motor = detail == Detail::mechanics ? 1 : detail == Detail::currents ? 3 : 7;
        using Vector = std::array<Real, of_motor + (with_train ? 1 : 0)>;
        struct None {};
        struct Side {
            Real theta, wound;
        };

        Vector y;
        Real theta_m, load_torque;
        AtAngle<Real> here;
        [[no_unique_address]] std::conditional_t<with_train, Side, None> side{};

        [[gnu::always_inline]] void take(PlantState<Real>& x) const {
            x.omega_m = y[0];
            x.theta_m = theta_m;
            x.load.torque = load_torque;
            if constexpr (detail != Detail::mechanics) x.i = {y[1], y[2]};
            if constexpr (detail == Detail::energies) x.energy = {y[3], y[4], y[5], y[6]};
            if constexpr (with_train) {
                x.side.omega = y[of_motor];
                x.side.theta = side.theta;
                x.side.wound = side.wound;
            }
        }
    };

    // One step, within which nothing stops or breaks away and no contact changes. angle(theta) returns what depends on an angle, and
    // angle.both() what depends on each of two. If Angle::share_angles, that is expensive and the step takes Nystrom's method; if
    // Angle::brief, it takes Kutta's. The voltage has no effect if the currents are given. With lanes, h is the nominal step.
    template <Detail detail, bool with_train = false, bool saturated = false, class Angle>
    [[gnu::always_inline]] Step<detail, with_train> step(const PlantState<Real>& x, const AtAngle<Real>& here, Voltage<Real> u,
                                                         double time, double h, Angle&& angle) const {
        using Made = Step<detail, with_train>;
        using Vector = typename Made::Vector;
        const auto load = load_.later(x.load, h);
        // factors are grouped for the shortest chain of operations from one stage's state to the next
        const Real per_inertia = select(x.stuck, Real(0.0), per_inertia_);
        const Real coulomb = coulomb_friction_ * x.direction;
        const auto slope = [&](const Vector& y, Real theta_m, const AtAngle<Real>& there, Real load_constant, double when,
                               Real theta_load) __attribute__((always_inline)) {
            const Currents<Real> i = detail == Detail::mechanics ? x.i : Currents<Real>{y[1], y[2]};
            const Real omega_m = y[0];
            const Linkage<Real> e = motor_.template linkage<saturated>(there.ripple, i);
            Real load_torque, opposing, friction, lost, taken;
            Vector d;
            if constexpr (with_train) {
                friction = train_->friction.sliding(omega_m, theta_m, x.direction);
                lost = friction * omega_m;
                if (const LoadSide* side = load_side()) {
                    const double omega = y[Made::of_motor];
                    const LoadSide::Shaft shaft = side->shaft(x.side.contact, theta_m, omega_m, theta_load, omega);
                    const double beyond = side->friction().sliding(omega, theta_load, x.side.direction);
                    load_torque = load_constant + part_of_load_side(theta_load, when);
                    opposing = shaft.on_motor;
                    lost += beyond * omega + shaft.loss;
                    taken = load_torque * omega;
                    d[Made::of_motor] = x.side.stuck ? 0.0 : (shaft.torque - load_torque - beyond) * side->per_inertia();
                } else {
                    opposing = load_constant + part_of_angle_and_time(there, theta_m, when);
                    taken = opposing * omega_m;
                    d[Made::of_motor] = 0.0;
                }
            } else {
                opposing = load_constant + part_of_angle_and_time(there, theta_m, when);
                friction = viscous_friction_ * omega_m + coulomb;
                lost = friction * omega_m;
                taken = opposing * omega_m;
            }
            d[0] = motor_.torque(e, i) * per_inertia + ((there.cogging - opposing) - friction) * per_inertia;
            if constexpr (detail != Detail::mechanics) {
                const Real u_d = there.axis.re * u.alpha + there.axis.im * u.beta;
                const Real u_q = there.axis.re * u.beta - there.axis.im * u.alpha;
                const Currents<Real> di = motor_.template derivative<saturated>(e, i, u_d, u_q, omega_m);
                d[1] = di.d;
                d[2] = di.q;
                if constexpr (detail == Detail::energies) {
                    d[3] = motor_.power_factor() * (u_d * i.d + u_q * i.q);
                    d[4] = motor_.copper_loss(i);
                    d[5] = lost;
                    d[6] = taken;
                }
            }
            return d;
        };
        Vector start;
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
        Real load_1{};
        if constexpr (with_train) {
            start[Made::of_motor] = x.side.omega;
            load_1 = x.side.theta;
        }
        constexpr bool share = std::remove_cvref_t<Angle>::share_angles;
        // the angles of the stages and of the step's end, from the accelerations of the stages before
        const auto second = [h](Real theta, Real omega, Real k1) __attribute__((always_inline)) {
            return share ? theta + 0.5 * h * omega + 0.125 * h * h * k1 : theta + 0.5 * h * omega;
        };
        const auto third = [h](Real theta_2, Real k1) __attribute__((always_inline)) {
            return share ? theta_2 : theta_2 + 0.25 * h * h * k1;
        };
        const auto fourth = [h](Real theta, Real omega, Real k2, Real k3) __attribute__((always_inline)) {
            return theta + h * omega + 0.5 * h * h * (share ? k3 : k2);
        };
        const auto last = [h](Real theta, Real omega, Real k1, Real k2, Real k3) __attribute__((always_inline)) {
            return theta + h * omega + h * h / 6.0 * (k1 + k2 + k3);
        };
        // one of these functions for the load side's angle; zero without a drive train
        const auto of_load = [&](const auto& f) __attribute__((always_inline)) {
            if constexpr (with_train) return f(load_1, x.side.omega, Made::of_motor);
            return Real{};
        };
        const Vector k1 = slope(start, x.theta_m, here, x.load.torque, time, load_1);
        const Real angle_2 = second(x.theta_m, x.omega_m, k1[0]);
        const Real load_2 = of_load([&](Real theta, Real omega, std::size_t n) { return second(theta, omega, k1[n]); });
        const AtAngle<Real> at_2 = angle(angle_2);
        const Vector k2 = slope(plus(start, 0.5 * h, k1), angle_2, at_2, load.middle, time + 0.5 * h, load_2);
        const auto wind = [&](Made& made, const auto& end) __attribute__((always_inline)) {
            if constexpr (with_train) {
                made.side.theta = of_load(end);
                if (const LoadSide* side = load_side()) {
                    made.side.wound = side->unwound(x.side, h);
                    if constexpr (detail == Detail::energies) {  // what the shaft loses while it unwinds within the gap
                        made.y[5] += side->wound_energy(x.side.wound) - side->wound_energy(made.side.wound);
                    }
                }
            }
        };
        if constexpr (std::remove_cvref_t<Angle>::brief) {
            const auto stage = [h](Real theta, Real omega, Real k1) __attribute__((always_inline)) {
                return theta + h * omega + h * h * k1;
            };
            const auto end = [h](Real theta, Real omega, Real k1, Real k2) __attribute__((always_inline)) {
                return theta + h * omega + h * h / 6.0 * (k1 + 2.0 * k2);
            };
            const Real angle_3 = stage(x.theta_m, x.omega_m, k1[0]), theta_m = end(x.theta_m, x.omega_m, k1[0], k2[0]);
            const Real load_3 = of_load([&](Real theta, Real omega, std::size_t n) { return stage(theta, omega, k1[n]); });
            const auto [at_3, at_end] = angle.both(angle_3, theta_m);
            const Vector k3 = slope(plus(plus(start, -h, k1), 2.0 * h, k2), angle_3, at_3, load.end, time + h, load_3);
            Vector y;
#pragma GCC unroll 8
            for (std::size_t n = 0; n < y.size(); ++n) y[n] = (start[n] + h / 6.0 * (k1[n] + 4.0 * k2[n])) + h / 6.0 * k3[n];
            Made made{y, theta_m, load.end, at_end};
            wind(made, [&](Real theta, Real omega, std::size_t n) { return end(theta, omega, k1[n], k2[n]); });
            return made;
        }
        const Real angle_3 = third(angle_2, k1[0]);
        const Real load_3 = of_load([&](Real, Real, std::size_t n) { return third(load_2, k1[n]); });
        const AtAngle<Real> at_3 = share ? at_2 : angle(angle_3);
        const Vector k3 = slope(plus(start, 0.5 * h, k2), angle_3, at_3, load.middle, time + 0.5 * h, load_3);
        const Real angle_4 = fourth(x.theta_m, x.omega_m, k2[0], k3[0]);
        const Real load_4 = of_load([&](Real theta, Real omega, std::size_t n) { return fourth(theta, omega, k2[n], k3[n]); });

        const Real theta_m = last(x.theta_m, x.omega_m, k1[0], k2[0], k3[0]);
        const auto [at_4, at_end] = angle.both(angle_4, theta_m);
        const Vector k4 = slope(plus(start, h, k3), angle_4, at_4, load.end, time + h, load_4);
        Vector y;
#pragma GCC unroll 8
        for (std::size_t n = 0; n < y.size(); ++n) {
            y[n] = (start[n] + h / 6.0 * (k1[n] + 2.0 * (k2[n] + k3[n]))) + h / 6.0 * k4[n];
        }
        Made made{y, theta_m, load.end, at_end};
        wind(made, [&](Real theta, Real omega, std::size_t n) { return last(theta, omega, k1[n], k2[n], k3[n]); });
        return made;
    }

private:
    template <class>
    friend class Equations;

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

    // The load's harmonics and tables, at the angle of a load side.
    double part_of_load_side(double theta, double time) const {
        return train_->load_side->of_angle(theta) + (load_.has_tables() ? load_.of_tables(theta, time) : 0.0);
    }

    // The load whose harmonics depend on the rotor's angle: with a load side they depend on that side's, so there are none.
    static LoadConfig on_the_rotor(const MechanicsConfig& mechanics, LoadConfig load) {
        if (mechanics.load_side) load.harmonics.clear();
        return load;
    }

    AngleFunctions<Real> angle_;
    Pmsm<Real> motor_;
    Real inertia_, per_inertia_;  // a product costs less than a quotient
    Real viscous_friction_, coulomb_friction_, breakaway_friction_;
    bool sticks_;
    Load<Real> load_;
    std::optional<DriveTrain> train_{};
};

}  // namespace cogless
