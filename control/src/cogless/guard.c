#include "guard.h"

#define BAR CGL_R(1.18)          /* times the baseline's variance: 9 % of its ripple */
#define FAR CGL_R(4.0)           /* beyond it a window counts twice */
#define LOUD CGL_R(36.0)         /* beyond it, */
#define LOUD_QUARTERS CGL_R(2.0) /* or beyond the squares of so many such quarters, a window is over */
#define STRIKES 3U
#define FALLS CGL_R(0.7)         /* in a window: wait another */
#define HOLD_MOST 4U             /* windows */
#define AWAY CGL_R(0.1)          /* of the reference: a rotor that begins with a larger error runs up */
#define PATIENCE CGL_R(3.0)      /* [s] that learning waits for a calm window to begin with; a run-up spoils two quarters */
#define EVEN CGL_R(2.0)          /* a window's first quarter to another: more is a run-up, or learning that helped within it */
#define NO_WORSE CGL_R(0.9)      /* of what it is compared with, after */
#define LOOK_TIME CGL_R(2.0)     /* [s] and */
#define LOOK_TURNS CGL_R(3.0)
#define HALTS CGL_R(0.9)         /* of the samples are learned from: fewer, and it looks at once */
#define PROVEN CGL_R(0.2)        /* and after */
#define GAINED CGL_R(0.5)        /* of the baseline: more than this, and it is measured again in time */
#define PROOF_TIME CGL_R(4.0)    /* [s] and */
#define PROOF_TURNS CGL_R(16.0)
#define RISEN CGL_R(2.5)         /* since learning began, or the baseline was supposed: measure it */
#define AGREE CGL_R(1.5)         /* two windows of a probe */
#define PROBE_MOST 6U            /* windows */
#define AGED 100U                /* windows after which a baseline is measured anew where little is gained */
#define MUTED 40U                /* windows */
#define RETRY 50U                /* good windows until a gentler step is taken back, doubled each time */
#define MOVING 8U                /* windows with a reference that moves are patient */
#define SAME CGL_R(1.1)          /* one speed */
#define NEAR CGL_R(2.8)          /* so far a baseline is carried */
#define BELOW CGL_R(0.7)         /* a step holds from there on */
#define SHORTEST CGL_R(0.0625)   /* [s] */
#define LONGEST CGL_R(1.25)      /* [s] */
#define RAMP CGL_R(0.5)          /* of the share [s]: slow to the feedback, which takes over a load that was learned */
#define SETTLE CGL_R(0.6)        /* with the ramp [s] */
#define QUICK CGL_R(5.0)         /* so much faster, and a third of the time, for what does harm */
#define MOVED CGL_R(0.02)
#define ELSEWHERE CGL_R(1.25)    /* another speed */
#define CLEARED CGL_R(6.2)       /* quarters of a turn, in which every cell is passed, after as many as a Q filter waits for */
#define STALLED CGL_R(0.5)       /* of the reference: an error of more, and the rotor doesn't turn with it */
#define ENDLESS 2U               /* so many of the longest quarters: a limit that does not end */
#define SLOWEST CGL_R(0.01)      /* below it is all one speed [rad/s] */
#define SMALLEST CGL_R(1.0e-20)  /* a variance below it is nothing [rad^2/s^2] */
#define SQUARE_MAX CGL_R(1.0e30)

const cgl_gentle cgl_gentle_steps[CGL_GUARD_STEPS + 1U] = {
    {CGL_REAL_MAX, CGL_R(1.0), CGL_R(1.0)}, {CGL_R(1.01), CGL_R(1.0), CGL_R(1.0)}, {CGL_R(0.5), CGL_R(1.0), CGL_R(0.98)},
    {CGL_R(0.5), CGL_R(0.5), CGL_R(0.95)},  {CGL_R(0.5), CGL_R(0.25), CGL_R(0.9)}, {CGL_R(0.5), CGL_R(0.0625), CGL_R(0.8)},
    {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)}};

/* Steps in a time [s], at least one. */
CGL_SELDOM static uint32_t steps_in(cgl_real time, cgl_real ts)
{
    const cgl_real steps = time / ts, most = CGL_R(1.0e8);
    return 1U + (uint32_t)(steps < most ? steps : most);
}

