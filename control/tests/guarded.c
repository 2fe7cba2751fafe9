#include "guarded.h"

#include "check.h"
#include "cogless/angle.h"
#include "cogless/guard.h"

#define TS CGL_R(1.0e-3)
#define OMEGA (CGL_R(4.0) * CGL_TWO_PI) /* a window is a turn, 250 samples */
#define WINDOW 250

static cgl_guard guard;
static unsigned sample;

static void step(double error, bool saturated, bool learned)
{
    const cgl_guard_input in = {(cgl_real)error, OMEGA, OMEGA, true, saturated, learned, learned && guard.learn && !saturated};
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
    CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
    (void)run(4.0, 1.0, 0.0, false);
    CHECK(guard.phase == CGL_GUARD_IDLE && guard.learn && within(guard.share - CGL_R(1.0), CGL_R(0.0)));
    CHECK(within(guard.baseline[0].slow - CGL_R(0.5), CGL_R(0.03)) && within(guard.omega[0] - OMEGA, CGL_R(0.01)));
    (void)run(2.0, 1.0, -0.5, true);
    CHECK(guard.phase == CGL_GUARD_LEARN);
}

/* Too much three times: it stands still; it stays: it doesn't act; it was learning: it is forgotten, and learned more gently. */
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

/* No fault of learning: a hold that calms, a load with more ripple. */
static void what_does_not(void)
{
    begin();
    CHECK(run(20.0, 1.0, 0.2, true) < 4.0 && guard.phase == CGL_GUARD_HOLD);
    CHECK(run(20.0, 1.0, -0.5, true) <= 1.5 && guard.phase == CGL_GUARD_LEARN);
    CHECK(run(20.0, 3.0, 0.0, true) < 4.0 && run(20.0, 3.0, 0.0, true) < 5.0 && guard.phase == CGL_GUARD_PROBE);
    CHECK(run(20.0, 3.0, 0.0, true) < 5.0 && guard.phase == CGL_GUARD_LEARN && guard.gentle == 1U && guard.doubts > 0U);
    CHECK(run(40.0, 3.0, 0.0, true) >= 40.0);
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
    static const double omega[] = {0.05, 1.0, 3.0, 25.0, 300.0, 5000.0};
    for (uint32_t k = 0; k < sizeof omega / sizeof omega[0]; ++k) {
        CHECK(cgl_guard_init(&guard, TS) == CGL_OK);
        const cgl_guard_input in = {CGL_R(0.0), (cgl_real)omega[k], (cgl_real)omega[k], true, false, true, true};
        cgl_guard_step(&guard, &in);
        const double quarter = 0.5 * (double)CGL_PI / omega[k] / (double)TS, length = (double)guard.length;
        const double beyond = length - quarter * (double)(long)(length / quarter + 0.5);
        CHECK(guard.length >= 62U && guard.length <= 1251U);
        CHECK(guard.length == 1251U || (beyond < 0.51 && beyond > -0.51));
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

void guarded(void)
{
    what_hurts();
    what_does_not();
    a_burst();
    lengths();
    a_limit_that_stays();
}
