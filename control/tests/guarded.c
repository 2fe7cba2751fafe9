#include "guarded.h"

#include "check.h"
#include "cogless/angle.h"
#include "cogless/guard.h"

#define TS CGL_R(1.0e-3)
#define OMEGA (CGL_R(3.9) * CGL_TWO_PI)
#define WINDOW 258 /* a window is a turn */

static cgl_guard guard;
static unsigned sample;

static void step(double error, bool saturated, bool learn)
{
    const bool learned = learn && cgl_guard_may_learn(&guard) && !saturated;
    const cgl_guard_input in = {(cgl_real)error, OMEGA, true, saturated, learn, learned};
    cgl_guard_step(&guard, &in);
    ++sample;
}

static double wave(void)
{
    cgl_real sine, cosine;
    cgl_sincos(cgl_fraction(CGL_R(6.0) * OMEGA * TS * (cgl_real)(sample % 10000U) / CGL_TWO_PI) * CGL_TWO_PI, &sine, &cosine);
    return (double)sine;
}

/* A ripple of `without`, and of `more` for what is learned; until the phase is another, or so many windows. Returns how many. */
static double run(double windows, double without, double more, bool learn)
{
    const uint8_t phase = guard.phase;
    int n = 0;
    for (; n < (int)(windows * WINDOW) && guard.phase == phase; ++n) {
        step((without + more * (double)guard.share) * wave(), false, learn);
    }
    return (double)n / WINDOW;
}

/* The feedback's ripple is measured in two windows that agree, and then the law may learn. */
static void begin(bool learn)
{
    sample = 0U;
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    CHECK(guard.phase == CGL_GUARD_START && !cgl_guard_may_learn(&guard) && !cgl_guard_acts(&guard));
    step(0.2 * (double)OMEGA, false, learn); /* not yet at its reference */
    const double waited = run(9.0, 1.0, 0.0, learn);
    CHECK(waited > 1.9 && waited < 2.1);
    CHECK(cgl_guard_may_learn(&guard) && within(guard.alone - CGL_R(0.5), CGL_R(0.03)) && within(guard.speed - OMEGA, CGL_R(0.01)));
}

/* What a run-up leaves dies out before anything is learned, and is not in the bar. */
static void a_run_up(void)
{
    sample = 0U;
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    int n = 0;
    for (double error = (double)OMEGA; guard.phase == CGL_GUARD_START; ++n, error *= 0.99) {
        step(error + wave(), false, true);
        CHECK(guard.phase == CGL_GUARD_LEARN || !cgl_guard_may_learn(&guard));
    }
    CHECK(n > 2.9 * WINDOW && n < 4.1 * WINDOW && within(guard.alone - CGL_R(0.5), CGL_R(0.05)));
}

/* A rotor at its reference learns at once. Its first window is the bar, and no burst ends it. */
static void at_once(void)
{
    sample = 0U;
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    step(0.05 * (double)OMEGA, false, true);
    CHECK(cgl_guard_may_learn(&guard) && within(guard.alone, CGL_R(0.0)));
    for (int n = 0; n < WINDOW - 2; ++n) {
        CHECK(within(guard.alone, CGL_R(0.0)));
        step(wave(), false, true);
    }
    (void)run(0.02, 1.0, 0.0, true);
    CHECK(cgl_guard_may_learn(&guard) && within(guard.alone - CGL_R(0.5), CGL_R(0.03)) && guard.patience == 16U);
    CHECK(guard.noise > CGL_R(0.0));
    const double learned = run(20.0, 0.95, 0.0, true);
    CHECK(learned > 15.9 && learned < 16.1 && guard.phase == CGL_GUARD_HOLD);
}

/* Learning that takes nine tenths of the ripple is tested by a quarter of its share. A window counts an eighth of one that gains little. */
static void what_helps(void)
{
    begin(true);
    const double learned = run(1000.0, 1.0, -0.9, true);
    CHECK(learned > 120.0 && learned < 135.0 && guard.phase == CGL_GUARD_HOLD && cgl_guard_acts(&guard));
    CHECK(run(9.0, 1.0, -0.9, true) <= 1.1 && guard.phase == CGL_GUARD_PART);
    CHECK(run(9.0, 1.0, -0.9, true) < 4.0 && guard.phase == CGL_GUARD_LEARN);
    CHECK(within(guard.alone - CGL_R(0.196), CGL_R(0.02))); /* 4 P(3/4) - 3 P(1) */
    CHECK(guard.patience == 32U && guard.gentle == 1U && guard.evidence == 0U);
    CHECK(!cgl_guard_may_learn(&guard)); /* the share goes back first */
    CHECK(run(2.5, 1.0, -0.9, true) > 2.4 && cgl_guard_may_learn(&guard));
}

