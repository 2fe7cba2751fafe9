/* Random bit patterns at every init and step of every law. Whatever comes in, outputs are finite and within their limits,
 * so is what is learned, and nothing outside the caller's memory is written. To be run under the sanitizers too. */
#include "random_inputs.h"

#include <string.h>

#include "check.h"
#include "cogless/angle.h"
#include "cogless/anti_cogging.h"
#include "cogless/foc.h"
#include "cogless/modulation.h"
#include "cogless/pi_ilc.h"
#include "cogless/robust_ilc.h"
#include "cogless/speed_pi.h"

#define CELLS_MAX 200U
#define GUARD 8U
#define CANARY CGL_R(123.456)
#define STEPS_PER_CONFIG 300

static cgl_real fenced[CGL_MEMORY_LENGTH(CELLS_MAX, CELLS_MAX / 2U) + 2U * GUARD];

/* The caller's memory, between two fences. */
static cgl_real *fence(uint32_t length)
{
    for (uint32_t n = 0; n < length + 2U * GUARD; ++n) {
        fenced[n] = CANARY;
    }
    return fenced + GUARD;
}

static void check_fence(uint32_t length)
{
    for (uint32_t n = 0; n < GUARD; ++n) {
        CHECK(!(fenced[n] < CANARY) && !(fenced[n] > CANARY));
        CHECK(!(fenced[GUARD + length + n] < CANARY) && !(fenced[GUARD + length + n] > CANARY));
    }
}

static bool within(cgl_real x, cgl_real limit)
{
    return x >= -limit && x <= limit; /* false for NaN */
}

static void check_cells(uint32_t length, cgl_real limit)
{
    for (uint32_t n = 0; n < length; ++n) {
        CHECK(within(fenced[GUARD + n], limit));
    }
}

/* What a law says of itself against what it did: `before` is the map before the step. */
static void check_status(unsigned status, const cgl_memory_config *config, const cgl_real *before)
{
    if ((status & (unsigned)CGL_STATUS_FAULT) != 0U) {
        CHECK((status & (unsigned)CGL_STATUS_FROZEN) != 0U);
    }
    if ((status & (unsigned)CGL_STATUS_FROZEN) != 0U && config->kind == CGL_MEMORY_ANGLE) {
        CHECK(memcmp(before, fenced + GUARD, config->cells * sizeof before[0]) == 0);
    }
}

/* ---- inputs: any, or a rotor that turns so that something is learned ---- */

static void next_input(cgl_speed_input *in, int step)
{
    static cgl_real theta, omega;
    if (step == 0 || random_below(100) == 0U) {
        omega = random_real(CGL_R(100.0));
        omega = cgl_is_finite(omega) ? cgl_clamp(omega, CGL_R(3000.0)) : CGL_R(0.0);
        theta = random_real(CGL_R(6.0));
    }
    theta += CGL_R(1.0e-3) * omega;
    const bool any = random_below(4) == 0U;
    in->omega_ref = any ? random_real(CGL_R(100.0)) : omega;
    in->omega_m = any ? random_real(CGL_R(100.0)) : omega + (cgl_real)random_below(3) - CGL_R(1.0);
    in->theta_m = any ? random_real(CGL_R(10.0)) : theta;
    in->i_q = any ? random_real(CGL_R(5.0)) : CGL_R(0.1);
    in->learn = random_below(8) != 0U;
}

static cgl_pi_config random_pi(void)
{
    const cgl_pi_config config = {random_gain(CGL_R(1.0)), random_gain(CGL_R(10.0)), random_gain(CGL_R(1.0e-3)),
                                  random_gain(CGL_R(5.0))};
    return config;
}

static cgl_memory_config random_memory(void)
{
    cgl_memory_config config;
    config.kind = random_below(2) ? CGL_MEMORY_ANGLE : CGL_MEMORY_TIME;
    config.cells = 4U + random_below(CELLS_MAX - 3U);
    config.periods_per_rev = random_below(10) ? 1U + random_below(8) : 1U + random_below(65535);
    config.q_half_width = random_below(2) ? 0U : random_below((config.cells + 1U) / 2U);
    config.lead = random_below(2) ? 0U : random_below(config.cells / 4U + 1U);
    config.forgetting = random_below(2) ? CGL_R(1.0) : random_gain(CGL_R(1.0));
    config.limit = random_gain(CGL_R(5.0));
    config.ts = random_gain(CGL_R(2.0e-3));
    return config;
}

/* ---- one function a law: a random config that init accepts, then random steps ---- */

static void try_angle(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real sine, cosine;
        cgl_sincos(random_real(CGL_R(1.0e5)), &sine, &cosine);
        CHECK(within(sine, CGL_R(1.000001)) && within(cosine, CGL_R(1.000001)));
        const cgl_real fraction = cgl_fraction(random_real(CGL_R(1.0e9)));
        CHECK(fraction >= CGL_R(0.0) && fraction < CGL_R(1.0));
    }
}

