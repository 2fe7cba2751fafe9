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

private:
    std::int64_t number_, since_;
};

}  // namespace cogless
