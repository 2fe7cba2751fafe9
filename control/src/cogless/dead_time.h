/* Compensation of the inverter's dead time. A leg loses voltage while both its transistors are off, and across the devices that conduct.
 * The lost voltage has the sign of the phase current. This compensation adds the lost voltage to the duty cycles. The sign comes from the
 * current reference, which has no noise. The reference is delayed as the current loop delays the current, and transformed at the angle
 * where the voltage will act. In a band about zero current the sign is uncertain. So within this band the correction is proportional to the
 * current.
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
    cgl_real time;    /* time for which both transistors of a leg are off at each switching [s], 0 to ts/2, default 0 */
    cgl_real drop;    /* voltage across a leg's transistor or diode that conducts [V], >= 0, default 0 */
    cgl_real band;    /* half width of the linear band of phase current [A], > 0 */
    cgl_real lag;     /* time constant of the current loop, L / kp [s], >= 0, default 0 */
    cgl_real advance; /* time from sampling until the voltage acts, as in cgl_foc_config [periods], >= 0 */
    uint32_t phases;  /* 3 (or 0): half bridges; 2: two H-bridges, of two legs each; default 3 */
} cgl_dead_time_config;

typedef struct {
    cgl_dead_time_config config;
    cgl_real ts;       /* period of the current loop [s] */
    cgl_real ahead;    /* time from sampling until the voltage acts, advance * ts [s] */
    cgl_real share;    /* dead time as a share of the period, time / ts [-] */
    cgl_real per_band; /* 1 / band [1/A] */
    cgl_real follow;   /* share of its distance to the present reference by which the delayed reference moves in a period [-] */
    cgl_real i_d, i_q; /* the delayed reference [A] */
} cgl_dead_time;

/* Copies the config. ts is the period of the current loop and of the pulses [s], > 0. */
cgl_error cgl_dead_time_init(cgl_dead_time *dead_time, const cgl_dead_time_config *config, cgl_real ts);

void cgl_dead_time_reset(cgl_dead_time *dead_time);

/* Replaces the config at run time, within the ranges that init accepts. */
cgl_error cgl_dead_time_retune(cgl_dead_time *dead_time, const cgl_dead_time_config *config);

/* Corrects the duty cycles of this period in place, within [0, 1]. The function reads theta_e, omega_e, u_dc and the references of `in`. A
 * duty cycle of 0 or 1 has no edges and stays. If one of these inputs is not plausible in the sense of cgl_foc_step(), or a reference is
 * not finite, all duty cycles stay. */
void cgl_dead_time_step(cgl_dead_time *dead_time, const cgl_foc_input *in, cgl_real duty[3]);

#ifdef __cplusplus
}
#endif

#endif
