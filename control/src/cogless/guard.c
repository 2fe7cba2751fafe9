#include "guard.h"

/* Ratios of variances to the baseline. */
#define BAD_RATIO CGL_R(1.18)    /* A bad window is beyond it: by 9 % of the ripple, which is more than its scatter. */
#define SEVERE_RATIO CGL_R(4.0)  /* A window beyond it, with twice the ripple, is two strikes. */
#define LOUD_RATIO CGL_R(36.0)   /* Beyond it, six times the ripple, one gentler step would not be enough. */
#define LITTLE_GAIN CGL_R(0.5)   /* Where learning leaves more, the baseline is measured again after BASELINE_WINDOWS. */
#define LOUD_QUARTERS CGL_R(2.0) /* A burst has the squares of so many loud quarters. */

/* Ratios of variances to those at the begin of learning, where there is no baseline. */
#define LOOK_RATIO CGL_R(0.9)  /* With more after LOOK_TIME and LOOK_TURNS, a probe begins. */
#define PROOF_RATIO CGL_R(0.2) /* With less after PROOF_TIME and PROOF_TURNS, learning helps. */
#define RISEN_RATIO CGL_R(2.5) /* A rise by so much above the least since then leads to a probe at once. */
#define EVEN_RATIO CGL_R(2.0)  /* A first quarter so far above another belongs to a run-up, or to learning that helps quickly. */

/* Ratios of variances of two windows in a row. */
#define FALLING_RATIO CGL_R(0.7)  /* Below it the ripple is dying out, and HOLD waits for it. */
#define AGREEING_RATIO CGL_R(1.5) /* Within it two windows of a probe measure the same. */

/* Counts of windows. */
#define STRIKE_LIMIT 3U       /* strikes that suspect what is learned */
#define MOVING_STRIKES 8U     /* as many while the reference moves, since that disturbs the error too */
#define RECOVERY_LIMIT 20U    /* recovery score at which the law becomes gentler */
#define HOLD_WINDOWS 4U       /* HOLD waits no longer for a ripple that falls. */
#define PROBE_WINDOWS 6U      /* A probe waits no longer for two windows that agree. */
#define BASELINE_WINDOWS 100U /* A baseline is out of date after so many windows that gain little. */
#define MUTE_WINDOWS 40U      /* What was learned at another speed does not act for so long. */
#define RETRY_WINDOWS 50U     /* After as many good windows a gentler step is taken back; the number doubles each time. */
#define DOUBLINGS_MOST 6U     /* but no more often than this */

/* Times and turns. */
#define SHORTEST_TIME CGL_R(0.0625)  /* of a quarter [s]: twenty windows take the 5 s that are promised */
#define LONGEST_TIME CGL_R(1.25)     /* of a quarter [s]: one window takes them */
#define CALM_PATIENCE CGL_R(3.0)     /* Learning waits so long for a calm window [s]. */
#define LOOK_TIME CGL_R(2.0)         /* [s] */
#define LOOK_TURNS CGL_R(3.0)        /* the first turns of many laws are wrong */
#define PROOF_TIME CGL_R(4.0)        /* [s] */
#define PROOF_TURNS CGL_R(16.0)      /* by then learning has grown or has not */
#define RAMP_TIME CGL_R(0.5)         /* of the share [s]: the feedback's integral has to take over a load that was learned */
#define SETTLING_TIME CGL_R(0.6)     /* with the ramp [s]: what swings by it dies out */
#define QUICK_FACTOR CGL_R(5.0)      /* The ramp is so much faster for what does harm, */
#define QUICK_SETTLING 3U            /* and settling is so much shorter. */
#define CLEARED_QUARTERS CGL_R(6.2)  /* quarter turns that pass every cell, after those for which a Q filter waits */
#define ENDLESS_QUARTERS 2U          /* A limit for so many of the longest quarters does not end by itself. */

/* Speeds. */
#define RUN_UP_SHARE CGL_R(0.1)      /* A rotor that begins with a larger error, as a share of the reference, runs up. */
#define STALLED_SHARE CGL_R(0.5)     /* A rotor with a larger mean error does not turn with its reference. */
#define MOVED_SHARE CGL_R(0.02)      /* A reference that changes by more within a window moves. */
#define SAME_SPEED CGL_R(1.1)        /* Within this ratio two speeds have one baseline. */
#define OTHER_SPEED CGL_R(1.25)      /* Beyond this ratio what was convicted is tried again. */
#define NEAR_SPEED CGL_R(2.8)        /* Within this ratio the nearest baseline stands in for one that is missing. */
#define STEP_SPEED_SHARE CGL_R(0.7)  /* A gentler step holds from this share of the speed at which it was needed. */
#define SLOWEST_SPEED CGL_R(0.01)    /* Slower references count as this one [rad/s]. */
#define LESSON_SHARE CGL_R(0.9)      /* A law that learns in fewer of the samples is at a limit, as one that is unstable. */

