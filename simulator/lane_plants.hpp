// Plants of several drives that advance together, each in a lane of the processor's vector registers. A lane's states are bit by
// bit those that the plant would have alone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "current_sensors.hpp"
#include "inverter.hpp"
#include "lane_loops.hpp"
#include "plant.hpp"

namespace cogless {

class LanePlants {
public:
    // Arrays with an entry for each lane.
    struct View {
        const double *theta_m, *omega_m;
        double *i_d, *i_q, *load_torque, *load_target;
        std::array<const double*, 3> current;                // A, out of the inverter's phases, computed by measure()
        std::array<const double*, 3> measured;               // A, by the current sensors, computed by measure()
        std::array<double*, 3> duty, last;                   // arguments of averaged(), read by apply(), as are the next three
        double *bus_voltage, *dead_share, *device_drop;      // V, 1, V
        const double *u_alpha, *u_beta;                      // V, during the next step, computed by apply()
    };

    virtual ~LanePlants() = default;
    virtual View view() = 0;
    virtual void put(std::size_t lane, const PlantState<>& x, const AtAngle<double>& here) = 0;
    virtual void get(std::size_t lane, PlantState<>& x, AtAngle<double>& here) const = 0;
    // The random numbers go on in measure(), until get() returns them.
    virtual void put(std::size_t lane, const CurrentSensors& sensors, const Random& random) = 0;
    virtual void get(std::size_t lane, Random& random) const = 0;
    // Computes the present phase currents of all lanes and what their sensors show, View::current and View::measured.
    virtual void measure() = 0;
    // Computes the inverter's voltages from now on. Before the first call they are zero, which has no effect if the currents are given.
    virtual void apply(const Carrier& carrier) = 0;
    // Advances each lane by the nominal step h with its voltage, unless its rotor stops or breaks away within the step. Lanes of
    // such rotors stay as they are; returns them, lane n as bit n.
    virtual std::uint32_t step(double h) = 0;
};

// An instruction set of the processor, such as AVX2, and how many lanes it computes at once.
struct LaneKernel {
    std::string name;
    std::size_t lanes;
    std::unique_ptr<LanePlants> (*make)(const std::vector<const Plant*>& plants, Detail detail, std::size_t legs);
    std::uint32_t (*step_loops)(LaneLoops& loops, std::uint32_t lanes);
    std::uint32_t (*step_quietly)(LaneLoops& loops, std::uint32_t lanes);
    std::uint32_t (*watch)(LaneLoops& loops, const double* theta_m, std::uint32_t lanes);
    void (*sum_orders)(LaneOrders& orders);
};

// The kernels that this processor can run, the widest first.
std::vector<LaneKernel> lane_kernels();

}  // namespace cogless
