// A motor with its mechanics and its load, in steps. Coulomb friction holds the rotor at standstill until the other torques
// exceed the breakaway torque. The instants of stopping and of breaking away are found within the step, which keeps the order
// of the method.
#pragma once

#include <cmath>

#include "angle_patch.hpp"
#include "equations.hpp"
#include "instant.hpp"
#include "train_step.hpp"

namespace cogless {

class Plant {
    using Two = Wide<2, 1>;

public:
    Plant(const PmsmConfig& motor, const MechanicsConfig& mechanics, const LoadConfig& load, double nominal_step)
        : equations_(motor, mechanics, load, nominal_step),
          plain_(!equations_.sticks() && equations_.train() == nullptr && !equations_.motor().saturates()),
          two_angles_(Each<AngleFunctions<double>, Two>{&equations_.angle(), &equations_.angle()}) {}

    // Sets this plant's motor to that of the plant `of`, with resistance and magnets' flux times the factors of `by`.
    void warm(const Plant& of, const Warmth& by) {
        equations_.warm(of.equations_, by);
        two_angles_.scale(of.two_angles_, by.flux);
    }

    const Equations<>& equations() const { return equations_; }
    const Pmsm<>& motor() const { return equations_.motor(); }

    // Computes what depends on an angle, or on each of two at once. Returns zeros if step() needs none of it with this detail.
    template <Detail detail>
    class Exact {
    public:
        static constexpr bool share_angles = true;
        static constexpr bool brief = false;

        explicit Exact(const Plant& plant) : plant_(plant), needed_(detail != Detail::mechanics || plant.angle().ripples()) {}

        [[gnu::always_inline]] AtAngle<double> operator()(double theta_m) const {
            return needed_ ? plant_.angle().at(theta_m) : AtAngle<double>{};
        }
        [[gnu::always_inline]] std::array<AtAngle<double>, 2> both(double a, double b) const {
            if (!needed_) return {};
            Two theta_m;
            theta_m.set(0, a);
            theta_m.set(1, b);
            const AtAngle<Two> at = plant_.two_angles_.at(theta_m);
            return {of(at, 0), of(at, 1)};
        }

    private:
        [[gnu::always_inline]] static AtAngle<double> of(const AtAngle<Two>& at, std::size_t lane) {
            return {{at.axis.re[lane], at.axis.im[lane]}, {at.ripple.d[lane], at.ripple.q[lane]}, at.cogging[lane], at.load[lane]};
        }

        const Plant& plant_;
        bool needed_;
    };

    const AngleFunctions<double>& angle() const { return equations_.angle(); }

    PlantState<> start(double theta_m, double omega_m) const {
        PlantState<> x;
        x.theta_m = theta_m;
        x.omega_m = omega_m;
        x.load = equations_.load().start();
        const DriveTrain* train = equations_.train();
        x.stuck = (train != nullptr ? train->friction.sticks() : equations_.sticks()) && omega_m == 0.0;
        x.direction = omega_m < 0.0 ? -1.0 : 1.0;
        if (const LoadSide* side = equations_.load_side()) x.side = side->start(theta_m, omega_m);
        return x;
    }

    // Advances x by h from the given time. here: what depends on the angle of x; it advances too. angle: a function that returns
    // this for any angle. The voltage is constant; it has no effect if the currents are given.
    template <Detail detail, class Angle>
    [[gnu::always_inline]] void step(PlantState<>& x, AtAngle<double>& here, Voltage<> u, double time, double h,
                                     Angle&& angle) const {
        if (plain_) {
            const auto step = equations_.step<detail>(x, here, u, time, h, angle);
            step.take(x);
            here = step.here;
        } else if (equations_.train() != nullptr) {
            step_with_train<detail>(x, here, u, time, h, angle);
        } else {
            step_with_stops<detail>(x, here, u, time, h, angle);
        }
    }

private:
    // A step within which the rotor neither stops nor breaks away, of any motor.
    template <Detail detail, class Angle>
    [[gnu::always_inline]] Equations<>::Step<detail> whole(const PlantState<>& x, const AtAngle<double>& here, Voltage<> u,
                                                           double time, double h, Angle& angle) const {
        if (equations_.motor().saturates()) return saturated<detail>(x, here, u, time, h, angle);
        return equations_.step<detail>(x, here, u, time, h, angle);
    }
    // A function of its own, so that motors without saturation keep their registers.
    template <Detail detail, class Angle>
    [[gnu::noinline]] Equations<>::Step<detail> saturated(const PlantState<>& x, const AtAngle<double>& here, Voltage<> u,
                                                          double time, double h, Angle& angle) const {
        return equations_.step<detail, false, true>(x, here, u, time, h, angle);
    }