#define SMALLEST_VARIANCE CGL_R(1.0e-20) /* of a window: a ratio to it has a meaning [rad^2/s^2] */
#define LARGEST_SQUARES CGL_R(1.0e30)    /* of a quarter: their sums and ratios are finite [rad^2/s^2] */

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
    guard->shortest_quarter = steps_in(SHORTEST_TIME, ts);
    guard->longest_quarter = steps_in(LONGEST_TIME, ts);
    guard->settling_length = steps_in(SETTLING_TIME, ts);
    cgl_guard_reset(guard);
    return CGL_OK;
}

CGL_SELDOM static void begin_quarter(cgl_guard *guard)
{
    guard->quarter_sum = guard->quarter_squares = guard->quarter_way = CGL_R(0.0);
    guard->quarter_count = 0U;
    guard->squares_limit = CGL_REAL_MAX;
    guard->quarter_length = guard->longest_quarter;
}

CGL_SELDOM static void begin_window(cgl_guard *guard)
{
    begin_quarter(guard);
    guard->window_sum = guard->window_squares = guard->window_fast = guard->centre_drift = CGL_R(0.0);
    guard->window_count = 0U;
    guard->quarter_index = 0U;
    guard->reference_moved = false;
    guard->lesson_samples = 0U;
    guard->reference_tolerance = CGL_R(-1.0); /* the reference of the first sample is to come */
}

CGL_SELDOM static void go_to(cgl_guard *guard, cgl_guard_phase phase)
{
    const bool acts = phase <= CGL_GUARD_HOLD;
    guard->phase = (uint8_t)phase;
    guard->target_share = acts ? CGL_R(1.0) : CGL_R(0.0);
    guard->settling_samples = guard->share < guard->target_share || guard->share > guard->target_share ? guard->settling_length : 0U;
    guard->share_step = guard->ts < RAMP_TIME ? guard->ts / RAMP_TIME : CGL_R(1.0);
    guard->learn = phase == CGL_GUARD_LEARN && guard->settling_samples == 0U; /* not what a part of the share leaves over */
    guard->forget = phase == CGL_GUARD_CLEAR;
    guard->phase_windows = guard->strike_count = 0U;
    guard->phase_way = CGL_R(0.0);
    guard->phase_samples = guard->limited_samples = 0U;
    begin_window(guard);
}

CGL_SELDOM void cgl_guard_reset(cgl_guard *guard)
{
    guard->share = CGL_R(1.0);
    guard->gentle = 1U;
    static const cgl_guard_ripple nothing = {CGL_R(0.0), CGL_R(0.0)};
    guard->last_error = guard->error_centre = guard->window_reference = guard->last_variance = CGL_R(0.0);
    guard->first_quarter_variance = guard->start_variance = guard->lesson_speed = CGL_R(0.0);
    guard->suspected_ripple = nothing;
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        guard->baseline_speed[n] = CGL_R(0.0);
        guard->baseline[n] = nothing;
    }
    for (uint32_t k = 0U; k < CGL_GUARD_STEPS; ++k) {
        guard->step_speed[k] = k > 0U ? CGL_REAL_MAX : CGL_R(0.0);
    }
    guard->wait_count = guard->shortfall_samples = 0U;
    guard->good_windows = 0U;
    guard->recovery_score = guard->extra_strikes = guard->lesson_windows = guard->retry_doublings = guard->next_baseline = 0U;
    guard->reference_moved_before = guard->learned_elsewhere = guard->baseline_is_supposed = false;
    guard->start_is_measured = guard->stalled = false;
    guard->least_variance = CGL_R(0.0);
    go_to(guard, CGL_GUARD_IDLE);
}

static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

/* Ratio of the larger of two speeds to the smaller, at least 1. */
CGL_SELDOM static cgl_real speed_ratio(cgl_real a, cgl_real b)
{
    return a > b ? (b > CGL_R(0.0) ? a / b : CGL_REAL_MAX) : (b > a ? (a > CGL_R(0.0) ? b / a : CGL_REAL_MAX) : CGL_R(1.0));
}

