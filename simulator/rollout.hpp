// Many drives at once, on threads.
#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <thread>
#include <vector>

#include "drive.hpp"

namespace cogless {

struct Rollout {
    const Drive* drive;
    DriveState* state;
    Recorder* recorder;
    std::int64_t ticks;
};

// Advances each of them. If any throws, the others still run to their end, then the first one's exception is thrown.
inline void rollout(const std::vector<Rollout>& runs, unsigned threads) {
    std::atomic<std::size_t> next{0};
    std::vector<std::exception_ptr> errors(runs.size());
    const auto work = [&] {
        for (std::size_t n = next++; n < runs.size(); n = next++) {
            try {
                runs[n].drive->advance(*runs[n].state, *runs[n].recorder, runs[n].ticks);
            } catch (...) {
                errors[n] = std::current_exception();
            }
        }
    };
    {
        std::vector<std::jthread> workers;
        for (unsigned n = 1; n < threads; ++n) workers.emplace_back(work);
        work();
    }
    for (const std::exception_ptr& error : errors) {
        if (error) std::rethrow_exception(error);
    }
}

}  // namespace cogless
