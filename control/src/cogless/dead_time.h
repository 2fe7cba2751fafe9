/* Compensation of the inverter's dead time: the voltage that a leg loses while both its transistors are off, and the drop
 * across its devices, given back by the sign of the phase's current. The sign is that of the reference, which has no noise,
 * delayed as the current loop delays it, at the angle where the voltage will act. Within a band about zero current, where the
 * sign is not certain, the correction is linear.
 *
 * After the current loop's step, once per period:
 *
 *   cgl_drive_actuate(&drive, &out);
 *   cgl_dead_time_step(&dead_time, &drive.currents, out.duty); */
#ifndef COGLESS_DEAD_TIME_H
#define COGLESS_DEAD_TIME_H

#include <stdint.h>

#include "foc.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real time;    /* both transistors of a leg are off at each switching [s], 0 to ts/2, default 0 */
    cgl_real drop;    /* across a leg's transistor or diode that conducts [V], >= 0, default 0 */
    cgl_real band;    /* phase currents below this get a part of the correction [A], > 0 */
    cgl_real lag;     /* time constant of the current loop, L / kp [s], >= 0, default 0 */
    cgl_real advance; /* the voltage acts this many periods after sampling, as in cgl_foc_config [periods], >= 0 */
    uint32_t phases;  /* 3 (or 0): half bridges; 2: two H-bridges, of two legs each; default 3 */
} cgl_dead_time_config;

typedef struct {
    cgl_dead_time_config config;
    cgl_real ts;       /* [s] */
    cgl_real ahead;    /* advance ts [s] */
    cgl_real share;    /* time / ts [periods] */
    cgl_real per_band; /* 1 / band [1/A] */
    cgl_real follow;   /* the delayed reference follows by this part of the way in a period */
    cgl_real i_d, i_q; /* the delayed reference [A] */
} cgl_dead_time;

/* Takes the config, which need not stay; ts: period of the current loop, which is that of the pulses [s], > 0. */
cgl_error cgl_dead_time_init(cgl_dead_time *dead_time, const cgl_dead_time_config *config, cgl_real ts);

void cgl_dead_time_reset(cgl_dead_time *dead_time);

/* Other constants for a state that init has made; checked as by init. */
cgl_error cgl_dead_time_retune(cgl_dead_time *dead_time, const cgl_dead_time_config *config);

/* Corrects the duty cycles of this period in place; they stay in [0, 1]. theta_e, omega_e, u_dc and the references of `in` are
 * looked at. A duty cycle of 0 or 1 has no edges and stays; all stay where an input is not plausible (as cgl_foc_step says it). */
void cgl_dead_time_step(cgl_dead_time *dead_time, const cgl_foc_input *in, cgl_real duty[3]);

#ifdef __cplusplus
}
#endif

#endif