/* Two bad windows: what is learned is tested against nothing, twice. It is cleared, and learned more gently. */
static void what_hurts(void)
{
    begin(true);
    (void)run(5.0, 1.0, -0.1, true);
    CHECK(run(20.0, 1.0, 0.6, true) < 3.1 && guard.phase == CGL_GUARD_HOLD && !cgl_guard_may_learn(&guard));
    for (int n = 0; n < 2; ++n) {
        CHECK(run(20.0, 1.0, 0.6, true) <= 4.1 && guard.phase == CGL_GUARD_ALONE && guard.evidence == 2U * (unsigned)n);
        CHECK(run(20.0, 1.0, 0.6, true) <= 4.1);
    }
    CHECK(guard.phase == CGL_GUARD_FORGET && cgl_guard_forgets(&guard) && within(guard.share, CGL_R(0.0)));
    CHECK(guard.gentle == 3U && guard.retry == 128U && guard.patience == 16U); /* two steps, as it did harm at once */
    const double cleared = run(20.0, 1.0, 0.6, true);
    CHECK(cleared > 1.55 && cleared < 1.65 && guard.phase == CGL_GUARD_MUTE && !cgl_guard_forgets(&guard));
    CHECK(run(20.0, 1.0, 0.6, true) < 2.2 && guard.phase == CGL_GUARD_LEARN && guard.gentle == 3U);
    int n = 0;
    for (; n < 200 * WINDOW && guard.gentle == 3U; ++n) {
        step(0.8 * wave(), false, true);
    }
    CHECK(n > 120 * WINDOW && n < 140 * WINDOW && guard.gentle == 2U); /* taken back */
}

/* A load with more ripple is no fault of learning, and is the bar from then on. Nor is a disturbance that is over at the second look. */
static void what_does_not(void)
{
    begin(true);
    CHECK(run(20.0, 3.0, 0.0, true) <= 2.1 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(20.0, 3.0, 0.0, true) <= 2.1 && guard.phase == CGL_GUARD_ALONE);
    CHECK(run(20.0, 3.0, 0.0, true) <= 4.5 && guard.phase == CGL_GUARD_LEARN && guard.gentle == 1U);
    CHECK(within(guard.alone - CGL_R(4.5), CGL_R(0.3)));
    begin(true);
    CHECK(run(20.0, 1.9, 0.0, true) <= 2.1 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(20.0, 1.9, 0.0, true) <= 2.1 && guard.phase == CGL_GUARD_ALONE);
    CHECK(run(20.0, 1.0, 0.0, true) <= 4.5 && guard.phase == CGL_GUARD_HOLD && guard.evidence == 2U);
    CHECK(run(20.0, 1.0, 0.0, true) <= 4.5 && guard.phase == CGL_GUARD_LEARN && guard.evidence == 3U);
}

/* Learning that makes three times the ripple is convicted by one test, unless a burst led to it. */
static void what_hurts_much(void)
{
    begin(true);
    (void)run(5.0, 1.0, -0.1, true);
    CHECK(run(20.0, 1.0, 2.0, true) < 3.1 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(20.0, 1.0, 2.0, true) < 3.1 && guard.phase == CGL_GUARD_ALONE && guard.bad == 1U);
    CHECK(run(20.0, 1.0, 2.0, true) < 3.1 && guard.phase == CGL_GUARD_FORGET);
    begin(true);
    CHECK(run(20.0, 1.0, 9.0, true) < 1.0 && guard.phase == CGL_GUARD_HOLD && guard.bad == 2U);
    CHECK(run(20.0, 1.0, 9.0, true) < 1.0 && guard.phase == CGL_GUARD_ALONE && guard.bad == 0U);
    CHECK(run(20.0, 1.0, 2.0, true) < 3.1 && guard.phase == CGL_GUARD_HOLD && guard.evidence == 2U);
}

/* What hurts at every step: in the end nothing is learned, and it is tried again after a while that doubles. */
static void what_always_hurts(void)
{
    begin(true);
    for (int n = 0; n < 100 && !(guard.phase == CGL_GUARD_MUTE && guard.gentle == CGL_GUARD_STEPS); ++n) {
        (void)run(20.0, 1.0, 0.6, true);
    }
    CHECK(guard.phase == CGL_GUARD_MUTE && guard.gentle == CGL_GUARD_STEPS && guard.retry == 512U);
    const double muted = run(1000.0, 1.0, 0.6, true);
    CHECK(muted > 505.0 && muted < 515.0 && guard.phase == CGL_GUARD_LEARN && guard.gentle == CGL_GUARD_STEPS - 1U);
}

