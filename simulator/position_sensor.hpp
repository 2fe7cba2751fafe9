// Position sensors. The control library computes the speed from the angle, as in firmware.
//
// ideal: the true angle and speed. The other kinds show the angle in steps:
// encoder: incremental, counted on all four edges, which can be timed.
// absolute: a word of the angle.
// resolver: an angle with its converter's steps.
// hall: six steps per electrical revolution, each edge with an error of its placement; the angle between two edges is
// interpolated.
// Encoder, absolute and resolver may have an error that depends on the angle, and a latency unless edges are timed.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "cogless/angle_observer.h"
#include "cogless/encoder.h"
#include "cogless/encoder_table.h"
#include "cogless/hall.h"
#include "cogless/speed_count.h"
#include "cogless/speed_timed.h"
#include "law.hpp"
#include "maths.hpp"
#include "table.hpp"

namespace cogless {

enum class PositionSensorKind { ideal, encoder, absolute, resolver, hall };
// M: counts over a speed-loop period. average: counts over a window, at the current loop's rate. T: from the time between the
// last two edges. MT: from counts and the times of edges. observer: an observer of the angle, at the current loop's rate.
enum class SpeedMethod { M, average, T, MT, observer };

// A part of the sensor's error, amplitude sin(order theta_m + phase).
struct AngleOrder {
    int order;         // of the mechanical revolution
    double amplitude;  // rad
    double phase;      // rad
};

struct PositionSensorConfig {
    PositionSensorKind kind = PositionSensorKind::ideal;
    double counts = 0.0;                  // steps in a mechanical revolution
    SpeedMethod speed_method = SpeedMethod::M;
    double timer = 0.0;                   // Hz, the clock that times the edges (T, MT, hall)
    double bandwidth = 0.0;               // rad/s, of the observer
    int window = 1;                       // average: current-loop periods; hall: intervals between edges
    std::vector<AngleOrder> error = {};
    Table error_table = {};               // rad, error over the mechanical angle
    double latency = 0.0;                 // s, age of the angle that is sampled
    std::array<double, 6> placement = {}; // hall: rad, mechanical, by which each edge comes late
};

struct Measurement {
    double theta_m;  // rad, wrapped to the revolution that begins at zero
    double omega_m;  // rad/s
};

// The correction of the sensor's own error in its angle.
struct AngleCorrection {
    cgl_encoder_table* table = nullptr;  // null: no correction, as for an ideal sensor and Hall sensors
    cgl_real i_q = 0;                    // A, measured in the last period
    bool missing = false;                // the sensor gives no angle
};

class PositionSensor {
public:
    struct State {
        double theta_before = 0.0;  // rad, the sensor's angle at the last call of watch()
        std::int64_t count = 0;     // present count of steps
        double omega_m = 0.0;       // rad/s, last result
        cgl_edges edges{};
        cgl_speed_count counted{};
        cgl_speed_timed timed{};
        cgl_encoder encoder{};
        cgl_angle_observer observer{};
        cgl_hall hall{};
        std::vector<Measurement> past;      // true angle and speed, the newest at `newest`; empty without latency
        std::size_t newest = 0;
        std::vector<std::uint32_t> before;  // memory of `counted`, whose pointer to this is set before each use
    };

    PositionSensor(const PositionSensorConfig& config, double current_period, double speed_period) : config_(config) {
        if (config.kind == PositionSensorKind::ideal) return;
        step_ = turn / config.counts;
        counts_ = static_cast<std::uint32_t>(std::min(config.counts, 4294967295.0));
        counting_ = {counts_, static_cast<std::uint32_t>(averages() ? config.window : 1)};
        counting_period_ = averages() ? current_period : speed_period;
        const double late = config.latency / current_period;
        late_ = static_cast<std::size_t>(late + 1e-9);
        later_ = std::max(0.0, late - static_cast<double>(late_));
        current_period_ = current_period;
        State unused;
        prepare(unused, current_period);
        start_ = unused;
    }

    State start(double theta_m, double omega_m) const {
        State s;
        restart(s, theta_m, omega_m);
        return s;
    }

    // start() in a state of this sensor, which keeps its memory.
    void restart(State& s, double theta_m, double omega_m) const {
        s = start_;
        if (config_.kind == PositionSensorKind::ideal) return;
        // as if the rotor had turned at this speed before
        for (std::size_t n = 0; n < s.past.size(); ++n) {
            s.past[s.past.size() - 1 - n] = {theta_m - omega_m * current_period_ * static_cast<double>(n + 1), omega_m};
        }
        s.newest = s.past.empty() ? 0 : s.past.size() - 1;
        theta_m -= omega_m * config_.latency;
        s.theta_before = seen(theta_m);
        s.count = count(s.theta_before);
        s.omega_m = omega_m;
        for (std::uint32_t n = 0; n < counting_.window; ++n) {
            s.before[n] = low(count(seen(theta_m - omega_m * counting_period_ * (counting_.window - n))));
        }
        const double edge_period = omega_m != 0.0 ? step_ / std::abs(omega_m) : 1e9;
        const double behind = s.theta_before / step_ - static_cast<double>(s.count);
        const double since = (omega_m < 0.0 ? 1.0 - behind : behind) * edge_period;
        s.edges = {low(s.count), 0U - ticks_of(since), ticks_of(edge_period), omega_m < 0.0, false};
        cgl_speed_timed_reset(&s.timed, &s.edges, 0U, static_cast<cgl_real>(omega_m));
        cgl_encoder_reset(&s.encoder, low(s.count));
        cgl_encoder_place(&s.encoder, position(s.count));
        cgl_angle_observer_reset(&s.observer, s.encoder.turns, static_cast<cgl_real>(omega_m));
        if (config_.kind == PositionSensorKind::hall) start_hall(s, theta_m, omega_m, edge_period);
    }