CGL_SELDOM cgl_error cgl_guard_init(cgl_guard *guard, cgl_real ts)
{
    if (!cgl_is_positive(ts)) {
        return CGL_ERROR_CONFIG;
    }
    guard->ts = ts;
    guard->quarter_turn = CGL_R(0.5) * CGL_PI / ts;
    guard->shortest = steps_in(SHORTEST, ts);
    guard->longest = steps_in(LONGEST, ts);
    guard->settle = steps_in(SETTLE, ts);
    cgl_guard_reset(guard);
    return CGL_OK;
}

CGL_SELDOM static void begin_quarter(cgl_guard *guard)
{
    guard->sum = guard->squares = guard->turned = CGL_R(0.0);
    guard->count = 0U;
    guard->most = CGL_REAL_MAX;
    guard->length = guard->longest;
}

CGL_SELDOM static void begin_window(cgl_guard *guard)
{
    begin_quarter(guard);
    guard->sum_before = guard->squares_before = guard->fast = guard->drift = CGL_R(0.0);
    guard->count_before = 0U;
    guard->quarter = 0U;
    guard->moved = false;
    guard->taught = 0U;
    guard->tolerance = CGL_R(-1.0); /* the reference of the first sample is to come */
}

CGL_SELDOM static void go_to(cgl_guard *guard, cgl_guard_phase phase)
{
    const bool acts = phase <= CGL_GUARD_HOLD;
    guard->phase = (uint8_t)phase;
    guard->target = acts ? CGL_R(1.0) : CGL_R(0.0);
    guard->settling = guard->share < guard->target || guard->share > guard->target ? guard->settle : 0U;
    guard->slope = guard->ts < RAMP ? guard->ts / RAMP : CGL_R(1.0);
    guard->learn = phase == CGL_GUARD_LEARN && guard->settling == 0U; /* what a part of the share leaves is not to be learned */
    guard->forget = phase == CGL_GUARD_CLEAR;
    guard->windows = guard->strikes = 0U;
    guard->way = CGL_R(0.0);
    guard->time = guard->limited = 0U;
    begin_window(guard);
}

CGL_SELDOM void cgl_guard_reset(cgl_guard *guard)
{
    guard->share = CGL_R(1.0);
    guard->gentle = 1U;
    static const cgl_guard_ripple nothing = {CGL_R(0.0), CGL_R(0.0)};
    guard->last_error = guard->centre = guard->reference = guard->last = CGL_R(0.0);
    guard->first = guard->quietest = guard->here = CGL_R(0.0);
    guard->suspect = nothing;
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        guard->omega[n] = CGL_R(0.0);
        guard->baseline[n] = nothing;
    }
    for (uint32_t k = 0U; k < CGL_GUARD_STEPS; ++k) {
        guard->from[k] = k > 0U ? CGL_REAL_MAX : CGL_R(0.0);
    }
    guard->wait = guard->short_of = 0U;
    guard->good = 0U;
    guard->alarms = guard->doubts = guard->lessons = guard->backoff = guard->next = 0U;
    guard->last_moved = guard->elsewhere = guard->supposed = guard->compared = guard->stalled = false;
    guard->best = CGL_R(0.0);
    go_to(guard, CGL_GUARD_IDLE);
}

static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

/* How far apart two speeds are, as a ratio of at least 1. */
CGL_SELDOM static cgl_real apart(cgl_real a, cgl_real b)
{
    return a > b ? (b > CGL_R(0.0) ? a / b : CGL_REAL_MAX) : (b > a ? (a > CGL_R(0.0) ? b / a : CGL_REAL_MAX) : CGL_R(1.0));
}

/* Place of the baseline nearest to a speed, CGL_GUARD_SPEEDS if there is none within `most`. */
CGL_SELDOM static uint32_t nearest(const cgl_guard *guard, cgl_real omega, cgl_real most)
{
    uint32_t found = CGL_GUARD_SPEEDS;
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        if (guard->baseline[n].slow > CGL_R(0.0)) {
            const cgl_real way = apart(guard->omega[n], omega);
            if (way < most) {
                most = way;
                found = n;
            }
        }
    }
    return found;
}