/* A table that nobody learns on is tested soon, switched off where it hurts, and never cleared. */
static void a_table(void)
{
    begin(false);
    const double waited = run(20.0, 1.0, 0.0, false); /* it acted in the bar too */
    CHECK(waited > 3.9 && waited < 4.1 && guard.phase == CGL_GUARD_HOLD);
    begin(false);
    CHECK(run(20.0, 1.0, 0.6, false) < 4.1 && guard.phase == CGL_GUARD_HOLD);
    for (int n = 0; n < 20 && guard.phase != CGL_GUARD_MUTE; ++n) {
        (void)run(20.0, 1.0, 0.6, false);
        CHECK(guard.phase != CGL_GUARD_FORGET);
    }
    CHECK(guard.phase == CGL_GUARD_MUTE && guard.gentle == CGL_GUARD_STEPS);
}

/* A burst needs no whole window, and no ramp. */
static void a_burst(void)
{
    begin(true);
    (void)run(5.0, 1.0, -0.5, true);
    CHECK(run(5.0, 1.0, 40.0, true) < 0.1 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(5.0, 1.0, 40.0, true) < 0.1 && guard.phase == CGL_GUARD_ALONE && within(guard.share, CGL_R(0.0)));
}

/* A window is whole turns of a quarter second or more, and at most 2.5 s. */
static void lengths(void)
{
    static const double speed[] = {0.05, 1.0, 3.0, 25.0, 300.0, 5000.0};
    for (uint32_t k = 0; k < sizeof speed / sizeof speed[0]; ++k) {
        CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
        const cgl_guard_input in = {CGL_R(0.0), (cgl_real)speed[k], true, false, true, true};
        cgl_guard_step(&guard, &in);
        const double turn = 2.0 * (double)CGL_PI / speed[k] / (double)TS, length = (double)guard.length;
        const double beyond = length - turn * (double)(long)(length / turn + 0.5);
        CHECK(guard.length >= 250U && guard.length <= 2501U);
        CHECK(guard.length >= 2500U || (beyond < 1.1 && beyond > -1.1));
    }
}

/* A map that was learned under a load holds the rotor at its limit without it: two bad windows do not count there, but the time does. */
static void a_limit_that_stays(void)
{
    begin(true);
    (void)run(20.0, 1.0, -0.9, true);
    unsigned n = 0U;
    for (; n < 100U * WINDOW && guard.gentle == 1U; ++n) {
        step((guard.share > CGL_R(0.0) ? 8.0 : 1.0) * wave(), guard.share > CGL_R(0.0), true);
    }
    CHECK(n > 16U * WINDOW && n < 40U * WINDOW);
}

/* A bar that a stalled rotor gives is none. */
static void a_rotor_that_stalls(void)
{
    begin(true);
    for (unsigned n = 0U; n < 40U * WINDOW; ++n) {
        step(0.8 * (double)OMEGA + wave(), false, false);
    }
    CHECK(guard.alone < CGL_R(1.0) && guard.gentle == 1U);
}

/* ---- a drive of numbers, whose law learns well or badly and whose speed, load and limit change ---- */

#define STEPS_PER_CONFIG 40000

/* What is learned, in units of the ripple without it: a good law goes to -depth, a bad one grows. */
static cgl_real learned_on(cgl_real learned, cgl_real gain, cgl_real depth, bool harms)
{
    const cgl_real next = harms ? learned * (CGL_R(1.0) + gain) + gain : learned - gain * (depth + learned);
    return cgl_clamp(next, CGL_R(50.0));
}

/* All that the guard keeps. */
static void hear_state(void)
{
    const cgl_real state[] = {guard.share,  guard.mean,  guard.last_error, guard.squares, guard.fast, guard.ripple,
                              guard.acting, guard.alone, guard.noise,      guard.speed};
    hear_all(state, sizeof state / sizeof state[0]);
    const uint32_t count[] = {guard.count, guard.length, guard.limited, guard.age, guard.patience, guard.good, guard.retry};
    for (uint32_t n = 0U; n < sizeof count / sizeof count[0]; ++n) {
        hear_bits(count[n]);
    }
    hear_bits(guard.phase | (uint32_t)guard.evidence << 8 | (uint32_t)guard.bad << 16 | (guard.taught ? 1U << 24 : 0U));
}

