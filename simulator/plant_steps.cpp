// The steps of plants that are compiled once; see the end of plant.hpp.
#define COGLESS_PLANT_STEPS_HERE
#include "plant.hpp"

namespace cogless {

COGLESS_ALL_PLANT_STEPS()

}  // namespace cogless
