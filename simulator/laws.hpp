// Every law that a drive can run, and its state: the speed laws, and the one that learns from trial to trial.
#pragma once

#include <variant>

#include "speed_laws.hpp"
#include "trial_law.hpp"

namespace cogless {

using Law = std::variant<PiLaw, PiIlcLaw, RobustIlcLaw, AntiCoggingLaw, PluginLaw, CallbackLaw, TrialLaw>;
using LawState = std::variant<PiLaw::State, PiIlcLaw::State, RobustIlcLaw::State, AntiCoggingLaw::State, PluginLaw::State,
                              CallbackLaw::State, TrialLaw::State>;

}  // namespace cogless