static bool are_duties(const cgl_real duty[3])
{
    bool all = true;
    for (int x = 0; x < 3; ++x) {
        all = all && duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0);
    }
    return all;
}

static void try_modulation(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real duty[3];
        cgl_modulate(random_real(CGL_R(100.0)), random_real(CGL_R(100.0)), random_real(CGL_R(100.0)), duty);
        CHECK(are_duties(duty));
    }
}

static void try_foc(void)
{
    cgl_foc_config config;
    cgl_foc foc;
    do {
        config.kp_d = random_gain(CGL_R(10.0));
        config.ki_d = random_gain(CGL_R(1000.0));
        config.kp_q = random_gain(CGL_R(10.0));
        config.ki_q = random_gain(CGL_R(1000.0));
        config.ts = random_gain(CGL_R(1.0e-4));
        config.current_limit = random_gain(CGL_R(5.0));
        config.advance = random_gain(CGL_R(2.0));
        config.decoupling = random_below(2) != 0U;
        config.L_d = random_gain(CGL_R(1.0e-2));
        config.L_q = random_gain(CGL_R(1.0e-2));
        config.psi_f = random_gain(CGL_R(0.1));
    } while (cgl_foc_init(&config, &foc) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_foc_input in = {{random_real(CGL_R(5.0)), random_real(CGL_R(5.0)), random_real(CGL_R(5.0))},
                                  random_real(CGL_R(7.0)),
                                  random_real(CGL_R(1000.0)),
                                  random_real(CGL_R(300.0)),
                                  random_real(CGL_R(5.0)),
                                  random_real(CGL_R(5.0))};
        const cgl_foc before = foc;
        cgl_foc_output out;
        cgl_foc_step(&config, &foc, &in, &out);
        CHECK(are_duties(out.duty));
        CHECK(cgl_is_finite(out.u_d) && cgl_is_finite(out.u_q));
        CHECK(cgl_is_finite(out.i_d) && cgl_is_finite(out.i_q));
        CHECK(cgl_is_finite(foc.integral_d) && cgl_is_finite(foc.integral_q));
        if ((out.status & CGL_STATUS_FAULT) != 0U) {
            CHECK(!(foc.integral_d < before.integral_d) && !(foc.integral_d > before.integral_d));
            CHECK(!(foc.integral_q < before.integral_q) && !(foc.integral_q > before.integral_q));
        } else { /* the voltage is one that the bus has */
            const cgl_real u_d = out.u_d / in.u_dc, u_q = out.u_q / in.u_dc;
            CHECK(u_d * u_d + u_q * u_q <= CGL_R(0.33334) || in.u_dc < CGL_R(1.0e-30));
        }
    }
}

static void try_pi(void)
{
    cgl_pi_config config;
    cgl_pi pi;
    do {
        config = random_pi();
    } while (cgl_pi_init(&config, &pi) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        CHECK(within(cgl_pi_step(&config, &pi, random_real(CGL_R(10.0)), random_real(CGL_R(1.0))), config.limit));
        CHECK(within(pi.integral, config.limit));
        cgl_speed_input in;
        cgl_speed_output out;
        next_input(&in, step);
        cgl_speed_pi_step(&config, &pi, &in, &out);
        CHECK(within(out.i_q_ref, config.limit));
    }
}