    template <Detail detail, class Angle>
    [[gnu::noinline]] void step_with_train(PlantState<>& x, AtAngle<double>& here, Voltage<> u, double time, double h,
                                           Angle& angle) const {
        TrainStep<detail, Angle>(equations_, u, angle).advance(x, here, time, h);
    }

    template <Detail detail, class Angle>
    void step_with_stops(PlantState<>& x, AtAngle<double>& here, Voltage<> u, double time, double h, Angle&& angle) const {
        constexpr int most_pieces = 16;  // limit for a rotor that stops and breaks away repeatedly within one step
        for (int piece = 0; h > 0.0; ++piece) {
            const auto step = whole<detail>(x, here, u, time, h, angle);
            const double at_end = equations_.sticks() ? beyond<detail>(x, step, time + h) : 0.0;
            if (piece == most_pieces || !(at_end > 0.0)) {
                step.take(x);
                here = step.here;
                return;
            }
            const double done = change_friction<detail>(x, here, u, time, h, at_end, angle);
            time += done;
            h -= done;
        }
    }

    // A value that is above zero once friction must change: the speed against the direction of sliding, or at standstill the torque
    // beyond the breakaway torque.
    double beyond(const PlantState<>& x, const AtAngle<double>& here, double time) const {
        return x.stuck ? std::abs(equations_.torques(x, here, time).driving()) - equations_.breakaway_friction()
                       : -x.direction * x.omega_m;
    }
    // beyond() after a step from x, with the friction of x.
    template <Detail detail>
    [[gnu::always_inline]] double beyond(const PlantState<>& x, const Equations<>::Step<detail>& step, double time) const {
        if (!x.stuck) return -x.direction * step.y[0];
        PlantState<> then = x;
        step.take(then);
        return beyond(then, step.here, time);
    }

    // Advances x to the instant at which friction changes, and changes it; returns the time that passed. at_end: beyond() at the
    // end of the step.
    template <Detail detail, class Angle>
    [[gnu::noinline]] double change_friction(PlantState<>& x, AtAngle<double>& here, Voltage<> u, double time, double h,
                                             double at_end, Angle& angle) const {
        const double at_start = beyond(x, here, time);
        // torque that grew at once, such as by a load without lag, breaks the rotor away at once
        const double done = x.stuck && !(at_start < 0.0)
                                ? 0.0
                                : instant(h, at_start, at_end, [&](double middle) {
                                      return beyond<detail>(x, whole<detail>(x, here, u, time, middle, angle),
                                                            time + middle);
                                  });
        if (done > 0.0) {
            const auto step = whole<detail>(x, here, u, time, done, angle);
            step.take(x);
            here = step.here;
        }
        if (!x.stuck) x.omega_m = 0.0;
        const double torque = equations_.torques(x, here, time + done).driving();
        x.stuck = !x.stuck && std::abs(torque) <= equations_.breakaway_friction();
        x.direction = torque < 0.0 ? -1.0 : 1.0;
        return done;
    }

    Equations<> equations_;
    bool plain_;  // true: equations_.step() is the whole step, without standstill friction, drive train and saturation
    AngleFunctions<Two> two_angles_;
};

// Steps that only some plants take. They do not depend on the laws' number type, so plant_steps.cpp compiles them once for both.
#define COGLESS_PLANT_STEPS(EXTERN, DETAIL, ...)                                                                               \
    EXTERN template void Plant::step_with_train<DETAIL, __VA_ARGS__>(PlantState<>&, AtAngle<double>&, Voltage<>, double, double, \
                                                                     __VA_ARGS__&) const;                                      \
    EXTERN template Equations<>::Step<DETAIL> Plant::saturated<DETAIL, __VA_ARGS__>(                                           \
        const PlantState<>&, const AtAngle<double>&, Voltage<>, double, double, __VA_ARGS__&) const;                           \
    EXTERN template double Plant::change_friction<DETAIL, __VA_ARGS__>(PlantState<>&, AtAngle<double>&, Voltage<>, double,     \
                                                                       double, double, __VA_ARGS__&) const;
#define COGLESS_ALL_PLANT_STEPS(EXTERN)                                                                  \
    COGLESS_PLANT_STEPS(EXTERN, Detail::mechanics, const Plant::Exact<Detail::mechanics>)                \
    COGLESS_PLANT_STEPS(EXTERN, Detail::currents, const Plant::Exact<Detail::currents>)                  \
    COGLESS_PLANT_STEPS(EXTERN, Detail::energies, const Plant::Exact<Detail::energies>)

#ifndef COGLESS_PLANT_STEPS_HERE
COGLESS_ALL_PLANT_STEPS(extern)
#endif

}  // namespace cogless
