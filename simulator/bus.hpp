// A bus between the drive and its law, which runs elsewhere, as on a PC. The law sees angle and speed as the drive measured them
// some time ago, and its current reference reaches the drive some time later, in whole steps of the bus's number format. Each
// way may take longer by a random part of `jitter`. A command never overtakes an earlier one.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "maths.hpp"
#include "position_sensor.hpp"
#include "random.hpp"

namespace cogless {

struct BusConfig {
    double delay_measured;  // s, from the drive's measurement to the law
    double delay_command;   // s, from the law to the drive
    double jitter;          // s, the most by which each delay may be longer, evenly distributed
    double quantum;         // A, step of the q-axis current reference; 0: not rounded
};

struct BusCommand {
    double i_q_ref, i_d_ref;  // A
};

struct SentCommand {
    std::int64_t at;  // tick at which it reaches the drive
    BusCommand command;
};

class Bus {
public:
    struct State {
        std::vector<Measurement> past;  // a ring: measurements of the last ticks, the newest at `newest`
        std::size_t newest = 0;
        std::vector<SentCommand> sent;  // a ring: `waiting` of them from `first` on
        std::size_t first = 0, waiting = 0;
        Random random{0};
    };

    // current_period, law_period: s.
    Bus(const BusConfig& config, double current_period, double law_period) : config_(config), rate_(1.0 / current_period) {
        start_.past.resize(static_cast<std::size_t>(ticks(config.delay_measured + config.jitter)) + 1);
        start_.sent.resize(static_cast<std::size_t>((config.delay_command + config.jitter) / law_period) + 2);
    }

    // Sets the past as if the rotor had turned at this speed before, and drops the commands on their way. `random` goes on as it was.
    void restart(State& s, double theta_m, double omega_m) const {
        const Random random = s.random;
        s = start_;
        s.random = random;
        s.newest = s.past.size() - 1;
        for (std::size_t n = 0; n < s.past.size(); ++n) {
            const double theta = theta_m - omega_m / rate_ * static_cast<double>(n + 1);
            s.past[s.newest - n] = {theta - turn * round_down(theta / turn), omega_m};
        }
    }

    // Stores what the drive measures in this tick.
    void measure(State& s, Measurement now) const {
        s.newest = s.newest + 1 < s.past.size() ? s.newest + 1 : 0;
        s.past[s.newest] = now;
    }

    // The measurement that reaches the law in this tick.
    Measurement arrived(State& s) const {
        const auto late = static_cast<std::size_t>(drawn(s, config_.delay_measured));
        return s.past[s.newest >= late ? s.newest - late : s.newest + s.past.size() - late];
    }

    void send(State& s, std::int64_t tick, BusCommand command) const {
        std::int64_t at = tick + drawn(s, config_.delay_command);
        const std::size_t size = s.sent.size();
        if (s.waiting > 0) at = std::max(at, s.sent[(s.first + s.waiting - 1) % size].at);
        if (config_.quantum > 0.0) command.i_q_ref = config_.quantum * std::round(command.i_q_ref / config_.quantum);
        s.sent[(s.first + s.waiting++) % size] = {at, command};
    }

    // The last command that has reached the drive in this tick; null if none has.
    const BusCommand* received(State& s, std::int64_t tick) const {
        const BusCommand* last = nullptr;
        while (s.waiting > 0 && s.sent[s.first].at <= tick) {
            last = &s.sent[s.first].command;
            s.first = (s.first + 1) % s.sent.size();
            --s.waiting;
        }
        return last;
    }

private:
    static constexpr double turn = 2.0 * std::numbers::pi;

    // A time, s, in ticks, rounded up.
    std::int64_t ticks(double time) const { return static_cast<std::int64_t>(std::ceil(time * rate_ - 1e-9)); }

    std::int64_t drawn(State& s, double delay) const {
        return ticks(config_.jitter > 0.0 ? delay + config_.jitter * s.random.uniform() : delay);
    }

    BusConfig config_;
    double rate_;  // Hz, of the current loop
    State start_;
};

}  // namespace cogless
