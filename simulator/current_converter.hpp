// What a phase-current sensor does to a current, for several numbers at once.
#pragma once

#include "wide.hpp"

namespace cogless {

template <class Real>
[[gnu::always_inline]] inline Real with_gain(const Real& i, const Real& gain_error, const Real& offset) {
    return i + (gain_error * i + offset);
}

// Rounds to the nearest step, halves away from zero. NaN becomes the lowest step. per_step: the inverse of `step`.
template <class Real>
[[gnu::always_inline]] inline Real converted(const Real& i, const Real& lowest, const Real& highest, const Real& step, const Real& per_step) {
    const Real below = select(i > highest, highest, i);
    const Real steps = select(below > lowest, below, lowest) * per_step;
    return step * truncated(steps + select(Real(0.0) > steps, Real(-0.5), Real(0.5)));
}

}  // namespace cogless
