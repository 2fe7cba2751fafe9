// A step of a plant with a drive train (drive_train.hpp), in pieces between the instants at which a side stops or breaks away, or
// the gap's sides meet or part.
#pragma once

#include <array>
#include <cmath>

#include "equations.hpp"
#include "instant.hpp"

namespace cogless {

template <Detail detail, class Angle>
class TrainStep {
    using Step = typename Equations<>::template Step<detail, true>;
    enum Change { motor, load, contact, changes };

public:
    TrainStep(const Equations<>& equations, Voltage<> u, Angle& angle) : equations_(equations), u_(u), angle_(angle) {}

    void advance(PlantState<>& x, AtAngle<double>& here, double time, double h) const {
        constexpr int most_pieces = 32;  // limit for friction and contact that change repeatedly within one step
        for (int piece = 0; h > 0.0; ++piece) {
            const Step step = over(x, here, time, h);
            const First first = piece == most_pieces ? First{changes, h} : first_change(x, here, step, time, h);
            if (first.change == changes) {
                take(step, x, here);
                return;
            }
            if (first.at > 0.0) take(over(x, here, time, first.at), x, here);
            time += first.at;
            h -= first.at;
            change(x, here, time, first.change);
        }
    }

private:
    struct First {
        Change change;  // `changes`: none
        double at;      // s, from the step's start
    };

    Step over(const PlantState<>& x, const AtAngle<double>& here, double time, double h) const {
        if (equations_.motor().saturates()) return equations_.step<detail, true, true>(x, here, u_, time, h, angle_);
        return equations_.step<detail, true>(x, here, u_, time, h, angle_);
    }

    static void take(const Step& step, PlantState<>& x, AtAngle<double>& here) {
        step.take(x);
        here = step.here;
    }

    First first_change(const PlantState<>& x, const AtAngle<double>& here, const Step& step, double time, double h) const {
        First first{changes, h};
        const Beyond at_end = beyond(x, step, time + h);
        if (!(at_end[motor] > 0.0 || at_end[load] > 0.0 || at_end[contact] > 0.0)) return first;
        const Beyond at_start = beyond(x, here, time);
        for (int n = 0; n < changes; ++n) {
            const auto k = static_cast<std::size_t>(n);
            if (!(at_end[k] > 0.0)) continue;
            // a torque that jumped breaks a stuck side away at once
            const bool stuck = (n == motor && x.stuck) || (n == load && x.side.stuck);
            const double at = stuck && !(at_start[k] < 0.0)
                                  ? 0.0
                                  : instant(h, at_start[k], at_end[k], [&](double middle) {
                                        return beyond(x, over(x, here, time, middle), time + middle)[k];
                                    });
            if (first.change == changes || at < first.at) first = {static_cast<Change>(n), at};
        }
        return first;
    }

    // A value for each Change, above zero once that friction or contact must change.
    using Beyond = std::array<double, changes>;
    Beyond beyond(const PlantState<>& x, const AtAngle<double>& here, double time) const {
        const Torques<> torques = equations_.torques(x, here, time);
        Beyond found{-1.0, -1.0, -1.0};
        const auto of_friction = [](const Friction& f, bool stuck, double torque, double theta, double sliding) {
            return !f.sticks() ? -1.0 : stuck ? std::abs(torque) - f.holding(theta) : -sliding;
        };
        found[motor] = of_friction(equations_.train()->friction, x.stuck, torques.driving(), x.theta_m, x.direction * x.omega_m);
        if (const LoadSide* side = equations_.load_side()) {
            found[load] = of_friction(side->friction(), x.side.stuck, torques.driving_load(), x.side.theta,
                                      x.side.direction * x.side.omega);
            found[contact] = side->beyond(x.side, x.theta_m, x.omega_m);
        }
        return found;
    }
    // beyond() after a step from x, with the friction and contact of x.
    Beyond beyond(const PlantState<>& x, const Step& step, double time) const {
        PlantState<> then = x;
        step.take(then);
        return beyond(then, step.here, time);
    }

    void change(PlantState<>& x, const AtAngle<double>& here, double time, Change what) const {
        if (what == contact) {
            equations_.load_side()->change_contact(x.side, x.theta_m);
            return;
        }
        const bool of_motor = what == motor;
        const Friction& friction = of_motor ? equations_.train()->friction : equations_.load_side()->friction();
        bool& stuck = of_motor ? x.stuck : x.side.stuck;
        if (!stuck) (of_motor ? x.omega_m : x.side.omega) = 0.0;
        const Torques<> torques = equations_.torques(x, here, time);
        const double torque = of_motor ? torques.driving() : torques.driving_load();
        stuck = !stuck && std::abs(torque) <= friction.holding(of_motor ? x.theta_m : x.side.theta);
        (of_motor ? x.direction : x.side.direction) = torque < 0.0 ? -1.0 : 1.0;
    }

    const Equations<>& equations_;
    Voltage<> u_;
    Angle& angle_;
};

}  // namespace cogless
