/* Carries the signal v that was learned for one reference (trial.h) over to another reference. A plant with inertia, friction and delay
 * needs an input that is a sum of four functions of the reference, a constant c, and a remainder R that these do not explain:
 *
 *   w(p) = N v(p) + K_2 (v(0) + .. + v(p - 1))     the learned part of the input; without K_2 (..) if not through_integrator
 *        = theta_1 a(p) + theta_2 s(p) + theta_3 sign s(p) + theta_4 j(p) + c + R(p)
 *
 *   s(p) = y_ref(p + 1) - y_ref(p)                                          speed
 *   a(p) = (y_ref(p + 2) - y_ref(p + 1) - y_ref(p) + y_ref(p - 1)) / 2      acceleration
 *   j(p) = y_ref(p + 2) - 3 y_ref(p + 1) + 3 y_ref(p) - y_ref(p - 1)        jerk: a delay of the acceleration
 *
 * Each function is centred in the sample for which u(p) is held. theta_1 to theta_4 and c are fitted to w over the trial by least squares.
 * With another reference, marked by a prime, the four functions change, while theta_1 to theta_4, c and R stay:
 *
 *   w'(p) = w(p) + theta_1 (a'(p) - a(p)) + ..
 *
 * So the effects of inertia and friction follow the new motion. A load stays at its place in the trial. */
#ifndef COGLESS_TRIAL_BASIS_H
#define COGLESS_TRIAL_BASIS_H

#include "trial.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Carries v over from the reference of the last trial to this y_ref of `samples` entries. The old reference must still have its values.
 * Call this function in the background, after cgl_trial_end() and before cgl_trial_begin() with the new y_ref. The guard then measures
 * anew. The run time grows with the samples. Returns false, with nothing changed, if there was no trial, if n is 0, if v goes through the
 * integrator and k_2 / n is not in [0, 2), or if a number or a sum is not finite. */
bool cgl_trial_carry(cgl_trial *law, const cgl_real *y_ref);

#ifdef __cplusplus
}
#endif

#endif
