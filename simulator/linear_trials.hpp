// Any linear plant in discrete time under the trial law: x(p + 1) = A x(p) + B (u(p) - d(p)), y = C x.
//
// It serves to try designs on plants that are not drives. One tick is one sample. The law sees the states with noise; a recorded row
// has the true states.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "random.hpp"
#include "recorder.hpp"
#include "trial_law.hpp"
#include "trials.hpp"

namespace cogless {

// What differs from trial to trial at random: deviations of the load, and of the initial state, one for each state.
struct LinearSpread {
    std::vector<Deviation> initial_state;
    Deviation load;
};

// A phase: the plant from some trial on, and the initial state of each of its trials.
struct LinearPhase {
    std::int64_t from;
    std::vector<double> A;  // row by row
    std::vector<double> B, initial_state;
    std::vector<double> load;         // d at each sample of a trial
    std::vector<cgl_real> reference;  // y's reference at each sample of a trial
    std::optional<LinearSpread> each_trial;
};

struct LinearTrialsConfig {
    std::vector<LinearPhase> phases;  // ordered by `from`
    std::vector<double> C;
    double period;  // s
    std::vector<double> noise;  // standard deviation of the white noise on each measured state
    double load_noise;          // standard deviation of white noise on d
    std::uint64_t seed;
    Trials trials;
    TrialLaw law;
};

struct LinearTrialsState {
    std::int64_t tick = 0;
    std::array<double, CGL_TRIAL_STATES> x{};
    double load_deviation = 0.0;  // deviation of d in this trial
    Random random{0};             // source of the noise
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
    // Sets the plant to the initial state of a trial, and draws the trial's deviations.
    void restart(LinearTrialsState& state, const LinearPhase& phase, std::int64_t trial) const;
    // Sample p of a trial: steps the law, records a row and moves to the next sample.
    void step(LinearTrialsState& state, Recorder& recorder, const LinearPhase& phase, std::int64_t trial,
              std::size_t p) const;

    LinearTrialsConfig config_;
    std::vector<Signal> signals_;
};

}  // namespace cogless