/* The variance without learning at a speed, 0 where nobody knows: that of a near speed; towards higher speeds it falls. */
CGL_SELDOM static cgl_real bar_at(const cgl_guard *guard, cgl_real omega)
{
    const uint32_t n = nearest(guard, omega, NEAR);
    if (n == CGL_GUARD_SPEEDS) {
        return CGL_R(0.0);
    }
    const cgl_real ratio = guard->omega[n] / omega;
    return guard->baseline[n].slow * (omega > SAME * guard->omega[n] ? ratio * ratio : CGL_R(1.0));
}

/* A window in one number. Above the bar it has more than 1.18 times the ripple of the mean of two samples, or of all of it. The
 * fast part is the same at other speeds: ripple is less where its frequency is higher, and counts don't know the speed. */
CGL_SELDOM static cgl_real weighed(const cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const uint32_t n = nearest(guard, omega, NEAR);
    const cgl_real more = n < CGL_GUARD_SPEEDS ? ripple->fast - BAR * guard->baseline[n].fast : CGL_R(0.0);
    return ripple->slow + larger(more, CGL_R(0.0));
}

/* Sets how long this quarter is, and what its squares may come to. */
CGL_SELDOM static void watch(cgl_guard *guard)
{
    const cgl_real speed = cgl_abs(guard->reference), omega = speed > SLOWEST ? speed : SLOWEST, b = bar_at(guard, omega);
    const cgl_real turn = guard->quarter_turn / omega, shortest = (cgl_real)guard->shortest, longest = (cgl_real)guard->longest;
    cgl_real length = turn < longest ? turn : longest;
    if (turn < shortest) {
        const cgl_real more = (shortest - CGL_R(1.0)) / turn; /* quarter turns; a rotor so fast that they count nothing: any time */
        const cgl_real whole = more < CGL_R(1.0e6) ? (cgl_real)(1U + (uint32_t)more) * turn : shortest;
        length = whole < longest ? whole : longest;
    }
    guard->length = (uint32_t)(length + CGL_R(0.5));
    guard->most = CGL_REAL_MAX;
    const bool begins = guard->phase == CGL_GUARD_IDLE && guard->taught > 0U && !guard->moved;
    const bool goes_on = guard->phase == CGL_GUARD_LEARN && !guard->moved && !guard->last_moved;
    const bool compared = guard->compared || (begins && guard->quarter > 0U);
    const cgl_real bar = b > CGL_R(0.0) || !compared ? b : guard->quietest;
    if ((begins || goes_on || guard->phase == CGL_GUARD_HOLD) && bar > CGL_R(0.0)) {
        guard->most = LOUD_QUARTERS * LOUD * bar * length;
    }
}

/* Takes a baseline that was measured. What a rotor has that does not turn with its reference is none for long: without the load
 * that holds it it would be less. So it is only supposed, and measured again when the ripple, `best` so far, rises. */
CGL_SELDOM static void measure(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *baseline, cgl_real best)
{
    uint32_t n = nearest(guard, omega, SAME);
    if (n == CGL_GUARD_SPEEDS) {
        n = guard->next;
        guard->next = (uint8_t)(n + 1U < CGL_GUARD_SPEEDS ? n + 1U : 0U);
    }
    guard->omega[n] = omega;
    guard->baseline[n] = *baseline;
    guard->supposed = guard->stalled;
    guard->best = best;
}

/* The gentler step that holds at a speed. */
CGL_SELDOM static uint32_t step_at(const cgl_guard *guard, cgl_real omega)
{
    uint32_t k = CGL_GUARD_STEPS;
    while (k > 0U && omega < guard->from[k - 1U]) {
        --k;
    }
    return k;
}

CGL_SELDOM static void be_gentler(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = step_at(guard, omega);
    const cgl_real from = BELOW * omega;
    for (uint32_t n = 0U; n <= k && n < CGL_GUARD_STEPS; ++n) {
        guard->from[n] = guard->from[n] < from ? guard->from[n] : from;
    }
    guard->backoff = (uint8_t)(guard->backoff < 6U ? guard->backoff + 1U : 6U);
    guard->good = 0U;
    guard->alarms = 0U;
}

/* A gentler step is taken back at this speed and a little above. */
CGL_SELDOM static void be_bolder(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = step_at(guard, omega);
    for (uint32_t n = k > 1U ? k - 1U : 1U; n < CGL_GUARD_STEPS; ++n) {
        const cgl_real from = CGL_R(1.25) * omega;
        guard->from[n] = guard->from[n] > from ? guard->from[n] : from;
    }
    guard->good = 0U;
}

