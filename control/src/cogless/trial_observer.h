/* An observer of the error y_ref - y in a trial (trial.h). The observer also gives a feedback, and the input that was missing in the trial.
 *
 * The plant is a double integrator with a disturbance d at its input, y'' = b (u - d). T = f + N v is the input that is fed forward,
 * u_fb = u - T is the feedback, and T* is the input that would keep the error zero. So e'' = b (T* - T - u_fb). g = b Ts^2 is the change
 * per sample that one unit of the input adds in one sample. The observer estimates e, its change per sample s, and a = g (T* - T):
 *
 *   e- = e + s + (a - g u_fb) / 2,  s- = s + a - g u_fb                        from one sample to the next
 *   e = e- + l_1 (e_m - e-),  s = s- + l_2 (e_m - e-),  a += l_3 (e_m - e-)    e_m: measured
 *   l_1 = 1 - p^3,  l_2 = 1.5 (1 - p)^2 (1 + p),  l_3 = (1 - p)^3              three poles at p
 *   u_fb = (k_e e + k_s s + a) / g,  k_e = (1 - p)^2,  k_s = (1 - p) (3 + p) / 2      two poles at p
 *
 * The feedback makes e fall by (k_e / k_s) e a sample. While e falls to 0, half the limit of u can brake a change per sample of at most
 * sqrt(g limit e). So if e is above g limit (k_s / k_e)^2, the motion would overshoot. The longer u was at its limit, the larger the
 * overshoot. Therefore k_e e is limited to +-g limit (3 + p)^2 / 4. Within this bound, the term k_e e / g of u_fb can still be more than
 * twice the limit of u.
 *
 * The missing input r(p) follows from e'', centred in the sample for which u(p) is held:
 *
 *   r(p) = T*(p) - T(p) = u_fb(p) + (e(p + 2) - e(p + 1) - e(p) + e(p - 1)) / (2 g)
 *
 * This difference of e has no phase shift: for a double integrator with a held input its response is cos^2(w Ts / 2) at the angular
 * frequency w. If b is wrong by the factor beta, and S is the sensitivity of the feedback, a trial leaves the share
 * S (1 - beta cos^2(w Ts / 2)) of T* - T. */
#ifndef COGLESS_TRIAL_OBSERVER_H
#define COGLESS_TRIAL_OBSERVER_H

#include <stdbool.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real response; /* g, the change of y per sample that one unit of the input adds when held over one sample [y/u], > 0; 0: no
                          observer; default 0 */
    cgl_real pole;     /* p, the poles of observer and feedback, 0 to below 1; default 0 */
} cgl_trial_observer_config;

typedef struct {
    cgl_real e, s, a;        /* estimates e [y], s [y per sample] and a [y per sample^2], valid once `started` is true */
    cgl_real missing;        /* r(p - 2) in the last step [u] */
    cgl_real before[3];      /* e_m of 1, 2, 3 samples ago [y] */
    cgl_real feedback[2];    /* u_fb of 1, 2 samples ago, as applied within the limit of u [u] */
    bool started;            /* the trial has had a sample */
} cgl_trial_observer;

/* Checks the config and `limit`, the largest |u| [u]. */
cgl_error cgl_trial_observer_init(const cgl_trial_observer_config *config, cgl_real limit);

/* Resets the observer for a new trial. */
void cgl_trial_observer_reset(cgl_trial_observer *observer);

/* Takes the measured error e_m, which is finite, and the limit of u. Returns (k_e e + k_s s) / g [u]. *held is a / g, the part that cancels
 * the disturbance [u]. */
cgl_real cgl_trial_observer_step(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real e_m,
                                 cgl_real limit, cgl_real *held);

/* Tells the observer the feedback u - T that is applied until the next sample [u]. The call has no effect before the first sample. */
void cgl_trial_observer_act(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real u_fb);

#ifdef __cplusplus
}
#endif

#endif
