/* A delay line as a learning law's memory (memory.h), for up to three functions at once.
 *
 * Kind time: it reaches back by a period of the reference speed, which may be a fraction of a sample. Kind delay: to where
 * the angle x was one period less, at the time P_t ago. For an angle that rises; while it does not, the line waits. P_t is
 * found by the differential equation of Verrelli 2016, Section 5,
 *
 *   dP_t/dt = 1 - (dx(t) + k_pp (x(t) - T - x(t - P_t))) / dx(t - P_t),   dx = dx/dt of the angle x
 *
 * or by inversion, x(t - P_t) = x(t) - T with x linear between samples. */
#ifndef COGLESS_DELAY_LINE_H
#define COGLESS_DELAY_LINE_H

#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether the config's kind is delay, and what that kind alone needs is in its range. */
bool cgl_delay_is_valid(const cgl_memory_config *config, cgl_real ts);

void cgl_delay_reset(cgl_delay_line *line);

/* cgl_memory_step for both kinds; theta is an angle. */
bool cgl_delay_step(cgl_memory *memory, cgl_real theta, cgl_real speed, bool learn, const cgl_real *correction,
                    cgl_real *value);

#ifdef __cplusplus
}
#endif

#endif
