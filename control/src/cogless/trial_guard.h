/* A guard for learning from trial to trial: what is learned leaves no more error than the feedback alone for long.
 *
 * It knows no plant. It compares J, the sum of e^2 over a trial, e = y_ref - y as measured, with two that it has measured: that
 * of the best v so far, and F, that of the feedback alone, v = 0. J is too much beyond 1.1025 F, which is 1.05 times the RMS,
 * and beyond 4 times the best, twice the RMS; beyond 1.1025 times the best if u was at its limit, where no law of learning
 * holds.
 *
 * Too much has two causes: learning, or another plant. The best v tells them apart, as it runs again for a trial: if its J is
 * not too much now, learning was wrong. If it is, the plant has changed, and what was measured has expired.
 *
 *   LEARN   J is too much, and no less than 0.91 of the trial before -> v is the best again, REPLAY. As long as J falls, which
 *           is what learning does after the plant has changed, it goes on, for five trials. Then, or as soon as it does not
 *           fall any more and the RMS is half of the first, v is the best, and -> COMPARE
 *   REPLAY  the best v runs. Its J is not too much: a strike, -> HOLD. It is: -> COMPARE
 *   HOLD    the best v runs, and nothing is learned, for 4^strikes trials with that of REPLAY -> LEARN; too much, or less than
 *           a quarter -> COMPARE
 *   COMPARE v = 0 runs, which measures F: the better of the two goes on -> LEARN. If F is what it was, the plant is too, and a v
 *           that is worse than none is a strike, -> HOLD
 *
 * Strikes also make learning gentle: only the share 8^-strikes of what it would add to the best v is added. The best falling by
 * a tenth takes one back, another plant all of them. So the harm comes to nothing, in number of trials and in size, as long as
 * the plant stays.
 *
 * COMPARE costs a trial, and is left out where F is surely more than J. If the plant is as it was, it is for J <= F. If not, let
 * z be what v adds to the error, before the change |z| >= | |e_0| - |e| |, after it |e_0'| >= | |z| - |e'| |. With the roots of
 * F, of J in the first trial after the change, of J now and of the best, |e_0'| is above the third if the first two differ by
 * more than the sum of the others. For that it is enough that F and the first J differ by a factor of 4, and that the larger
 * one is 8 times the sum of the others. */
#ifndef COGLESS_TRIAL_GUARD_H
#define COGLESS_TRIAL_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_TRIAL_STRIKES 6U /* more are not counted: a try in 4096 trials */

typedef enum { CGL_TRIAL_LEARN, CGL_TRIAL_REPLAY, CGL_TRIAL_HOLD, CGL_TRIAL_COMPARE } cgl_trial_phase;

/* What is to be done with v at the end of a trial, in this order. */
typedef struct {
    bool store; /* the best v <- v */
    bool back;  /* v <- the best v */
    bool clear; /* v and the best v <- 0 */
    bool learn; /* from this trial */
} cgl_trial_verdict;

typedef struct {
    cgl_real error;      /* sum of e^2 in this trial [y^2] */
    cgl_real last;       /* and in the trial before */
    cgl_real best;       /* with the best v, as last measured; below 0: there is none */
    cgl_real feedback;   /* F; below 0: not yet measured */
    cgl_real jump;       /* in the first of the trials that were too much */
    cgl_real share;      /* 8^-strikes */
    uint32_t above;      /* trials in a row that were too much, in LEARN */
    uint32_t wait;       /* trials that HOLD still lasts */
    uint32_t returns;    /* how often v became the best again, or 0, since the reset */
    uint32_t strikes;    /* 0 to CGL_TRIAL_STRIKES */
    cgl_trial_phase phase; /* of the next trial */
    bool limited;        /* u was at its limit in this trial */
} cgl_trial_guard;

/* Knows nothing. */
void cgl_trial_guard_reset(cgl_trial_guard *guard);

/* Judges a whole trial, whose `error` is complete; none: its v was 0. */
cgl_trial_verdict cgl_trial_guard_judge(cgl_trial_guard *guard, bool none);

#ifdef __cplusplus
}
#endif

#endif
