/* Carries what was learned for one reference over to another one. A plant with inertia, friction and delay needs an input that is a sum of
 * a few functions of the reference:
 *
 *   w(p) = N v(p) + K_2 (v(0) + .. + v(p - 1))     the learned part of the input; the sum only if v acts through the integral
 *        = theta_1 a(p) + theta_2 s(p) + theta_3 sign s(p) + theta_4 j(p) + c + the rest
 *
 *   s(p) = y_ref(p + 1) - y_ref(p)                                          speed
 *   a(p) = (y_ref(p + 2) - y_ref(p + 1) - y_ref(p) + y_ref(p - 1)) / 2      acceleration
 *   j(p) = y_ref(p + 2) - 3 y_ref(p + 1) + 3 y_ref(p) - y_ref(p - 1)        jerk: a delay of the acceleration
 *
 * Each function belongs to the middle of the sample over which u acts. theta and c are fitted over the trial by least squares. With another
 * reference the four functions change, while theta, c and the rest stay:
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

/* Carries what is learned over from the reference of the last trial to this y_ref of `samples` entries. The old reference must still
 * have its values. Call it in the background, between the end of a trial and the next begin with the same y_ref. The guard then measures
 * anew. The run time grows with the samples. Returns false, with nothing changed, if there was no trial, if n is 0, if v acts through an
 * integral and k_2 / n is outside 0 to 2, or if a number or a sum is not finite. */
bool cgl_trial_carry(cgl_trial *law, const cgl_real *y_ref);

#ifdef __cplusplus
}
#endif

#endif
