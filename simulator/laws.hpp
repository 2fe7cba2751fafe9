// Every law that a drive can run, and its state: the speed laws, those that learn over an angle, and the one that learns from
// trial to trial.
#pragma once

#include <variant>

#include "space_laws.hpp"
#include "speed_laws.hpp"
#include "trial_law.hpp"

namespace cogless {

using Law = std::variant<PiLaw, PiIlcLaw, RobustIlcLaw, AntiCoggingLaw, SpacePositionLaw, SpaceSpeedLaw, PluginLaw, CallbackLaw,
                         TrialLaw>;
using LawState = std::variant<PiLaw::State, PiIlcLaw::State, RobustIlcLaw::State, AntiCoggingLaw::State,
                              SpacePositionLaw::State, SpaceSpeedLaw::State, PluginLaw::State, CallbackLaw::State,
                              TrialLaw::State>;

}  // namespace cogless
