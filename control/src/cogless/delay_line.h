/* A delay line as the memory of a learning law (memory.h), for up to three functions of an angle at once.
 *
 * Kind time reads the value of one period ago, where the reference speed gives the period. The value is interpolated between samples. Kind
 * delay reads the value of the time P_t ago, when the angle x was less by one period T. The angle must rise. While x does not rise, the
 * line stores nothing and gives the last value. P_t follows from the differential equation of Verrelli 2016, Section 5,
 *
 *   dP_t/dt = 1 - (dx(t) + k_pp (x(t) - T - x(t - P_t))) / dx(t - P_t),   dx = dx/dt of the angle x
 *
 * or from the inversion x(t - P_t) = x(t) - T, where x is linear between samples. */
#ifndef COGLESS_DELAY_LINE_H
#define COGLESS_DELAY_LINE_H

#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether the config's kind is delay and the fields of this kind are in their ranges. */
bool cgl_delay_is_valid(const cgl_memory_config *config, cgl_real ts);

void cgl_delay_reset(cgl_delay_line *line);

/* Does the step of cgl_memory_step() for the kinds time and delay. `place` is the rotor's place in the period [2^-32 periods]. */
bool cgl_delay_step(cgl_memory *memory, uint32_t place, cgl_real speed, bool learn, const cgl_real *correction,
                    cgl_real *value);

#ifdef __cplusplus
}
#endif

#endif
