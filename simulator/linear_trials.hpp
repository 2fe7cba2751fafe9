// Any linear plant in discrete time under the trial law: x(p + 1) = A x(p) + B (u(p) - d(p)), y = C x.
//
// One tick is one sample. This tries designs on plants that are not drives.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recorder.hpp"
#include "trial_law.hpp"
#include "trials.hpp"

namespace cogless {

// A phase: the plant from some trial on, and the initial state of each of its trials.
struct LinearPhase {
    std::int64_t from;
    std::vector<double> A;  // row by row
    std::vector<double> B, initial_state;
    std::vector<double> load;         // d, at each sample of a trial
    std::vector<cgl_real> reference;  // likewise
};

struct LinearTrialsConfig {
    std::vector<LinearPhase> phases;  // by `from`
    std::vector<double> C;
    double period;  // s
    Trials trials;
    TrialLaw law;
};

struct LinearTrialsState {
    std::int64_t tick = 0;
    std::array<double, CGL_TRIAL_STATES> x{};
    TrialLaw::State law;
};

class LinearTrials {
public:
    // Throws std::invalid_argument for a configuration that the law refuses.
    explicit LinearTrials(const LinearTrialsConfig& config);

    const std::vector<Signal>& signals() const { return signals_; }

    LinearTrialsState start() const;

    // Runs `ticks` samples. Throws std::runtime_error if the plant's states overflow. Throws std::invalid_argument, and runs
    // nothing, if the samples exceed the number of trials.
    void advance(LinearTrialsState& state, Recorder& recorder, std::int64_t ticks) const;

    const LinearTrialsConfig& config() const { return config_; }

private:
    // Sample p of a trial: steps the law, records a row and moves to the next sample.
    void step(LinearTrialsState& state, Recorder& recorder, const LinearPhase& phase, std::int64_t trial,
              std::size_t p) const;

    LinearTrialsConfig config_;
    std::vector<Signal> signals_;
};

}  // namespace cogless
