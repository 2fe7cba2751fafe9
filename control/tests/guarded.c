#include "guarded.h"

#include "check.h"
#include "cogless/angle.h"
#include "cogless/guard.h"

#define TS CGL_R(1.0e-3)
#define OMEGA (CGL_R(4.0) * CGL_TWO_PI) /* at first; a window is a turn, 250 samples */
#define WINDOW 250

static cgl_guard guard;
static unsigned sample;
static cgl_real omega;

static void step(double error, bool saturated, bool learned)
{
    const cgl_guard_input in = {(cgl_real)error, omega, omega, true, saturated, learned, learned && guard.learn && !saturated};
    cgl_guard_step(&guard, &in);
    ++sample;
}

static double wave(void)
{
    cgl_real sine, cosine;
    cgl_sincos(CGL_R(6.0) * OMEGA * TS * (cgl_real)(sample % WINDOW), &sine, &cosine);
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

static void begin(void)
{
    sample = 0U;
    omega = OMEGA;
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    (void)run(4.0, 1.0, 0.0, false);
    CHECK(guard.phase == CGL_GUARD_IDLE && guard.learn && within(guard.share - CGL_R(1.0), CGL_R(0.0)));
    CHECK(within(guard.baseline[0].slow - CGL_R(0.5), CGL_R(0.03)) && within(guard.baseline_speed[0] - OMEGA, CGL_R(0.01)));
    (void)run(2.0, 1.0, -0.5, true);
    CHECK(guard.phase == CGL_GUARD_LEARN);
}

/* Three bad windows: learning holds. No better: what was learned stops acting. Was it learning: it is cleared, and learned more
 * gently. */
static void what_hurts(void)
{
    begin();
    CHECK(run(20.0, 1.0, -0.5, true) >= 20.0); /* what helps goes on */
    CHECK(run(20.0, 1.0, 0.6, true) < 3.5 && guard.phase == CGL_GUARD_HOLD && !guard.learn);
    CHECK(within(guard.share - CGL_R(1.0), CGL_R(0.0)));
    CHECK(run(20.0, 1.0, 0.6, true) <= 2.0 && guard.phase == CGL_GUARD_PROBE);
    CHECK(run(20.0, 1.0, 0.6, true) <= 4.0 && guard.phase == CGL_GUARD_CLEAR && guard.forget);
    CHECK(within(guard.share, CGL_R(0.0)));
    const double cleared = run(20.0, 1.0, 0.6, true);
    CHECK(cleared > 1.5 && cleared < 2.1);
    CHECK(guard.phase == CGL_GUARD_LEARN && guard.gentle == 2U && !guard.learn && !guard.forget);
    (void)run(2.2, 1.0, -0.7, true);
    CHECK(!guard.learn && within(guard.share - CGL_R(1.0), CGL_R(0.0))); /* what the ramp leaves dies out first: 0.6 s */
    (void)run(0.5, 1.0, -0.7, true);
    CHECK(guard.learn);
    const double waited = run(1000.0, 1.0, -0.7, true);
    CHECK(waited >= 1000.0 && guard.gentle == 1U); /* taken back */
}

/* What is not learning's fault: ripple that calms during a hold, a load with more ripple. */
static void what_does_not(void)
{
    begin();
    CHECK(run(20.0, 1.0, 0.2, true) < 4.0 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(20.0, 1.0, -0.5, true) <= 1.5 && guard.phase == CGL_GUARD_LEARN);
    CHECK(run(20.0, 3.0, 0.0, true) < 4.0 && run(20.0, 3.0, 0.0, true) < 5.0 && guard.phase == CGL_GUARD_PROBE);
    CHECK(run(20.0, 3.0, 0.0, true) < 5.0 && guard.phase == CGL_GUARD_LEARN && guard.gentle == 1U && guard.extra_strikes > 0U);
    CHECK(run(40.0, 3.0, 0.0, true) >= 40.0);
}

/* What hurts at every step: nothing is learned at this speed for a long time, but at lower ones; then it begins more boldly. */
static void what_always_hurts(void)
{
    begin();
    for (int n = 0; n < 100 && guard.phase != CGL_GUARD_MUTE; ++n) {
        (void)run(20.0, 1.0, 0.6, true);
    }
    CHECK(guard.phase == CGL_GUARD_MUTE && guard.gentle == CGL_GUARD_STEPS && !guard.learn);
    const unsigned wait = 50U << guard.retry_doublings;
    (void)run(3.0, 1.0, 0.6, true);
    omega = CGL_R(0.5) * OMEGA;
    (void)run(20.0, 1.0, 0.0, true);
    CHECK(guard.phase == CGL_GUARD_LEARN && guard.gentle < CGL_GUARD_STEPS);
    (void)run(10.0, 1.0, -0.5, true);
    CHECK(guard.learn);
    omega = OMEGA;
    CHECK(run(20.0, 1.0, -0.5, true) < 4.0 && guard.phase == CGL_GUARD_MUTE && !guard.learn);
    const double muted = run(2.0 * wait, 1.0, 0.6, true);
    CHECK(muted > 0.98 * wait && muted < 1.01 * wait && guard.phase == CGL_GUARD_CLEAR && within(guard.share, CGL_R(0.0)));
    (void)run(20.0, 1.0, 0.0, true);
    CHECK(guard.phase == CGL_GUARD_LEARN && guard.gentle < CGL_GUARD_STEPS);
}

/* Learning gains nothing: after a hundred windows the baseline is measured again. */
static void what_gains_nothing(void)
{
    begin();
    const double learned = run(200.0, 1.0, 0.0, true);
    CHECK(learned > 97.0 && learned < 101.0 && guard.phase == CGL_GUARD_PROBE);
    (void)run(0.2, 1.0, 0.0, true);
    CHECK(within(guard.share - CGL_R(0.9), CGL_R(0.01))); /* it falls in half a second, so that the feedback takes over */
    CHECK(run(20.0, 1.0, 0.0, true) < 6.0 && guard.phase == CGL_GUARD_LEARN && guard.gentle == 1U);
}

static void a_burst(void)
{
    begin();
    (void)run(5.0, 1.0, -0.5, true);
    CHECK(run(5.0, 1.0, 40.0, true) < 0.5 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(5.0, 1.0, 40.0, true) < 0.5 && guard.phase == CGL_GUARD_PROBE && within(guard.share, CGL_R(0.0)));
}

/* A quarter takes a sixteenth of a second at least and 1.25 s at most; between these whole quarter turns. */
static void lengths(void)
{
    static const double speed[] = {0.05, 1.0, 3.0, 25.0, 300.0, 5000.0};
    for (uint32_t k = 0; k < sizeof speed / sizeof speed[0]; ++k) {
        CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
        const cgl_guard_input in = {CGL_R(0.0), (cgl_real)speed[k], (cgl_real)speed[k], true, false, true, true};
        cgl_guard_step(&guard, &in);
        const double quarter = 0.5 * (double)CGL_PI / speed[k] / (double)TS, length = (double)guard.quarter_length;
        const double beyond = length - quarter * (double)(long)(length / quarter + 0.5);
        CHECK(guard.quarter_length >= 62U && guard.quarter_length <= 1251U);
        CHECK(guard.quarter_length == 1251U || (beyond < 0.51 && beyond > -0.51));
    }
}

/* A map that was learned under a load holds the rotor at its limit without it. */
static void a_limit_that_stays(void)
{
    begin();
    (void)run(20.0, 1.0, -0.5, true);
    unsigned n = 0U;
    for (; n < 10000U && guard.phase == CGL_GUARD_LEARN; ++n) {
        step(8.0, n % 160U > 9U, true);
    }
    CHECK(n > 2500U && n < 2800U && guard.phase == CGL_GUARD_PROBE);
    CHECK(run(20.0, 1.0, 0.0, true) < 6.0 && guard.phase == CGL_GUARD_CLEAR);
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
    const cgl_real state[] = {guard.target_share,
                              guard.share_step,
                              guard.error_centre,
                              guard.centre_drift,
                              guard.window_reference,
                              guard.reference_tolerance,
                              guard.quarter_squares,
                              guard.quarter_way,
                              guard.window_fast,
                              guard.last_variance,
                              guard.suspected_ripple.slow,
                              guard.suspected_ripple.fast,
                              guard.squares_limit,
                              guard.first_quarter_variance,
                              guard.start_variance,
                              guard.least_variance,
                              guard.phase_way,
                              guard.lesson_speed};
    hear_all(state, sizeof state / sizeof state[0]);
    hear_all(guard.baseline_speed, CGL_GUARD_SPEEDS);
    hear_all(guard.step_speed, CGL_GUARD_STEPS);
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        hear(guard.baseline[n].slow);
        hear(guard.baseline[n].fast);
    }
    const uint32_t count[] = {guard.quarter_count,    guard.window_count,      guard.lesson_samples,  guard.quarter_length,
                              guard.shortfall_samples, guard.limited_samples,  guard.settling_samples, guard.phase_samples,
                              guard.wait_count,       guard.good_windows};
    for (uint32_t n = 0U; n < sizeof count / sizeof count[0]; ++n) {
        hear_bits(count[n]);
    }
    hear_bits(guard.quarter_index | (uint32_t)guard.strike_count << 8 | (uint32_t)guard.recovery_score << 16
              | (uint32_t)guard.extra_strikes << 24);
    hear_bits(guard.phase_windows | (uint32_t)guard.lesson_windows << 8 | (uint32_t)guard.retry_doublings << 16
              | (uint32_t)guard.next_baseline << 24);
}

