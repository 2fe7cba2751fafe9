/* PI speed control with a P-type iterative learning part beside it (Liu 2018, Fig. 1 and eq. (29)):
 *
 *   u_{k+1}(t) = Q u_k(t) + gain e_{k+1}(t),    i_q_ref = PI + u_{k+1}
 *
 * where k counts periods. The paper prints it with Q = 1, and so it drifts apart in the long run; forgetting or the Q
 * filter of the memory keep it bounded. Where ki > 0 the mean over a period belongs to the integral, and u passes its own mean on to
 * it. */
#ifndef COGLESS_PI_ILC_H
#define COGLESS_PI_ILC_H

#include "memory.h"
#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_pi_config pi;         /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    cgl_real gain;            /* learning gain [A s/rad], >= 0; 0: nothing is learned. A guard wants pi.kp > 0 beside it */
    cgl_memory_config memory; /* entries and limit of the learned part in [A], at most loop.current_limit; channels: 1 */
} cgl_pi_ilc_config;

typedef struct {
    bool idle;        /* nothing is left of the gain, and nothing is being cleared: what is learned is frozen */
    uint32_t gentle;  /* how gently, as the guard says */
    cgl_real gain;    /* learning gain [A s/rad] */
    cgl_real acting;  /* what the guard leaves of it [A s/rad] */
    cgl_real learned; /* the learned part of the last step [A] */
    cgl_pi pi;
    cgl_memory memory;
} cgl_pi_ilc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_pi_ilc_bad_field(const cgl_pi_ilc_config *config, const cgl_loop *loop);

/* loop: drive.loop. `cell`: CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the state keeps using. */
cgl_error cgl_pi_ilc_init(cgl_pi_ilc *law, const cgl_pi_ilc_config *config, const cgl_loop *loop, cgl_real *cell, uint32_t length);

/* Takes other gains and limits while it runs, as cgl_pi_retune and cgl_memory_retune. */
cgl_error cgl_pi_ilc_retune(cgl_pi_ilc *law, const cgl_pi_ilc_config *config);

void cgl_pi_ilc_reset(cgl_pi_ilc *law);

/* Learning freezes, and the learned part repeats, while in->learn is false, the output was at its limit, an input is not
 * finite, the angle is beyond CGL_ANGLE_MAX, the gain is 0 as configured or as the guard leaves it, or the memory has no value of one
 * period ago. While in->off it is frozen too,
 * and the output and the PI's integral are 0; in torque mode the integral is in->i_q_ref. */
void cgl_pi_ilc_step(cgl_pi_ilc *law, const cgl_law_input *in,
                     cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
