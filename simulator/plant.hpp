// Motor, inertia, friction and load as one system of differential equations, integrated by fixed-step RK4.
//
// Coulomb friction holds the rotor at standstill until the other torques exceed the breakaway torque. The instants of
// stopping and of breaking away are found within the step, which keeps the order of the method.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "load.hpp"
#include "pmsm.hpp"

namespace cogless {

struct MechanicsConfig {
    double inertia;             // kg m^2
    double viscous_friction;    // N m s/rad
    double coulomb_friction;    // N m, while moving
    double breakaway_friction;  // N m, at standstill; not below coulomb_friction
};

// Voltage in the stationary frame, held during a step, V.
struct Voltage {
    double alpha, beta;
};

// Parts of the state that are integrated. mechanics: speed and angle, with given, constant currents; currents: these and the
// currents; energies: these and the energies.
enum class Detail { mechanics, currents, energies };

// Integrated powers since the start, J.
struct Energy {
    double electrical = 0.0, copper = 0.0, friction = 0.0, load = 0.0;
};

struct PlantState {
    Currents i{0.0, 0.0};       // A
    double omega_m = 0.0;       // rad/s
    double theta_m = 0.0;       // rad, not wrapped
    LoadState load{0.0, 0.0};
    bool stuck = false;         // held by friction at standstill
    double direction = 0.0;     // direction of sliding, 1 or -1; friction acts against it
    Energy energy;              // integrated only with Detail::energies
};

struct Torques {
    double electromagnetic, cogging, load;  // N m
};

class Plant {
public:
    Plant(const PmsmConfig& motor, const MechanicsConfig& mechanics, const LoadConfig& load, double nominal_step)
        : powers_(all_orders(motor, load)), motor_(motor, powers_), mechanics_(mechanics),
          per_inertia_(1.0 / mechanics.inertia), load_(load, powers_, nominal_step),
          ripples_(!motor.flux_harmonics.empty() || !motor.cogging.empty() || !load.harmonics.empty()) {}

    const Pmsm& motor() const { return motor_; }

    // The powers of e^{j theta} at an angle that this detail needs, for a caller of step().
    template <Detail detail>
    void evaluate(double theta_m, Powers::Values& z) const {
        if (detail != Detail::mechanics || ripples_) powers_.evaluate(theta_m, z);
    }

    PlantState start(double theta_m, double omega_m) const {
        PlantState x;
        x.theta_m = theta_m;
        x.omega_m = omega_m;
        x.load = load_.start();
        x.stuck = sticks() && omega_m == 0.0;
        x.direction = omega_m < 0.0 ? -1.0 : 1.0;
        return x;
    }

    // z here and below: the result of evaluate() at x.theta_m.
    Torques torques(const PlantState& x, const Powers::Values& z, double time) const {
        return {motor_.torque(motor_.linkage(z, x.i), x.i), motor_.cogging(z),
                x.load.torque + load_.other_parts(z, x.theta_m, time)};
    }

    double stored_energy(const PlantState& x, const Powers::Values& z) const {
        return motor_.magnetic_energy(x.i) + 0.5 * mechanics_.inertia * x.omega_m * x.omega_m +
               motor_.cogging_energy(z);
    }

    // Advances x and z by h from the given time. The voltage is constant; it has no effect if the currents are given.
    template <Detail detail>
    void step(PlantState& x, Powers::Values& z, Voltage u, double time, double h) const {
        constexpr int most_pieces = 16;  // limit for a rotor that stops and breaks away repeatedly within one step
        for (int piece = 0; sticks() && piece < most_pieces && h > 0.0; ++piece) {
            const double done = x.stuck ? stuck_piece<detail>(x, z, u, time, h)
                                        : sliding_piece<detail>(x, z, u, time, h);
            evaluate<detail>(x.theta_m, z);
            time += done;
            h -= done;
        }
        if (h > 0.0) {
            smooth_step<detail>(x, z, u, time, h);
            evaluate<detail>(x.theta_m, z);
        }
    }

private:
    static std::vector<int> all_orders(const PmsmConfig& motor, const LoadConfig& load) {
        std::vector<int> all = Pmsm::orders(motor);
        for (const int order : Load::orders(load)) all.push_back(order);
        return all;
    }

