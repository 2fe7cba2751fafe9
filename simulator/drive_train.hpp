// Mechanics beyond one mass with Coulomb friction: a load side behind a gear and a soft shaft with backlash, and friction that
// depends on speed (Stribeck) and on position.
//
// The gear's output turns by g(theta_m) = theta_m / ratio + its transmission error. Between it and the load is the gap, in
// series with the shaft (Nordin, Galic', Gutman, New models for backlash and gear play, 1997):
//
//     g(theta_m) - theta_load = shaft's twist + position in the gap,    |position| <= backlash / 2
//
// In contact with a side of the gap the shaft's torque is stiffness twist + damping twist', as long as that pushes. Within the gap
// the torque is zero, and the twist decays exponentially with the time constant damping / stiffness.
#pragma once

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "harmonics.hpp"
#include "load.hpp"
#include "maths.hpp"
#include "table.hpp"

namespace cogless {

// Friction of the motor side or of the load side. Where it depends on position, that is the side's own angle.
struct FrictionConfig {
    double viscous;                    // N m s/rad
    double coulomb;                    // N m, while moving
    double breakaway;                  // N m, at standstill; not below coulomb
    double stribeck_speed = 0.0;       // rad/s, where friction is coulomb + (breakaway - coulomb) / e; 0: coulomb at any speed
    std::vector<Harmonic> harmonics = {};  // N m, added to coulomb and breakaway
    Table table = {};                  // N m over rad, added to coulomb and breakaway
};

struct LoadSideConfig {
    double inertia;                   // kg m^2
    FrictionConfig friction;
    double stiffness, damping;        // N m/rad, N m s/rad
    double backlash = 0.0;            // rad, the whole gap
    double ratio = 1.0;               // motor's speed over the load's
    std::vector<Harmonic> input_errors = {}, output_errors = {};  // rad at the output, over the angle of the input and of the output
};

struct MechanicsConfig {
    double inertia;  // kg m^2
    FrictionConfig friction;
    std::optional<LoadSideConfig> load_side = {};  // none: the inertia is of rotor and load
};

// The load side's part of a plant's state.
struct LoadSideState {
    double omega = 0.0, theta = 0.0;  // rad/s, rad, not wrapped
    double direction = 1.0;           // direction of sliding, 1 or -1
    bool stuck = false;
    int contact = 1;                  // the side of the gap, 1 or -1; 0: within it
    double wound = 0.0;               // rad, the shaft's twist while within the gap
};

// A sum of sinusoids over an angle, with the angle's powers.
class Waves {
public:
    struct Value {
        double value, slope;
    };

    explicit Waves(const std::vector<Harmonic>& harmonics) : powers_(orders(harmonics)) {
        for (const Harmonic& h : harmonics) series_.add(powers_, h);
    }

    Value at(double theta) const {
        if (series_.empty()) return {0.0, 0.0};
        Powers::Values<double> z;
        powers_.evaluate(theta, z);
        const std::array<double, 5> terms = series_.taylor(z);
        return {terms[0], terms[1]};
    }

private:
    static std::vector<int> orders(const std::vector<Harmonic>& harmonics) {
        std::vector<int> all{1};
        for (const Harmonic& h : harmonics) all.push_back(h.order);
        return all;
    }

    Powers powers_;
    Series<double> series_;
};

class Friction {
public:
    explicit Friction(const FrictionConfig& config) : config_(config), waves_(config.harmonics) {}

    bool plain() const { return !(config_.stribeck_speed > 0.0) && config_.harmonics.empty() && config_.table.empty(); }
    bool sticks() const { return config_.breakaway > 0.0 || !config_.harmonics.empty() || !config_.table.empty(); }

    // Torque against a rotor that slides in the direction 1 or -1, N m.
    double sliding(double omega, double theta, double direction) const {
        double dry = config_.coulomb + of_position(theta);
        if (config_.stribeck_speed > 0.0) {
            const double share = omega / config_.stribeck_speed;
            dry += (config_.breakaway - config_.coulomb) * exponential(-share * share);
        }
        return config_.viscous * omega + direction * dry;
    }

    // The torque up to which friction holds at standstill, N m.
    double holding(double theta) const { return config_.breakaway + of_position(theta); }

private:
    double of_position(double theta) const {
        return waves_.at(theta).value + (config_.table.empty() ? 0.0 : config_.table.periodic(theta));
    }

    FrictionConfig config_;
    Waves waves_;
};

class LoadSide {
public:
    LoadSide(const LoadSideConfig& config, const LoadConfig& load)
        : config_(config), friction_(config.friction), input_errors_(config.input_errors),
          output_errors_(config.output_errors), load_(load.harmonics), half_gap_(0.5 * config.backlash) {}

