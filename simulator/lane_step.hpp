// One step of a LanePlants, compiled once for each set of instructions (lane_step.cpp).
#pragma once

#include <cstdint>

#include "inverter.hpp"
#include "plant.hpp"

namespace cogless {

// As many registers as hide an operation's latency without spilling.
using Sse2 = Wide<2, 2>;
using Avx2 = Wide<4, 2>;
using Avx512 = Wide<8, 1>;

template <class Real>
struct LaneStates {
    PlantState<Real> x;
    AtAngle<Real> here;
};

// What averaged() needs, and the phase currents.
template <class Real>
struct LaneInverter {
    InPhases<Real> current, duty, last;
    Real bus_voltage, dead_share, device_drop;
};

// Defined where the processor's instructions are enabled: nothing else may run there, least of all a function that other
// files have too, since the linker keeps only one of them.
#define COGLESS_LANE_STEP(Real)                                                                                        \
    std::uint32_t lane_step(const Equations<Real>&, LaneStates<Real>&, const Voltage<Real>&, double h, Detail detail); \
    void lane_currents(const LaneStates<Real>&, LaneInverter<Real>&, std::size_t legs);                                \
    void lane_voltage(const LaneInverter<Real>&, Voltage<Real>&, const Carrier&, std::size_t legs);
COGLESS_LANE_STEP(Sse2)
COGLESS_LANE_STEP(Avx2)
COGLESS_LANE_STEP(Avx512)
#undef COGLESS_LANE_STEP

}  // namespace cogless
