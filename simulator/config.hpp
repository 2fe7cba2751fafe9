// A drive's configuration from the plain nested dict that Python makes of a study; SI units throughout.
#pragma once

#include <nanobind/nanobind.h>

#include "drive.hpp"

namespace cogless {

// `controller`: the user's object with step(input), or None. Throws std::invalid_argument naming the key that's missing or
// of the wrong type.
DriveConfig read_config(const nanobind::dict& config, const nanobind::object& controller);

}  // namespace cogless
