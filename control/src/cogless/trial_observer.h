/* Observer of the error of a trial, its feedback, and the input that was missing.
 *
 * The plant is a double integrator with some disturbance d at its input, y'' = b (u - d). Within a trial let
 * T = f + N v be the input that is fed forward, u_fb = u - T the rest, and T* the input with which the error stays zero.
 * Then e'' = b (T* - T - u_fb). With the angle that one unit of the input adds in one sample, g = b Ts^2, the observer
 * estimates e, its change per sample s and a = g (T* - T):
 *
 *   e- = e + s + (a - g u_fb) / 2,  s- = s + a - g u_fb                        from one sample to the next
 *   e = e- + l_1 (e_m - e-),  s = s- + l_2 (e_m - e-),  a += l_3 (e_m - e-)    e_m: measured
 *   l_1 = 1 - p^3,  l_2 = 1.5 (1 - p)^2 (1 + p),  l_3 = (1 - p)^3              three poles at p
 *   u_fb = (k_e e + k_s s + a) / g,  k_e = (1 - p)^2,  k_s = (1 - p) (3 + p) / 2      two poles at p
 *
 * The feedback makes e fall by (k_e / k_s) e a sample. What one can brake with half the limit of u within e is at most
 * sqrt(g limit e), so beyond e = g limit (k_s / k_e)^2 the motion would overshoot, by the more the longer u was at its limit.
 * So k_e e stays within +-g limit (3 + p)^2 / 4, which is more than twice what the limit lets through.
 *
 * e'' also says what was missing. Centred in the sample over which u acts:
 *
 *   r(p) = T*(p) - T(p) = u_fb(p) + (e(p + 2) - e(p + 1) - e(p) + e(p - 1)) / (2 g)
 *
 * The difference has no phase shift: of a double integrator with the input held it makes cos^2(w Ts / 2). If b is wrong
 * by the factor beta and S is the sensitivity of the feedback, a trial leaves S (1 - beta cos^2(w Ts / 2)) of T* - T. */
#ifndef COGLESS_TRIAL_OBSERVER_H
#define COGLESS_TRIAL_OBSERVER_H

#include <stdbool.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real response; /* g: what one unit of the input held over one sample adds to the change of y per sample [y/u],
                          above 0; 0: no observer; default 0 */
    cgl_real pole;     /* p, 0 to below 1; default 0 */
} cgl_trial_observer_config;

typedef struct {
    cgl_real e, s, a;        /* e [y], s and a [y per sample, per sample^2]; until the first sample not meant */
    cgl_real missing;        /* r(p - 2), of the last step [u] */
    cgl_real before[3];      /* e_m of 1, 2, 3 samples ago [y] */
    cgl_real feedback[2];    /* u_fb of 1, 2 samples ago, as it acted [u] */
    bool started;            /* has seen a sample */
} cgl_trial_observer;

/* Checks the config; limit: of u. There is no state to begin with. */
cgl_error cgl_trial_observer_init(const cgl_trial_observer_config *config, cgl_real limit);

/* Forgets the trial. */
void cgl_trial_observer_reset(cgl_trial_observer *observer);

/* Takes the measured error e_m, finite, and the limit of u, and returns k_e e + k_s s over g [u]; the disturbance's share is
 * *held. */
cgl_real cgl_trial_observer_step(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real e_m,
                                 cgl_real limit, cgl_real *held);

/* Tells the observer the feedback u - T that acts until the next sample [u]; before the first sample it is ignored. */
void cgl_trial_observer_act(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real u_fb);

#ifdef __cplusplus
}
#endif

#endif
