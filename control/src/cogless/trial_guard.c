#include "trial_guard.h"

#define WORSE CGL_R(1.1025)       /* 1.05^2: J is too much above this times F; with u at its limit also above this times J_best */
#define GROWN CGL_R(2.25)         /* 1.5^2: J is too much above this times J_best */
#define CHANGED CGL_R(1.21)       /* 1.1^2: a change of J_best by more than this factor is a change of the plant */
#define FAR CGL_R(4.0)            /* 2^2: factor between sums whose roots differ by a factor of 2 */
#define TRIALS_ABOVE 5U           /* number of successive trials with J too much but falling, before COMPARE */
#define SHARE_FACTOR CGL_R(0.125) /* factor on the share for each strike */

void cgl_trial_guard_reset(cgl_trial_guard *guard)
{
    const cgl_real unknown = CGL_R(-1.0);
    const cgl_trial_guard fresh = {CGL_R(0.0), CGL_R(0.0), unknown, unknown, CGL_R(0.0), CGL_R(0.0), CGL_R(1.0), 0U, 0U, 0U,
                                   0U, CGL_TRIAL_LEARN, false};
    *guard = fresh;
}

static void set_strikes(cgl_trial_guard *guard, uint32_t strikes)
{
    guard->strikes = strikes < CGL_TRIAL_STRIKES ? strikes : CGL_TRIAL_STRIKES;
    guard->share = CGL_R(1.0);
    for (uint32_t i = 0; i < guard->strikes; ++i) {
        guard->share *= SHARE_FACTOR;
    }
}

/* Adds a strike, because learning was wrong. The best v runs without learning for 4^strikes - 1 trials. */
static void strike(cgl_trial_guard *guard)
{
    set_strikes(guard, guard->strikes + 1U);
    guard->mark = guard->best;
    guard->wait = (1U << (2U * guard->strikes)) - 1U;
    guard->phase = CGL_TRIAL_HOLD;
}

/* Whether J = `error` is too much. `growth` is the allowed multiple of J_best. */
static bool is_too_much(const cgl_trial_guard *guard, cgl_real error, cgl_real growth)
{
    return error > growth * guard->best || (guard->feedback >= CGL_R(0.0) && error > WORSE * guard->feedback);
}

/* Makes v, with J = `error`, the best v after a change of the plant. Decides whether v must be compared with v = 0 (COMPARE). `best` is
 * J_best from before the change. */
static void accept(cgl_trial_guard *guard, cgl_real error, cgl_real best)
{
    const cgl_real f = guard->feedback;
    const cgl_real more = f > guard->jump ? f : guard->jump;
    const cgl_real less = f > guard->jump ? guard->jump : f;
    const bool is_better = error <= f && FAR * less <= more && CGL_R(8.0) * (error + best) <= more;
    guard->best = error;
    guard->above = 0U;
    if (is_better) {
        guard->feedback = more; /* The feedback's error on the new plant is taken to be `more` until it is measured. */
        set_strikes(guard, 0U);
    }
    guard->phase = is_better ? CGL_TRIAL_LEARN : CGL_TRIAL_COMPARE;
}

/* Judges a trial in LEARN, with a v that was learned. */
static void judge_learned(cgl_trial_guard *guard, cgl_trial_verdict *verdict)
{
    const cgl_real error = guard->error, best = guard->best;
    const cgl_real growth = guard->limited ? WORSE : GROWN;
    verdict->learn = true;
    if (best < CGL_R(0.0) || !is_too_much(guard, error, growth)) {
        guard->above = 0U;
        if (best < CGL_R(0.0) || error < best) {
            if (guard->strikes > 0U && FAR * error <= guard->mark) {
                set_strikes(guard, guard->strikes - 1U);
                guard->mark = error;
            }
            guard->best = error;
            verdict->store = true;
        }
        return;
    }
    ++guard->above;
    if (guard->above == 1U) {
        guard->jump = error;
    }
    const bool goes_on = guard->above == 1U ? guard->strikes == 0U : WORSE * error <= guard->last;
    const bool has_halved = !goes_on && FAR * error <= guard->jump;
    if (guard->above >= TRIALS_ABOVE || has_halved) {
        accept(guard, error, best);
        verdict->store = true;
    } else if (!goes_on) {
        guard->above = 0U;
        ++guard->returns;
        guard->phase = CGL_TRIAL_REPLAY;
        verdict->back = true;
        verdict->learn = false;
    }
}

/* Judges a trial in REPLAY or HOLD, with the best v. */
static void judge_best(cgl_trial_guard *guard, bool none, cgl_trial_verdict *verdict)
{
    const cgl_real error = guard->error, best = guard->best;
    if (is_too_much(guard, error, CHANGED) || CHANGED * error < best) {
        guard->jump = error;
        accept(guard, error, best);
        if (none) { /* v was 0 in this trial, so its J is F */
            guard->feedback = error;
            set_strikes(guard, 0U);
            guard->phase = CGL_TRIAL_LEARN;
        }
        verdict->learn = true;
    } else if (guard->phase == CGL_TRIAL_REPLAY) {
        guard->best = error;
        strike(guard);
    } else if (guard->wait > 1U) {
        --guard->wait;
    } else {
        guard->phase = CGL_TRIAL_LEARN;
        verdict->learn = true;
    }
}

/* Judges a trial in COMPARE, with v = 0. */
static void judge_feedback(cgl_trial_guard *guard, cgl_trial_verdict *verdict)
{
    const cgl_real error = guard->error, before = guard->feedback;
    const bool same = error <= WORSE * before && before <= WORSE * error;
    guard->feedback = error;
    guard->phase = CGL_TRIAL_LEARN;
    if (!same) {
        set_strikes(guard, 0U);
    }
    if (error < guard->best) {
        ++guard->returns;
        guard->best = error;
        verdict->clear = true;
        if (same) {
            strike(guard);
        } else {
            verdict->learn = true;
        }
    }
}

cgl_trial_verdict cgl_trial_guard_judge(cgl_trial_guard *guard, bool none)
{
    cgl_trial_verdict verdict = {false, false, false, false};
    if (guard->phase == CGL_TRIAL_COMPARE) {
        judge_feedback(guard, &verdict);
    } else if (guard->phase == CGL_TRIAL_LEARN) {
        judge_learned(guard, &verdict);
    } else {
        judge_best(guard, none, &verdict);
    }
    if (none) {
        guard->feedback = guard->error;
    }
    guard->last = guard->error;
    return verdict;
}
