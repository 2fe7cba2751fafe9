#include "trial_config.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace cogless {

namespace {

// A square matrix, row by row, of finite numbers.
std::vector<double> matrix(const Section& s, const char* key, std::size_t size) {
    const auto rows = s.get<std::vector<std::vector<double>>>(key);
    std::vector<double> all;
    for (const std::vector<double>& row : rows) {
        if (row.size() == size) all.insert(all.end(), row.begin(), row.end());
    }
    if (rows.size() != size || all.size() != size * size) {
        s.refuse(key, "expected " + std::to_string(size) + " rows and columns");
    }
    if (!std::all_of(all.begin(), all.end(), [](double x) { return std::isfinite(x); })) {
        s.refuse(key, "expected finite numbers");
    }
    return all;
}

std::optional<LinearSpread> spread(const Section& phase, std::size_t states) {
    if (!phase.has("each_trial")) return {};
    const Section s = phase.section("each_trial");
    LinearSpread all{{}, deviation(s.section("load"))};
    for (const Section& one : s.sections("initial_state")) all.initial_state.push_back(deviation(one));
    if (all.initial_state.size() != states) s.refuse("initial_state", "expected " + std::to_string(states) + " deviations");
    return all;
}

}  // namespace

std::vector<cgl_real> reals(const std::vector<double>& values) { return {values.begin(), values.end()}; }

Trials read_trials(const Section& s) {
    const Trials trials{s.get<std::uint32_t>("samples"), s.get<std::uint32_t>("count")};
    if (trials.samples < 1) s.refuse("samples", "expected 1 or more");
    if (trials.count < 1) s.refuse("count", "expected 1 or more");
    return trials;
}

std::int64_t first_trial(const Section& phase, std::int64_t before, const Trials& trials) {
    const auto from = phase.get<std::int64_t>("from");
    if (before < 0 && from != 0) phase.refuse("from", "expected 0 in the first phase");
    if (from <= before) phase.refuse("from", "expected more than in the phase before");
    if (from >= trials.count) phase.refuse("from", "expected less than the number of trials");
    return from;
}

Deviation deviation(const Section& s) {
    const Deviation d{s.choice<bool>("form", {{"normal", true}, {"uniform", false}}), s.number("size")};
    if (!(d.size >= 0.0 && std::isfinite(d.size))) s.refuse("size", "expected 0 or more");
    return d;
}

TrialLaw trial_law(const Section& s, std::size_t states, const Trials& trials) {
    const auto law = TrialLaw::of(s, {});
    if (law.config.states != states) s.refuse("config", "expected " + std::to_string(states) + " states");
    if (law.config.samples != trials.samples) {
        s.refuse("config", "expected " + std::to_string(trials.samples) + " samples");
    }
    return law;
}

LinearTrialsConfig read_linear_trials(const Value& description) {
    const Section top(description, "");
    const Trials trials = read_trials(top);
    const auto samples = static_cast<std::size_t>(trials.samples);
    const std::size_t states = top.get<std::vector<double>>("C").size();
    if (states < 1 || states > CGL_TRIAL_STATES) {
        top.refuse("C", "expected 1 to " + std::to_string(CGL_TRIAL_STATES) + " numbers");
    }
    if (!(top.number("period") > 0.0)) top.refuse("period", "expected more than 0");
    LinearTrialsConfig result{{}, top.numbers("C", states), top.number("period"), top.numbers("noise", states),
                              top.number("load_noise"), top.get<std::uint64_t>("seed"), trials,
                              trial_law(top.section("controller"), states, trials)};
    std::int64_t before = -1;
    for (const Section& s : top.sections("phases")) {
        before = first_trial(s, before, trials);
        result.phases.push_back({before, matrix(s, "A", states), s.numbers("B", states),
                                 s.numbers("initial_state", states), s.numbers("load", samples),
                                 reals(s.numbers("reference", samples)), spread(s, states)});
    }
    if (result.phases.empty()) top.refuse("phases", "expected one or more");
    return result;
}

}  // namespace cogless
