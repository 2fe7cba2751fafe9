// Trials: repetitions of equal length, one after the other, between which a law learns.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace cogless {

struct Trials {
    std::int64_t samples;  // samples of the law in a trial
    std::int64_t count;
};

// Throws std::invalid_argument if the trials have fewer than `samples` samples in total.
inline void require_trials(const Trials& trials, std::int64_t samples) {
    if (samples > trials.samples * trials.count) {
        throw std::invalid_argument("there are only " + std::to_string(trials.count) + " trials");
    }
}

// Throws std::runtime_error naming the trial, from 0, in which something failed.
[[noreturn]] inline void fail_in_trial(std::int64_t trial, const std::string& why) {
    throw std::runtime_error("trial " + std::to_string(trial + 1) + ": " + why);
}

// Index of the phase that a trial belongs to: the last phase whose `from` is not beyond the trial. The first phase has
// `from` 0.
template <class Phase>
std::size_t phase_of(const std::vector<Phase>& phases, std::int64_t trial) {
    const auto beyond = std::upper_bound(phases.begin(), phases.end(), trial,
                                         [](std::int64_t t, const Phase& p) { return t < p.from; });
    return static_cast<std::size_t>(beyond - phases.begin()) - 1;
}

}  // namespace cogless