    // Whether edges must be timed between samples.
    bool watches() const {
        return config_.kind == PositionSensorKind::hall || config_.speed_method == SpeedMethod::T ||
               config_.speed_method == SpeedMethod::MT;
    }

    // Whether, between two of its edges, the sensor shows the same angle and speed until the law runs again.
    bool rests_between_edges() const {
        return watches() && config_.kind != PositionSensorKind::hall && config_.kind != PositionSensorKind::ideal && config_.error.empty() &&
               config_.error_table.empty() && config_.latency <= 0.0;
    }

    // Angles low and high, rad: the count stays for low <= theta < high. They lie inside the count's step by a rounding error, to be sure.
    std::pair<double, double> bounds(const State& s) const {
        const double low = static_cast<double>(s.count) * step_, high = static_cast<double>(s.count + 1) * step_;
        return {low + 0x1p-50 * std::abs(low), high - 0x1p-50 * std::abs(high)};
    }
    double angle(const State& s) const { return wrapped(static_cast<double>(s.count) * step_); }  // rad, that the sensor shows

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
                return clocked(from + (edge_at(boundary) - s.theta_before) * rate);
            };
            const std::uint32_t edge = when(last), edge_before = first == last ? s.edges.time : when(last - direction);
            const bool backward = direction < 0;
            s.edges = {low(now), edge, edge - edge_before, backward, first == last && backward != s.edges.backward};
            s.count = now;
        }
        s.theta_before = theta;
    }

    // Measures, once per current-loop period; speed_sample: the speed loop runs in it too.
    [[gnu::always_inline]] Measurement sample(State& s, double time, double theta_m, double omega_m, bool speed_sample,
                                              const AngleCorrection& correction) const {
        if (config_.kind == PositionSensorKind::ideal) return {wrapped(theta_m), omega_m};
        if (config_.kind == PositionSensorKind::hall) return sample_hall(s, time);
        if (!s.past.empty()) theta_m = old(s, theta_m, omega_m);
        if (!watches()) s.count = count(seen(theta_m));
        const double theta = corrected(s, angle(s), correction);
        const bool observed = config_.speed_method == SpeedMethod::observer;
        if (observed || speed_sample || averages()) s.omega_m = speed(s, time, correction.table);
        return {theta, s.omega_m};
    }

