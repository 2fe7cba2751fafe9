/* Each file is numbers: how many cases; each has its config, how many steps, inputs and outputs of each, how many entries
 * are learned in the end, and these. tests/golden_vectors.py makes them. */
#include "vectors.h"

#include <stdio.h>

#include "check.h"
#include "cogless/anti_cogging.h"
#include "cogless/foc.h"
#include "cogless/harmonic.h"
#include "cogless/monitor.h"
#include "cogless/pi_afc.h"
#include "cogless/pi_ilc.h"
#include "cogless/quality.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/trial.h"

#ifndef VECTORS
#define VECTORS "control/tests/vectors"
#endif

#ifdef COGLESS_DOUBLE
#define EPS 2.220446049250313e-16
#else
#define EPS 1.1920929e-7
#endif

#define CELLS 70000U

static FILE *file;
static const char *name;
static double roundings; /* that a result may be off by */
/* A loop that leaves a law every config: any current, and no guard. */
static const cgl_loop *loop_of(cgl_real ts)
{
    static cgl_loop loop;
    loop.ts = ts;
    loop.current_limit = CGL_REAL_MAX;
    return &loop;
}

static cgl_real cell[3U * CELLS];

static uint32_t entries_of(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

static double number(void)
{
    double x = 0.0;
    CHECK(fscanf(file, "%lf", &x) == 1);
    return x;
}

static cgl_real real(void)
{
    return (cgl_real)number(); /* config and inputs are numbers of 32 bits */
}

static uint32_t count(void)
{
    return (uint32_t)number();
}

static bool flag(void)
{
    return number() > 0.5;
}

static void reals(cgl_real *x, uint32_t n)
{
    for (uint32_t k = 0; k < n; ++k) {
        x[k] = real();
    }
}

/* Compares with the next number. */
static void expect(cgl_real got)
{
    const double expected = number(), apart = (double)got - expected;
    const double size = expected < 0.0 ? -expected : expected, most = roundings * EPS * (1.0 + size);
    const bool near = apart <= most && apart >= -most;
    CHECK(near);
    if (!near) {
        printf("  %s: %.9g, not %.9g\n", name, (double)got, expected);
    }
}

static void expect_same(unsigned got)
{
    const unsigned expected = (unsigned)number();
    CHECK(got == expected);
    if (got != expected) {
        printf("  %s: %u, not %u\n", name, got, expected);
    }
}

/* What is learned, at the end of a case. */
static void expect_learned(const cgl_real *learned)
{
    for (uint32_t n = 0, entries = count(); n < entries; ++n) {
        expect(learned[n]);
    }
}

/* ---- configs ---- */

static cgl_pi_config a_pi(void)
{
    cgl_pi_config config;
    config.kp = real();
    config.ki = real();
    config.limit = real();
    return config;
}

static cgl_memory_config a_memory(void)
{
    cgl_memory_config config;
    config.kind = (cgl_memory_kind)count();
    config.channels = count();
    config.cells = count();
    config.turns = count();
    config.parts = count();
    config.q_half_width = count();
    config.lead = count();
    config.forgetting = real();
    reals(config.limit, CGL_CHANNELS);
    config.method = flag() ? CGL_DELAY_INVERSION : CGL_DELAY_ODE;
    config.k_pp = real();
    return config;
}

/* ---- one function a subject, for one case ---- */

static void pi(void)
{
    static cgl_pi_config config;
    cgl_pi law;
    config = a_pi();
    CHECK(cgl_pi_init(&law, &config, loop_of(real())) == CGL_OK);
    for (uint32_t left = count(); left > 0U; --left) {
        const cgl_real error = real(), feedforward = real();
        expect(cgl_pi_step(&law, error, feedforward));
        expect(law.integral);
    }
    expect_learned(cell);
}

static void foc(void)
{
    static cgl_foc_config config;
    cgl_foc law;
    config.kp_d = real();
    config.ki_d = real();
    config.kp_q = real();
    config.ki_q = real();
    config.current_limit = real();
    config.advance = real();
    config.decoupling = flag();
    config.L_d = real();
    config.L_q = real();
    config.psi_f = real();
    config.phases = count();
    CHECK(cgl_foc_init(&law, &config, real()) == CGL_OK);
    for (uint32_t left = count(); left > 0U; --left) {
        cgl_foc_input in;
        cgl_foc_output out;
        reals(in.i_abc, 3U);
        in.theta_e = real();
        in.omega_e = real();
        in.u_dc = real();
        in.i_d_ref = real();
        in.i_q_ref = real();
        cgl_foc_step(&law, &in, &out);
        for (int x = 0; x < 3; ++x) {
            expect(out.duty[x]);
        }
        expect(out.i_d);
        expect(out.i_q);
        expect(out.u_d);
        expect(out.u_q);
    }
    expect_learned(cell);
}

static void memory(void)
{
    static cgl_memory_config config;
    cgl_memory state;
    config = a_memory();
    const cgl_real ts = real();
    CHECK(cgl_memory_init(&state, &config, ts, count(), cell, entries_of(&config)) == CGL_OK);
    for (uint32_t left = count(); left > 0U; --left) {
        cgl_real change[CGL_CHANNELS], value[CGL_CHANNELS];
        const cgl_real theta = real(), omega = real();
        const bool learn = flag();
        reals(change, config.channels);
        const bool learned = cgl_memory_step(&state, theta, omega, learn, change, value);
        for (uint32_t c = 0; c < config.channels; ++c) {
            expect(value[c]);
        }
        expect_same(learned);
    }
    expect_learned(cell);
}

/* The steps of a law, and what it learned. */
#define STEPS(law, step)                                                                                               \
    do {                                                                                                               \
        for (uint32_t left = count(); left > 0U; --left) {                                                             \
            cgl_law_input in = {.learn = false};                                                                       \
            cgl_law_output out;                                                                                        \
            in.theta_ref = real();                                                                                     \
            in.omega_ref = real();                                                                                     \
            in.alpha_ref = real();                                                                                     \
            in.theta_m = real();                                                                                       \
            in.omega_m = real();                                                                                       \
            in.learn = flag();                                                                                         \
            in.torque = flag();                                                                                        \
            in.i_q_ref = real();                                                                                       \
            step(&(law), &in, &out);                                                                                   \
            expect(out.i_q_ref);                                                                                       \
            expect_same(out.status);                                                                                   \
        }                                                                                                              \
        expect_learned(cell);                                                                                          \
    } while (0)

static void pi_ilc(void)
{
    static cgl_pi_ilc_config config;
    cgl_pi_ilc law;
    config.pi = a_pi();
    config.gain = real();
    config.memory = a_memory();
    CHECK(cgl_pi_ilc_init(&law, &config, loop_of(real()), cell, entries_of(&config.memory)) == CGL_OK);
    STEPS(law, cgl_pi_ilc_step);
}

static void robust_ilc(void)
{
    static cgl_robust_ilc_config config;
    cgl_robust_ilc law;
    config.b = real();
    config.c = real();
    config.g = real();
    config.eta = real();
    config.q = real();
    config.beta_1 = real();
    config.beta_2 = real();
    config.gamma = real();
    config.viscous = real();
    config.coulomb = real();
    config.limit = real();
    config.memory = a_memory();
    CHECK(cgl_robust_ilc_init(&law, &config, loop_of(real()), cell, entries_of(&config.memory)) == CGL_OK);
    STEPS(law, cgl_robust_ilc_step);
}

static void space_speed(void)
{
    static cgl_space_speed_config config;
    cgl_space_speed law;
    config.k = real();
    config.mu_alpha = real();
    config.mu_beta = real();
    config.mu_h = real();
    config.eta_bar = real();
    config.omega_min = real();
    config.limit = real();
    config.ratio = count();
    config.memory = a_memory();
    CHECK(cgl_space_speed_init(&law, &config, loop_of(real()), cell, entries_of(&config.memory)) == CGL_OK);
    STEPS(law, cgl_space_speed_step);
}

static void space_position(void)
{
    static cgl_space_position_config config;
    cgl_space_position law;
    config.ratio = count();
    config.k_theta = real();
    config.k_omega = real();
    config.k_v = real();
    config.v_0 = real();
    config.v_2 = real();
    config.k_i = real();
    config.mu_alpha = real();
    config.mu_beta = real();
    config.mu_h = real();
    config.hand_over = flag();
    config.ramp = real();
    config.omega_min = real();
    config.index = flag() ? CGL_SPACE_BY_ROTOR : CGL_SPACE_BY_REFERENCE;
    config.limit = real();
    config.memory = a_memory();
    CHECK(cgl_space_position_init(&law, &config, loop_of(real()), cell, entries_of(&config.memory)) == CGL_OK);
    STEPS(law, cgl_space_position_step);
}

static void pi_afc(void)
{
    static cgl_pi_afc_config config;
    cgl_pi_afc law;
    config.pi = a_pi();
    config.orders = count();
    for (uint32_t k = 0; k < config.orders; ++k) {
        config.order[k] = count();
    }
    config.gain = real();
    config.lead = real();
    config.omega_min = real();
    config.limit = real();
    CHECK(cgl_pi_afc_init(&law, &config, loop_of(real()), cell, CGL_PI_AFC_LENGTH(config.orders)) == CGL_OK);
    STEPS(law, cgl_pi_afc_step);
}

static void harmonic(void)
{
    cgl_harmonic_config config;
    cgl_harmonic law;
    config.pi = a_pi();
    config.k_theta = real();
    config.b = real();
    config.delay = real();
    config.step = real();
    config.base = count();
    config.bends = count();
    config.orders = count();
    config.fast = count();
    config.rate = real();
    config.rate_min = real();
    config.limit = real();
    for (uint32_t n = 0; n < CGL_HARMONIC_EDGES; ++n) {
        config.held[n] = real();
    }
    CHECK(cgl_harmonic_init(&law, &config, loop_of(real()), cell, CGL_HARMONIC_LENGTH(config.orders)) == CGL_OK);
    STEPS(law, cgl_harmonic_step);
}

static void anti_cogging(void)
{
    static cgl_anti_cogging_config config;
    cgl_anti_cogging law;
    config.pi = a_pi();
    config.cells = count();
    config.speed = real();
    config.revolutions = count();
    config.position_gain = real();
    config.lead = real();
    CHECK(cgl_anti_cogging_init(&law, &config, loop_of(real()), cell, config.cells) == CGL_OK);
    reals(cell, config.cells);
    for (uint32_t left = count(); left > 0U; --left) {
        cgl_law_input in = {.learn = true};
        cgl_law_output out;
        in.omega_ref = real();
        in.omega_m = real();
        in.theta_m = real();
        in.torque = flag();
        in.i_q_ref = real();
        cgl_anti_cogging_step(&law, &in, &out);
        expect(out.i_q_ref);
    }
    expect_learned(cell);
}

static void trial(void)
{
    static cgl_trial_config config;
    static cgl_real y_ref[100];
    cgl_trial law;
    config.samples = 40U;
    config.unguarded = true;
    config.states = 2U;
    reals(config.k_1, 2U);
    config.k_2 = real();
    config.n = real();
    reals(config.c, 2U);
    config.through_integrator = flag();
    config.k_3 = real();
    config.shift = count();
    config.limit = real();
    config.learned_limit = real();
    config.unguarded = true;
    config.observer.response = real();
    config.observer.pole = real();
    reals(y_ref, config.samples);
    CHECK(cgl_trial_init(&law, &config, cell, CELLS) == CGL_OK);
    for (uint32_t p = 0, samples = count(); p < samples; ++p) {
        if (p % config.samples == 0U) {
            cgl_trial_begin(&law, y_ref);
        }
        cgl_trial_input in = {.learn = true};
        cgl_trial_output out;
        reals(in.x, 2U);
        cgl_trial_step(&law, &in, &out);
        expect(out.u);
        expect_same((out.status & (unsigned)CGL_STATUS_SATURATED) != 0U);
        if (p % config.samples + 1U == config.samples) {
            CHECK(cgl_trial_end(&law));
        }
    }
    expect_learned(cell);
}

static void quality(void)
{
    static cgl_quality_config config;
    cgl_quality state;
    config.span = real();
    config.longest = real();
    config.outlier = real();
    config.floor = real();
    CHECK(cgl_quality_init(&state, &config, real()) == CGL_OK);
    for (uint32_t left = count(); left > 0U; --left) {
        const cgl_real error = real(), omega = real();
        const bool learning = flag();
        expect_same(cgl_quality_step(&state, error, omega, learning));
        const cgl_quality_report report = cgl_quality_read(&state);
        expect(report.residual);
        expect(report.progress);
    }
    expect_learned(cell);
}

static void monitor(void)
{
    static cgl_monitor_config config;
    cgl_monitor state;
    config.omega_max = real();
    config.angle_step = real();
    config.speed_window = real();
    config.stuck_angle = real();
    config.stuck_time = real();
    config.current_max = real();
    config.current_sum = real();
    config.bridge = real();
    config.hold = real();
    config.phases = count();
    CHECK(cgl_monitor_init(&state, &config, real()) == CGL_OK);
    for (uint32_t left = count(); left > 0U; --left) {
        cgl_measurement now;
        reals(now.i_abc, 3U);
        now.theta_m = real();
        now.omega_m = real();
        now.u_dc = real();
        const cgl_real omega_ref = real();
        cgl_monitor_step(&state, &now, omega_ref, flag());
        expect(state.theta_m);
        expect(state.omega_m);
        expect_same(state.status & ~(unsigned)CGL_STATUS_OFF);
        expect_same(state.trusted);
    }
    expect_learned(cell);
}

/* `most`: roundings of a result. The laws add up a few terms; sums over a map or a window, and what is fed back from one
 * period to the next, more of them; an angle times cells or orders is off by as many times more. */
static void run(const char *subject, void (*one)(void), double most)
{
    char path[500];
    name = subject;
    roundings = most;
    snprintf(path, sizeof path, "%s/%s.txt", VECTORS, subject);
    file = fopen(path, "r");
    CHECK(file != NULL);
    if (file == NULL) {
        printf("  %s\n", path);
        return;
    }
    for (uint32_t left = count(); left > 0U; --left) {
        one();
    }
    char rest;
    CHECK(fscanf(file, " %c", &rest) == EOF);
    fclose(file);
}

void golden_vectors(void)
{
    run("pi", pi, 64.0);
    run("foc", foc, 64.0);
    run("memory", memory, 1000.0);
    run("delay_line", memory, 2000.0);
    run("pi_ilc", pi_ilc, 1000.0);
    run("robust_ilc", robust_ilc, 1000.0);
    run("space_speed", space_speed, 1000.0);
    run("space_position", space_position, 1000.0);
    run("pi_afc", pi_afc, 200.0);
    run("harmonic", harmonic, 1000.0);
    run("anti_cogging", anti_cogging, 200.0);
    run("trial", trial, 200.0);
    run("quality", quality, 200.0);
    run("monitor", monitor, 64.0);
}
