// Motor, inertia, friction and load as one system of differential equations, integrated by fixed-step RK4.
//
// Coulomb friction really sticks: at standstill the rotor stays until the other torques exceed the breakaway torque. The
// instants of stopping and of breaking away are found within the step, so that the order of the method is kept.
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
    double direction = 0.0;     // of sliding, which friction opposes: 1 or -1
    Energy energy;              // counted only where asked for
};

struct Torques {
    double electromagnetic, cogging, load;  // N m
};

class Plant {
public:
    Plant(const PmsmConfig& motor, const MechanicsConfig& mechanics, const LoadConfig& load, double nominal_step)
        : powers_(all_orders(motor, load)), motor_(motor, powers_), mechanics_(mechanics),
          load_(load, powers_, nominal_step) {}

    const Pmsm& motor() const { return motor_; }

    PlantState start(double theta_m, double omega_m) const {
        PlantState x;
        x.theta_m = theta_m;
        x.omega_m = omega_m;
        x.load = load_.start();
        x.stuck = sticks() && omega_m == 0.0;
        x.direction = omega_m < 0.0 ? -1.0 : 1.0;
        return x;
    }

    Torques torques(const PlantState& x, double time) const {
        Powers::Values z;
        powers_.evaluate(x.theta_m, z);
        return {motor_.torque(motor_.linkage(z, x.i), x.i), motor_.cogging(z),
                x.load.torque + load_.other_parts(z, x.theta_m, time)};
    }

    double stored_energy(const PlantState& x) const {
        Powers::Values z;
        powers_.evaluate(x.theta_m, z);
        return motor_.magnetic_energy(x.i) + 0.5 * mechanics_.inertia * x.omega_m * x.omega_m +
               motor_.cogging_energy(z);
    }

    // Advances by h from the given time under a constant voltage. CountEnergy integrates the powers with the states.
    template <bool CountEnergy>
    void step(PlantState& x, Voltage u, double time, double h) const {
        if (!sticks()) {
            x = smooth_step<CountEnergy>(x, u, time, h);
            return;
        }
        constexpr int most_pieces = 16;  // a rotor that stops and breaks away again and again within one step
        for (int piece = 0; piece < most_pieces && h > 0.0; ++piece) {
            const double done = x.stuck ? stuck_piece<CountEnergy>(x, u, time, h)
                                        : sliding_piece<CountEnergy>(x, u, time, h);
            time += done;
            h -= done;
        }
        if (h > 0.0) x = smooth_step<CountEnergy>(x, u, time, h);
    }

private:
    static std::vector<int> all_orders(const PmsmConfig& motor, const LoadConfig& load) {
        std::vector<int> all = Pmsm::orders(motor);
        for (const int order : Load::orders(load)) all.push_back(order);
        return all;
    }

    bool sticks() const { return mechanics_.breakaway_friction > 0.0; }

    // One RK4 step within which nothing starts or stops.
    template <bool CountEnergy>
    PlantState smooth_step(const PlantState& x, Voltage u, double time, double h) const {
        constexpr std::size_t size = CountEnergy ? 8 : 4;
        using Vector = std::array<double, size>;

        const double load_start = x.load.torque;
        const double load_middle = load_.constant_part(x.load, 0.5 * h);
        const double load_end = load_.constant_part(x.load, h);
        Vector start{x.i.d, x.i.q, x.omega_m, x.theta_m};
        if constexpr (CountEnergy) {
            start[4] = x.energy.electrical;
            start[5] = x.energy.copper;
            start[6] = x.energy.friction;
            start[7] = x.energy.load;
        }
        const auto moved = [&start](const Vector& slope, double by) {
            Vector y;
            for (std::size_t n = 0; n < size; ++n) y[n] = start[n] + by * slope[n];
            return y;
        };
        const Vector k1 = derivative<Vector>(start, x, u, load_start, time);
        const Vector k2 = derivative<Vector>(moved(k1, 0.5 * h), x, u, load_middle, time + 0.5 * h);
        const Vector k3 = derivative<Vector>(moved(k2, 0.5 * h), x, u, load_middle, time + 0.5 * h);
        const Vector k4 = derivative<Vector>(moved(k3, h), x, u, load_end, time + h);
        Vector y;
        for (std::size_t n = 0; n < size; ++n) y[n] = start[n] + h / 6.0 * (k1[n] + 2.0 * (k2[n] + k3[n]) + k4[n]);

        PlantState next = x;
        next.i = {y[0], y[1]};
        next.omega_m = y[2];
        next.theta_m = y[3];
        next.load.torque = load_end;
        if constexpr (CountEnergy) next.energy = {y[4], y[5], y[6], y[7]};
        return next;
    }

