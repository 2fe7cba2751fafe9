// A drive's configuration from a study's description, a plain tree of values in SI units.
#pragma once

#include "drive.hpp"
#include "value.hpp"

namespace cogless {

// own: the user's law if the description says "python", else empty. Throws std::invalid_argument naming the key that's missing
// or of the wrong type.
DriveConfig read_config(const Value& description, const CallbackLaw& own = {});

}  // namespace cogless
