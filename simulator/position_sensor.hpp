// Position sensors. The speed is computed from them by the control library, as firmware does.
//
// ideal: the true angle and speed. encoder: incremental, counted on all four edges. Speed by counting over a speed-loop
// period (M), from the time between the last two edges (T), from counts and the times of the edges (MT), or by an observer of
// the angle at the current loop's rate.
// resolver: an angle with `bits` bits; speed as the moving average of its differences at the current loop's rate.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

#include "cogless/angle_observer.h"
#include "cogless/encoder.h"
#include "cogless/speed_count.h"
#include "cogless/speed_timed.h"
#include "law.hpp"
#include "maths.hpp"

namespace cogless {

enum class PositionSensorKind { ideal, encoder, resolver };
enum class SpeedMethod { M, T, MT, observer };

struct PositionSensorConfig {
    PositionSensorKind kind = PositionSensorKind::ideal;
    int lines = 0;                   // encoder: lines per revolution; four counts each
    SpeedMethod speed_method = SpeedMethod::M;
    double timer = 0.0;              // encoder: Hz, the clock that times the edges (T, MT)
    double bandwidth = 0.0;          // encoder: rad/s, of the observer
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
        double theta_before = 0.0;  // encoder: its angle at the last call of watch()
        std::int64_t count = 0;     // now
        double omega_m = 0.0;       // rad/s, last result
        cgl_edges edges{};
        cgl_speed_count counted{};
        cgl_speed_timed timed{};
        cgl_encoder encoder{};
        cgl_angle_observer observer{};
        std::vector<std::uint32_t> before;  // of `counted`, whose pointer to it is set anew before each use
    };

    PositionSensor(const PositionSensorConfig& config, double current_period, double speed_period) : config_(config) {
        if (config.kind == PositionSensorKind::ideal) return;
        const bool encoder = config.kind == PositionSensorKind::encoder;
        const double counts = encoder ? 4.0 * config.lines : std::ldexp(1.0, config.bits);
        step_ = turn / counts;
        counts_ = static_cast<std::uint32_t>(std::min(counts, 4294967295.0));
        if (!encoder) {
            counting_ = {counts_, static_cast<std::uint32_t>(config.window)};
            counting_period_ = current_period;
        } else {
            counting_ = {counts_, 1};
            counting_period_ = speed_period;
        }
        State unused;
        prepare(unused, current_period);
        start_ = unused;
    }

    State start(double theta_m, double omega_m) const {
        State s = start_;
        if (config_.kind == PositionSensorKind::ideal) return s;
        s.theta_before = seen(theta_m);
        s.count = count(s.theta_before);
        s.omega_m = omega_m;
        // as if the rotor had turned at this speed before
        if (config_.kind == PositionSensorKind::resolver) {
            for (std::uint32_t n = 0; n < counting_.window; ++n) {
                s.before[n] = low(count(theta_m - omega_m * counting_period_ * (counting_.window - n)));
            }
            return s;
        }
        s.before[0] = low(count(seen(theta_m - omega_m * counting_period_)));
        const double edge_period = omega_m != 0.0 ? step_ / std::abs(omega_m) : 1e9;
        const double behind = s.theta_before / step_ - static_cast<double>(s.count);
        const double since = (omega_m < 0.0 ? 1.0 - behind : behind) * edge_period;
        s.edges = {low(s.count), 0U - ticks_of(since), ticks_of(edge_period), omega_m < 0.0, false};
        cgl_speed_timed_reset(&s.timed, &s.edges, 0U, static_cast<cgl_real>(omega_m));
        cgl_encoder_reset(&s.encoder, low(s.count));
        cgl_encoder_place(&s.encoder, position(s.count));
        cgl_angle_observer_reset(&s.observer, s.encoder.turns, static_cast<cgl_real>(omega_m));
        return s;
    }

    // Whether edges must be timed between samples.
    bool watches() const {
        return config_.kind == PositionSensorKind::encoder &&
               (config_.speed_method == SpeedMethod::T || config_.speed_method == SpeedMethod::MT);
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
            const std::uint32_t edge = when(last), edge_before = first == last ? s.edges.time : when(last - direction);
            const bool backward = direction < 0;
            s.edges = {low(now), edge, edge - edge_before, backward, first == last && backward != s.edges.backward};
            s.count = now;
        }
        s.theta_before = theta;
    }

    // Measures, once per current-loop period; speed_sample: the speed loop runs in it too.
    [[gnu::always_inline]] Measurement sample(State& s, double time, double theta_m, double omega_m, bool speed_sample) const {
        if (config_.kind == PositionSensorKind::ideal) return {wrapped(theta_m), omega_m};
        if (!watches()) s.count = count(seen(theta_m));
        const bool observed = config_.speed_method == SpeedMethod::observer;
        if (observed || speed_sample || config_.kind == PositionSensorKind::resolver) s.omega_m = speed(s, time);
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

    static std::uint32_t low(std::int64_t count) { return static_cast<std::uint32_t>(static_cast<std::uint64_t>(count)); }

    std::uint32_t position(std::int64_t count) const {
        const std::int64_t counts = counts_, rest = count % counts;
        return static_cast<std::uint32_t>(rest < 0 ? rest + counts : rest);
    }

    // The timer at that time.
    std::uint32_t clocked(double time) const { return low(static_cast<std::int64_t>(round_down(time * config_.timer))); }

    std::uint32_t ticks_of(double duration) const {
        return static_cast<std::uint32_t>(std::min(round_down(duration * config_.timer), 4294967295.0));
    }

    // Throws std::invalid_argument for what the control library refuses.
    void prepare(State& s, double current_period) const {
        s.before.resize(counting_.window);
        const auto length = static_cast<std::uint32_t>(s.before.size());
        require(cgl_speed_count_init(&s.counted, &counting_, static_cast<cgl_real>(counting_period_), s.before.data(), length),
                "speed by counting");
        if (watches()) {
            const cgl_speed_timed_config timing = {counts_, static_cast<cgl_real>(config_.timer),
                                                   config_.speed_method == SpeedMethod::T};
            require(cgl_speed_timed_init(&s.timed, &timing), "speed by the time of edges");
        }
        if (config_.speed_method != SpeedMethod::observer) return;
        const cgl_encoder_config encoder = {counts_, 0U, 0U, false, false};
        const cgl_angle_observer_config observer = {static_cast<cgl_real>(config_.bandwidth)};
        require(cgl_encoder_init(&s.encoder, &encoder, 0U), "encoder");
        require(cgl_angle_observer_init(&s.observer, &observer, static_cast<cgl_real>(current_period)), "speed observer");
    }

    double speed(State& s, double time) const {
        if (watches()) return static_cast<double>(cgl_speed_timed_step(&s.timed, &s.edges, clocked(time)));
        if (config_.speed_method == SpeedMethod::observer) {
            cgl_encoder_step(&s.encoder, low(s.count));
            cgl_angle_observer_step(&s.observer, s.encoder.turns);
            return static_cast<double>(s.observer.omega);
        }
        s.counted.before = s.before.data();
        return static_cast<double>(cgl_speed_count_step(&s.counted, low(s.count)));
    }

    PositionSensorConfig config_;
    double step_ = 0.0;  // rad per count
    std::uint32_t counts_ = 0;
    cgl_speed_count_config counting_{};
    double counting_period_ = 0.0;  // s
    State start_;
};

}  // namespace cogless
