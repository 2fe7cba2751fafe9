#include "trial_guard.h"

#define WORSE CGL_R(1.1025)       /* times F is too much, and the best at the limit of u: 1.05^2 */
#define GROWN CGL_R(4.0)          /* times the best is too much: 2^2 */
#define TRIALS_ABOVE 5U           /* in a row, and falling, before v = 0 is compared */
#define SHARE_FACTOR CGL_R(0.125) /* on the share, by a strike */

void cgl_trial_guard_reset(cgl_trial_guard *guard)
{
    const cgl_real unknown = CGL_R(-1.0);
    const cgl_trial_guard fresh = {CGL_R(0.0), CGL_R(0.0), unknown, unknown, CGL_R(0.0), CGL_R(1.0), 0U, 0U, 0U, 0U,
                                   CGL_TRIAL_LEARN, false};
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

/* Learning was wrong: the best v holds for a while. */
static void strike(cgl_trial_guard *guard)
{
    set_strikes(guard, guard->strikes + 1U);
    guard->wait = (1U << (2U * guard->strikes)) - 1U;
    guard->phase = CGL_TRIAL_HOLD;
}

/* growth: of the best that is too much. */
static bool is_too_much(const cgl_trial_guard *guard, cgl_real error, cgl_real growth)
{
    return error > growth * guard->best || (guard->feedback >= CGL_R(0.0) && error > WORSE * guard->feedback);
}

/* The plant has changed, and v, whose error this is, is the best: is it better than v = 0? best: before the change. */
static void accept(cgl_trial_guard *guard, cgl_real error, cgl_real best)
{
    const cgl_real f = guard->feedback;
    const cgl_real more = f > guard->jump ? f : guard->jump;
    const cgl_real less = f > guard->jump ? guard->jump : f;
    const bool is_better = error <= f && GROWN * less <= more && CGL_R(8.0) * (error + best) <= more;
    guard->best = error;
    guard->above = 0U;
    if (is_better) {
        guard->feedback = more; /* about: it differs by `less` at most, and the best */
        set_strikes(guard, 0U);
    }
    guard->phase = is_better ? CGL_TRIAL_LEARN : CGL_TRIAL_COMPARE;
}

/* v was learned, and runs. */
static void judge_learned(cgl_trial_guard *guard, cgl_trial_verdict *verdict)
{
    const cgl_real error = guard->error, best = guard->best;
    const cgl_real growth = guard->limited ? WORSE : GROWN;
    verdict->learn = true;
    if (best < CGL_R(0.0) || !is_too_much(guard, error, growth)) {
        guard->above = 0U;
        if (best < CGL_R(0.0) || error < best) {
            if (guard->strikes > 0U && WORSE * error < best) {
                set_strikes(guard, guard->strikes - 1U);
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
    const bool has_halved = !goes_on && GROWN * error <= guard->jump;
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

/* The best v runs. */
static void judge_best(cgl_trial_guard *guard, bool none, cgl_trial_verdict *verdict)
{
    const cgl_real error = guard->error, best = guard->best;
    if (is_too_much(guard, error, GROWN) || GROWN * error < best) {
        guard->jump = error;
        accept(guard, error, best);
        if (none) { /* nothing to compare */
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

/* v = 0 runs. */
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
