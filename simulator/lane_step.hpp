// One step of a LanePlants, compiled once for each set of instructions (lane_step.cpp).
#pragma once

#include <cstdint>

#include "inverter.hpp"
#include "plant.hpp"

namespace cogless {

// A type for each set of instructions, with enough registers to hide an operation's latency and few enough not to spill.
using Sse2 = Wide<2, 2>;
using Avx2 = Wide<4, 2>;
using Avx512 = Wide<8, 1>;

template <class Real>
struct LaneStates {
    PlantState<Real> x;
    AtAngle<Real> here;
};

// The arguments of averaged(), among them the phase currents.
template <class Real>
struct LaneInverter {
    InPhases<Real> current, duty, last;
    Real bus_voltage, dead_share, device_drop;
};

// lane_step.cpp defines these with the processor's instructions enabled. It may define nothing else that runs elsewhere: of a
// function that other files also contain, the linker keeps only one copy, perhaps the one with these instructions.
#define COGLESS_LANE_STEP(Real)                                                                                        \
    std::uint32_t lane_step(const Equations<Real>&, LaneStates<Real>&, const Voltage<Real>&, double h, Detail detail); \
    void lane_currents(const LaneStates<Real>&, LaneInverter<Real>&, std::size_t legs);                                \
    void lane_voltage(const LaneInverter<Real>&, Voltage<Real>&, const Carrier&, std::size_t legs);
COGLESS_LANE_STEP(Sse2)
COGLESS_LANE_STEP(Avx2)
COGLESS_LANE_STEP(Avx512)
#undef COGLESS_LANE_STEP

}  // namespace cogless