/* Place of the baseline whose speed is nearest to omega, or CGL_GUARD_SPEEDS if none is within a ratio of `most`. */
CGL_SELDOM static uint32_t nearest_baseline(const cgl_guard *guard, cgl_real omega, cgl_real most)
{
    uint32_t place = CGL_GUARD_SPEEDS;
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        if (guard->baseline[n].slow > CGL_R(0.0)) {
            const cgl_real ratio = speed_ratio(guard->baseline_speed[n], omega);
            if (ratio < most) {
                most = ratio;
                place = n;
            }
        }
    }
    return place;
}

/* The variance without learning at a speed, or 0 where none was measured near it. One that is carried to a higher speed falls
 * with * the square of the speed, as the ripple of a constant torque does. */
CGL_SELDOM static cgl_real baseline_at(const cgl_guard *guard, cgl_real omega)
{
    const uint32_t n = nearest_baseline(guard, omega, NEAR_SPEED);
    if (n == CGL_GUARD_SPEEDS) {
        return CGL_R(0.0);
    }
    const cgl_real ratio = guard->baseline_speed[n] / omega;
    return guard->baseline[n].slow * (omega > SAME_SPEED * guard->baseline_speed[n] ? ratio * ratio : CGL_R(1.0));
}

/* The slow part of a window, and what its fast part has beyond the bar. The baseline of the fast part is carried to other
 * speeds as it * is, since the noise of an encoder's counts does not depend on the speed. */
CGL_SELDOM static cgl_real judged_variance(const cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const uint32_t n = nearest_baseline(guard, omega, NEAR_SPEED);
    const cgl_real more = n < CGL_GUARD_SPEEDS ? ripple->fast - BAD_RATIO * guard->baseline[n].fast : CGL_R(0.0);
    return ripple->slow + larger(more, CGL_R(0.0));
}

/* Samples in a quarter: quarter turns of at least SHORTEST_TIME and at most LONGEST_TIME. */
CGL_SELDOM static cgl_real quarter_samples(const cgl_guard *guard, cgl_real omega)
{
    const cgl_real turn = guard->quarter_turn / omega;
    const cgl_real shortest = (cgl_real)guard->shortest_quarter, longest = (cgl_real)guard->longest_quarter;
    if (!(turn < shortest)) {
        return turn < longest ? turn : longest;
    }
    const cgl_real more = (shortest - CGL_R(1.0)) / turn; /* quarter turns; a rotor may be too fast for them to count anything */
    const cgl_real whole = more < CGL_R(1.0e6) ? (cgl_real)(1U + (uint32_t)more) * turn : shortest;
    return whole < longest ? whole : longest;
}

/* Sets how long this quarter is, and which sum of squares is a burst. Only what learning can have made is watched for bursts. */
CGL_SELDOM static void set_quarter(cgl_guard *guard)
{
    const cgl_real speed = cgl_abs(guard->window_reference), omega = speed > SLOWEST_SPEED ? speed : SLOWEST_SPEED;
    const cgl_real b = baseline_at(guard, omega), length = quarter_samples(guard, omega);
    const bool begins = guard->phase == CGL_GUARD_IDLE && guard->lesson_samples > 0U && !guard->reference_moved;
    const bool goes_on = guard->phase == CGL_GUARD_LEARN && !guard->reference_moved && !guard->reference_moved_before;
    const bool has_start = guard->start_is_measured || (begins && guard->quarter_index > 0U);
    const cgl_real bar = b > CGL_R(0.0) || !has_start ? b : guard->start_variance;
    const bool watched = (begins || goes_on || guard->phase == CGL_GUARD_HOLD) && bar > CGL_R(0.0);
    guard->quarter_length = (uint32_t)(length + CGL_R(0.5));
    guard->squares_limit = watched ? LOUD_QUARTERS * LOUD_RATIO * bar * length : CGL_REAL_MAX;
}

/* Stores a baseline in place of that of the same speed, or of the oldest. That of a rotor which does not turn with its
 * reference is * only supposed, since it would be less without the load that holds the rotor. It is measured again when the
 * ripple rises above * `least_variance`. */
CGL_SELDOM static void store_baseline(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *baseline, cgl_real least_variance)
{
    uint32_t n = nearest_baseline(guard, omega, SAME_SPEED);
    if (n == CGL_GUARD_SPEEDS) {
        n = guard->next_baseline;
        guard->next_baseline = (uint8_t)(n + 1U < CGL_GUARD_SPEEDS ? n + 1U : 0U);
    }
    guard->baseline_speed[n] = omega;
    guard->baseline[n] = *baseline;
    guard->baseline_is_supposed = guard->stalled;
    guard->least_variance = least_variance;
}