/* A guard that is reset decides as a new one, of a ripple that grows from the first sample on. */
static void check_reset(cgl_real speed)
{
    static cgl_guard fresh;
    CHECK(cgl_guard_init(&fresh, TS) == CGL_OK);
    cgl_guard_reset(&guard);
    check_bytes(&guard, &fresh, 0U, sizeof fresh);
    for (int n = 0; n < 8000; ++n) {
        cgl_real sine, cosine;
        cgl_sincos(cgl_fraction(speed * TS * (cgl_real)n / CGL_TWO_PI * CGL_R(6.0)) * CGL_TWO_PI, &sine, &cosine);
        const cgl_real error = CGL_R(0.001) * speed * (CGL_R(1.0) + CGL_R(0.0005) * (cgl_real)n) * sine;
        const cgl_guard_input in = {error, speed, true, false, true, cgl_guard_may_learn(&fresh)};
        cgl_guard_step(&guard, &in);
        cgl_guard_step(&fresh, &in);
        CHECK(guard.phase == fresh.phase && guard.age == fresh.age && within(guard.share - fresh.share, CGL_R(0.0)));
    }
}

static void try_guard(void)
{
    const bool bad = random_below(2) != 0U, changes = random_below(2) != 0U;
    const cgl_real speed[3] = {CGL_R(1.0) + (cgl_real)random_below(300), CGL_R(1.0) + (cgl_real)random_below(300), CGL_R(30.0)};
    const cgl_real rate = CGL_R(0.002) * (cgl_real)(1U + random_below(10)), depth = CGL_R(0.25) * (cgl_real)random_below(5);
    const cgl_real start = (cgl_real)random_below(8); /* a ripple that dies out by itself */
    cgl_real learned = CGL_R(0.0), mean = CGL_R(0.0), theta = CGL_R(0.0);
    cgl_guard_input in = {CGL_R(0.0), speed[0], true, false, true, false};
    bool harms = bad, limited = false, stands = random_below(8) == 0U;
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    for (int n = 0; n < STEPS_PER_CONFIG; ++n) {
        if (random_below(4000) == 0U && changes) {
            in.omega_ref = speed[random_below(3)];
            harms = bad && random_below(4) != 0U;
        }
        mean = random_below(2000) ? CGL_R(0.99) * mean : CGL_R(5.0);
        stands = stands && random_below(8000) != 0U;
        limited = random_below(limited ? 300U : 5000U) ? limited : !limited;
        theta = cgl_fraction((theta + CGL_R(6.0) * in.omega_ref * TS) / CGL_TWO_PI) * CGL_TWO_PI;
        cgl_real sine, cosine;
        cgl_sincos(theta, &sine, &cosine);
        const cgl_real noise = CGL_R(0.001) * (cgl_real)random_below(100) + (stands ? in.omega_ref : CGL_R(0.0));
        const cgl_real ripple = CGL_R(1.0) + start / (CGL_R(1.0) + CGL_R(0.01) * (cgl_real)n) + learned * guard.share;
        in.error = random_below(5000) ? mean + noise + ripple * sine : random_real(CGL_R(10.0));
        in.plausible = cgl_is_within(in.error, CGL_R(1.0e10));
        in.saturated = limited;
        in.learn = random_below(1000) != 0U;
        in.learned = in.learn && cgl_guard_may_learn(&guard) && in.plausible && !limited;
        cgl_guard_step(&guard, &in);
        learned = in.learned ? learned_on(learned, cgl_gentle_gain(guard.gentle, rate, rate), depth, harms) : learned;
        learned = cgl_guard_forgets(&guard) ? CGL_R(0.99) * learned : learned;
        CHECK(guard.share >= CGL_R(0.0) && guard.share <= CGL_R(1.0) && guard.gentle <= CGL_GUARD_STEPS);
        CHECK(guard.phase <= (uint8_t)CGL_GUARD_MUTE && guard.evidence < 4U && guard.bad <= 2U);
        CHECK(guard.patience <= 1024U && guard.retry <= 4096U);
        if (n % 250 == 0) {
            hear_state();
        }
        if (n % 25 == 0) {
            hear(guard.share);
            hear_bits(guard.phase | guard.gentle << 8 | (cgl_guard_may_learn(&guard) ? 1U << 16 : 0U)
                      | (cgl_guard_forgets(&guard) ? 1U << 17 : 0U) | (cgl_guard_acts(&guard) ? 1U << 18 : 0U));
        }
    }
    check_reset(speed[0]);
}

void guarded(long configs)
{
    a_run_up();
    at_once();
    what_helps();
    what_hurts();
    what_hurts_much();
    what_does_not();
    what_always_hurts();
    a_table();
    a_burst();
    lengths();
    a_limit_that_stays();
    a_rotor_that_stalls();
    static const random_subject subject = {"guard", try_guard, 0xb044256aU, 0xca8bef91U};
    try_subjects(&subject, 1U, configs);
}
