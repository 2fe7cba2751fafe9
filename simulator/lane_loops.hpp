// Periods of the current loop of several drives, and sums of the harmonic law's orders, each in a lane of the processor's vector
// registers. A lane's numbers are bit by bit those of the control library, whose text lane_loops.cpp includes once more for vectors.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cogless/harmonic.h"
#include "cogless/real.h"
#include "wide.hpp"

namespace cogless {

struct LaneLoops {
    static constexpr std::size_t most = 8, outputs = 9;  // lanes; numbers of cgl_foc_output

    template <class Number>
    struct alignas(64) Each {
        Number of[most]{};
        Number& operator[](std::size_t lane) { return of[lane]; }
        Number operator[](std::size_t lane) const { return of[lane]; }
    };
    using Reals = Each<cgl_real>;

    // of all lanes
    bool two_phases = false, decoupling = false;
    std::uint32_t monitor_phases = 0;
    // as in cgl_foc and its config
    Reals kp_d, kp_q, rise_d, rise_q, L_d, L_q, psi_f, current_limit;
    Reals integral_d, integral_q, lost_d, lost_q;
    // as in cgl_monitor and its limits, and in cgl_drive
    Reals travel_square, speed_square, doubt_square, current_square, sum_square, period, pole_pairs;
    Reals theta_sensor, ref_turned;
    // what stays the same in a quiet period: angle and speed as measured, the speed's reference of the monitor, the bus voltage, and the
    // current references
    Reals theta_m, omega_m, omega_ref, u_dc, i_d_ref, i_q_ref;
    // of the rotor's electrical angle, as measured and when the voltage acts; NaN: there is no valid angle
    Reals sine, cosine, acting_sine, acting_cosine;
    Reals output[outputs];                  // of the last period, in the order of cgl_foc_output
    Reals delayed;                          // 1: duty cycles act a period later; 0: at once
    Reals computed[3];                      // duty cycles of the last period
    Each<double> least_duty;                // see without_short_pulses()
    // if the position sensor's edges are timed: angles between which its count stays, and the angle in the step before, rad
    Each<double> theta_low, theta_high, theta_before;
    Each<const cgl_real*> in;               // the numbers of cgl_foc_input, for step_loops(), which does not use its angle
    // each with a number for each lane: numbers that must be finite, the measured currents, A, and the duty cycles that act in this period
    const double *states[4], *measured[3];
    double* duty[3];
};

// Sums of the harmonic law's orders: see cgl_orders. All lanes have the same ranges of orders.
struct LaneOrders {
    std::uint32_t begin, end, low, acting;
    LaneLoops::Each<cgl_real*> cosine, sine;
    LaneLoops::Each<const cgl_real*> gain;
    LaneLoops::Reals first_cosine, first_sine, loads, error, limit, phase_sum, sum;
    cgl_real unused[2 * CGL_HARMONIC_ORDERS]{};  // for the pointers of a lane that has no sum
};

// Takes the sums of all lanes.
template <class Lanes>
void sum_orders(LaneOrders& orders);
// Steps the loops of these lanes, lane n as bit n, and returns them, except for those whose reference or voltage is limited, and those
// whose inputs are no plausible numbers. All other lanes stay as they are.
template <class Lanes>
std::uint32_t step_loops(LaneLoops& loops, std::uint32_t lanes);
// The same in a quiet period: no law, and the position sensor shows the same angle and speed as in the last period. Lanes for which
// this period is no ordinary one of the monitor do not step, either.
template <class Lanes>
std::uint32_t step_quietly(LaneLoops& loops, std::uint32_t lanes);
// Moves the position sensors of these lanes to theta_m, and returns those that have not passed an edge. The others stay as they are.
template <class Lanes>
std::uint32_t watch(LaneLoops& loops, const double* theta_m, std::uint32_t lanes);

// lane_loops.cpp defines these, each for one set of instructions.
#define COGLESS_LANE_LOOPS(Lanes)                                              \
    template <>                                                                \
    std::uint32_t step_loops<Lanes>(LaneLoops & loops, std::uint32_t lanes);   \
    template <>                                                                \
    std::uint32_t step_quietly<Lanes>(LaneLoops & loops, std::uint32_t lanes); \
    template <>                                                                \
    std::uint32_t watch<Lanes>(LaneLoops & loops, const double* theta_m, std::uint32_t lanes);
COGLESS_LANE_LOOPS(Sse2)
COGLESS_LANE_LOOPS(Avx2)
COGLESS_LANE_LOOPS(Avx512)
#undef COGLESS_LANE_LOOPS

}  // namespace cogless