CGL_SELDOM static void probe(cgl_guard *guard, const cgl_guard_ripple *suspect, bool harms)
{
    guard->suspect = *suspect;
    go_to(guard, CGL_GUARD_PROBE);
    if (harms) {
        guard->slope *= QUICK;
        guard->settling = guard->settling / 3U;
    }
}

CGL_SELDOM static void hold(cgl_guard *guard, cgl_real v)
{
    go_to(guard, CGL_GUARD_HOLD);
    guard->last = v;
}

CGL_SELDOM static void mute(cgl_guard *guard, uint32_t windows)
{
    go_to(guard, CGL_GUARD_MUTE);
    guard->wait = windows;
}

/* Learning begins or goes on at this speed. */
CGL_SELDOM static void learn_on(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = step_at(guard, omega);
    guard->gentle = k;
    if (k == CGL_GUARD_STEPS) {
        mute(guard, RETRY << guard->backoff);
    } else {
        go_to(guard, CGL_GUARD_LEARN);
    }
}

CGL_SELDOM static void count_good(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, cgl_real v, cgl_real b)
{
    guard->strikes = 0U;
    guard->alarms = (uint8_t)(guard->alarms > 0U && guard->good % 2U == 0U ? guard->alarms - 1U : guard->alarms);
    guard->good = (uint16_t)(guard->good < UINT16_MAX ? guard->good + 1U : UINT16_MAX);
    if (guard->gentle > 1U && guard->good >= RETRY << guard->backoff) {
        be_bolder(guard, omega);
        guard->gentle = step_at(guard, omega);
    } else if (v > GAINED * b) {
        if (++guard->windows >= AGED) {
            probe(guard, ripple, false);
        }
    } else {
        guard->windows = 0U;
    }
}

/* Without a baseline: looks after a while whether learning does harm, and later whether it has proven itself. */
CGL_SELDOM static void prove(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const cgl_real v = ripple->slow, time = (cgl_real)guard->time * guard->ts, turn = CGL_R(4.0) * guard->quarter_turn;
    const bool halts = (cgl_real)guard->taught < HALTS * (cgl_real)guard->count_before; /* at a limit, as what is unstable */
    const bool rises = guard->best > CGL_R(0.0) && v > RISEN * guard->best;
    const bool harms = guard->compared && (rises || v > FAR * guard->quietest);
    guard->best = v < guard->best ? v : guard->best;
    if (!harms && !halts && (time < LOOK_TIME || guard->way < LOOK_TURNS * turn)) {
        return;
    }
    const bool late = time >= PROOF_TIME && guard->way >= PROOF_TURNS * turn;
    if (!harms && guard->compared && v < (late ? PROVEN : NO_WORSE) * guard->quietest) {
        guard->strikes = 0U;
        if (late && guard->best > CGL_R(0.0)) {
            probe(guard, ripple, false); /* what fell may have been the drive's own start: no proof */
        } else if (late) {
            const cgl_guard_ripple baseline = {guard->quietest, ripple->fast};
            measure(guard, omega, &baseline, v);
            guard->supposed = true;
        }
        return;
    }
    guard->strikes = (uint8_t)(guard->strikes + (harms ? STRIKES : 2U));
    if (guard->strikes >= STRIKES) {
        probe(guard, ripple, harms);
    }
}

CGL_SELDOM static void judge_learning(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm)
{
    if (apart(omega, guard->here) > SAME) {
        guard->compared = guard->compared && !(guard->here > CGL_R(0.0));
        guard->here = omega;
        guard->elsewhere = guard->elsewhere || guard->lessons > 0U;
        guard->lessons = 0U;
    }
    if (guard->taught > 0U && guard->lessons < UINT8_MAX) {
        ++guard->lessons;
    }
    guard->gentle = step_at(guard, omega);
    const cgl_real b = bar_at(guard, omega), v = weighed(guard, omega, ripple);
    if (guard->gentle == CGL_GUARD_STEPS) {
        mute(guard, RETRY << guard->backoff);
    } else if (!(b > CGL_R(0.0))) {
        if (calm) {
            prove(guard, omega, ripple);
        }
    } else if (v <= BAR * b && !(guard->supposed && v > RISEN * guard->best)) {
        guard->best = v < guard->best ? v : guard->best;
        count_good(guard, omega, ripple, v, b);
    } else {
        guard->strikes = (uint8_t)(guard->strikes + (v > FAR * b && calm ? 2U : 1U));
        if (guard->strikes < (calm ? STRIKES : MOVING) + guard->doubts) {
            return;
        }
        if (v <= BAR * b) {
            probe(guard, ripple, false);
        } else {
            hold(guard, v);
        }
    }
}

