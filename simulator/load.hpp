// Load torque: a constant part that follows its target with a lag, a function of angle, and tables.
#pragma once

#include <cmath>
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

struct LoadState {
    double torque;  // N m, the constant part now
    double target;  // N m, the value that it approaches
};

class Load {
public:
    Load(const LoadConfig& config, const Powers& powers, double nominal_step)
        : config_(config), harmonics_(powers, config.harmonics),
          varies_(!config.harmonics.empty() || !config.angle_table.empty() || !config.time_table.empty()),
          nominal_step_(nominal_step), nominal_decay_(decay_over(nominal_step)),
          nominal_half_decay_(decay_over(0.5 * nominal_step)) {}

    static std::vector<int> orders(const LoadConfig& config) {
        std::vector<int> all;
        for (const Harmonic& h : config.harmonics) all.push_back(h.order);
        return all;
    }

    LoadState start() const { return {config_.torque, config_.torque}; }

    // The exact constant part after a time. The engine mostly asks for one step and for half a step.
    double constant_part(const LoadState& load, double after) const {
        if (load.torque == load.target) return load.target;
        const double decay = after == nominal_step_         ? nominal_decay_
                             : after == 0.5 * nominal_step_ ? nominal_half_decay_
                                                            : decay_over(after);
        return load.target + (load.torque - load.target) * decay;
    }

    // The part that depends on angle and time, N m.
    double other_parts(const Powers::Values& z, double theta_m, double time) const {
        if (!varies_) return 0.0;
        double torque = harmonics_.value(z);
        if (!config_.angle_table.empty()) torque += config_.angle_table.periodic(theta_m);
        if (!config_.time_table.empty()) torque += config_.time_table.held(time);
        return torque;
    }

private:
    double decay_over(double time) const {
        return config_.lag > 0.0 ? std::exp(-time / config_.lag) : (time > 0.0 ? 0.0 : 1.0);
    }

    LoadConfig config_;
    Series harmonics_;
    bool varies_;  // with angle or time
    double nominal_step_, nominal_decay_, nominal_half_decay_;
};

}  // namespace cogless