/* The step that holds at a speed: the last of those that begin at it or below. */
CGL_SELDOM static uint32_t gentle_step_at(const cgl_guard *guard, cgl_real omega)
{
    uint32_t k = CGL_GUARD_STEPS;
    while (k > 0U && omega < guard->step_speed[k - 1U]) {
        --k;
    }
    return k;
}

/* The next step holds from a part of this speed on, and boldness is tried later than before. */
CGL_SELDOM static void be_gentler(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = gentle_step_at(guard, omega);
    const cgl_real from = STEP_SPEED_SHARE * omega;
    for (uint32_t n = 0U; n <= k && n < CGL_GUARD_STEPS; ++n) {
        guard->step_speed[n] = guard->step_speed[n] < from ? guard->step_speed[n] : from;
    }
    guard->retry_doublings = (uint8_t)(guard->retry_doublings < DOUBLINGS_MOST ? guard->retry_doublings + 1U : DOUBLINGS_MOST);
    guard->good_windows = 0U;
    guard->recovery_score = 0U;
}

/* This step is taken back at this speed and a little above. */
CGL_SELDOM static void be_bolder(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = gentle_step_at(guard, omega);
    for (uint32_t n = k > 1U ? k - 1U : 1U; n < CGL_GUARD_STEPS; ++n) {
        const cgl_real from = OTHER_SPEED * omega;
        guard->step_speed[n] = guard->step_speed[n] > from ? guard->step_speed[n] : from;
    }
    guard->good_windows = 0U;
}

/* What is learned fades out, and quickly if it is known to do harm. */
CGL_SELDOM static void begin_probe(cgl_guard *guard, const cgl_guard_ripple *suspect, bool harms)
{
    guard->suspected_ripple = *suspect;
    go_to(guard, CGL_GUARD_PROBE);
    if (harms) {
        guard->share_step *= QUICK_FACTOR;
        guard->settling_samples = guard->settling_samples / QUICK_SETTLING;
    }
}

CGL_SELDOM static void begin_holding(cgl_guard *guard, cgl_real v)
{
    go_to(guard, CGL_GUARD_HOLD);
    guard->last_variance = v;
}

CGL_SELDOM static void begin_mute(cgl_guard *guard, uint32_t windows)
{
    go_to(guard, CGL_GUARD_MUTE);
    guard->wait_count = windows;
}

/* Learning begins or goes on with the step of this speed, if that step learns anything. */
CGL_SELDOM static void begin_learning(cgl_guard *guard, cgl_real omega)
{
    const uint32_t k = gentle_step_at(guard, omega);
    guard->gentle = k;
    if (k == CGL_GUARD_STEPS) {
        begin_mute(guard, RETRY_WINDOWS << guard->retry_doublings);
    } else {
        go_to(guard, CGL_GUARD_LEARN);
    }
}

/* A window at or below the bar. Enough of them take a gentler step back, and the baseline of a drive that gains little ages. */
CGL_SELDOM static void judge_good(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, cgl_real v, cgl_real b)
{
    guard->strike_count = 0U;
    if (guard->recovery_score > 0U && guard->good_windows % 2U == 0U) {
        --guard->recovery_score;
    }
    guard->good_windows = (uint16_t)(guard->good_windows < UINT16_MAX ? guard->good_windows + 1U : UINT16_MAX);
    if (guard->gentle > 1U && guard->good_windows >= RETRY_WINDOWS << guard->retry_doublings) {
        be_bolder(guard, omega);
        guard->gentle = gentle_step_at(guard, omega);
    } else if (v > LITTLE_GAIN * b) {
        if (++guard->phase_windows >= BASELINE_WINDOWS) {
            begin_probe(guard, ripple, false);
        }
    } else {
        guard->phase_windows = 0U;
    }
}

/* Learning without a baseline. At first it may do what it likes, unless it rises or halts. From LOOK_TIME on it has to be
 * below its * begin, or it is two strikes. From PROOF_TIME on it has to be far below it, and its begin is then the baseline. */
