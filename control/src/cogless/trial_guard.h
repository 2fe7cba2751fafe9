/* A guard for learning from trial to trial. It makes sure that learning does not leave more error than the feedback alone for long.
 *
 * The guard needs no model of the plant. J is the sum of e^2 over a trial, with the measured e = y_ref - y. v is the learned signal. F is J
 * with the feedback alone, v = 0. J_best is J with the best v so far. J is called too much in any of these cases:
 *
 *   J > 1.1025 F                                    1.05 times the RMS of the feedback alone
 *   J > 2.25 J_best                                 1.5 times the RMS of the best v
 *   J > 1.1025 J_best, and u was at its limit       learning at a limit need not converge
 *
 * Too much has two possible causes: learning, or a change of the plant. To tell them apart, the best v runs again for a trial. If J_best is
 * the same as before, within a factor of 1.21, learning was wrong. If not, the plant has changed, and the old values are void.
 *
 *   LEARN   v is learned. If J is too much and does not fall, the best v comes back -> REPLAY. J falls if it is at most 0.91 of J in the
 *           trial before. The first trial with too much J counts as falling, unless there is a strike. While J falls, as after a change
 *           of the plant, learning goes on. After five successive trials with too much J, the present v becomes the best v -> COMPARE.
 *           The same happens earlier if J stops falling and the RMS has halved since the first of these trials
 *   REPLAY  The best v runs for a trial. If J_best is the same as before, that is a strike -> HOLD. Else -> COMPARE
 *   HOLD    The best v runs without learning. REPLAY and HOLD together last 4^strikes trials -> LEARN. If J_best changes -> COMPARE
 *   COMPARE v = 0 runs for a trial, which measures F. Then the better of v = 0 and the best v runs -> LEARN. If F is the same as before,
 *           the plant is the same: a best v that is worse than v = 0 is then a strike -> HOLD
 *
 * Strikes also reduce learning: it adds only the share 8^-strikes to the best v. If J_best falls to a quarter, one strike is taken back. If
 * the plant changes, all strikes are taken back. So while the plant stays the same, harmful trials become ever rarer, and their harm ever
 * smaller.
 *
 * COMPARE costs a trial. So COMPARE is left out if F on the changed plant must be larger than J. J <= F shows this for a plant that has
 * not changed after all. For a plant that has changed, a bound of norms shows it. z is the error that v adds, e_0 the error without v, and
 * a prime marks values after the change. Before the change |z| >= | |e_0| - |e| |, and after it |e_0'| >= | |z| - |e'| |. These norms are
 * the roots of four sums: F, J_1, J and J_best. J_1 is J in the first trial after the change, and J is its present value. |e_0'| is above
 * the root of J if the roots of F and J_1 differ by more than the sum of the roots of J and J_best. It suffices that F and J_1 differ by a
 * factor of 4, and that the larger of them is 8 (J + J_best). */
#ifndef COGLESS_TRIAL_GUARD_H
#define COGLESS_TRIAL_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_TRIAL_STRIKES 6U /* largest number of strikes, with which learning is tried in one of 4096 trials */

typedef enum { CGL_TRIAL_LEARN, CGL_TRIAL_REPLAY, CGL_TRIAL_HOLD, CGL_TRIAL_COMPARE } cgl_trial_phase;

/* What to do with the learned signal v at the end of a trial, in this order. */
typedef struct {
    bool store; /* the best v <- v */
    bool back;  /* v <- the best v */
    bool clear; /* v and the best v <- 0 */
    bool learn; /* learn from this trial */
} cgl_trial_verdict;

typedef struct {
    cgl_real error;      /* sum of e^2 in this trial [y^2] */
    cgl_real last;       /* sum of e^2 in the trial before [y^2] */
    cgl_real best;       /* J_best, as last measured [y^2]; < 0: there is no best v */
    cgl_real feedback;   /* F, as last measured [y^2]; < 0: F has not been measured */
    cgl_real jump;       /* J_1: sum of e^2 in the first trial after a change of the plant, or the first with too much J [y^2] */
    cgl_real mark;       /* J_best when the number of strikes last changed [y^2] */
    cgl_real share;      /* share of a correction of v that is added to the best v [-], 8^-strikes */
    uint32_t above;      /* number of successive trials in LEARN with too much J */
    uint32_t wait;       /* number of trials until HOLD ends */
    uint32_t returns;    /* number of times since the reset that v went back to the best v, or to 0 */
    uint32_t strikes;    /* number of strikes, 0 to CGL_TRIAL_STRIKES */
    cgl_trial_phase phase; /* phase of the next trial */
    bool limited;        /* u was at its limit in this trial */
} cgl_trial_guard;

/* Resets the guard to LEARN, without any measured J and without strikes. */
void cgl_trial_guard_reset(cgl_trial_guard *guard);

/* Judges a complete trial by guard->error. `none` says that v was 0 in this trial. */
cgl_trial_verdict cgl_trial_guard_judge(cgl_trial_guard *guard, bool none);

#ifdef __cplusplus
}
#endif

#endif
