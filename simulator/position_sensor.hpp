// Position sensors, and the speed that a drive computes from them.
//
// ideal: the true angle and speed. encoder: incremental, counted on all four edges. Speed by counting over a speed-loop
// period (M), from the time between
//   the last two edges (T), or counted edges over the exact time between the first and the last of them (MT).
// resolver: an angle with `bits` bits; speed as the moving average of its differences at the current loop's rate.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

#include "maths.hpp"

namespace cogless {

enum class PositionSensorKind { ideal, encoder, resolver };
enum class SpeedMethod { M, T, MT };

struct PositionSensorConfig {
    PositionSensorKind kind = PositionSensorKind::ideal;
    int lines = 0;                   // encoder: lines per revolution; four counts each
    SpeedMethod speed_method = SpeedMethod::M;
    double timer = 0.0;              // encoder: Hz, the clock that times the edges (T, MT); 0: a perfect one
    double eccentricity = 0.0;       // encoder: rad, error of the angle once per revolution
    double eccentricity_phase = 0.0; // rad
    int bits = 0;                    // resolver
    int window = 1;                  // resolver: current-loop periods in the moving average
};

struct Measurement {
    double theta_m;  // rad, within one revolution of zero upwards
    double omega_m;  // rad/s
};

class PositionSensor {
public:
    struct State {
        double theta_before = 0.0;             // encoder: its angle at the last call of watch()
        std::int64_t count = 0;                // now
        std::int64_t count_at_speed = 0;       // at the last speed-loop period
        double last_edge = 0.0, edge_before = 0.0;  // s
        int last_direction = 0, direction_before = 0;
        double edge_at_speed = 0.0;            // s, the last edge before the last speed-loop period
        std::int64_t edges_since_speed = 0;    // signed
        double omega_m = 0.0;                  // rad/s, last result
        std::vector<std::int64_t> history;     // resolver: counts of the last periods
        std::size_t oldest = 0;
    };

    PositionSensor(const PositionSensorConfig& config, double current_period, double speed_period)
        : config_(config), current_period_(current_period), speed_period_(speed_period) {
        if (config.kind == PositionSensorKind::encoder) step_ = turn / (4.0 * config.lines);
        if (config.kind == PositionSensorKind::resolver) step_ = turn / std::ldexp(1.0, config.bits);
    }

    State start(double theta_m, double omega_m) const {
        State s;
        if (config_.kind == PositionSensorKind::ideal) return s;
        s.theta_before = seen(theta_m);
        s.count = count(s.theta_before);
        s.omega_m = omega_m;
        // as if the rotor had turned at this speed before
        s.count_at_speed = count(seen(theta_m - omega_m * speed_period_));
        s.last_direction = s.direction_before = omega_m < 0.0 ? -1 : 1;
        const double edge_period = omega_m != 0.0 ? step_ / std::abs(omega_m) : 1e9;
        const double behind = s.theta_before / step_ - static_cast<double>(s.count);
        s.last_edge = -(omega_m < 0.0 ? 1.0 - behind : behind) * edge_period;
        s.edge_before = s.last_edge - edge_period;
        s.edge_at_speed = s.last_edge;
        for (int n = 0; n < config_.window && config_.kind == PositionSensorKind::resolver; ++n) {
            s.history.push_back(count(theta_m - omega_m * current_period_ * (config_.window - n)));
        }
        return s;
    }

    // Whether edges must be timed between samples.
    bool watches() const {
        return config_.kind == PositionSensorKind::encoder && config_.speed_method != SpeedMethod::M;
    }

    // Times the edges that the rotor passed on its way to theta_m, between the instants `from` and `to`.
    void watch(State& s, double from, double to, double theta_m) const {
        const double theta = seen(theta_m);
        const std::int64_t now = count(theta);
        if (now != s.count) {
            const int direction = now > s.count ? 1 : -1;
            // the first and the last step boundary that was crossed, counted in steps
            const std::int64_t first = direction > 0 ? s.count + 1 : s.count;
            const std::int64_t last = direction > 0 ? now : now + 1;
            const double rate = (to - from) / (theta - s.theta_before);
            const auto when = [&](std::int64_t boundary) {
                return clocked(from + (static_cast<double>(boundary) * step_ - s.theta_before) * rate);
            };
            s.edge_before = first == last ? s.last_edge : when(last - direction);
            s.direction_before = first == last ? s.last_direction : direction;
            s.last_edge = when(last);
            s.last_direction = direction;
            s.edges_since_speed += now - s.count;
            s.count = now;
        }
        s.theta_before = theta;
    }

    // Measures, once per current-loop period; speed_sample: the speed loop runs in it too.
    [[gnu::always_inline]] Measurement sample(State& s, double time, double theta_m, double omega_m, bool speed_sample) const {
        if (config_.kind == PositionSensorKind::ideal) return {wrapped(theta_m), omega_m};
        if (!watches()) s.count = count(seen(theta_m));
        if (config_.kind == PositionSensorKind::resolver) {
            const std::int64_t moved = s.count - s.history[s.oldest];
            s.omega_m = static_cast<double>(moved) * step_ / (config_.window * current_period_);
            s.history[s.oldest] = s.count;
            s.oldest = s.oldest + 1 < s.history.size() ? s.oldest + 1 : 0;
        } else if (speed_sample) {
            s.omega_m = encoder_speed(s, time);
        }
        return {wrapped(static_cast<double>(s.count) * step_), s.omega_m};
    }

private:
    static constexpr double turn = 2.0 * std::numbers::pi;

    static double wrapped(double theta) { return theta - turn * round_down(theta / turn); }

    double seen(double theta_m) const {
        return config_.eccentricity != 0.0
                   ? theta_m + config_.eccentricity * sine(theta_m + config_.eccentricity_phase)
                   : theta_m;
    }

    std::int64_t count(double theta) const {
        const double counts = round_down(theta / step_);
        return std::abs(counts) < 9e18 ? static_cast<std::int64_t>(counts) : 0;  // a run with such an angle ends anyway
    }

    double clocked(double time) const {
        return config_.timer > 0.0 ? round_down(time * config_.timer) / config_.timer : time;
    }

    double encoder_speed(State& s, double time) const {
        if (config_.speed_method == SpeedMethod::M) {
            const std::int64_t moved = s.count - s.count_at_speed;
            s.count_at_speed = s.count;
            return static_cast<double>(moved) * step_ / speed_period_;
        }
        double speed = 0.0;
        if (config_.speed_method == SpeedMethod::MT && s.edges_since_speed != 0) {
            const double elapsed = s.last_edge - s.edge_at_speed;
            speed = elapsed > 0.0 ? static_cast<double>(s.edges_since_speed) * step_ / elapsed : s.omega_m;
        } else if (s.last_direction == s.direction_before) {
            // between edges the rotor can't be faster than one step since the last edge
            const double elapsed = std::max(s.last_edge - s.edge_before, clocked(time) - s.last_edge);
            speed = elapsed > 0.0 ? s.last_direction * step_ / elapsed : s.omega_m;
        }
        s.edge_at_speed = s.last_edge;
        s.edges_since_speed = 0;
        return speed;
    }

    PositionSensorConfig config_;
    double current_period_, speed_period_;
    double step_ = 0.0;  // rad per count
};

}  // namespace cogless