    template <class Vector>
    Vector derivative(const Vector& y, const PlantState& mode, Voltage u, double load_constant, double time) const {
        Powers::Values z;
        powers_.evaluate(y[3], z);
        const Currents i{y[0], y[1]};
        const double omega_m = y[2];
        const Complex axis = motor_.axis(z);
        const double u_d = axis.re * u.alpha + axis.im * u.beta;
        const double u_q = axis.re * u.beta - axis.im * u.alpha;
        const Pmsm::Linkage e = motor_.linkage(z, i);
        const Currents di = motor_.derivative(e, i, u_d, u_q, omega_m);
        const double load = load_constant + load_.other_parts(z, y[3], time);
        const double friction = mechanics_.viscous_friction * omega_m + mechanics_.coulomb_friction * mode.direction;

        Vector slope;
        slope[0] = di.d;
        slope[1] = di.q;
        slope[2] = mode.stuck ? 0.0
                              : (motor_.torque(e, i) + motor_.cogging(z) - load - friction) / mechanics_.inertia;
        slope[3] = omega_m;
        if constexpr (std::tuple_size_v<Vector> == 8) {
            slope[4] = 1.5 * (u_d * i.d + u_q * i.q);
            slope[5] = 1.5 * motor_.config().R_s * (i.d * i.d + i.q * i.q);
            slope[6] = friction * omega_m;
            slope[7] = load * omega_m;
        }
        return slope;
    }

    // Torque on the rotor but for friction.
    double driving_torque(const PlantState& x, double time) const {
        const Torques t = torques(x, time);
        return t.electromagnetic + t.cogging - t.load;
    }

    // The earliest time in (0, h] at which `excess` of the state reaches zero from below; it's above zero at h.
    // Illinois's regula falsi.
    template <bool CountEnergy, class Excess>
    double instant(const PlantState& x, Voltage u, double time, double h, double at_start, double at_end,
                   const Excess& excess) const {
        double low = 0.0, high = h, below = at_start, above = at_end;
        for (int n = 0; n < 60 && high - low > 1e-15 * h; ++n) {
            const double middle = below < 0.0 ? low + (high - low) * below / (below - above) : 0.5 * (low + high);
            if (!(middle > low && middle < high)) break;
            const double value = excess(smooth_step<CountEnergy>(x, u, time, middle), time + middle);
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
    template <bool CountEnergy>
    double sliding_piece(PlantState& x, Voltage u, double time, double h) const {
        const auto backwards = [&x](const PlantState& y, double) { return -x.direction * y.omega_m; };
        PlantState next = smooth_step<CountEnergy>(x, u, time, h);
        double done = h;
        const double at_end = backwards(next, 0.0);
        if (at_end > 0.0) {
            done = instant<CountEnergy>(x, u, time, h, backwards(x, 0.0), at_end, backwards);
            next = smooth_step<CountEnergy>(x, u, time, done);
            next.omega_m = 0.0;
            const double torque = driving_torque(next, time + done);
            next.stuck = std::abs(torque) <= mechanics_.breakaway_friction;
            next.direction = torque < 0.0 ? -1.0 : 1.0;
        }
        x = next;
        return done;
    }

    // Rests for h, or until the rotor breaks away; returns the time that passed.
    template <bool CountEnergy>
    double stuck_piece(PlantState& x, Voltage u, double time, double h) const {
        const auto excess = [this](const PlantState& y, double at) {
            return std::abs(driving_torque(y, at)) - mechanics_.breakaway_friction;
        };
        PlantState next = smooth_step<CountEnergy>(x, u, time, h);
        double done = h;
        const double at_end = excess(next, time + h);
        if (at_end > 0.0) {
            const double at_start = excess(x, time);
            done = at_start < 0.0 ? instant<CountEnergy>(x, u, time, h, at_start, at_end, excess) : 0.0;
            next = done > 0.0 ? smooth_step<CountEnergy>(x, u, time, done) : x;
            next.stuck = false;
            next.direction = driving_torque(next, time + done) < 0.0 ? -1.0 : 1.0;
        }
        x = next;
        return done;
    }

    Powers powers_;
    Pmsm motor_;
    MechanicsConfig mechanics_;
    Load load_;
};

}  // namespace cogless
