// Every law that a drive can run, and its state: those of laws.def, microstepping, and a user's own.
#pragma once

#include <type_traits>
#include <variant>

#include "c_law.hpp"
#include "microstepping_law.hpp"
#include "own_law.hpp"
#include "trial_law.hpp"

namespace cogless {

template <class Row>
using LawOf = std::conditional_t<std::is_same_v<Row, trial_row>, TrialLaw, CLaw<Row>>;

template <class... Laws>
struct AnyOf {
    using Law = std::variant<Laws...>;
    using State = std::variant<typename Laws::State...>;
};
using AnyLaw = AnyOf<
#define CGL_LAW_WITHOUT_MEMORY(law, stem, header, step_function) LawOf<stem##_row>,
#include "cogless/laws.def"
    MicrosteppingLaw, PluginLaw, CallbackLaw>;
using Law = AnyLaw::Law;
using LawState = AnyLaw::State;

}  // namespace cogless