CGL_SELDOM static void judge_without_baseline(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const cgl_real v = ripple->slow, time = (cgl_real)guard->phase_samples * guard->ts, turn = CGL_R(4.0) * guard->quarter_turn;
    const bool halts = (cgl_real)guard->lesson_samples < LESSON_SHARE * (cgl_real)guard->window_count;
    const bool fell_first = guard->least_variance > CGL_R(0.0);
    const bool rises = fell_first && v > RISEN_RATIO * guard->least_variance;
    const bool harms = guard->start_is_measured && (rises || v > SEVERE_RATIO * guard->start_variance);
    guard->least_variance = v < guard->least_variance ? v : guard->least_variance;
    if (!harms && !halts && (time < LOOK_TIME || guard->phase_way < LOOK_TURNS * turn)) {
        return;
    }
    const bool late = time >= PROOF_TIME && guard->phase_way >= PROOF_TURNS * turn;
    if (!harms && guard->start_is_measured && v < (late ? PROOF_RATIO : LOOK_RATIO) * guard->start_variance) {
        guard->strike_count = 0U;
        if (late && fell_first) {
            begin_probe(guard, ripple, false); /* The fall may have been the drive's own start, and is no proof. */
        } else if (late) {
            const cgl_guard_ripple baseline = {guard->start_variance, ripple->fast};
            store_baseline(guard, omega, &baseline, v);
            guard->baseline_is_supposed = true;
        } else { /* It is on its way. */
        }
        return;
    }
    guard->strike_count = (uint8_t)(guard->strike_count + (harms ? STRIKE_LIMIT : 2U));
    if (guard->strike_count >= STRIKE_LIMIT) {
        begin_probe(guard, ripple, harms);
    }
}

/* Lessons are counted for each speed. At another one nothing of this window compares with the begin of learning. */
CGL_SELDOM static void count_lesson(cgl_guard *guard, cgl_real omega)
{
    if (speed_ratio(omega, guard->lesson_speed) > SAME_SPEED) {
        guard->start_is_measured = guard->start_is_measured && !(guard->lesson_speed > CGL_R(0.0));
        guard->lesson_speed = omega;
        guard->learned_elsewhere = guard->learned_elsewhere || guard->lesson_windows > 0U;
        guard->lesson_windows = 0U;
    }
    if (guard->lesson_samples > 0U && guard->lesson_windows < UINT8_MAX) {
        ++guard->lesson_windows;
    }
}

/* A window of learning at a speed whose baseline may be known. Enough strikes lead to HOLD, where what is learned is seen without
 * learning. A rise above a baseline that is only supposed leads to a probe instead. */
CGL_SELDOM static void judge_learning(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm)
{
    count_lesson(guard, omega);
    guard->gentle = gentle_step_at(guard, omega);
    const cgl_real b = baseline_at(guard, omega), v = judged_variance(guard, omega, ripple);
    if (guard->gentle == CGL_GUARD_STEPS) {
        begin_mute(guard, RETRY_WINDOWS << guard->retry_doublings);
    } else if (!(b > CGL_R(0.0))) {
        if (calm) {
            judge_without_baseline(guard, omega, ripple);
        }
    } else if (v <= BAD_RATIO * b && !(guard->baseline_is_supposed && v > RISEN_RATIO * guard->least_variance)) {
        guard->least_variance = v < guard->least_variance ? v : guard->least_variance;
        judge_good(guard, omega, ripple, v, b);
    } else {
        guard->strike_count = (uint8_t)(guard->strike_count + (v > SEVERE_RATIO * b && calm ? 2U : 1U));
        if (guard->strike_count < (calm ? STRIKE_LIMIT : MOVING_STRIKES) + guard->extra_strikes) {
            return;
        }
        if (v <= BAD_RATIO * b) { /* It has risen without being bad. */
            begin_probe(guard, ripple, false);
        } else {
            begin_holding(guard, v);
        }
    }
}

/* Learning stands still. A ripple that ends by that was made by learning itself: often enough, it makes the law gentler. One that
 * stays may be of what is learned, and leads to a probe. */
CGL_SELDOM static void judge_holding(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple)
{
    const cgl_real b = baseline_at(guard, omega), v = judged_variance(guard, omega, ripple), last = guard->last_variance;
    guard->last_variance = v;
    ++guard->phase_windows;
    if (v <= BAD_RATIO * b) {
        const unsigned half = RECOVERY_LIMIT / 2U;
        guard->recovery_score = (uint8_t)(guard->recovery_score + (guard->phase_windows > 1U ? half : half / 2U));
        if (guard->recovery_score >= RECOVERY_LIMIT) {
            be_gentler(guard, omega);
        }
        begin_learning(guard, omega);
    } else if (!(v < FALLING_RATIO * last && guard->phase_windows < HOLD_WINDOWS)) {
        begin_probe(guard, ripple, true);
    }
}

/* Nothing learned acts, until two windows agree. The quieter is the new baseline, and the suspected ripple is judged by it.
 * What was * learned at this speed is cleared; what was learned at another speed may be right there, and does not act for a
 * while. */
