// Trials: repetitions of equal length, one after the other, between which a law learns.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "random.hpp"

namespace cogless {

struct Trials {
    std::int64_t samples;  // samples of the law in a trial
    std::int64_t count;
};

// A deviation that is drawn anew in each trial, around zero.
struct Deviation {
    bool normal;  // false: uniform
    double size;  // standard deviation; of a uniform deviation the largest magnitude

    double draw(Random& random) const {
        return size * (normal ? distribution_.draw(random) : 2.0 * random.uniform() - 1.0);
    }

private:
    inline static const Normal distribution_;
};

// A trial's own stream of random numbers. It depends on nothing but the seed and the trial, from 0, so all controllers get
// the same starts and loads. It differs from the streams of sensors and bus.
inline Random random_of_trial(std::uint64_t seed, std::int64_t trial) {
    Random seeds(seed ^ 0x747269616c73U);
    seeds.skip(static_cast<std::uint64_t>(trial));
    return Random(seeds.bits());
}

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
