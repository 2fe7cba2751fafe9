// Any linear plant in discrete time under the trial law: x(p + 1) = A x(p) + B (u(p) - d(p)), y = C x.
//
// One tick is one sample. For designs to be tried on plants that are no drive.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recorder.hpp"
#include "trial_law.hpp"
#include "trials.hpp"

namespace cogless {

// The plant from a trial on, and where each of its trials starts.
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

    // Runs so many samples. Throws std::runtime_error where the plant's states grow beyond all numbers, and
    // std::invalid_argument, running none, where there are not so many trials.
    void advance(LinearTrialsState& state, Recorder& recorder, std::int64_t ticks) const;

    const LinearTrialsConfig& config() const { return config_; }

private:
    // Sample p of a trial: law, row, and on to the next one.
    void step(LinearTrialsState& state, Recorder& recorder, const LinearPhase& phase, std::int64_t trial,
              std::size_t p) const;

    LinearTrialsConfig config_;
    std::vector<Signal> signals_;
};

}  // namespace cogless