CGL_SELDOM static void judge_holding(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const cgl_real b = bar_at(guard, omega), v = weighed(guard, omega, ripple), last = guard->last;
    guard->last = v;
    ++guard->windows;
    if (v <= BAR * b) {
        guard->alarms = (uint8_t)(guard->alarms + (guard->windows > 1U ? 10U : 5U));
        if (guard->alarms >= 20U) {
            be_gentler(guard, omega);
        }
        learn_on(guard, omega);
    } else if (!(v < FALLS * last && guard->windows < HOLD_MOST)) {
        probe(guard, ripple, true);
    }
}

CGL_SELDOM static void judge_probe(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm, bool learn)
{
    ++guard->windows;
    const cgl_real v = ripple->slow, last = guard->last;
    const bool agree = v <= AGREE * last && last <= AGREE * v;
    guard->last = v;
    if (guard->windows < 2U || (!(calm && agree) && guard->windows < PROBE_MOST)) {
        return;
    }
    const cgl_guard_ripple baseline = {v < last ? v : last, ripple->fast};
    measure(guard, omega, &baseline, guard->suspect.slow);
    const cgl_real b = bar_at(guard, omega), suspect = weighed(guard, omega, &guard->suspect);
    if (suspect <= BAR * b) {
        guard->doubts = (uint8_t)(guard->doubts < 3U ? 2U * guard->doubts + 1U : 7U);
        learn_on(guard, omega);
    } else if (learn && (guard->lessons > 2U || !guard->elsewhere)) {
        be_gentler(guard, omega);
        if (suspect > LOUD * b) {
            be_gentler(guard, omega); /* the next step would not be enough */
        }
        go_to(guard, CGL_GUARD_CLEAR);
    } else {
        mute(guard, MUTED);
    }
}

CGL_SELDOM static void judge_mute(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm, bool learn)
{
    if (calm) {
        measure(guard, omega, ripple, ripple->slow);
    }
    const bool forbidden = step_at(guard, omega) == CGL_GUARD_STEPS;
    guard->wait -= guard->wait > 0U ? 1U : 0U;
    if (calm && !forbidden && apart(omega, guard->here) > ELSEWHERE) {
        learn_on(guard, omega);
    } else if (guard->wait == 0U && learn) {
        if (forbidden) {
            be_bolder(guard, omega);
        }
        go_to(guard, CGL_GUARD_CLEAR);
    }
}

CGL_SELDOM static bool is_out_of_patience(const cgl_guard *guard)
{
    return (cgl_real)guard->wait * guard->ts >= PATIENCE;
}

/* Learning hasn't begun: the last calm window is the baseline, and with one it may begin. */
CGL_SELDOM static void judge_idle(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm)
{
    if (guard->taught > 0U) {
        go_to(guard, CGL_GUARD_LEARN);
        return;
    }
    if (calm) {
        measure(guard, omega, ripple, ripple->slow);
        guard->wait = 0U;
    }
    guard->learn = calm || is_out_of_patience(guard);
}