/* A guard that is reset decides as a new one, of a ripple that grows from the first sample on. */
static void check_reset(cgl_real speed)
{
    static cgl_guard fresh;
    CHECK(cgl_guard_init(&fresh, TS) == CGL_OK);
    cgl_guard_reset(&guard);
    for (uint32_t n = 0U; n < CGL_GUARD_SPEEDS; ++n) {
        CHECK(within(guard.baseline_speed[n] - fresh.baseline_speed[n], CGL_R(0.0)));
    }
    for (int n = 0; n < 8000; ++n) {
        cgl_real sine, cosine;
        cgl_sincos(cgl_fraction(speed * TS * (cgl_real)n / CGL_TWO_PI * CGL_R(6.0)) * CGL_TWO_PI, &sine, &cosine);
        const cgl_real error = CGL_R(0.001) * speed * (CGL_R(1.0) + CGL_R(0.0005) * (cgl_real)n) * sine;
        const cgl_guard_input in = {error, speed - error, speed, true, false, true, fresh.learn};
        cgl_guard_step(&guard, &in);
        cgl_guard_step(&fresh, &in);
        CHECK(guard.phase == fresh.phase && guard.learn == fresh.learn && within(guard.share - fresh.share, CGL_R(0.0)));
    }
}

static void try_guard(void)
{
    const bool bad = random_below(2) != 0U, changes = random_below(2) != 0U;
    const cgl_real speed[3] = {CGL_R(1.0) + (cgl_real)random_below(300), CGL_R(1.0) + (cgl_real)random_below(300), CGL_R(30.0)};
    const cgl_real rate = CGL_R(0.002) * (cgl_real)(1U + random_below(10)), depth = CGL_R(0.25) * (cgl_real)random_below(5);
    const cgl_real start = (cgl_real)random_below(8); /* a ripple that dies out by itself */
    cgl_real learned = CGL_R(0.0), mean = CGL_R(0.0), theta = CGL_R(0.0);
    cgl_guard_input in = {CGL_R(0.0), speed[0], speed[0], true, false, true, false};
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
        in.omega_m = in.omega_ref - (cgl_is_within(in.error, CGL_R(100.0)) ? in.error : CGL_R(0.0));
        in.plausible = cgl_is_within(in.error, CGL_R(1.0e10));
        in.saturated = limited;
        in.learn = random_below(1000) != 0U;
        in.learned = in.learn && guard.learn && in.plausible && !limited;
        cgl_guard_step(&guard, &in);
        learned = in.learned ? learned_on(learned, cgl_gentle_gain(guard.gentle, rate, rate), depth, harms) : learned;
        learned = guard.forget ? CGL_R(0.99) * learned : learned;
        CHECK(guard.share >= CGL_R(0.0) && guard.share <= CGL_R(1.0) && guard.gentle <= CGL_GUARD_STEPS);
        CHECK(!guard.learn || guard.phase <= (uint8_t)CGL_GUARD_LEARN);
        CHECK(guard.forget == (guard.phase == CGL_GUARD_CLEAR));
        if (n % 250 == 0) {
            hear_state();
        }
        if (n % 25 == 0) {
            hear(guard.share);
            hear_bits(guard.phase | guard.gentle << 8 | (guard.learn ? 1U << 16 : 0U) | (guard.forget ? 1U << 17 : 0U)
                      | (cgl_guard_acts(&guard) ? 1U << 18 : 0U));
        }
    }
    check_reset(speed[0]);
}

void guarded(long configs)
{
    what_hurts();
    what_does_not();
    what_always_hurts();
    what_gains_nothing();
    a_burst();
    lengths();
    a_limit_that_stays();
    static const random_subject subject = {"guard", try_guard, 0xd84aa3a5U, 0xc24510d2U};
    try_subjects(&subject, 1U, configs);
}