    const Friction& friction() const { return friction_; }
    double per_inertia() const { return 1.0 / config_.inertia; }
    double ratio() const { return config_.ratio; }
    bool has_gap() const { return half_gap_ > 0.0; }

    // Torque of the load's harmonics at the load side's angle, N m.
    double of_angle(double theta) const { return load_.at(theta).value; }

    LoadSideState start(double theta_m, double omega_m) const {
        const Waves::Value out = gear(theta_m);
        LoadSideState s;
        s.theta = out.value;
        s.omega = out.slope * omega_m;
        s.direction = s.omega < 0.0 ? -1.0 : 1.0;
        s.stuck = friction_.sticks() && s.omega == 0.0;
        s.contact = has_gap() ? 0 : 1;
        return s;
    }

    // The shaft's torques and loss, with the motor at theta_m and the load side at theta.
    struct Shaft {
        double torque;    // N m, on the load
        double on_motor;  // N m, against the motor
        double loss;      // W, in its damping
    };
    Shaft shaft(int contact, double theta_m, double omega_m, double theta, double omega) const {
        if (contact == 0) return {0.0, 0.0, 0.0};
        const Waves::Value out = gear(theta_m);
        const double rate = out.slope * omega_m - omega;
        const double torque = config_.stiffness * (out.value - theta - contact * half_gap_) + config_.damping * rate;
        return {torque, out.slope * torque, config_.damping * rate * rate};
    }

    // The shaft's twist within the gap a time h later, rad.
    double unwound(const LoadSideState& s, double h) const {
        if (s.contact != 0 || s.wound == 0.0) return s.wound;
        return config_.damping > 0.0 ? s.wound * exponential(-config_.stiffness / config_.damping * h) : 0.0;
    }

    // Energy in the shaft's twist, J.
    double twist_energy(const LoadSideState& s, double theta_m) const {
        const double twist = s.contact == 0 ? s.wound : twist_at(s, theta_m);
        return 0.5 * config_.stiffness * twist * twist;
    }
    double wound_energy(double wound) const { return 0.5 * config_.stiffness * wound * wound; }
    double kinetic_energy(const LoadSideState& s) const { return 0.5 * config_.inertia * s.omega * s.omega; }

    // A value that is above zero once the contact must change: in contact the torque with which the shaft would pull, N m; within
    // the gap the position beyond the side that is approached, rad.
    double beyond(const LoadSideState& s, double theta_m, double omega_m) const {
        if (!has_gap()) return -1.0;
        if (s.contact != 0) return -s.contact * shaft(s.contact, theta_m, omega_m, s.theta, s.omega).torque;
        const Waves::Value out = gear(theta_m);
        const double place = out.value - s.theta - s.wound;
        double rate = out.slope * omega_m - s.omega;
        if (config_.damping > 0.0) rate += config_.stiffness / config_.damping * s.wound;
        return (rate < 0.0 ? -place : place) - half_gap_;
    }

    // Parts the sides in contact; within the gap, brings the sides that have met into contact.
    void change_contact(LoadSideState& s, double theta_m) const {
        if (s.contact != 0) {
            s.wound = config_.damping > 0.0 ? twist_at(s, theta_m) : 0.0;
            s.contact = 0;
        } else {
            s.contact = gear(theta_m).value - s.theta - s.wound < 0.0 ? -1 : 1;
            s.wound = 0.0;
        }
    }

private:
    // The angle of the gear's output, and its slope over theta_m.
    Waves::Value gear(double theta_m) const {
        const double per_ratio = 1.0 / config_.ratio, output = theta_m * per_ratio;
        const Waves::Value by_input = input_errors_.at(theta_m), by_output = output_errors_.at(output);
        return {output + (by_input.value + by_output.value), per_ratio + (by_input.slope + per_ratio * by_output.slope)};
    }

    double twist_at(const LoadSideState& s, double theta_m) const {
        return gear(theta_m).value - s.theta - s.contact * half_gap_;
    }

    LoadSideConfig config_;
    Friction friction_;
    Waves input_errors_, output_errors_, load_;
    double half_gap_;
};

// Friction and load side of a plant. of() returns none if one mass with Coulomb friction is all there is.
struct DriveTrain {
    Friction friction;  // on the motor side
    std::optional<LoadSide> load_side;

    static std::optional<DriveTrain> of(const MechanicsConfig& mechanics, const LoadConfig& load) {
        Friction friction(mechanics.friction);
        if (!mechanics.load_side && friction.plain()) return {};
        DriveTrain train{std::move(friction), {}};
        if (mechanics.load_side) train.load_side.emplace(*mechanics.load_side, load);
        return train;
    }
};

}  // namespace cogless