static void try_memory(void)
{
    cgl_memory_config config;
    cgl_memory memory;
    uint32_t length;
    do {
        config = random_memory();
        length = CGL_MEMORY_LENGTH(config.cells, config.q_half_width);
    } while (cgl_memory_init(&config, &memory, fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_speed_input in;
        cgl_real filtered, held;
        next_input(&in, step);
        cgl_memory_recall(&config, &memory, in.theta_m, in.omega_ref, &filtered, &held);
        CHECK(within(filtered, config.limit) && within(held, config.limit));
        const cgl_real acting =
            cgl_memory_update(&config, &memory, random_real(config.limit), random_real(config.limit), in.learn);
        CHECK(within(acting, config.limit));
        CHECK(memory.newest < length && memory.head < length && memory.known <= length);
        if (random_below(1000) == 0U) {
            cgl_memory_reset(&config, &memory);
        }
    }
    check_cells(length, config.limit);
    check_fence(length);
}

static void try_pi_ilc(void)
{
    cgl_pi_ilc_config config;
    cgl_pi_ilc law;
    uint32_t length;
    do {
        config.pi = random_pi();
        config.gain = random_gain(CGL_R(0.1));
        config.memory = random_memory();
        length = CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width);
    } while (cgl_pi_ilc_init(&config, &law, fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_speed_input in;
        cgl_speed_output out;
        next_input(&in, step);
        cgl_real before[CELLS_MAX];
        memcpy(before, fenced + GUARD, config.memory.cells * sizeof before[0]);
        cgl_pi_ilc_step(&config, &law, &in, &out);
        check_status(out.status, &config.memory, before);
        CHECK(within(out.i_q_ref, config.pi.limit));
        CHECK(within(law.learned, config.memory.limit));
        CHECK(within(law.pi.integral, config.pi.limit));
        if (random_below(1000) == 0U) {
            cgl_pi_ilc_reset(&config, &law);
        }
    }
    check_cells(length, config.memory.limit);
    check_fence(length);
}

static void try_robust_ilc(void)
{
    cgl_robust_ilc_config config;
    cgl_robust_ilc law;
    uint32_t length;
    do {
        config.b = random_gain(CGL_R(500.0));
        config.c = random_gain(CGL_R(10.0));
        config.g = random_gain(CGL_R(60.0));
        config.eta = random_gain(CGL_R(200.0));
        config.q = random_gain(CGL_R(0.3));
        config.beta_1 = random_gain(CGL_R(1.0));
        config.beta_2 = random_gain(CGL_R(1.0));
        config.gamma = random_gain(CGL_R(5.0));
        config.viscous = random_real(CGL_R(1.0));
        config.coulomb = random_real(CGL_R(10.0));
        config.ts = random_gain(CGL_R(1.0e-3));
        config.limit = random_gain(CGL_R(5.0));
        config.memory = random_memory();
        length = CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width);
    } while (cgl_robust_ilc_init(&config, &law, fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_speed_input in;
        cgl_speed_output out;
        next_input(&in, step);
        cgl_real before[CELLS_MAX];
        memcpy(before, fenced + GUARD, config.memory.cells * sizeof before[0]);
        cgl_robust_ilc_step(&config, &law, &in, &out);
        check_status(out.status, &config.memory, before);
        CHECK(within(out.i_q_ref, config.limit));
        CHECK(within(law.error_integral, CGL_R(1.0e9)));
        CHECK(within(law.adapted, config.b * config.limit));
        if (random_below(1000) == 0U) {
            cgl_robust_ilc_reset(&config, &law);
        }
    }
    check_cells(length, config.memory.limit);
    check_fence(length);
}

static void try_anti_cogging(void)
{
    cgl_anti_cogging_config config;
    cgl_anti_cogging law;
    do {
        config.pi = random_pi();
        config.cells = 4U + random_below(CELLS_MAX - 3U);
        config.speed = random_gain(CGL_R(100.0));
        config.revolutions = 1U + (random_below(2) ? 0U : random_below(100));
        config.position_gain = random_gain(CGL_R(20.0));
        config.lead = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-3));
    } while (cgl_anti_cogging_init(&config, &law, fence(config.cells), config.cells) != CGL_OK);
    for (int step = 0; step < 4 * STEPS_PER_CONFIG; ++step) {
        if (random_below(400) == 0U) {
            cgl_anti_cogging_calibrate(&config, &law);
        } else if (random_below(2000) == 0U) {
            cgl_anti_cogging_reset(&config, &law);
        }
        cgl_speed_input in;
        cgl_speed_output out;
        next_input(&in, step);
        cgl_anti_cogging_step(&config, &law, &in, &out);
        CHECK(within(out.i_q_ref, config.pi.limit));
        CHECK(within(law.looked_up, config.pi.limit));
        CHECK(within(law.friction, config.pi.limit));
    }
    check_cells(config.cells, config.pi.limit);
    check_fence(config.cells);
}

/* Configs of any bits: init may refuse them, and does no more than that. */
static void try_any_config(void)
{
    const uint32_t length = random_below(CELLS_MAX);
    cgl_memory_config memory = random_memory();
    *(random_below(2) ? &memory.cells : &memory.q_half_width) = random_bits();
    memory.periods_per_rev = random_bits();
    cgl_memory state;
    if (cgl_memory_init(&memory, &state, fence(length), length) == CGL_OK) {
        CHECK(CGL_MEMORY_LENGTH(memory.cells, memory.q_half_width) <= length);
    }
    check_fence(length);
    const cgl_anti_cogging_config table = {random_pi(), random_bits() >> random_below(32), random_real(CGL_R(1.0)),
                                           random_bits() >> random_below(32), random_real(CGL_R(1.0))};
    cgl_anti_cogging law;
    if (cgl_anti_cogging_init(&table, &law, fence(length), length) == CGL_OK) {
        CHECK(table.cells <= length);
    }
    check_fence(length);
}

void random_inputs(long configs)
{
    for (long n = 0; n < configs; ++n) {
        try_angle();
        try_modulation();
        try_foc();
        try_pi();
        try_memory();
        try_pi_ilc();
        try_robust_ilc();
        try_anti_cogging();
        try_any_config();
    }
}
