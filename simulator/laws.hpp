// Every law that a drive can run, and its state: those of laws.def, and a user's own.
#pragma once

#include <variant>

#include "c_law.hpp"
#include "own_law.hpp"
#include "trial_law.hpp"

namespace cogless {

using PiLaw = CLaw<pi_row>;
using PiIlcLaw = CLaw<pi_ilc_row>;
using RobustIlcLaw = CLaw<robust_ilc_row>;
using AntiCoggingLaw = CLaw<anti_cogging_row>;
using SpacePositionLaw = CLaw<space_position_row>;
using SpaceSpeedLaw = CLaw<space_speed_row>;

template <class... Laws>
struct AnyOf {
    using Law = std::variant<Laws...>;
    using State = std::variant<typename Laws::State...>;
};
using AnyLaw = AnyOf<PiLaw, PiIlcLaw, RobustIlcLaw, AntiCoggingLaw, SpacePositionLaw, SpaceSpeedLaw, PluginLaw, CallbackLaw,
                     TrialLaw>;
using Law = AnyLaw::Law;
using LawState = AnyLaw::State;

}  // namespace cogless
