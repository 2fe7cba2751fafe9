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

}  // namespace

LinearTrials::LinearTrials(const LinearTrialsConfig& config) : config_(config), signals_(signals_of(config)) {
    config_.law.start();
}

LinearTrialsState LinearTrials::start() const {
    LinearTrialsState s;
    s.law = config_.law.start();
    return s;
}

void LinearTrials::advance(LinearTrialsState& s, Recorder& recorder, std::int64_t ticks) const {
    const std::int64_t samples = config_.trials.samples, end = s.tick + ticks;
    require_trials(config_.trials, end);
    recorder.reserve(ticks);
    while (s.tick < end) {
        const std::int64_t trial = s.tick / samples, origin = trial * samples;
        const LinearPhase& phase = config_.phases[phase_of(config_.phases, trial)];
        if (s.tick == origin) {
            std::copy(phase.initial_state.begin(), phase.initial_state.end(), s.x.begin());
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
        s.law.input.x[n] = static_cast<cgl_real>(s.x[n]);
    }
    s.law.input.learn = true;
    const cgl_trial_output out = config_.law.step(s.law);
    const auto u = static_cast<double>(out.u);

    if (recorder.wants(s.tick)) {
        double* row = recorder.next_row();
        const double first[] = {static_cast<double>(s.tick) * config_.period, static_cast<double>(trial + 1),
                                static_cast<double>(phase.reference[p]), y, u, phase.load[p]};
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
        next[n] += phase.B[n] * (u - phase.load[p]);
    }
    s.x = next;
}

}  // namespace cogless