CGL_SELDOM static void end_window(cgl_guard *guard, bool learn)
{
    const cgl_real count = (cgl_real)guard->count_before, mean = guard->sum_before / count;
    const cgl_real variance = guard->squares_before / count - mean * mean;
    const cgl_real speed = cgl_abs(guard->reference), omega = speed > SLOWEST ? speed : SLOWEST;
    const cgl_real error = guard->centre + mean; /* where the rotor doesn't turn with its reference, all of it is ripple */
    guard->stalled = cgl_abs(error) > STALLED * omega;
    const cgl_real slow = variance + (guard->stalled ? error * error : CGL_R(0.0));
    const cgl_guard_ripple ripple = {larger(slow, SMALLEST), guard->fast / count};
    const bool known = bar_at(guard, omega) > CGL_R(0.0);
    if (guard->taught > 0U && !known && !guard->elsewhere && !guard->compared && !guard->moved) {
        guard->compared = true;
        const bool fell = guard->first > EVEN * guard->quietest; /* what began high may have been no ripple: it must not rise */
        guard->quietest = fell ? guard->first : guard->quietest;
        guard->best = fell ? ripple.slow : CGL_R(0.0);
    }
    const cgl_real way = guard->drift + mean;
    const bool calm = !guard->moved && !guard->last_moved && way * way <= ripple.slow;
    guard->centre += mean;
    guard->last_moved = guard->moved;
    guard->limited = 0U;
    switch (guard->phase) {
    case CGL_GUARD_IDLE:
        judge_idle(guard, omega, &ripple, calm);
        break;
    case CGL_GUARD_LEARN:
        judge_learning(guard, omega, &ripple, calm);
        break;
    case CGL_GUARD_HOLD:
        judge_holding(guard, omega, &ripple);
        break;
    case CGL_GUARD_PROBE:
        judge_probe(guard, omega, &ripple, calm, learn);
        break;
    case CGL_GUARD_MUTE:
        judge_mute(guard, omega, &ripple, calm, learn);
        break;
    default: /* CLEAR ends with a turn */
        break;
    }
    begin_window(guard);
}

/* The mean has moved so far: from here on deviations are from where it is. */
CGL_SELDOM static void follow_mean(cgl_guard *guard, cgl_real mean)
{
    const cgl_real before = (cgl_real)guard->count_before * mean;
    guard->centre += mean;
    guard->drift += mean;
    guard->squares -= guard->sum * mean;
    guard->sum = CGL_R(0.0);
    guard->squares_before += mean * (before - CGL_R(2.0) * guard->sum_before);
    guard->sum_before -= before;
}

/* More squares than this quarter may have. False: it was the mean that moved; about it the quarter may have as many as before. */
CGL_SELDOM static bool ends_loud(cgl_guard *guard)
{
    const cgl_real count = (cgl_real)guard->count, mean = guard->sum / count;
    const cgl_real squares = guard->squares - guard->sum * mean;
    if (guard->moved) {
        guard->most = CGL_REAL_MAX;
        return false;
    }
    if (squares < guard->most) {
        follow_mean(guard, mean);
        return false;
    }
    const cgl_guard_ripple loud = {squares / count, CGL_R(0.0)};
    if (guard->phase == CGL_GUARD_HOLD) {
        guard->share = CGL_R(0.0); /* no time to fade */
        probe(guard, &loud, true);
    } else {
        hold(guard, loud.slow);
    }
    return true;
}

/* Of a quarter before learning began, with a variance v: whether its window had begun while the rotor ran up. */
CGL_SELDOM static bool runs_up(cgl_guard *guard, cgl_real v)
{
    const bool ran_up = guard->moved || guard->first > EVEN * v;
    guard->wait += guard->wait < UINT32_MAX / 2U ? guard->count : 0U;
    if (is_out_of_patience(guard)) {
        guard->learn = ran_up; /* else this window may be the calm one */
    } else if (guard->moved) {
        guard->learn = false;
    }
    return ran_up;
}

CGL_SELDOM static void end_quarter(cgl_guard *guard, const cgl_guard_input *in)
{
    if (!(guard->squares <= SQUARE_MAX && guard->fast <= SQUARE_MAX && cgl_is_finite(guard->turned))) {
        begin_window(guard);
        return;
    }
    if (guard->squares >= guard->most && ends_loud(guard)) {
        return;
    }
    if (guard->count < guard->length) {
        return;
    }
    const cgl_real count = (cgl_real)guard->count, mean = guard->sum / count;
    const cgl_real v = guard->squares / count - mean * mean, omega = cgl_abs(guard->reference);
    guard->first = guard->quarter == 0U ? v : guard->first;
    if (!guard->compared) {
        guard->quietest = guard->quarter == 0U || v < guard->quietest ? v : guard->quietest;
    }
    if (guard->phase == CGL_GUARD_IDLE && guard->taught == 0U && runs_up(guard, v)) {
        begin_window(guard);
        return;
    }
    guard->way += guard->phase == CGL_GUARD_CLEAR ? cgl_abs(guard->turned) : omega * count;
    guard->time += guard->time < UINT32_MAX / 2U ? guard->count : 0U;
    guard->sum_before += guard->sum;
    guard->squares_before += guard->squares;
    guard->count_before += guard->count;
    ++guard->quarter;
    if (guard->phase == CGL_GUARD_CLEAR && guard->way > CLEARED * guard->quarter_turn) {
        guard->elsewhere = false;
        learn_on(guard, omega);
    } else if (guard->quarter == 4U) {
        end_window(guard, in->learn);
    } else {
        begin_quarter(guard);
        watch(guard);
    }
}

