#include "linear_trials.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace cogless {

namespace {

std::vector<Signal> signals_of(const LinearTrialsConfig& config) {
    std::vector<Signal> all{{"time", "s"}, {"trial", ""}, {"y_ref", ""}, {"y", ""}, {"u", ""}, {"load", ""}};
    for (std::size_t n = 1; n <= config.C.size(); ++n) all.push_back({"x_" + std::to_string(n), ""});
    all.push_back({"status", ""});
    for (const Term& term : config.law.terms()) all.push_back({term.name, ""});
    all.push_back({"learned", ""});
    return all;
}

const Normal normal;

}  // namespace

LinearTrials::LinearTrials(const LinearTrialsConfig& config) : config_(config), signals_(signals_of(config)) {
    config_.law.start();
}

LinearTrialsState LinearTrials::start() const {
    LinearTrialsState s;
    s.law = config_.law.start();
    s.random = Random(config_.seed);
    return s;
}

void LinearTrials::restart(LinearTrialsState& s, const LinearPhase& phase, std::int64_t trial) const {
    std::copy(phase.initial_state.begin(), phase.initial_state.end(), s.x.begin());
    s.load_deviation = 0.0;
    if (!phase.each_trial) return;
    Random random = random_of_trial(config_.seed, trial);
    for (std::size_t n = 0; n < config_.C.size(); ++n) s.x[n] += phase.each_trial->initial_state[n].draw(random);
    s.load_deviation = phase.each_trial->load.draw(random);
}

void LinearTrials::advance(LinearTrialsState& s, Recorder& recorder, std::int64_t ticks) const {
    const std::int64_t samples = config_.trials.samples, end = s.tick + ticks;
    require_trials(config_.trials, end);
    recorder.reserve(s.tick, ticks);
    while (s.tick < end) {
        const std::int64_t trial = s.tick / samples, origin = trial * samples;
        const LinearPhase& phase = config_.phases[phase_of(config_.phases, trial)];
        if (s.tick == origin) {
            restart(s, phase, trial);
            config_.law.begin(s.law, phase.reference);
        }
        for (const std::int64_t until = std::min(end, origin + samples); s.tick < until; ++s.tick) {
            step(s, recorder, phase, trial, static_cast<std::size_t>(s.tick - origin));
        }
        if (s.tick == origin + samples) config_.law.end(s.law);
    }
}

void LinearTrials::step(LinearTrialsState& s, Recorder& recorder, const LinearPhase& phase, std::int64_t trial,
                        std::size_t p) const {
    const std::size_t states = config_.C.size();
    double y = 0.0;
    for (std::size_t n = 0; n < states; ++n) {
        if (!std::isfinite(s.x[n])) fail_in_trial(trial, "the plant's states grew beyond all numbers: expected smaller gains");
        y += config_.C[n] * s.x[n];
        double measured = s.x[n];
        if (config_.noise[n] > 0.0) measured += config_.noise[n] * normal.draw(s.random);
        s.law.input.x[n] = static_cast<cgl_real>(measured);
    }
    double load = phase.load[p] + s.load_deviation;
    if (config_.load_noise > 0.0) load += config_.load_noise * normal.draw(s.random);
    s.law.input.learn = true;
    const cgl_trial_output out = config_.law.step(s.law);
    const auto u = static_cast<double>(out.u);

    if (recorder.wants(s.tick)) {
        double* row = recorder.next_row();
        const double first[] = {static_cast<double>(s.tick) * config_.period, static_cast<double>(trial + 1),
                                static_cast<double>(phase.reference[p]), y, u, load};
        row = std::copy(std::begin(first), std::end(first), row);
        row = std::copy_n(s.x.begin(), states, row);
        *row++ = static_cast<double>(out.status);
        row = config_.law.put_terms(s.law, row);
        *row = static_cast<double>(s.law.law.v);
    }

    std::array<double, CGL_TRIAL_STATES> next{};
    for (std::size_t n = 0; n < states; ++n) {
        const double* a = phase.A.data() + n * states;
        for (std::size_t m = 0; m < states; ++m) next[n] += a[m] * s.x[m];
        next[n] += phase.B[n] * (u - load);
    }
    s.x = next;
}

}  // namespace cogless
