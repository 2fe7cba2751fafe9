/* A guard for learning from trial to trial. It makes sure that learning does not leave more error than the feedback alone for long.
 *
 * It needs no model of the plant. J is the sum of e^2 over a trial, e = y_ref - y as measured. The guard compares J with two measured
 * values of it: that of the best v so far, and F, that of the feedback alone, v = 0. J is too much above 1.1025 F, which is 1.05 times
 * the RMS. It is also too much above 2.25 times that of the best v, which is 1.5 times the RMS, or above 1.1025 times that if u was at
 * its limit, as learning need not converge then.
 *
 * Too much has two possible causes: learning, or a change of the plant. To tell them apart, the best v runs again for a trial. If its J is
 * the same as before, within a factor of 1.21, learning was wrong. If not, the plant has changed, and the old values are void.
 *
 *   LEARN   v is learned. If J is too much, and above 0.91 of the trial before, v becomes the best v -> REPLAY. While J is too much but
 *           falls, as learning makes it after a change of the plant, learning goes on for up to five trials. Then the present v
 *           becomes the best v -> COMPARE. So it does earlier, if J stops falling and the RMS has halved since the first such trial
 *   REPLAY  The best v runs for a trial. If its J is the same as before, that is a strike -> HOLD. Else -> COMPARE
 *   HOLD    The best v runs without learning, for 4^strikes trials with that of REPLAY -> LEARN. If its J changes -> COMPARE
 *   COMPARE v = 0 runs for a trial, which measures F. Then the better of v = 0 and the best v runs -> LEARN. If F is the same as before,
 *           so is the plant; a best v that is worse than v = 0 then is a strike -> HOLD
 *
 * Strikes also reduce learning: only the share 8^-strikes of what it would add to the best v is added. If the J of the best v falls to a
 * quarter, one strike is taken back; if the plant changes, all are. So while the plant stays the same, harmful trials become ever rarer,
 * and their harm ever smaller.
 *
 * COMPARE costs a trial. It is left out where the new F must be larger than J. If the plant has not changed, that is where J <= F. If it
 * has changed, let z be the error that v adds, and e_0 the error without v. Before the change |z| >= | |e_0| - |e| |, and after it
 * |e_0'| >= | |z| - |e'| |. The roots of four sums bound these norms: F, J in the first trial after the change, J now, and J of the best
 * v. |e_0'| is above the third root if the first two roots differ by more than the sum of the last two. For that it suffices that F and
 * the first J differ by a factor of 4, and that the larger of them is 8 times the sum of the last two. */
#ifndef COGLESS_TRIAL_GUARD_H
#define COGLESS_TRIAL_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_TRIAL_STRIKES 6U /* largest number of strikes, at which one trial in 4096 is tried */

typedef enum { CGL_TRIAL_LEARN, CGL_TRIAL_REPLAY, CGL_TRIAL_HOLD, CGL_TRIAL_COMPARE } cgl_trial_phase;

/* What to do with v at the end of a trial, in this order. */
typedef struct {
    bool store; /* the best v <- v */
    bool back;  /* v <- the best v */
    bool clear; /* v and the best v <- 0 */
    bool learn; /* learn from this trial */
} cgl_trial_verdict;

typedef struct {
    cgl_real error;      /* sum of e^2 in this trial [y^2] */
    cgl_real last;       /* the same sum in the trial before [y^2] */
    cgl_real best;       /* the same sum with the best v, as last measured [y^2]; < 0: there is no best v */
    cgl_real feedback;   /* F [y^2]; < 0: it has not been measured */
    cgl_real jump;       /* the sum in the first of the trials that were too much [y^2] */
    cgl_real mark;       /* value of `best` at the last change of strikes [y^2] */
    cgl_real share;      /* share of what learning adds, 8^-strikes */
    uint32_t above;      /* number of successive trials in LEARN that were too much */
    uint32_t wait;       /* number of trials until HOLD ends */
    uint32_t returns;    /* number of times since the reset that v went back to the best v, or to 0 */
    uint32_t strikes;    /* number of strikes, 0 to CGL_TRIAL_STRIKES */
    cgl_trial_phase phase; /* phase of the next trial */
    bool limited;        /* u was at its limit in this trial */
} cgl_trial_guard;

/* Starts anew, without any measurement. */
void cgl_trial_guard_reset(cgl_trial_guard *guard);

/* Judges a complete trial by guard->error. `none` says that its v was 0. */
cgl_trial_verdict cgl_trial_guard_judge(cgl_trial_guard *guard, bool none);

#ifdef __cplusplus
}
#endif

#endif
