// The configuration of trials and of the law that learns between them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "linear_trials.hpp"
#include "section.hpp"
#include "trial_law.hpp"
#include "trials.hpp"

namespace cogless {

// The numbers converted to the control laws' type.
std::vector<cgl_real> reals(const std::vector<double>& values);

// Number of samples and of trials.
Trials read_trials(const Section& s);

// First trial of a phase. It must be later than `before`, the first trial of the previous phase; for the first phase
// `before` is -1 and the trial is 0.
std::int64_t first_trial(const Section& phase, std::int64_t before, const Trials& trials);

// A deviation that is drawn in each trial.
Deviation deviation(const Section& s);

// states: number of states of the controlled plant.
TrialLaw trial_law(const Section& s, std::size_t states, const Trials& trials);

// Like the functions above, throws std::invalid_argument naming the key that's missing or of the wrong type, length or order.
LinearTrialsConfig read_linear_trials(const Value& description);

}  // namespace cogless