CGL_SELDOM static void judge_probe(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm, bool learn)
{
    ++guard->phase_windows;
    const cgl_real v = ripple->slow, last = guard->last_variance;
    const bool agree = v <= AGREEING_RATIO * last && last <= AGREEING_RATIO * v;
    guard->last_variance = v;
    if (guard->phase_windows < 2U || (!(calm && agree) && guard->phase_windows < PROBE_WINDOWS)) {
        return;
    }
    const cgl_guard_ripple baseline = {v < last ? v : last, ripple->fast};
    store_baseline(guard, omega, &baseline, guard->suspected_ripple.slow);
    const cgl_real b = baseline_at(guard, omega), suspect = judged_variance(guard, omega, &guard->suspected_ripple);
    if (suspect <= BAD_RATIO * b) {
        guard->extra_strikes = (uint8_t)(guard->extra_strikes < 3U ? 2U * guard->extra_strikes + 1U : 7U);
        begin_learning(guard, omega);
    } else if (learn && (guard->lesson_windows > 2U || !guard->learned_elsewhere)) {
        be_gentler(guard, omega);
        if (suspect > LOUD_RATIO * b) {
            be_gentler(guard, omega);
        }
        go_to(guard, CGL_GUARD_CLEAR);
    } else {
        begin_mute(guard, MUTE_WINDOWS);
    }
}

/* Nothing learned acts, until the pause is over or the speed is another. After the pause learning begins anew, and from the
 * last step it * goes back by one. */
CGL_SELDOM static void judge_mute(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm, bool learn)
{
    if (calm) {
        store_baseline(guard, omega, ripple, ripple->slow);
    }
    const bool forbidden = gentle_step_at(guard, omega) == CGL_GUARD_STEPS;
    guard->wait_count -= guard->wait_count > 0U ? 1U : 0U;
    if (calm && !forbidden && speed_ratio(omega, guard->lesson_speed) > OTHER_SPEED) {
        begin_learning(guard, omega);
    } else if (guard->wait_count == 0U && learn) {
        if (forbidden) {
            be_bolder(guard, omega);
        }
        go_to(guard, CGL_GUARD_CLEAR);
    }
}

/* In IDLE no window has been calm for CALM_PATIENCE. */
CGL_SELDOM static bool is_out_of_patience(const cgl_guard *guard)
{
    return (cgl_real)guard->wait_count * guard->ts >= CALM_PATIENCE;
}

/* Learning has not begun. The last calm window is the baseline, and with one learning may begin. */
CGL_SELDOM static void judge_idle(cgl_guard *guard, cgl_real omega, const cgl_guard_ripple *ripple, bool calm)
{
    if (guard->lesson_samples > 0U) {
        go_to(guard, CGL_GUARD_LEARN);
        return;
    }
    if (calm) {
        store_baseline(guard, omega, ripple, ripple->slow);
        guard->wait_count = 0U;
    }
    guard->learn = calm || is_out_of_patience(guard);
}

/* The first window of learning without a baseline: what comes later is compared with its quietest quarter. A first quarter far
 * above * that one stands in for it, but it may have been the drive's own start, so the ripple since then is kept too. */
CGL_SELDOM static void measure_start(cgl_guard *guard, cgl_real omega, cgl_real variance)
{
    const bool known = baseline_at(guard, omega) > CGL_R(0.0);
    if (guard->lesson_samples > 0U && !known && !guard->learned_elsewhere && !guard->start_is_measured && !guard->reference_moved) {
        const bool fell = guard->first_quarter_variance > EVEN_RATIO * guard->start_variance;
        guard->start_is_measured = true;
        guard->start_variance = fell ? guard->first_quarter_variance : guard->start_variance;
        guard->least_variance = fell ? variance : CGL_R(0.0);
    }
}

/* Ripple is what the error deviates from its mean. Where the rotor does not turn with its reference, all of the error is
 * ripple. A * window is calm if the reference rested, in the window before too, and the mean moved by no more than the ripple. */
CGL_SELDOM static void end_window(cgl_guard *guard, bool learn)
{
    const cgl_real count = (cgl_real)guard->window_count, mean = guard->window_sum / count;
    const cgl_real variance = guard->window_squares / count - mean * mean, error = guard->error_centre + mean;
    const cgl_real speed = cgl_abs(guard->window_reference), omega = speed > SLOWEST_SPEED ? speed : SLOWEST_SPEED;
    guard->stalled = cgl_abs(error) > STALLED_SHARE * omega;
    const cgl_real slow = variance + (guard->stalled ? error * error : CGL_R(0.0));
    const cgl_guard_ripple ripple = {larger(slow, SMALLEST_VARIANCE), guard->window_fast / count};
    measure_start(guard, omega, ripple.slow);
    const cgl_real way = guard->centre_drift + mean;
    const bool calm = !guard->reference_moved && !guard->reference_moved_before && way * way <= ripple.slow;
    guard->error_centre += mean;
    guard->reference_moved_before = guard->reference_moved;
    guard->limited_samples = 0U;
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
    default: /* CLEAR ends with a turn, in end_quarter. */
        break;
    }
    begin_window(guard);
}