    bool sticks() const { return mechanics_.breakaway_friction > 0.0; }

    // omega_m and theta_m, then i_d, i_q and the energies if they are integrated.
    template <Detail detail>
    using Vector = std::array<double, detail == Detail::mechanics ? 2 : detail == Detail::currents ? 4 : 8>;

    // The state after one RK4 step within which the rotor neither stops nor breaks away.
    template <Detail detail>
    Vector<detail> integrated(const PlantState& x, const Powers::Values& z, Voltage u, double time,
                                   double h) const {
        using Vector = Plant::Vector<detail>;
        static constexpr double reach[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
        const double load_middle = load_.constant_part(x.load, 0.5 * h);
        const double load[] = {x.load.torque, load_middle, load_middle, load_.constant_part(x.load, h)};
        Vector start{x.omega_m, x.theta_m};
        if constexpr (detail != Detail::mechanics) {
            start[2] = x.i.d;
            start[3] = x.i.q;
        }
        if constexpr (detail == Detail::energies) {
            start[4] = x.energy.electrical;
            start[5] = x.energy.copper;
            start[6] = x.energy.friction;
            start[7] = x.energy.load;
        }
        Vector slope{}, sum{};
        Powers::Values there;
        // unrolled, since the engine spends most time here: this saves an eighth of the time
#pragma GCC unroll 4
        for (int stage = 0; stage < 4; ++stage) {
            const double after = reach[stage] * h;
            Vector y = start;
            if (stage > 0) {
#pragma GCC unroll 8
                for (std::size_t n = 0; n < y.size(); ++n) y[n] += after * slope[n];
                evaluate<detail>(y[1], there);
            }
            slope = derivative<detail>(y, stage > 0 ? there : z, x, u, load[stage], time + after);
#pragma GCC unroll 8
            for (std::size_t n = 0; n < y.size(); ++n) sum[n] += weight[stage] * slope[n];
        }
#pragma GCC unroll 8
        for (std::size_t n = 0; n < sum.size(); ++n) start[n] += h / 6.0 * sum[n];
        return start;
    }

    // Sets the state to y, the result of integrated() with the same h.
    template <Detail detail>
    void move(PlantState& x, const Vector<detail>& y, double h) const {
        x.omega_m = y[0];
        x.theta_m = y[1];
        x.load.torque = load_.constant_part(x.load, h);
        if constexpr (detail != Detail::mechanics) x.i = {y[2], y[3]};
        if constexpr (detail == Detail::energies) x.energy = {y[4], y[5], y[6], y[7]};
    }

    template <Detail detail>
    void smooth_step(PlantState& x, const Powers::Values& z, Voltage u, double time, double h) const {
        move<detail>(x, integrated<detail>(x, z, u, time, h), h);
    }

    template <Detail detail>
    Vector<detail> derivative(const Vector<detail>& y, const Powers::Values& z, const PlantState& mode, Voltage u,
                              double load_constant, double time) const {
        Currents i = mode.i;
        if constexpr (detail != Detail::mechanics) i = {y[2], y[3]};
        const double omega_m = y[0];
        const Pmsm::Linkage e = motor_.linkage(z, i);
        const double load = load_constant + load_.other_parts(z, y[1], time);
        const double friction = mechanics_.viscous_friction * omega_m + mechanics_.coulomb_friction * mode.direction;

        Vector<detail> slope;
        slope[0] = mode.stuck ? 0.0
                              : (motor_.torque(e, i) + motor_.cogging(z) - load - friction) * per_inertia_;
        slope[1] = omega_m;
        if constexpr (detail != Detail::mechanics) {
            const Complex axis = motor_.axis(z);
            const double u_d = axis.re * u.alpha + axis.im * u.beta;
            const double u_q = axis.re * u.beta - axis.im * u.alpha;
            const Currents di = motor_.derivative(e, i, u_d, u_q, omega_m);
            slope[2] = di.d;
            slope[3] = di.q;
            if constexpr (detail == Detail::energies) {
                slope[4] = motor_.power_factor() * (u_d * i.d + u_q * i.q);
                slope[5] = motor_.power_factor() * motor_.config().R_s * (i.d * i.d + i.q * i.q);
                slope[6] = friction * omega_m;
                slope[7] = load * omega_m;
            }
        }
        return slope;
    }

    // Torque on the rotor without friction.
    double driving_torque(const PlantState& x, const Powers::Values& z, double time) const {
        const Torques t = torques(x, z, time);
        return t.electromagnetic + t.cogging - t.load;
    }

    // The earliest time in (0, h] at which `excess` of the state reaches zero from below; it's above zero at h.
    // Illinois's regula falsi.
    template <Detail detail, class Excess>
    double instant(const PlantState& x, const Powers::Values& z, Voltage u, double time, double h, double at_start,
                   double at_end, const Excess& excess) const {
        double low = 0.0, high = h, below = at_start, above = at_end;
        for (int n = 0; n < 60 && high - low > 1e-15 * h; ++n) {
            const double middle = below < 0.0 ? low + (high - low) * below / (below - above) : 0.5 * (low + high);
            if (!(middle > low && middle < high)) break;
            PlantState then = x;
            smooth_step<detail>(then, z, u, time, middle);
            const double value = excess(then, time + middle);
            if (value > 0.0) {
                if (high - middle < 0.5 * (high - low)) below *= 0.5;
                high = middle;
                above = value;
            } else {
                if (middle - low < 0.5 * (high - low)) above *= 0.5;
                low = middle;
                below = value;
                if (value == 0.0) return middle;
            }
        }
        return high;
    }

    // Slides for h, or until the rotor stops; returns the time that passed.
    template <Detail detail>
    double sliding_piece(PlantState& x, const Powers::Values& z, Voltage u, double time, double h) const {
        const auto y = integrated<detail>(x, z, u, time, h);
        const double at_end = -x.direction * y[0];
        if (!(at_end > 0.0)) {
            move<detail>(x, y, h);
            return h;
        }
        const auto backwards = [&x](const PlantState& then, double) { return -x.direction * then.omega_m; };
        const double done = instant<detail>(x, z, u, time, h, backwards(x, time), at_end, backwards);
        smooth_step<detail>(x, z, u, time, done);
        x.omega_m = 0.0;
        Powers::Values there;
        evaluate<detail>(x.theta_m, there);
        const double torque = driving_torque(x, there, time + done);
        x.stuck = std::abs(torque) <= mechanics_.breakaway_friction;
        x.direction = torque < 0.0 ? -1.0 : 1.0;
        return done;
    }

    // Rests for h, or until the rotor breaks away; returns the time that passed.
    template <Detail detail>
    double stuck_piece(PlantState& x, const Powers::Values& z, Voltage u, double time, double h) const {
        const PlantState before = x;
        const auto excess = [this, &z](const PlantState& y, double at) {  // the angle does not change, so z stays valid
            return std::abs(driving_torque(y, z, at)) - mechanics_.breakaway_friction;
        };
        smooth_step<detail>(x, z, u, time, h);
        const double at_end = excess(x, time + h);
        if (!(at_end > 0.0)) return h;

        const double at_start = excess(before, time);
        const double done =
            at_start < 0.0 ? instant<detail>(before, z, u, time, h, at_start, at_end, excess) : 0.0;
        x = before;
        if (done > 0.0) smooth_step<detail>(x, z, u, time, done);
        x.stuck = false;
        x.direction = driving_torque(x, z, time + done) < 0.0 ? -1.0 : 1.0;
        return done;
    }

    Powers powers_;
    Pmsm motor_;
    MechanicsConfig mechanics_;
    double per_inertia_;  // a product costs less than a quotient
    Load load_;
    bool ripples_;  // some torque is a sum of harmonics of the angle
};

}  // namespace cogless
