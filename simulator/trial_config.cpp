#include "trial_config.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace cogless {

namespace {

// Copies the numbers of a list to an array of the C configuration; returns how many.
template <std::size_t Capacity>
std::uint32_t fill(cgl_real (&to)[Capacity], const Section& s, const char* key) {
    const auto values = s.get<std::vector<double>>(key);
    if (values.size() > Capacity) s.refuse(key, "expected at most " + std::to_string(Capacity) + " numbers");
    for (std::size_t n = 0; n < values.size(); ++n) to[n] = static_cast<cgl_real>(values[n]);
    return static_cast<std::uint32_t>(values.size());
}

void fill_states(cgl_real (&to)[CGL_TRIAL_STATES], const Section& s, const char* key, std::uint32_t states) {
    if (fill(to, s, key) != states) s.refuse(key, "expected " + std::to_string(states) + " numbers");
}

cgl_feedforward_config feedforward(const Section& s) {
    cgl_feedforward_config f{};
    f.numerator = fill(f.num, s, "num");
    f.denominator = fill(f.den, s, "den");
    f.preview = s.get<std::uint32_t>("preview");
    return f;
}

cgl_zero_phase_config q_filter(const Section& s, std::uint32_t samples) {
    cgl_zero_phase_config q{};
    const std::uint32_t count = fill(q.b, s, "b");
    if (fill(q.a, s, "a") != count || count == 1) s.refuse("a", "expected as many numbers as in b, none or at least two");
    q.order = count > 0 ? count - 1 : 0;
    if (q.order > 0 && samples <= CGL_ZERO_PHASE_PAD(q.order)) {
        s.refuse("a", "expected trials longer than " + std::to_string(CGL_ZERO_PHASE_PAD(q.order)) +
                          " samples with a filter of this order");
    }
    return q;
}

std::shared_ptr<const std::vector<cgl_real>> learning_matrix(const Section& s, std::uint32_t samples) {
    if (!s.has("learning_matrix")) return nullptr;
    const auto matrix = s.get<Value::Matrix>("learning_matrix");
    if (matrix.rows != samples || matrix.columns != samples) {
        s.refuse("learning_matrix", "expected " + std::to_string(samples) + " rows and columns");
    }
    return std::make_shared<const std::vector<cgl_real>>(matrix.data.begin(), matrix.data.end());
}

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

TrialLaw trial_law(const Section& s, std::uint32_t states, std::uint32_t samples) {
    TrialLaw law{};
    cgl_trial_config& c = law.config;
    c.samples = samples;
    c.states = states;
    fill_states(c.k_1, s, "K_1", states);
    fill_states(c.c, s, "C", states);
    c.k_2 = s.real("K_2");
    c.n = s.real("N");
    c.through_integrator = s.get<bool>("through_integrator");
    c.k_3 = s.real("K_3");
    c.shift = s.get<std::uint32_t>("shift");
    if (c.shift >= samples) s.refuse("shift", "expected less than the samples of a trial");
    c.feedforward = feedforward(s.section("feedforward"));
    c.q_filter = q_filter(s.section("q_filter"), samples);
    c.filter_signal = s.has("filter_signal") && s.get<bool>("filter_signal");
    law.learning_matrix = learning_matrix(s, samples);
    c.learning_matrix = law.learning_matrix ? law.learning_matrix->data() : nullptr;
    c.limit = s.real("limit");
    c.learned_limit = s.real("learned_limit");
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
    LinearTrialsConfig result{{}, top.numbers("C", states), top.number("period"), trials,
                              trial_law(top.section("controller"), static_cast<std::uint32_t>(states),
                                        static_cast<std::uint32_t>(samples))};
    std::int64_t before = -1;
    for (const Section& s : top.sections("phases")) {
        before = first_trial(s, before, trials);
        result.phases.push_back({before, matrix(s, "A", states), s.numbers("B", states),
                                 s.numbers("initial_state", states), s.numbers("load", samples),
                                 reals(s.numbers("reference", samples))});
    }
    if (result.phases.empty()) top.refuse("phases", "expected one or more");
    return result;
}

}  // namespace cogless