private:
    static constexpr double turn = 2.0 * std::numbers::pi;

    static double wrapped(double theta) { return theta - turn * round_down(theta / turn); }

    bool averages() const { return config_.speed_method == SpeedMethod::average; }

    // The sensor's angle without its own error. The call also learns that error.
    static double corrected(const State& s, double theta, const AngleCorrection& correction) {
        if (correction.table == nullptr) return theta;
        cgl_measurement now{};
        now.theta_m = correction.missing ? std::numeric_limits<cgl_real>::quiet_NaN() : static_cast<cgl_real>(theta);
        now.omega_m = static_cast<cgl_real>(s.omega_m);
        cgl_encoder_table_step(correction.table, &now, correction.i_q, true);
        return correction.missing ? theta : static_cast<double>(now.theta_m);
    }

    double seen(double theta_m) const {
        double error = 0.0;
        for (const AngleOrder& e : config_.error) error += e.amplitude * sine(e.order * theta_m + e.phase);
        if (!config_.error_table.empty()) error += config_.error_table.periodic(theta_m);
        return theta_m + error;
    }

    // Stores the present angle and speed, and returns the true angle `latency` ago, by a cubic polynomial between two samples.
    double old(State& s, double theta_m, double omega_m) const {
        const std::size_t size = s.past.size();
        s.newest = s.newest + 1 < size ? s.newest + 1 : 0;
        s.past[s.newest] = {theta_m, omega_m};
        const auto ago = [&](std::size_t n) { return s.past[s.newest >= n ? s.newest - n : s.newest + size - n]; };
        const Measurement b = ago(late_);
        if (later_ < 1e-9) return b.theta_m;
        const Measurement a = ago(late_ + 1);
        const double h = current_period_, u = 1.0 - later_, moved = b.theta_m - a.theta_m;
        return a.theta_m + u * (h * a.omega_m + u * (3.0 * moved - h * (2.0 * a.omega_m + b.omega_m) +
                                                     u * (h * (a.omega_m + b.omega_m) - 2.0 * moved)));
    }

    // The angle at which the sensor changes from step `boundary` - 1 to step `boundary`, rad.
    double edge_at(std::int64_t boundary) const {
        const double even = static_cast<double>(boundary) * step_;
        return config_.kind == PositionSensorKind::hall ? even + config_.placement[sector(boundary)] : even;
    }

    static std::size_t sector(std::int64_t count) { return static_cast<std::size_t>((count % 6 + 6) % 6); }

    std::int64_t count(double theta) const {
        const double counts = round_down(theta / step_);
        if (!(std::abs(counts) < 9e18)) return 0;  // a run with such an angle ends anyway
        const auto even = static_cast<std::int64_t>(counts);
        if (config_.kind != PositionSensorKind::hall) return even;
        return theta < edge_at(even) ? even - 1 : (theta >= edge_at(even + 1) ? even + 1 : even);
    }

    Measurement sample_hall(State& s, double time) const {
        cgl_hall_step(&s.hall, static_cast<std::uint32_t>(sector(s.count)), s.edges.time, clocked(time));
        s.omega_m = static_cast<double>(s.hall.omega_m);
        return {static_cast<double>(cgl_radians(s.hall.turns)), s.omega_m};
    }

    // Gives the Hall estimator the last edges, as if the rotor had passed them at this speed, unless they are too old for the timer.
    void start_hall(State& s, double theta_m, double omega_m, double edge_period) const {
        constexpr std::int64_t before = 7;
        const std::int64_t way = omega_m < 0.0 ? -1 : 1, first = s.count - before * way;
        const bool timed = static_cast<double>(before + 1) * edge_period * config_.timer < 2e9;
        cgl_hall_reset(&s.hall, position(timed ? first : s.count));
        for (std::int64_t n = first + way; timed && n != s.count + way; n += way) {
            const std::uint32_t edge = clocked((edge_at(way > 0 ? n : n + 1) - theta_m) / omega_m);
            cgl_hall_step(&s.hall, static_cast<std::uint32_t>(sector(n)), edge, edge);
            s.edges.time = edge;
        }
    }

    static std::uint32_t low(std::int64_t count) { return static_cast<std::uint32_t>(static_cast<std::uint64_t>(count)); }

    std::uint32_t position(std::int64_t count) const {
        const std::int64_t counts = counts_, rest = count % counts;
        return static_cast<std::uint32_t>(rest < 0 ? rest + counts : rest);
    }

    // The timer's count, of 32 bits, at a time, s.
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
        if (watches() && config_.kind != PositionSensorKind::hall) {
            const cgl_speed_timed_config timing = {counts_, static_cast<cgl_real>(config_.timer),
                                                   config_.speed_method == SpeedMethod::T};
            require(cgl_speed_timed_init(&s.timed, &timing), "speed by the time of edges");
        }
        if (config_.kind == PositionSensorKind::hall) {
            const cgl_hall_config hall = {counts_ / 6U, static_cast<std::uint32_t>(config_.window),
                                          static_cast<cgl_real>(config_.timer)};
            require(cgl_hall_init(&s.hall, &hall), "Hall sensors");
        }
        if (config_.latency > 0.0) s.past.resize(late_ + 2);
        if (config_.speed_method != SpeedMethod::observer) return;
        const cgl_encoder_config encoder = {counts_, 0U, 0U, false, false};
        const cgl_angle_observer_config observer = {static_cast<cgl_real>(config_.bandwidth)};
        require(cgl_encoder_init(&s.encoder, &encoder, 0U), "encoder");
        require(cgl_angle_observer_init(&s.observer, &observer, static_cast<cgl_real>(current_period)), "speed observer");
    }

    // Estimates the speed, from corrected angles if there is a table.
    double speed(State& s, double time, const cgl_encoder_table* table) const {
        if (config_.speed_method == SpeedMethod::observer) {
            cgl_encoder_step(&s.encoder, low(s.count));
            cgl_angle_observer_step(&s.observer, table == nullptr ? s.encoder.turns : cgl_encoder_table_turns(table, s.encoder.turns));
            return static_cast<double>(s.observer.omega);
        }
        s.counted.before = s.before.data();
        const cgl_real omega_m = watches() ? cgl_speed_timed_step(&s.timed, &s.edges, clocked(time))
                                           : cgl_speed_count_step(&s.counted, low(s.count));
        if (table == nullptr) return static_cast<double>(omega_m);
        return static_cast<double>(cgl_encoder_table_speed(table, omega_m, watches() ? s.timed.time : s.counted.time));
    }

    PositionSensorConfig config_;
    double step_ = 0.0;  // rad per count
    std::uint32_t counts_ = 0;
    cgl_speed_count_config counting_{};
    double counting_period_ = 0.0;  // s
    double current_period_ = 0.0;   // s
    std::size_t late_ = 0;          // latency in whole current-loop periods
    double later_ = 0.0;            // rest of the latency, in current-loop periods
    State start_;
};

}  // namespace cogless