/* The share goes to its target, and what swings by that dies out. */
CGL_SELDOM static void settle(cgl_guard *guard)
{
    const cgl_real rest = guard->target - guard->share;
    --guard->settling;
    guard->share = cgl_is_within(rest, guard->slope) ? guard->target : guard->share + cgl_clamp(rest, guard->slope);
    guard->learn = guard->phase == CGL_GUARD_LEARN && guard->settling == 0U;
}

/* Whether an unusual sample counts. An instability saturates the current loop too, but now this way and now the other: what is
 * longer than a quarter is something else, and the window that it spoils begins anew with what comes after. Unless it does
 * not end, as where a map that was learned under a load drives the rotor to its limit without it, and learns nothing there:
 * a probe says whose fault it is. */
CGL_SELDOM static bool counts(cgl_guard *guard, const cgl_guard_input *in)
{
    const bool weak = guard->short_of >= guard->shortest;
    guard->short_of = in->saturated ? (weak ? guard->short_of : guard->short_of + 1U) : 0U;
    if (guard->settling > 0U) {
        settle(guard);
        return false;
    }
    guard->limited += in->saturated ? 1U : 0U;
    if (guard->phase == CGL_GUARD_PROBE && guard->limited > guard->shortest) {
        guard->suspect.slow = guard->suspect.fast = CGL_R(0.0); /* it is so without what was learned */
    }
    if (guard->limited > ENDLESS * guard->longest && (guard->phase == CGL_GUARD_LEARN || guard->phase == CGL_GUARD_HOLD)) {
        static const cgl_guard_ripple endless = {SQUARE_MAX, CGL_R(0.0)};
        probe(guard, &endless, true);
        return false;
    }
    if (weak) {
        begin_window(guard);
        guard->last_moved = true; /* and until then the speed has to come back */
        return false;
    }
    return in->plausible;
}

/* The first sample of a window, or a reference that has moved since. A rotor that is with its reference in the very first one
 * may learn at once: what the first quarter has is no run-up. */
CGL_SELDOM static void compare_reference(cgl_guard *guard, const cgl_guard_input *in)
{
    if (guard->tolerance < CGL_R(0.0)) {
        guard->reference = cgl_is_finite(in->omega_ref) ? in->omega_ref : CGL_R(0.0);
        guard->tolerance = MOVED * cgl_abs(guard->reference);
        if (guard->phase == CGL_GUARD_IDLE && guard->wait == 0U && !guard->learn) {
            guard->learn = cgl_is_within(in->error, AWAY * larger(cgl_abs(guard->reference), SLOWEST));
        }
        watch(guard);
    } else {
        guard->moved = true;
    }
}

void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in)
{
    const bool usual = in->plausible && !in->saturated && (guard->short_of | guard->settling) == 0U;
    if (!CGL_OFTEN(usual) && !counts(guard, in)) {
        guard->last_error = in->error;
        return;
    }
    if (!CGL_OFTEN(cgl_is_within(in->omega_ref - guard->reference, guard->tolerance))) {
        compare_reference(guard, in);
    }
    const cgl_real half = CGL_R(0.5) * (in->error - guard->last_error), deviation = in->error - half - guard->centre;
    guard->last_error = in->error;
    guard->sum += deviation;
    guard->squares += deviation * deviation;
    guard->fast += half * half;
    if (guard->forget) {
        guard->turned += in->omega_m;
    }
    guard->taught += in->learned ? 1U : 0U;
    ++guard->count;
    if (!(guard->count < guard->length && guard->squares < guard->most)) {
        end_quarter(guard, in);
    }
}
