/* Active disturbance rejection control of the speed (Gao 2003; sampled as in Miklosovic 2006: the output uses estimates that the present
 * measurement has already corrected). An extended state observer estimates the disturbance f, which is all acceleration that does not come
 * from the current. The current then cancels the disturbance.
 *
 *   domega/dt = b i_q + f
 *   predicted = omega^ + ts (f^ + b i_q[k-1]),    e = omega - predicted,    p = exp(-omega_o ts)
 *   omega^ = predicted + (1 - p^2) e,    f^ += (1 - p)^2 / ts e
 *   i_q_ref = (omega_c (omega_ref - omega^) - f^) / b */
#ifndef COGLESS_ADRC_H
#define COGLESS_ADRC_H

#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real b;       /* acceleration per current, K_t / J [rad/s^2/A], > 0; 1 / b must be finite */
    cgl_real omega_c; /* bandwidth of the loop [1/s], >= 0 */
    cgl_real omega_o; /* bandwidth of the observer: magnitude of its double pole [1/s], > 0, at most 2 / ts */
    cgl_real limit;   /* bound of the output's magnitude [A], > 0, at most loop.current_limit; b * limit must be > 0 and finite */
} cgl_adrc_config;

typedef struct {
    uint32_t ready;        /* CGL_READY after init */
    bool started;          /* a speed has been measured, so omega is valid */
    cgl_real l1, l2;       /* gains from the prediction error e to omega [-] and to f [1/s] */
    cgl_real most;         /* largest disturbance that the current can cancel, b limit [rad/s^2] */
    cgl_real omega;        /* estimate of the speed [rad/s] */
    cgl_real f;            /* estimate of the disturbance, within +-most [rad/s^2] */
    cgl_real before;       /* last output [A]; the observer predicts the speed from it */
    cgl_real proportional; /* proportional part of the last output [A] */
    cgl_real rejected;     /* part of the last output that cancels the disturbance: -f / b [A] */
    cgl_loop loop;
    cgl_adrc_config config;
} cgl_adrc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_adrc_bad_field(const cgl_adrc_config *config, const cgl_loop *loop);

cgl_error cgl_adrc_init(cgl_adrc *law, const cgl_adrc_config *config, const cgl_loop *loop);

/* Replaces gains and limits at run time, as cgl_pi_retune() does. The estimates stay, but f is clipped to the new b * limit. */
cgl_error cgl_adrc_retune(cgl_adrc *law, const cgl_adrc_config *config);

void cgl_adrc_reset(cgl_adrc *law);

/* The observer uses the limited output, so nothing winds up. A speed that is not finite corrects no estimate. A reference that is not
 * finite counts as the estimated speed. While in->off, the output is 0 and the estimates start anew. In torque mode the estimates start
 * anew too, with f = -b in->i_q_ref. */
void cgl_adrc_step(cgl_adrc *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
