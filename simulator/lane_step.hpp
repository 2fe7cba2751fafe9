// One step of a LanePlants, compiled once for each set of instructions (lane_step.cpp).
#pragma once

#include <cstdint>

#include "inverter.hpp"
#include "plant.hpp"

namespace cogless {

template <class Real>
struct LaneStates {
    PlantState<Real> x;
    AtAngle<Real> here;
};

// The phases' current sensors: what CurrentSensors computes with, and the measured currents.
template <class Real>
struct LaneSensors {
    InPhases<Real> offset, gain_error, measured;
    Real noise, step, per_step, highest, lowest;
    Real converts, two;  // 1 or 0: whether there is a converter, and whether the third current is computed from the others
    std::uint64_t random[Real::lanes];  // states of the generators of the noise
    bool noisy;                         // any of the sensors
    const double* edges;                // Normal::edges()
};

// Normal::at_edge() with a generator's state.
double draw_at_edge(std::uint64_t& random, std::size_t layer, double x);

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
    void lane_currents(const LaneStates<Real>&, LaneInverter<Real>&, LaneSensors<Real>&, std::size_t legs);            \
    void lane_voltage(const LaneInverter<Real>&, Voltage<Real>&, const Carrier&, std::size_t legs);
COGLESS_LANE_STEP(Sse2)
COGLESS_LANE_STEP(Avx2)
COGLESS_LANE_STEP(Avx512)
#undef COGLESS_LANE_STEP

}  // namespace cogless