/* The mean has moved by `mean`, and deviations are from there. The sums so far are carried to the new centre. */
CGL_SELDOM static void move_centre(cgl_guard *guard, cgl_real mean)
{
    const cgl_real before = (cgl_real)guard->window_count * mean;
    guard->error_centre += mean;
    guard->centre_drift += mean;
    guard->quarter_squares -= guard->quarter_sum * mean;
    guard->quarter_sum = CGL_R(0.0);
    guard->window_squares += mean * (before - CGL_R(2.0) * guard->window_sum);
    guard->window_sum -= before;
}

/* This quarter has more squares than a burst. Whether it ends: not if the reference moved, nor if it was only the mean that
 * moved, * about which the quarter may have as many squares as before. In HOLD a burst leaves no time for the share to fade. */
CGL_SELDOM static bool ends_loud(cgl_guard *guard)
{
    const cgl_real count = (cgl_real)guard->quarter_count, mean = guard->quarter_sum / count;
    const cgl_real squares = guard->quarter_squares - guard->quarter_sum * mean;
    if (guard->reference_moved) {
        guard->squares_limit = CGL_REAL_MAX;
        return false;
    }
    if (squares < guard->squares_limit) {
        move_centre(guard, mean);
        return false;
    }
    const cgl_guard_ripple loud = {squares / count, CGL_R(0.0)};
    if (guard->phase == CGL_GUARD_HOLD) {
        guard->share = CGL_R(0.0);
        begin_probe(guard, &loud, true);
    } else {
        begin_holding(guard, loud.slow);
    }
    return true;
}

/* Whether the window of a quarter with a variance v began while the rotor ran up. Learning has not begun yet; out of patience it
 * does so even in a run-up, except in the first window, which may be calm. */
CGL_SELDOM static bool runs_up(cgl_guard *guard, cgl_real v)
{
    const bool ran_up = guard->reference_moved || guard->first_quarter_variance > EVEN_RATIO * v;
    guard->wait_count += guard->wait_count < UINT32_MAX / 2U ? guard->quarter_count : 0U;
    if (is_out_of_patience(guard)) {
        guard->learn = ran_up;
    } else if (guard->reference_moved) {
        guard->learn = false;
    }
    return ran_up;
}

/* Adds this quarter to its window and to its phase. */
CGL_SELDOM static void add_quarter(cgl_guard *guard, cgl_real omega)
{
    guard->phase_way += guard->phase == CGL_GUARD_CLEAR ? cgl_abs(guard->quarter_way) : omega * (cgl_real)guard->quarter_count;
    guard->phase_samples += guard->phase_samples < UINT32_MAX / 2U ? guard->quarter_count : 0U;
    guard->window_sum += guard->quarter_sum;
    guard->window_squares += guard->quarter_squares;
    guard->window_count += guard->quarter_count;
    ++guard->quarter_index;
}

/* The quarter is over, or has more squares than a burst. */
CGL_SELDOM static void end_quarter(cgl_guard *guard, const cgl_guard_input *in)
{
    if (!(guard->quarter_squares <= LARGEST_SQUARES && guard->window_fast <= LARGEST_SQUARES && cgl_is_finite(guard->quarter_way))) {
        begin_window(guard);
        return;
    }
    if (guard->quarter_squares >= guard->squares_limit && ends_loud(guard)) {
        return;
    }
    if (guard->quarter_count < guard->quarter_length) {
        return;
    }
    const cgl_real count = (cgl_real)guard->quarter_count, mean = guard->quarter_sum / count;
    const cgl_real v = guard->quarter_squares / count - mean * mean, omega = cgl_abs(guard->window_reference);
    guard->first_quarter_variance = guard->quarter_index == 0U ? v : guard->first_quarter_variance;
    if (!guard->start_is_measured) {
        guard->start_variance = guard->quarter_index == 0U || v < guard->start_variance ? v : guard->start_variance;
    }
    if (guard->phase == CGL_GUARD_IDLE && guard->lesson_samples == 0U && runs_up(guard, v)) {
        begin_window(guard);
        return;
    }
    add_quarter(guard, omega);
    if (guard->phase == CGL_GUARD_CLEAR && guard->phase_way > CLEARED_QUARTERS * guard->quarter_turn) {
        guard->learned_elsewhere = false;
        begin_learning(guard, omega);
    } else if (guard->quarter_index == 4U) {
        end_window(guard, in->learn);
    } else {
        begin_quarter(guard);
        set_quarter(guard);
    }
}

