/* What was learned for one reference, for another one. A plant that answers a motion with inertia, friction and delay needs an
 * input that is a sum of few functions of the reference,
 *
 *   w(p) = N v(p) + K_2 (v(0) + .. + v(p - 1))     the learned part of the input; the sum only if v acts through the integral
 *        = theta_1 a(p) + theta_2 s(p) + theta_3 sign s(p) + theta_4 j(p) + c + the rest
 *
 *   s(p) = y_ref(p + 1) - y_ref(p)                                          speed
 *   a(p) = (y_ref(p + 2) - y_ref(p + 1) - y_ref(p) + y_ref(p - 1)) / 2      acceleration
 *   j(p) = y_ref(p + 2) - 3 y_ref(p + 1) + 3 y_ref(p) - y_ref(p - 1)        jerk: a delay of the acceleration
 *
 * each in the middle of the sample over which u acts. theta and c are those of least squares, over the trial. With another
 * reference the four functions change, and theta, c and the rest stay:
 *
 *   w'(p) = w(p) + theta_1 (a'(p) - a(p)) + ..
 *
 * So inertia and friction, which the design did not know, move along with the motion. A load stays where it is in the trial. */
#ifndef COGLESS_TRIAL_BASIS_H
#define COGLESS_TRIAL_BASIS_H

#include "trial.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Between a trial's end and the next begin, which is given this y_ref: `samples` entries. Moves what is learned to it from the
 * reference of the last trial, which still has its values. The guard measures anew. Takes a time that grows with the samples: call
 * it from the background. Returns false, and leaves everything as it is, if there was no trial, if n is 0, if v acts through an
 * integral with k_2 / n beyond 0 to 2, or if a number or sum is not finite. */
bool cgl_trial_carry(cgl_trial *law, const cgl_real *y_ref);

#ifdef __cplusplus
}
#endif

#endif
