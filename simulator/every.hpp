// Ticks that are multiples of a number.
#pragma once

#include <cstdint>

namespace cogless {

// next() returns whether a tick is a multiple of `number`, for one tick after another from `first` on. A division for each tick
// would take longer.
class Every {
public:
    Every(std::int64_t number, std::int64_t first) : number_(number), since_(first % number) {}

    [[gnu::always_inline]] bool next() {
        const bool is_multiple = since_ == 0;
        since_ = since_ + 1 < number_ ? since_ + 1 : 0;
        return is_multiple;
    }

    // The number of calls of next() before it returns true.
    std::int64_t wait() const { return since_ == 0 ? 0 : number_ - since_; }

    // Goes on by as many ticks as next() would be called, none of which is a multiple.
    void skip(std::int64_t ticks) { since_ = (since_ + ticks) % number_; }

private:
    std::int64_t number_, since_;
};

}  // namespace cogless