/* One sample of settling: the share goes to its target, and then what swings by that dies out. Learning waits for the end. */
CGL_SELDOM static void fade_share(cgl_guard *guard)
{
    const cgl_real rest = guard->target_share - guard->share;
    --guard->settling_samples;
    guard->share = cgl_is_within(rest, guard->share_step) ? guard->target_share : guard->share + cgl_clamp(rest, guard->share_step);
    guard->learn = guard->phase == CGL_GUARD_LEARN && guard->settling_samples == 0U;
}

/* Counts a sample in which the current loop fell short. A limit that does not end leads to a probe, which shows whose fault it
 * is: * a map that was learned under a load drives the rotor to its limit without that load, and nothing is learned there.
 * Where the limit * lasts in the probe too, it is not the map's fault. True: a probe begins. */
CGL_SELDOM static bool count_limit(cgl_guard *guard, bool saturated)
{
    static const cgl_guard_ripple nothing = {CGL_R(0.0), CGL_R(0.0)}, endless = {LARGEST_SQUARES, CGL_R(0.0)};
    const bool acts = guard->phase == CGL_GUARD_LEARN || guard->phase == CGL_GUARD_HOLD;
    guard->limited_samples += saturated ? 1U : 0U;
    if (guard->phase == CGL_GUARD_PROBE && guard->limited_samples > guard->shortest_quarter) {
        guard->suspected_ripple = nothing;
    }
    if (acts && guard->limited_samples > ENDLESS_QUARTERS * guard->longest_quarter) {
        begin_probe(guard, &endless, true);
        return true;
    }
    return false;
}

/* Whether an unusual sample counts. A current loop that falls short for longer than a quarter is not unstable, since that would
 * alternate. Such a limit spoils its window and the next one, in which the speed comes back. */
CGL_SELDOM static bool is_counted(cgl_guard *guard, const cgl_guard_input *in)
{
    const bool lasts = guard->shortfall_samples >= guard->shortest_quarter;
    guard->shortfall_samples = in->saturated ? (lasts ? guard->shortfall_samples : guard->shortfall_samples + 1U) : 0U;
    if (guard->settling_samples > 0U) {
        fade_share(guard);
        return false;
    }
    if (count_limit(guard, in->saturated)) {
        return false;
    }
    if (lasts) {
        begin_window(guard);
        guard->reference_moved_before = true;
        return false;
    }
    return in->plausible;
}

/* Takes the reference in the first sample of a window, or notes that it has moved since. A rotor that is at its reference in
 * the very * first sample may learn at once, since it does not run up. */
CGL_SELDOM static void compare_reference(cgl_guard *guard, const cgl_guard_input *in)
{
    if (guard->reference_tolerance < CGL_R(0.0)) {
        guard->window_reference = cgl_is_finite(in->omega_ref) ? in->omega_ref : CGL_R(0.0);
        guard->reference_tolerance = MOVED_SHARE * cgl_abs(guard->window_reference);
        if (guard->phase == CGL_GUARD_IDLE && guard->wait_count == 0U && !guard->learn) {
            guard->learn = cgl_is_within(in->error, RUN_UP_SHARE * larger(cgl_abs(guard->window_reference), SLOWEST_SPEED));
        }
        set_quarter(guard);
    } else {
        guard->reference_moved = true;
    }
}

void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in)
{
    const bool usual = in->plausible && !in->saturated && (guard->shortfall_samples | guard->settling_samples) == 0U;
    if (!CGL_OFTEN(usual) && !is_counted(guard, in)) {
        guard->last_error = in->error;
        return;
    }
    if (!CGL_OFTEN(cgl_is_within(in->omega_ref - guard->window_reference, guard->reference_tolerance))) {
        compare_reference(guard, in);
    }
    const cgl_real half = CGL_R(0.5) * (in->error - guard->last_error), deviation = in->error - half - guard->error_centre;
    guard->last_error = in->error;
    guard->quarter_sum += deviation;
    guard->quarter_squares += deviation * deviation;
    guard->window_fast += half * half;
    if (guard->forget) {
        guard->quarter_way += in->omega_m;
    }
    guard->lesson_samples += in->learned ? 1U : 0U;
    ++guard->quarter_count;
    if (!(guard->quarter_count < guard->quarter_length && guard->quarter_squares < guard->squares_limit)) {
        end_quarter(guard, in);
    }
}
