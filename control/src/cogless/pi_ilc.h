/* PI speed control with a P-type iterative learning part beside it (Liu 2018, Fig. 1 and eq. (29)):
 *
 *   u_{k+1}(t) = Q u_k(t) + gain e_{k+1}(t),    i_q_ref = PI + u_{k+1}
 *
 * u is the learned current, e = omega_ref - omega the speed error, and k counts the periods. In the paper Q is 1, and u grows without bound
 * in the long run. Here Q is the forgetting and the Q filter of the memory, which keep u bounded. If ki > 0, the mean of u over a period
 * belongs to the integral: what learning takes from this mean is added to the integral. */
#ifndef COGLESS_PI_ILC_H
#define COGLESS_PI_ILC_H

#include "memory.h"
#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_pi_config pi;         /* kp [A s/rad], ki [A/rad], bound of the law's output [A] */
    cgl_real gain;            /* learning gain [A s/rad], >= 0; 0: nothing is learned. With a guard a gain above 0 needs pi.kp > 0 */
    cgl_memory_config memory; /* memory of u [A], with one channel; its limit is at most loop.current_limit */
} cgl_pi_ilc_config;

typedef struct {
    bool idle;        /* u is frozen, because the learning gain is 0, as configured or from the guard, and the guard clears nothing */
    uint32_t gentle;  /* index into cgl_gentle_steps that is in effect; 0: learns as configured */
    cgl_real gain;    /* learning gain of the config [A s/rad] */
    cgl_real acting;  /* learning gain in use, after the guard's reduction [A s/rad] */
    cgl_real learned; /* u in the last step [A] */
    cgl_pi pi;
    cgl_memory memory;
} cgl_pi_ilc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_pi_ilc_bad_field(const cgl_pi_ilc_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `cell` has CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the law uses from then on. */
cgl_error cgl_pi_ilc_init(cgl_pi_ilc *law, const cgl_pi_ilc_config *config, const cgl_loop *loop, cgl_real *cell, uint32_t length);

/* Replaces gains and limits at run time, as cgl_pi_retune() and cgl_memory_retune() do. */
cgl_error cgl_pi_ilc_retune(cgl_pi_ilc *law, const cgl_pi_ilc_config *config);

void cgl_pi_ilc_reset(cgl_pi_ilc *law);

/* Learning freezes, and u repeats the last period, under any of these conditions: in->learn is false; the last output was at its limit; an
 * input is not finite; the angle is beyond CGL_ANGLE_MAX; the gain is 0, as configured or as the guard leaves it; the memory has no value
 * of one period ago. While in->off, learning is frozen too, and the output and the PI's integral are 0. In torque mode learning is frozen,
 * and the integral is in->i_q_ref, or 0 if the integral gain in use is 0. */
void cgl_pi_ilc_step(cgl_pi_ilc *law, const cgl_law_input *in,
                     cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
