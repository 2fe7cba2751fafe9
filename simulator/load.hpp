// Load torque: a constant part that follows its target with a lag, a function of angle, and tables.
#pragma once

#include <type_traits>
#include <vector>

#include "harmonics.hpp"
#include "table.hpp"

namespace cogless {

struct LoadConfig {
    double torque = 0.0;              // N m, the constant part at the start
    double lag = 0.0;                 // s, time constant with which the constant part follows a step, such as a brake's
    std::vector<Harmonic> harmonics;  // N m, mechanical orders
    Table angle_table, time_table;    // N m over rad, over s
};

template <class Real = double>
struct LoadState {
    Real torque;  // N m, present value of the load without tables and harmonics
    Real target;  // N m, the value that it approaches
};

// The load without its harmonics, which AngleFunctions computes.
template <class Real = double>
class Load {
public:
    Load(const LoadConfig& config, double nominal_step)
        : config_(config), has_tables_(!config.angle_table.empty() || !config.time_table.empty()),
          nominal_step_(nominal_step), nominal_decay_(decay_over(nominal_step)),
          nominal_half_decay_(decay_over(0.5 * nominal_step)) {}

    // Several loads without tables, one for each lane.
    explicit Load(const Each<Load<double>, Real>& of)
        requires is_wide<Real>
        : has_tables_(false), nominal_step_(of[0]->nominal_step_),
          nominal_decay_(each<Real>(of, &Load<double>::nominal_decay_)),
          nominal_half_decay_(each<Real>(of, &Load<double>::nominal_half_decay_)) {}

    // The sums with 0.0 make a negative zero positive, so that all ways to compute the torque give the same bits.
    LoadState<> start() const { return {config_.torque + 0.0, config_.torque + 0.0}; }

    // The constant part half a step and a whole step later, exactly.
    struct Later {
        Real middle, end;
    };

    [[gnu::always_inline]] Later later(const LoadState<Real>& load, double h) const {
        Real half_decay = nominal_half_decay_, decay = nominal_decay_;
        if constexpr (std::is_same_v<Real, double>) {
            if (load.torque == load.target) return {load.target, load.target};
            if (h != nominal_step_) {
                half_decay = decay_over(0.5 * h);
                decay = decay_over(h);
            }
        }
        const Real away = load.torque - load.target;
        return {load.target + away * half_decay, load.target + away * decay};
    }

    bool has_tables() const { return has_tables_; }

    // The tables' part, N m.
    double of_tables(double theta_m, double time) const {
        double torque = 0.0;
        if (!config_.angle_table.empty()) torque += config_.angle_table.periodic(theta_m);
        if (!config_.time_table.empty()) torque += config_.time_table.held(time);
        return torque;
    }

private:
    template <class>
    friend class Load;

    double decay_over(double time) const {
        return config_.lag > 0.0 ? exponential(-time / config_.lag) : (time > 0.0 ? 0.0 : 1.0);
    }

    LoadConfig config_;
    bool has_tables_;
    double nominal_step_;
    Real nominal_decay_, nominal_half_decay_;
};

}  // namespace cogless
