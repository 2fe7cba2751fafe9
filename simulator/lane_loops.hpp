// Current loops of several drives that step together, each in a lane of the processor's vector registers. A lane's numbers are bit
// by bit those of cgl_foc_step(), whose parts lane_loops.cpp includes once more for vectors.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cogless/real.h"
#include "wide.hpp"

namespace cogless {

struct LaneLoops {
    static constexpr std::size_t most = 8;  // lanes

    template <class Number>
    struct alignas(64) Each {
        Number of[most]{};
        Number& operator[](std::size_t lane) { return of[lane]; }
    };

    bool two_phases = false, decoupling = false;                                              // of all lanes
    Each<cgl_real> kp_d, kp_q, rise_d, rise_q, L_d, L_q, psi_f, current_limit, ahead;         // as in cgl_foc and its config
    Each<cgl_real> integral_d, integral_q, lost_d, lost_q;                                    // as in cgl_foc
    Each<cgl_real> delayed;                                                                   // 1: duty cycles act a period later; 0: at once
    Each<double> least_duty;                                                                  // see without_short_pulses()
    Each<cgl_real> computed[3];                                                               // duty cycles of the last period
    Each<const cgl_real*> in;                                                                 // the numbers of cgl_foc_input
    Each<cgl_real*> out;                                                                      // the numbers of cgl_foc_output
    double* duty[3];                                                                          // duty cycles that act in this period
};

// Steps the loops of these lanes, lane n as bit n, and returns them, except for those whose reference or voltage is limited, and those
// whose inputs are no plausible numbers. Loops of all other lanes stay as they are; their numbers `out` and `duty` have no meaning.
template <class Lanes>
std::uint32_t step_loops(LaneLoops& loops, std::uint32_t lanes);
template <>
std::uint32_t step_loops<Sse2>(LaneLoops& loops, std::uint32_t lanes);
template <>
std::uint32_t step_loops<Avx2>(LaneLoops& loops, std::uint32_t lanes);
template <>
std::uint32_t step_loops<Avx512>(LaneLoops& loops, std::uint32_t lanes);

}  // namespace cogless
