/* Random bit patterns at every init and step of every law. Whatever comes in, outputs are finite and within their limits,
 * so is what is learned, and nothing outside the caller's memory is written. To be run under the sanitizers too. And what
 * comes out has the bits that it had when this was released. */
#include "random_inputs.h"

#include <stddef.h>
#include <string.h>

#include "check.h"
#include "cogless/angle.h"
#include "cogless/drive.h"
#include "cogless/foc.h"
#include "cogless/laws.def" /* the header of each law */
#include "cogless/modulation.h"
#include "cogless/polynomial.h"
#include "cogless/range.h"
#include "cogless/trial_basis.h"

#define CELLS_MAX 200U
#define GUARD 8U
#define CANARY CGL_R(123.456)
#define STEPS_PER_CONFIG 300

#define ROWS_MAX (4U * CGL_MEMORY_ROW(CELLS_MAX, CELLS_MAX / 2U))

/* A loop that leaves a law every config: any current, and no guard. */
static const cgl_loop *any_loop(cgl_real ts)
{
    static cgl_loop loop;
    loop.ts = ts;
    loop.current_limit = CGL_REAL_MAX;
    return &loop;
}

static cgl_real fenced[ROWS_MAX + 2U * GUARD];

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

static void check_cells(uint32_t length, cgl_real limit)
{
    for (uint32_t n = 0; n < length; ++n) {
        CHECK(within(fenced[GUARD + n], limit));
    }
}

static void check_off(const cgl_law_input *in, const cgl_law_output *out)
{
    hear(out->i_q_ref);
    hear_bits(out->status);
    const unsigned off = (unsigned)CGL_STATUS_OFF | (unsigned)CGL_STATUS_FROZEN;
    CHECK(((out->status & (unsigned)CGL_STATUS_OFF) != 0U) == in->off);
    CHECK(!in->off || (within(out->i_q_ref, CGL_R(0.0)) && (out->status & off) == off));
}

/* ---- a law that is reset does what a new one does, without any random number ---- */

static cgl_law_input ordinary_input(int step)
{
    const cgl_real time = CGL_R(1.0e-3) * (cgl_real)step;
    const cgl_law_input in = {.theta_ref = CGL_R(10.0) * time,
                              .omega_ref = CGL_R(10.0),
                              .theta_m = CGL_R(10.0) * time,
                              .omega_m = CGL_R(10.0) + CGL_R(0.25) * (cgl_real)(step % 5 - 2),
                              .i_q = CGL_R(0.1),
                              .learn = true};
    return in;
}

static void check_same(const cgl_law_output *one, const cgl_law_output *other)
{
    CHECK(memcmp(&one->i_q_ref, &other->i_q_ref, sizeof one->i_q_ref) == 0 && one->status == other->status);
}

/* What a law says of its output, term by term: they add up to it, as it is limited. */
static void check_sum(cgl_real output, cgl_real sum, cgl_real limit)
{
    const cgl_real wanted = cgl_clamped(sum, limit);
    CHECK(!(output < wanted) && !(output > wanted));
}

static cgl_real fresh_cells[ROWS_MAX];

#define CHECK_RESET(name, law, ...)                                                                                    \
    do {                                                                                                               \
        static cgl_##name fresh;                                                                                       \
        CHECK(cgl_##name##_init(&fresh, __VA_ARGS__) == CGL_OK);                                                       \
        cgl_##name##_reset(law);                                                                                       \
        for (int n = 0; n < 60; ++n) {                                                                                 \
            const cgl_law_input same = ordinary_input(n);                                                              \
            cgl_law_output one, other;                                                                                 \
            cgl_##name##_step((law), &same, &one);                                                                     \
            cgl_##name##_step(&fresh, &same, &other);                                                                  \
            check_same(&one, &other);                                                                                  \
        }                                                                                                              \
    } while (false)

/* A state that is reset, and one that is initialised again, is in every byte what init makes of the same config and memory. All are
 * static, so that their padding is 0. */
#define CHECK_ANEW(name, state, ...)                                                                                   \
    do {                                                                                                               \
        static cgl_##name fresh, again;                                                                                \
        memcpy(&again, (state), sizeof again);                                                                         \
        cgl_##name##_reset(state);                                                                                     \
        memcpy(fresh_cells, fenced + GUARD, sizeof fresh_cells);                                                       \
        CHECK(cgl_##name##_init(&fresh, __VA_ARGS__) == CGL_OK);                                                       \
        CHECK(cgl_##name##_init(&again, __VA_ARGS__) == CGL_OK);                                                       \
        check_bytes((state), &fresh, 0U, sizeof fresh);                                                                \
        check_bytes(&again, &fresh, 0U, sizeof fresh);                                                                 \
        check_bytes(fresh_cells, fenced + GUARD, 0U, sizeof fresh_cells);                                              \
    } while (false)

/* What has not begun is 0 (false, nothing): the fields of a state from one to another. */
static void check_zeros(const void *state, size_t first, size_t end)
{
    for (size_t n = first; n < end; ++n) {
        CHECK(((const char *)state)[n] == 0);
    }
}

#define CHECK_ZEROS(name, state, first, last)                                                                          \
    check_zeros((state), offsetof(cgl_##name, first), offsetof(cgl_##name, last) + sizeof (state)->last)

/* A law that is retuned keeps the gentler step that the guard asks for. */
#define CHECK_GENTLE(name, law, config)                                                                                \
    do {                                                                                                               \
        cgl_law_input in = ordinary_input(0);                                                                          \
        cgl_law_output out;                                                                                            \
        in.gentle = 3U;                                                                                                \
        cgl_##name##_step((law), &in, &out);                                                                           \
        const cgl_real gain = (law)->memory.gain;                                                                      \
        CHECK(cgl_##name##_retune((law), (config)) == CGL_OK);                                                         \
        cgl_##name##_step((law), &in, &out);                                                                           \
        CHECK(within((law)->memory.gain - gain, CGL_R(0.0)));                                                          \
    } while (false)

/* The terms of a law's current, a struct of reals. */
static void hear_terms(const void *terms, size_t size)
{
    cgl_real term[8];
    CHECK(size <= sizeof term);
    memcpy(term, terms, size);
    hear_all(term, (uint32_t)(size / sizeof term[0]));
}

/* ---- inputs: any, or a rotor that turns so that something is learned ---- */

/* What a guard may ask for: mostly nothing; a gentler step for some steps on end. */
static void ask_of_guard(cgl_law_input *in, int step)
{
    static uint32_t gentle;
    if (step == 0 || random_below(20) == 0U) {
        gentle = random_below(4) ? 0U : random_below(CGL_GUARD_STEPS + 1U);
    }
    in->muted = random_below(4) ? CGL_R(0.0) : CGL_R(0.01) * (cgl_real)random_below(101);
    in->gentle = gentle;
    in->forget = random_below(30) == 0U;
    in->torque = random_below(20) == 0U;
    in->i_q_ref = random_real(CGL_R(5.0));
}

static void next_input(cgl_law_input *in, int step)
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
    in->theta_ref = in->alpha_ref = CGL_R(0.0);
    in->learn = random_below(8) != 0U;
    in->off = random_below(50) == 0U;
    ask_of_guard(in, step);
}

/* Any, or a rotor that follows a reference which mostly rises. */
static void next_position_input(cgl_law_input *in, int step)
{
    static cgl_real theta, omega;
    if (step == 0 || random_below(60) == 0U) {
        omega = random_below(4) ? (cgl_real)random_below(300) : -(cgl_real)random_below(300);
    }
    theta = step == 0 ? CGL_R(0.0) : theta + CGL_R(1.0e-3) * omega;
    theta = theta > CGL_R(1.0e3) || theta < CGL_R(-1.0e3) ? CGL_R(0.0) : theta;
    const bool any = random_below(8) == 0U;
    in->theta_ref = any ? random_real(CGL_R(10.0)) : theta;
    in->omega_ref = any ? random_real(CGL_R(100.0)) : omega;
    in->alpha_ref = any ? random_real(CGL_R(100.0)) : CGL_R(1.0);
    in->theta_m = any ? random_real(CGL_R(10.0)) : theta + CGL_R(0.01);
    in->omega_m = any ? random_real(CGL_R(100.0)) : omega + (cgl_real)random_below(3) - CGL_R(1.0);
    in->i_q = CGL_R(0.0);
    in->learn = random_below(8) != 0U;
    in->off = random_below(50) == 0U;
    ask_of_guard(in, step);
}

static cgl_pi_config random_pi(void)
{
    const cgl_pi_config config = {random_gain(CGL_R(1.0)), random_gain(CGL_R(10.0)), random_gain(CGL_R(5.0))};
    return config;
}

/* A count that is mostly small, from 1 up. */
static uint32_t random_count(uint32_t usual)
{
    return 1U + (random_below(4) ? random_below(usual) : random_below(65535));
}

static cgl_memory_config random_memory(uint32_t channels)
{
    cgl_memory_config config;
    config.kind = random_below(2) ? CGL_MEMORY_ANGLE : (random_below(2) ? CGL_MEMORY_TIME : CGL_MEMORY_DELAY);
    config.channels = channels;
    config.cells = 4U + random_below(CELLS_MAX - 3U);
    config.turns = random_count(4);
    config.parts = random_count(4);
    config.q_half_width = random_below(2) ? 0U : random_below(random_below(2) ? 4U : config.cells / 2U);
    config.lead = random_below(2) ? 0U : random_below(config.cells / 4U + 1U);
    config.forgetting = random_below(2) ? CGL_R(1.0) : random_gain(CGL_R(1.0));
    for (uint32_t c = 0; c < (uint32_t)CGL_CHANNELS; ++c) {
        config.limit[c] = c < channels ? random_gain(CGL_R(5.0)) : random_real(CGL_R(5.0));
    }
    config.method = random_below(2) ? CGL_DELAY_ODE : CGL_DELAY_INVERSION;
    config.k_pp = random_gain(CGL_R(50.0));
    return config;
}

static uint32_t memory_length(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

/* Whether a law has this config, with the defaults in place of zeros that a random one may have. */
static bool is_in_full(const cgl_memory_config *of_law, cgl_memory_config config)
{
    config.forgetting = cgl_or_default(config.forgetting, CGL_R(1.0));
    config.k_pp = cgl_or_default(config.k_pp, CGL_R(10.0));
    return memcmp(of_law, &config, sizeof config) == 0;
}

/* What the memory holds, against its config. */
static void check_memory(const cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    const cgl_real *entry = memory->cell;
    if (config->kind == CGL_MEMORY_DELAY) {
        for (uint32_t n = 0; n < row; ++n, ++entry) {
            CHECK(*entry >= CGL_R(0.0) && *entry <= CGL_R(1.0)); /* an angle just below a period rounds up in float */
        }
    }
    for (uint32_t c = 0; c < config->channels; ++c) {
        for (uint32_t n = 0; n < row; ++n, ++entry) {
            CHECK(within(*entry, config->limit[c]));
        }
        CHECK(within(memory->channel[c].value, config->limit[c]));
    }
    const cgl_angle_map *const map = &memory->map;
    CHECK(map->at < config->cells && map->head <= config->q_half_width && map->half <= config->q_half_width);
    CHECK(map->part >= CGL_R(0.0) && map->part <= CGL_R(1.0));
    CHECK(map->anew_left >= 1U || !map->started);
    CHECK(map->passed <= config->cells / 4U + 1U);
    const cgl_delay_line *const line = &memory->line;
    CHECK(line->known <= row && line->then < row && line->newest < row);
    CHECK(line->p_t >= CGL_R(0.0) && line->p_t <= (cgl_real)(row + 1U) * memory->ts);
    check_fence(memory_length(config));
}

/* What a step did to the entries, against what it says: `before` are all of them, `old` is the state then. A map that does not
 * learn, or starts anew, stays; else it writes no more cells than it passed, and with a lead as many again there. */
static void check_writing(const cgl_memory *memory, const cgl_memory *old, const cgl_real *before)
{
    const cgl_memory_config *const config = &memory->config;
    if (config->kind != CGL_MEMORY_ANGLE) {
        return;
    }
    const uint32_t row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    const uint32_t passed = memory->map.passed;
    const bool writes = memory->learning && old->map.follows && passed <= 16U + 2U * old->map.passed;
    const uint32_t most = writes ? passed + (config->lead > 0U ? 16U + 2U * passed : 0U) : 0U;
    for (uint32_t c = 0; c < config->channels; ++c) {
        uint32_t written = 0U;
        for (uint32_t n = c * row; n < c * row + config->cells; ++n) {
            written += before[n] < memory->cell[n] || before[n] > memory->cell[n] ? 1U : 0U;
        }
        CHECK(written <= most);
    }
}

/* What a law says of its learning against what its memory did. */
static void check_learning(const cgl_law_input *in, const cgl_law_output *out, const cgl_memory *memory,
                           const cgl_memory *old, const cgl_real *before)
{
    const bool frozen = (out->status & (unsigned)CGL_STATUS_FROZEN) != 0U;
    CHECK(frozen == !memory->learning);
    const bool fault = (out->status & (unsigned)CGL_STATUS_FAULT) != 0U;
    CHECK(frozen || (!in->off && !in->torque && (in->forget || (in->learn && !fault)))); /* to forget, no speed is needed */
    check_writing(memory, old, before);
}

/* ---- one function a law: a random config that init accepts, then random steps ---- */

static void try_angle(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real sine, cosine;
        cgl_sincos(random_real(CGL_R(1.0e5)), &sine, &cosine);
        CHECK(within(sine, CGL_R(1.000001)) && within(cosine, CGL_R(1.000001)));
        hear(sine);
        hear(cosine);
        const cgl_real fraction = cgl_fraction(random_real(CGL_R(1.0e9)));
        CHECK(fraction >= CGL_R(0.0) && fraction < CGL_R(1.0));
        hear(fraction);
        const cgl_real theta = random_real(CGL_R(7.0)), last = random_real(CGL_R(100.0));
        const cgl_real unwrapped = cgl_unwrap(theta, last);
        hear(unwrapped);
        if (cgl_is_angle(theta) && cgl_is_angle(last)) {
            CHECK(cgl_abs(unwrapped - last) < CGL_R(3.18)); /* pi, and rounding at 1e5 rad */
        } else {
            CHECK(cgl_is_finite(unwrapped) || !cgl_is_finite(last));
        }
    }
}

static void try_modulation(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real duty[3];
        const cgl_real u_alpha = random_real(CGL_R(100.0)), u_beta = random_real(CGL_R(100.0));
        cgl_modulate(u_alpha, u_beta, random_real(CGL_R(100.0)), duty);
        hear_all(duty, 3U);
        CHECK(are_duties(duty));
    }
}

static cgl_foc_config random_foc(void)
{
    cgl_foc_config config;
    config.kp_d = random_gain(CGL_R(10.0));
    config.ki_d = random_gain(CGL_R(1000.0));
    config.kp_q = random_gain(CGL_R(10.0));
    config.ki_q = random_gain(CGL_R(1000.0));
    config.current_limit = random_gain(CGL_R(5.0));
    config.advance = random_gain(CGL_R(2.0));
    config.decoupling = random_below(2) != 0U;
    config.L_d = random_gain(CGL_R(1.0e-2));
    config.L_q = random_gain(CGL_R(1.0e-2));
    config.psi_f = random_gain(CGL_R(0.1));
    config.phases = random_below(2) ? 3U : 2U * random_below(2);
    return config;
}

static void try_foc(void)
{
    cgl_foc_config config;
    static cgl_foc foc;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_foc();
    } while (cgl_foc_init(&foc, &config, ts) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_foc_input in = {{random_real(CGL_R(5.0)), random_real(CGL_R(5.0)), random_real(CGL_R(5.0))},
                                  random_real(CGL_R(7.0)),
                                  random_real(CGL_R(1000.0)),
                                  random_real(CGL_R(300.0)),
                                  random_real(CGL_R(5.0)),
                                  random_real(CGL_R(5.0))};
        if (random_below(100) == 0U) {
            const cgl_foc_config other = random_foc();
            config = cgl_foc_retune(&foc, &other) == CGL_OK ? other : config;
        }
        const cgl_foc before = foc;
        cgl_foc_output out;
        cgl_foc_step(&foc, &in, &out);
        hear_all(out.duty, 3U);
        hear(out.i_d_ref);
        hear(out.i_q_ref);
        hear(out.i_d);
        hear(out.i_q);
        hear(out.u_d);
        hear(out.u_q);
        hear_bits(out.status);
        CHECK(are_duties(out.duty));
        CHECK(cgl_is_finite(out.u_d) && cgl_is_finite(out.u_q));
        CHECK(cgl_is_finite(out.i_d) && cgl_is_finite(out.i_q));
        CHECK(cgl_is_finite(foc.integral_d) && cgl_is_finite(foc.integral_q));
        if ((out.status & CGL_STATUS_FAULT) != 0U) {
            CHECK(!(foc.integral_d < before.integral_d) && !(foc.integral_d > before.integral_d));
            CHECK(!(foc.integral_q < before.integral_q) && !(foc.integral_q > before.integral_q));
        } else { /* the voltage is one that the bus has */
            const cgl_real u_d = out.u_d / in.u_dc, u_q = out.u_q / in.u_dc;
            const cgl_real longest = config.phases == 2U ? CGL_R(1.00001) : CGL_R(0.33334);
            CHECK(u_d * u_d + u_q * u_q <= longest || in.u_dc < CGL_R(1.0e-30));
        }
    }
    CHECK_ANEW(foc, &foc, &config, ts);
    CHECK_ZEROS(foc, &foc, integral_d, lost_q);
}

static void try_pi(void)
{
    cgl_pi_config config;
    static cgl_pi pi;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_pi();
    } while (cgl_pi_init(&pi, &config, any_loop(ts)) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_real error = random_real(CGL_R(10.0)), feedforward = random_real(CGL_R(1.0));
        const cgl_real output = cgl_pi_step(&pi, error, feedforward);
        hear(output);
        hear(pi.proportional);
        hear(pi.integral);
        CHECK(within(output, config.limit));
        CHECK(within(pi.integral, config.limit));
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        cgl_speed_pi_step(&pi, &in, &out);
        check_off(&in, &out);
        CHECK(within(out.i_q_ref, config.limit));
        if (random_below(100) == 0U) {
            const cgl_pi_config other = random_pi();
            config = cgl_pi_retune(&pi, &other) == CGL_OK ? other : config;
            hear(pi.proportional);
        }
    }
    CHECK_ANEW(pi, &pi, &config, any_loop(ts));
    CHECK(!pi.saturated);
    CHECK_ZEROS(pi, &pi, integral, proportional);
}

/* Another config for a state that has this one: mostly of the same sizes, which retune wants. */
static cgl_memory_config another_memory(const cgl_memory_config *now)
{
    cgl_memory_config other = random_memory(now->channels);
    if (random_below(4) != 0U) {
        other.kind = now->kind;
        other.cells = now->cells;
        other.turns = now->turns;
        other.parts = now->parts;
        other.q_half_width = now->q_half_width;
        other.lead = random_below(now->cells / 4U + 1U);
    }
    return other;
}

static void try_memory(void)
{
    static cgl_real before[ROWS_MAX];
    cgl_memory_config config;
    static cgl_memory memory;
    uint32_t length, ratio;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_memory(1U + random_below(CGL_CHANNELS));
        length = memory_length(&config);
        ratio = random_count(50);
    } while (cgl_memory_init(&memory, &config, ts, ratio, fence(length), length) != CGL_OK);
    CHECK(cgl_memory_fastest(&memory) >= CGL_R(0.0));
    const bool is_map = config.kind == CGL_MEMORY_ANGLE;
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        next_position_input(&in, step);
        cgl_real value[CGL_CHANNELS], correction[CGL_CHANNELS];
        for (uint32_t c = 0; c < config.channels; ++c) {
            correction[c] = random_below(16) ? config.limit[c] * CGL_R(0.01) : random_real(config.limit[c]);
        }
        memcpy(before, memory.cell, length * sizeof before[0]);
        const cgl_memory old = memory;
        const bool learned = cgl_memory_step(&memory, in.theta_ref, in.omega_ref, in.learn, correction, value);
        CHECK(learned == memory.learning && (in.learn || !learned));
        hear_all(value, config.channels);
        hear_bits((learned ? 1U : 0U) | (is_map && memory.map.started ? 2U : 0U) | (is_map && memory.map.lagging ? 4U : 0U)
                  | (is_map && memory.map.follows ? 8U : 0U) | (!is_map && memory.line.tracking ? 16U : 0U));
        for (uint32_t c = 0; c < config.channels; ++c) {
            CHECK(!learned || cgl_is_finite(correction[c]));
            CHECK(cgl_is_finite(value[c]) || (learned && config.lead == 0U)); /* a large correction on a large value */
        }
        check_writing(&memory, &old, before);
        check_memory(&memory);
        if (random_below(1000) == 0U) {
            cgl_memory_reset(&memory);
        } else if (random_below(1000) == 0U) {
            const cgl_memory_config now = memory.config;
            const cgl_memory_config other = another_memory(&now);
            if (cgl_memory_retune(&memory, &other) != CGL_OK) {
                CHECK(memcmp(&memory.config, &now, sizeof now) == 0);
            }
            check_memory(&memory);
        }
    }
    hear_all(memory.cell, length);
    hear(cgl_memory_fastest(&memory));
    const cgl_memory_config now = memory.config;
    CHECK_ANEW(memory, &memory, &now, ts, ratio, fenced + GUARD, length);
    CHECK(!memory.learning && !memory.map.started && !memory.map.follows && !memory.map.lagging && !memory.map.backward);
    for (const cgl_channel *channel = memory.channel; channel < memory.channel + CGL_CHANNELS; ++channel) {
        CHECK(within(channel->value, CGL_R(0.0)));
        check_zeros(channel, offsetof(cgl_channel, sum), sizeof *channel);
    }
}

static void try_pi_ilc(void)
{
    static cgl_real before[ROWS_MAX];
    cgl_pi_ilc_config config;
    static cgl_pi_ilc law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config.pi = random_pi();
        config.gain = random_gain(CGL_R(0.1));
        config.memory = random_memory(1U);
        length = memory_length(&config.memory);
    } while (cgl_pi_ilc_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        memcpy(before, fenced + GUARD, length * sizeof before[0]);
        const cgl_pi_ilc old = law;
        cgl_pi_ilc_step(&law, &in, &out);
        check_off(&in, &out);
        check_learning(&in, &out, &law.memory, &old.memory, before);
        CHECK(within(out.i_q_ref, config.pi.limit));
        hear(law.learned);
        CHECK(within(law.learned, config.memory.limit[0]));
        CHECK(within(law.pi.integral, config.pi.limit));
        if (random_below(1000) == 0U) {
            cgl_pi_ilc_reset(&law);
            CHECK(within(law.learned, CGL_R(0.0)));
        } else if (random_below(100) == 0U) {
            cgl_pi_ilc_config other = config;
            other.pi = random_pi();
            other.gain = random_gain(CGL_R(0.1));
            other.memory = another_memory(&config.memory);
            config = cgl_pi_ilc_retune(&law, &other) == CGL_OK ? other : config;
            CHECK(is_in_full(&law.memory.config, config.memory));
        }
    }
    check_memory(&law.memory);
    hear_all(law.memory.cell, length);
    CHECK_GENTLE(pi_ilc, &law, &config);
    CHECK_RESET(pi_ilc, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(pi_ilc, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK(within(law.learned, CGL_R(0.0)) && law.gentle == 0U);
}

static void try_robust_ilc(void)
{
    static cgl_real before[ROWS_MAX];
    cgl_robust_ilc_config config;
    static cgl_robust_ilc law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config.b = random_gain(CGL_R(500.0));
        config.c = random_gain(CGL_R(10.0));
        config.g = random_gain(CGL_R(60.0));
        config.eta = random_gain(CGL_R(200.0));
        config.q = random_gain(CGL_R(0.3));
        config.beta_1 = random_gain(CGL_R(1.0));
        config.beta_2 = random_gain(CGL_R(1.0));
        config.gamma = random_below(4) ? random_gain(CGL_R(5.0)) : CGL_R(0.0);
        config.viscous = random_real(CGL_R(1.0));
        config.coulomb = random_real(CGL_R(10.0));
        config.limit = random_gain(CGL_R(5.0));
        config.memory = random_memory(1U);
        length = memory_length(&config.memory);
    } while (cgl_robust_ilc_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        memcpy(before, fenced + GUARD, length * sizeof before[0]);
        const cgl_robust_ilc old = law;
        cgl_robust_ilc_step(&law, &in, &out);
        check_off(&in, &out);
        check_learning(&in, &out, &law.memory, &old.memory, before);
        const cgl_robust_ilc_terms *const terms = &law.terms;
        if (!in.off && !in.torque) {
            check_sum(out.i_q_ref, terms->surface + terms->switching + terms->linear + terms->learned + terms->adapted, config.limit);
        }
        CHECK(within(out.i_q_ref, config.limit));
        CHECK(within(law.error_integral, CGL_R(1.0e9)));
        CHECK(within(law.adapted, config.gamma > CGL_R(0.0) ? config.b * config.limit : CGL_R(0.0)));
        if (random_below(1000) == 0U) {
            cgl_robust_ilc_reset(&law);
        } else if (random_below(100) == 0U) {
            cgl_robust_ilc_config other = config;
            other.c = random_gain(CGL_R(10.0));
            other.beta_2 = random_gain(CGL_R(1.0));
            other.limit = random_gain(CGL_R(5.0));
            other.memory = another_memory(&config.memory);
            config = cgl_robust_ilc_retune(&law, &other) == CGL_OK ? other : config;
            CHECK(is_in_full(&law.memory.config, config.memory));
        }
        hear_terms(terms, sizeof *terms);
    }
    check_memory(&law.memory);
    hear_all(law.memory.cell, length);
    CHECK_GENTLE(robust_ilc, &law, &config);
    CHECK_RESET(robust_ilc, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(robust_ilc, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK(!law.started && !law.saturated && law.gentle == 0U);
    CHECK_ZEROS(robust_ilc, &law, error_integral, terms);
}

static void try_anti_cogging(void)
{
    cgl_anti_cogging_config config;
    static cgl_anti_cogging law;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config.pi = random_pi();
        config.cells = 4U + random_below(CELLS_MAX - 3U);
        config.speed = random_gain(CGL_R(100.0));
        config.revolutions = 1U + (random_below(2) ? 0U : random_below(100));
        config.position_gain = random_gain(CGL_R(20.0));
        config.lead = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-3));
    } while (cgl_anti_cogging_init(&law, &config, any_loop(ts), fence(config.cells), config.cells) != CGL_OK);
    for (int step = 0; step < 4 * STEPS_PER_CONFIG; ++step) {
        if (random_below(400) == 0U) {
            cgl_anti_cogging_calibrate(&law);
        } else if (random_below(400) == 0U) {
            cgl_anti_cogging_config other = config;
            other.pi = random_pi();
            other.lead = random_gain(CGL_R(1.0e-3));
            other.cells += random_below(8) ? 0U : 1U;
            config = cgl_anti_cogging_retune(&law, &other) == CGL_OK ? other : config;
            check_cells(config.cells, config.pi.limit);
        } else if (random_below(2000) == 0U) {
            cgl_anti_cogging_reset(&law);
        }
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        cgl_anti_cogging_step(&law, &in, &out);
        check_off(&in, &out);
        CHECK(within(out.i_q_ref, config.pi.limit));
        hear(law.looked_up);
        hear(law.friction);
        CHECK(within(law.looked_up, config.pi.limit));
        CHECK(within(law.friction, config.pi.limit));
    }
    check_cells(config.cells, config.pi.limit);
    check_fence(config.cells);
    hear_all(law.table, config.cells);
    static cgl_anti_cogging fresh, again;
    memcpy(&again, &law, sizeof again);
    cgl_anti_cogging_reset(&law); /* what a calibration that has ended says stays */
    CHECK(cgl_anti_cogging_init(&fresh, &config, any_loop(ts), fenced + GUARD, config.cells) == CGL_OK);
    CHECK(cgl_anti_cogging_init(&again, &config, any_loop(ts), fenced + GUARD, config.cells) == CGL_OK);
    check_bytes(&again, &fresh, 0U, sizeof fresh);
    check_cells(config.cells, CGL_R(0.0));
    fresh.friction = law.friction;
    check_bytes(&law, &fresh, 0U, sizeof fresh);
    CHECK(law.stage == CGL_ANTI_COGGING_RUN);
    CHECK_ZEROS(anti_cogging, &law, looked_up, looked_up);
    CHECK_ZEROS(anti_cogging, &law, place, started);
}

static cgl_pi_afc_config random_pi_afc(void)
{
    cgl_pi_afc_config config;
    config.pi = random_pi();
    config.orders = 1U + random_below(CGL_PI_AFC_ORDERS);
    uint32_t order = 0U;
    for (uint32_t k = 0; k < CGL_PI_AFC_ORDERS; ++k) {
        order += random_below(60) ? 1U + random_below(40) : random_word();
        config.order[k] = order;
    }
    config.gain = random_gain(CGL_R(10.0));
    config.lead = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-2));
    config.omega_min = random_gain(CGL_R(1.0));
    config.limit = random_gain(CGL_R(2.0));
    return config;
}

static void try_pi_afc(void)
{
    cgl_pi_afc_config config;
    static cgl_pi_afc law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_pi_afc();
        length = CGL_PI_AFC_LENGTH(config.orders);
    } while (cgl_pi_afc_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        cgl_real before[CGL_PI_AFC_LENGTH(CGL_PI_AFC_ORDERS)];
        memcpy(before, fenced + GUARD, length * sizeof before[0]);
        cgl_pi_afc_step(&law, &in, &out);
        check_off(&in, &out);
        const bool frozen = (out.status & (unsigned)CGL_STATUS_FROZEN) != 0U;
        CHECK(frozen == !law.learning && (frozen || (out.status & (unsigned)CGL_STATUS_FAULT) == 0U));
        CHECK(memcmp(before, fenced + GUARD, (frozen && !in.forget ? length : 0U) * sizeof before[0]) == 0);
        for (uint32_t n = 0; frozen && in.forget && !cgl_law_stands_by(&in) && n < 2U * config.orders; ++n) {
            CHECK(within(law.coefficient[n], CGL_R(0.0))); /* to forget is to clear, although nothing is learned */
        }
        CHECK(memcmp(before + 2U * config.orders, law.coefficient + 2U * config.orders,
                     config.orders * sizeof before[0]) == 0);
        CHECK(within(out.i_q_ref, config.pi.limit));
        hear(law.learned);
        CHECK(within(law.learned, config.limit));
        CHECK(within(law.pi.integral, config.pi.limit));
        check_cells(2U * config.orders, config.limit);
        if (random_below(1000) == 0U) {
            cgl_pi_afc_reset(&law);
            CHECK(within(law.learned, CGL_R(0.0)));
        } else if (random_below(100) == 0U) {
            cgl_pi_afc_config other = config;
            other.pi = random_pi();
            other.gain = random_gain(CGL_R(10.0));
            other.limit = random_gain(CGL_R(2.0));
            other.order[random_below(40) ? CGL_PI_AFC_ORDERS - 1U : 0U] += 1U;
            config = cgl_pi_afc_retune(&law, &other) == CGL_OK ? other : config;
        }
    }
    check_fence(length);
    CHECK_RESET(pi_afc, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(pi_afc, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK_ZEROS(pi_afc, &law, learned, learning);
}

static cgl_harmonic_config random_harmonic(void)
{
    cgl_harmonic_config config;
    config.pi = random_pi();
    config.k_theta = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(50.0));
    config.b = random_gain(CGL_R(1000.0));
    config.delay = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(2.0e-3));
    config.step = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-2));
    config.base = 1U + random_below(random_below(20) ? 40U : CGL_HARMONIC_ORDER_MAX);
    config.bends = random_below(3);
    config.orders = 1U + random_below(random_below(4) ? 8U : CGL_HARMONIC_ORDERS);
    config.fast = random_below(config.orders + 1U);
    config.rate = random_gain(CGL_R(10.0));
    config.rate_min = random_gain(CGL_R(1.0));
    config.limit = random_gain(CGL_R(2.0));
    for (uint32_t n = 0; n < CGL_HARMONIC_EDGES; ++n) {
        config.held[n] = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0));
    }
    return config;
}

static void try_harmonic(void)
{
    cgl_harmonic_config config;
    static cgl_harmonic law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_harmonic();
        length = CGL_HARMONIC_LENGTH(config.orders);
    } while (cgl_harmonic_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    bool calm = false;
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        calm = step % 200 != 0 ? calm : random_below(2) != 0U;
        if (calm) { /* it only learns after some time without a fault */
            in = ordinary_input(step);
            in.forget = random_below(400) == 0U;
            in.off = random_below(400) == 0U;
        }
        cgl_real before[2U * CGL_HARMONIC_ORDERS];
        memcpy(before, fenced + GUARD, 2U * config.orders * sizeof before[0]);
        cgl_harmonic_step(&law, &in, &out);
        check_off(&in, &out);
        const bool frozen = (out.status & (unsigned)CGL_STATUS_FROZEN) != 0U;
        CHECK(frozen == !law.learning && (frozen || (out.status & (unsigned)CGL_STATUS_FAULT) == 0U));
        for (uint32_t n = 0; frozen && n < 2U * config.orders; ++n) {
            CHECK(law.cosine[n] == (in.forget && !cgl_law_stands_by(&in) ? CGL_R(0.0) : before[n]));
        }
        for (uint32_t k = 0; k < config.orders; ++k) {
            CHECK((uint32_t)law.cosine[2U * config.orders + k] == config.base * (k + 1U));
        }
        CHECK(within(out.i_q_ref, config.pi.limit));
        const cgl_real state[] = {law.learned, law.rate, law.time, law.slowest, law.omega, law.load};
        hear_all(state, sizeof state / sizeof state[0]);
        hear_terms(law.bend.part, sizeof law.bend.part);
        CHECK(within(law.learned, config.limit));
        CHECK(within(law.pi.integral, config.pi.limit));
        check_cells(2U * config.orders, config.limit);
        if (random_below(1000) == 0U) {
            cgl_harmonic_reset(&law);
            CHECK(within(law.learned, CGL_R(0.0)));
        } else if (random_below(100) == 0U) {
            cgl_harmonic_config other = random_harmonic();
            other.base = config.base;
            other.orders = config.orders + (random_below(40) == 0U ? 1U : 0U);
            other.fast = random_below(config.orders + 1U);
            config = cgl_harmonic_retune(&law, &other) == CGL_OK ? other : config;
        }
    }
    check_fence(length);
    CHECK_RESET(harmonic, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(harmonic, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK_ZEROS(harmonic, &law, pending, theta_sensor);
    CHECK_ZEROS(harmonic, &law, since_edge, drift);
    CHECK_ZEROS(harmonic, &law, last_load, bend);
    CHECK_ZEROS(harmonic, &law, next_gain, low);
    CHECK_ZEROS(harmonic, &law, follows, learned);
}

/* ---- learning in space ---- */

static void try_space_position(void)
{
    static cgl_real before[ROWS_MAX];
    cgl_space_position_config config;
    static cgl_space_position law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config.ratio = random_count(50);
        config.k_theta = random_gain(CGL_R(5.0));
        config.k_omega = random_gain(CGL_R(5.0));
        config.k_v = random_gain(CGL_R(1.0));
        config.v_0 = random_gain(CGL_R(1.0));
        config.v_2 = random_gain(CGL_R(1.0));
        config.k_i = random_gain(CGL_R(50.0));
        config.mu_alpha = random_gain(CGL_R(250.0));
        config.mu_beta = random_gain(CGL_R(0.1));
        config.mu_h = random_gain(CGL_R(0.1));
        config.hand_over = random_below(2) != 0U;
        config.ramp = random_gain(CGL_R(0.1));
        config.omega_min = random_gain(CGL_R(1.0));
        config.index = random_below(2) ? CGL_SPACE_BY_REFERENCE : CGL_SPACE_BY_ROTOR;
        config.limit = random_gain(CGL_R(500.0));
        config.memory = random_memory(1U + random_below(CGL_CHANNELS));
        length = memory_length(&config.memory);
    } while (cgl_space_position_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_position_input(&in, step);
        memcpy(before, fenced + GUARD, length * sizeof before[0]);
        const cgl_space_position old = law;
        cgl_space_position_step(&law, &in, &out);
        check_off(&in, &out);
        check_learning(&in, &out, &law.memory, &old.memory, before);
        CHECK(within(out.i_q_ref, config.limit));
        CHECK(within(law.integral, config.limit));
        const cgl_space_position_terms *const terms = &law.terms;
        if (!in.off && !in.torque) {
            check_sum(out.i_q_ref, terms->proportional + terms->alpha + terms->beta + terms->h + terms->integral, config.limit);
        }
        if (random_below(1000) == 0U) {
            cgl_space_position_reset(&law);
        } else if (random_below(100) == 0U) {
            cgl_space_position_config other = config;
            other.k_omega = random_gain(CGL_R(5.0));
            other.mu_alpha = random_gain(CGL_R(250.0));
            other.ramp = random_below(2) ? config.ramp : random_gain(CGL_R(0.1));
            other.limit = random_gain(CGL_R(500.0));
            other.memory = another_memory(&config.memory);
            config = cgl_space_position_retune(&law, &other) == CGL_OK ? other : config;
            CHECK(is_in_full(&law.memory.config, config.memory));
        }
        hear_terms(terms, sizeof *terms);
    }
    check_memory(&law.memory);
    hear_all(law.memory.cell, length);
    CHECK_GENTLE(space_position, &law, &config);
    CHECK_RESET(space_position, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(space_position, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK(!law.saturated && law.gentle == 0U);
    CHECK_ZEROS(space_position, &law, learning_samples, terms);
}

static void try_space_speed(void)
{
    static cgl_real before[ROWS_MAX];
    cgl_space_speed_config config;
    static cgl_space_speed law;
    uint32_t length;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config.k = random_gain(CGL_R(5.0));
        config.mu_alpha = random_gain(CGL_R(250.0));
        config.mu_beta = random_gain(CGL_R(0.1));
        config.mu_h = random_gain(CGL_R(0.1));
        config.eta_bar = random_gain(CGL_R(3.0));
        config.omega_min = random_gain(CGL_R(1.0));
        config.limit = random_gain(CGL_R(500.0));
        config.ratio = random_count(50);
        config.memory = random_memory(1U + random_below(CGL_CHANNELS));
        length = memory_length(&config.memory);
    } while (cgl_space_speed_init(&law, &config, any_loop(ts), fence(length), length) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_position_input(&in, step);
        memcpy(before, fenced + GUARD, length * sizeof before[0]);
        const cgl_space_speed old = law;
        cgl_space_speed_step(&law, &in, &out);
        check_off(&in, &out);
        check_learning(&in, &out, &law.memory, &old.memory, before);
        CHECK(within(out.i_q_ref, config.limit));
        const cgl_space_speed_terms *const terms = &law.terms;
        if (!in.off && !in.torque) {
            check_sum(out.i_q_ref, terms->proportional + terms->alpha + terms->beta + terms->h, config.limit);
        }
        if (random_below(1000) == 0U) {
            cgl_space_speed_reset(&law);
        } else if (random_below(100) == 0U) {
            cgl_space_speed_config other = config;
            other.k = random_gain(CGL_R(5.0));
            other.mu_alpha = random_gain(CGL_R(250.0));
            other.limit = random_gain(CGL_R(500.0));
            other.memory = another_memory(&config.memory);
            config = cgl_space_speed_retune(&law, &other) == CGL_OK ? other : config;
            CHECK(is_in_full(&law.memory.config, config.memory));
        }
        hear_terms(terms, sizeof *terms);
    }
    check_memory(&law.memory);
    hear_all(law.memory.cell, length);
    CHECK_GENTLE(space_speed, &law, &config);
    CHECK_RESET(space_speed, &law, &config, any_loop(ts), fresh_cells, length);
    CHECK_ANEW(space_speed, &law, &config, any_loop(ts), fenced + GUARD, length);
    CHECK(!law.saturated && law.gentle == 0U);
    CHECK_ZEROS(space_speed, &law, terms, terms);
}

/* ---- learning from trial to trial ---- */

#define SAMPLES_MAX 60U

/* Coefficients whose roots lie inside the unit circle: any reflection coefficients below 1, stepped up. */
static void random_stable(cgl_real *a, uint32_t order)
{
    a[0] = CGL_R(1.0);
    for (uint32_t n = 1; n <= order; ++n) {
        cgl_real before[CGL_POLYNOMIAL_ORDER + 1];
        memcpy(before, a, n * sizeof a[0]);
        const cgl_real k = cgl_clamp(random_gain(CGL_R(1.0)), CGL_R(0.999)) * (random_below(2) ? CGL_R(1.0) : CGL_R(-1.0));
        for (uint32_t i = 1; i < n; ++i) {
            a[i] = before[i] + k * before[n - i];
        }
        a[n] = k;
    }
}

static cgl_zero_phase_config random_filter(void)
{
    cgl_zero_phase_config config;
    config.order = random_below(3) ? random_below(CGL_ZERO_PHASE_ORDER + 1U) : 0U;
    config.odd = random_below(2) != 0U;
    random_stable(config.a, CGL_ZERO_PHASE_ORDER);
    random_stable(config.a, config.order);
    for (uint32_t i = 0; i <= CGL_ZERO_PHASE_ORDER; ++i) {
        config.b[i] = random_below(20) ? random_gain(CGL_R(1.0)) : random_real(CGL_R(1.0));
    }
    return config;
}

static cgl_feedforward_config random_feedforward(void)
{
    cgl_feedforward_config config;
    config.numerator = random_below(2) ? random_below(CGL_FEEDFORWARD_TAPS + 1U) : 0U;
    config.denominator = 1U + random_below(4);
    config.preview = random_below(4) ? random_below(8) : random_word();
    random_stable(config.den, CGL_FEEDFORWARD_TAPS - 1U);
    random_stable(config.den, config.denominator - 1U);
    for (uint32_t i = 0; i < CGL_FEEDFORWARD_TAPS; ++i) {
        config.num[i] = random_below(20) ? random_gain(CGL_R(1.0)) : random_real(CGL_R(1.0));
    }
    return config;
}

static void try_zero_phase(void)
{
    cgl_zero_phase_config config;
    uint32_t samples;
    do {
        config = random_filter();
        samples = 1U + random_below(SAMPLES_MAX);
    } while (cgl_zero_phase_init(&config, samples) != CGL_OK);
    const uint32_t tail = CGL_ZERO_PHASE_TAIL(samples, config.order);
    for (int n = 0; n < 10; ++n) {
        cgl_real *x = fence(samples + tail);
        const bool finite = random_below(2) != 0U;
        for (uint32_t i = 0; i < samples; ++i) {
            x[i] = finite ? cgl_clamp(random_real(CGL_R(1.0)), CGL_REAL_MAX) : random_real(CGL_R(1.0));
        }
        cgl_zero_phase(&config, x, samples, x + samples);
        if (finite || config.order > 0U) {
            check_cells(samples, CGL_REAL_MAX);
        }
        hear_all(x, samples);
        check_fence(samples + tail);
    }
}

static cgl_real gain_of_any_sign(cgl_real usual)
{
    return random_below(2) ? random_gain(usual) : -random_gain(usual);
}

static cgl_trial_config random_trial(cgl_real *matrix)
{
    cgl_trial_config config;
    config.samples = 2U + random_below(SAMPLES_MAX - 1U);
    config.states = 1U + random_below(CGL_TRIAL_STATES);
    for (uint32_t i = 0; i < CGL_TRIAL_STATES; ++i) {
        config.k_1[i] = i < config.states ? gain_of_any_sign(CGL_R(1.0)) : random_real(CGL_R(1.0));
        config.c[i] = i < config.states ? gain_of_any_sign(CGL_R(1.0)) : random_real(CGL_R(1.0));
    }
    config.k_2 = gain_of_any_sign(CGL_R(0.1));
    config.n = gain_of_any_sign(CGL_R(1.0));
    config.through_integrator = random_below(2) != 0U;
    config.k_3 = gain_of_any_sign(CGL_R(1.0));
    config.shift = 1U + (random_below(4) ? random_below(4) : random_below(32));
    config.feedforward = random_feedforward();
    config.q_filter = random_filter();
    config.filter_signal = random_below(2) != 0U;
    config.learning_matrix = NULL;
    if (random_below(4) == 0U) {
        for (uint32_t i = 0; i < config.samples * config.samples; ++i) {
            matrix[i] = gain_of_any_sign(CGL_R(0.1));
        }
        config.learning_matrix = matrix;
    }
    config.limit = random_gain(CGL_R(20.0));
    config.learned_limit = random_gain(CGL_R(5.0));
    config.unguarded = random_below(4) == 0U;
    config.observer.response = config.observer.pole = CGL_R(0.0);
    if (random_below(3) == 0U) {
        config.observer.response = random_gain(CGL_R(0.1));
        config.observer.pole = CGL_R(0.1) * (cgl_real)random_below(11);
        config.shift = 2U;
        config.k_2 = CGL_R(0.0);
    }
    return config;
}

/* A step, with what it says checked against what it did. */
static void check_trial_step(const cgl_trial_config *config, cgl_trial *law, bool calm)
{
    cgl_trial_input in;
    for (uint32_t i = 0; i < CGL_TRIAL_STATES; ++i) {
        in.x[i] = calm && i < config->states ? gain_of_any_sign(CGL_R(3.0)) : random_real(CGL_R(3.0));
    }
    in.learn = calm || random_below(8) != 0U;
    const cgl_trial before = *law;
    cgl_real v[SAMPLES_MAX];
    memcpy(v, law->learned, config->samples * sizeof v[0]);
    cgl_trial_output out;
    cgl_trial_step(law, &in, &out);
    hear(out.u);
    hear_terms(&law->terms, sizeof law->terms);
    hear_bits(out.status);
    CHECK(within(out.u, config->limit));
    CHECK(cgl_is_finite(law->psi) && within(law->v, config->learned_limit));
    CHECK(cgl_is_finite(law->terms.feedback) && cgl_is_finite(law->terms.integral));
    CHECK(cgl_is_finite(law->terms.feedforward) && cgl_is_finite(law->terms.learned));
    CHECK(memcmp(v, law->learned, config->samples * sizeof v[0]) == 0);
    const cgl_trial_terms *const terms = &law->terms;
    check_sum(out.u, terms->feedback + terms->integral + terms->feedforward + terms->learned, config->limit);
    if ((out.status & (unsigned)CGL_STATUS_FAULT) != 0U || law->y_ref == NULL) {
        CHECK(within(out.u, CGL_R(0.0)));
        CHECK(memcmp(&before.psi, &law->psi, sizeof before.psi) == 0);
        CHECK((out.status & (unsigned)CGL_STATUS_FROZEN) != 0U);
        CHECK(law->spoilt || law->y_ref == NULL || before.sample >= config->samples);
    }
}

static void check_trial_in_a_drive(const cgl_trial_config *config, cgl_trial *law, int step)
{
    cgl_law_input in;
    cgl_law_output out;
    next_input(&in, step);
    cgl_real v[SAMPLES_MAX];
    memcpy(v, law->learned, config->samples * sizeof v[0]);
    cgl_trial_drive_step(law, &in, &out);
    check_off(&in, &out);
    CHECK(within(out.i_q_ref, config->limit) && cgl_is_finite(law->psi) && cgl_is_finite(law->theta));
    CHECK(memcmp(v, law->learned, config->samples * sizeof v[0]) == 0);
    if (law->y_ref != NULL && (in.off || !in.learn || (out.status & (unsigned)CGL_STATUS_FAULT) != 0U)) {
        CHECK(law->spoilt || law->sample > config->samples);
    }
}

static void check_trial_end(const cgl_trial_config *config, cgl_trial *law, bool whole)
{
    cgl_real v[SAMPLES_MAX];
    memcpy(v, law->learned, config->samples * sizeof v[0]);
    const bool learned = cgl_trial_end(law);
    CHECK(learned == whole);
    CHECK(learned || memcmp(v, law->learned, config->samples * sizeof v[0]) == 0);
    check_cells(config->samples, config->learned_limit);
    hear_all(law->learned, config->samples);
    CHECK(!cgl_trial_end(law)); /* not twice */
}

static void try_trial(void)
{
    static cgl_real matrix[(SAMPLES_MAX + 1U) * (SAMPLES_MAX + 1U)], y_ref[SAMPLES_MAX]; /* a retune asks for one sample more */
    cgl_trial_config config;
    static cgl_trial law;
    uint32_t length;
    do {
        config = random_trial(matrix);
        length = CGL_TRIAL_LENGTH(config.samples, config.q_filter.order) - (config.unguarded ? config.samples : 0U);
    } while (cgl_trial_init(&law, &config, fence(length), length) != CGL_OK);
    for (int trial = 0; trial < 8; ++trial) {
        const bool calm = random_below(4) != 0U;
        for (uint32_t p = 0; p < config.samples; ++p) {
            y_ref[p] = calm ? gain_of_any_sign(CGL_R(3.0)) : random_real(CGL_R(3.0));
        }
        if (random_below(8) != 0U) {
            cgl_trial_begin(&law, random_below(16) ? y_ref : NULL);
        }
        const uint32_t steps = random_below(4) ? config.samples + random_below(3) * 20U : random_below(config.samples);
        const bool in_a_drive = config.states == 2U && random_below(2) != 0U;
        for (uint32_t p = 0; p < steps; ++p) {
            if (in_a_drive) {
                check_trial_in_a_drive(&config, &law, (int)p);
            } else {
                check_trial_step(&config, &law, calm);
            }
        }
        if (random_below(16) == 0U) {
            cgl_trial_reset(&law);
            hear_terms(&law.terms, sizeof law.terms);
        }
        check_trial_end(&config, &law, law.y_ref != NULL && law.sample >= config.samples && !law.spoilt);
        if (random_below(4) == 0U) {
            cgl_trial_config other = random_trial(matrix);
            other.samples = config.samples + (random_below(8) == 0U ? 1U : 0U);
            other.states = config.states;
            other.q_filter = config.q_filter;
            other.unguarded = config.unguarded;
            config = cgl_trial_retune(&law, &other) == CGL_OK ? other : config;
            check_cells(config.samples, config.learned_limit);
            CHECK(within(law.v, config.learned_limit));
        }
        check_fence(length);
    }
    static cgl_trial fresh, again;
    memcpy(&again, &law, sizeof again);
    cgl_trial_reset(&law);
    check_cells(config.samples, CGL_R(0.0));
    CHECK(cgl_trial_init(&fresh, &config, fenced + GUARD, length) == CGL_OK);
    CHECK(cgl_trial_init(&again, &config, fenced + GUARD, length) == CGL_OK);
    for (int n = 0; n < 2; ++n) {
        const cgl_trial *const one = n > 0 ? &again : &law;
        check_bytes(one, &fresh, 0U, offsetof(cgl_trial, guard.limited) + 1U);
        check_bytes(one, &fresh, offsetof(cgl_trial, v), sizeof fresh);
    }
    CHECK(law.y_ref == NULL && !law.spoilt);
    CHECK_ZEROS(trial, &law, psi, psi);
    CHECK_ZEROS(trial, &law, v, theta);
    CHECK_ZEROS(trial, &law, sample, sample);
    CHECK_ZEROS(trial, &law, terms, terms);
}

/* What was learned for one reference, moved to another. */
static void try_trial_basis(void)
{
    static cgl_real matrix[SAMPLES_MAX * SAMPLES_MAX], y_ref[2][SAMPLES_MAX];
    cgl_trial_config config;
    cgl_trial law;
    uint32_t length;
    do {
        config = random_trial(matrix);
        config.unguarded = random_below(2) != 0U;
        length = CGL_TRIAL_LENGTH(config.samples, config.q_filter.order);
    } while (cgl_trial_init(&law, &config, fence(length), length) != CGL_OK);
    for (int trial = 0; trial < 8; ++trial) {
        const bool calm = random_below(4) != 0U;
        for (uint32_t p = 0; p < config.samples; ++p) {
            const cgl_real step = calm ? gain_of_any_sign(CGL_R(0.1)) : random_real(CGL_R(3.0));
            y_ref[trial % 2][p] = random_below(4) != 0U && p > 0U ? y_ref[trial % 2][p - 1U] + step : step;
            law.learned[p] = cgl_clamped(gain_of_any_sign(config.learned_limit), config.learned_limit);
        }
        const bool carried = cgl_trial_carry(&law, random_below(16) ? y_ref[trial % 2] : NULL);
        CHECK(trial > 0 || !carried);
        CHECK(!carried || !cgl_trial_end(&law));
        hear_bits(carried ? 1U : 0U);
        for (uint32_t p = 0; p < config.samples; ++p) {
            hear(law.learned[p]);
        }
        check_cells(config.samples, config.learned_limit);
        check_fence(length);
        cgl_trial_begin(&law, y_ref[trial % 2]);
    }
}

/* ---- the controller around a law ---- */

static cgl_monitor_config random_monitor(cgl_real ts, uint32_t phases)
{
    cgl_monitor_config config;
    config.omega_max = random_below(4) ? random_gain(CGL_R(1000.0)) : CGL_R(0.0);
    config.angle_step = random_gain(CGL_R(0.01));
    config.speed_window = random_below(4) ? random_gain(CGL_R(20.0)) * ts : random_gain(CGL_R(0.01));
    config.stuck_time = random_below(4) ? random_gain(CGL_R(20.0) * ts) : CGL_R(0.0);
    config.stuck_angle = random_below(4) ? random_gain(CGL_R(0.5)) : CGL_R(0.0);
    config.current_max = random_below(4) ? random_gain(CGL_R(10.0)) : CGL_R(0.0);
    config.current_sum = random_below(4) ? random_gain(CGL_R(5.0)) : CGL_R(0.0);
    config.bridge = random_below(4) ? random_gain(CGL_R(20.0)) * ts : CGL_R(0.0);
    config.hold = random_below(4) ? random_gain(CGL_R(20.0)) * ts : CGL_R(0.0);
    config.phases = phases;
    return config;
}

static cgl_quality_config random_quality(cgl_real ts)
{
    const cgl_quality_config config = {random_below(4) ? CGL_TWO_PI : random_gain(CGL_R(10.0)),
                                       random_below(4) ? CGL_R(50.0) * ts : random_gain(CGL_R(60.0)),
                                       random_below(2) ? random_gain(CGL_R(10.0)) : CGL_R(0.0),
                                       random_gain(CGL_R(1.0))};
    return config;
}

/* Any bits, or a rotor that turns, whose sensors fail now and then. */
static void next_measurement(cgl_measurement *now, int step)
{
    static cgl_real theta, omega, jump;
    if (step == 0 || random_below(200) == 0U) {
        omega = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(500.0));
        theta = random_gain(CGL_R(6.0));
        jump = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(3.0));
    }
    theta = CGL_TWO_PI * cgl_fraction((theta + CGL_R(1.0e-4) * omega) / CGL_TWO_PI);
    for (int x = 0; x < 3; ++x) {
        now->i_abc[x] = random_below(40) ? CGL_R(0.01) * (cgl_real)x : random_real(CGL_R(5.0));
    }
    now->theta_m = random_below(20) ? theta + jump : random_real(CGL_R(6.0));
    now->omega_m = random_below(40) ? omega : random_real(CGL_R(500.0));
    now->u_dc = random_below(40) ? CGL_R(24.0) : random_real(CGL_R(300.0));
}

static void check_monitor(const cgl_monitor_config *config, const cgl_monitor *monitor)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    CHECK(monitor->theta_m >= CGL_R(0.0) && monitor->theta_m < CGL_TWO_PI);
    CHECK(monitor->theta_sensor >= CGL_R(0.0) && monitor->theta_sensor < CGL_TWO_PI);
    CHECK(cgl_is_finite(monitor->omega_m) && within(monitor->sensor_offset, CGL_R(3.1416)));
    CHECK(!(config->omega_max > CGL_R(1.0e-15)) /* whose square is a number */
          || within(monitor->omega_m, CGL_R(1.000001) * config->omega_max));
    CHECK(cgl_is_finite(monitor->ref_turned));
    CHECK(monitor->missing_angles <= limits->bridge + 1U && monitor->hold_wait <= limits->hold + 1U);
    CHECK(monitor->speed_wait <= limits->window + 1U && monitor->gap_periods >= monitor->missing_angles);
    CHECK(monitor->stuck_after <= monitor->standstill && monitor->full_current <= monitor->standstill);
    CHECK((monitor->status & (unsigned)CGL_STATUS_ANGLE_STUCK) == 0U || monitor->stuck_after > 0U);
    CHECK(monitor->safe == (monitor->hold_wait > 0U));
    CHECK(!(monitor->safe && monitor->trusted));
    CHECK((monitor->status == 0U && monitor->missing_angles == 0U && monitor->speed_wait == 0U && monitor->standstill == 0U
           && !monitor->stuck_since_moved)
          == monitor->trusted);
    CHECK((monitor->speed_wait > 0U) == (monitor->speed_lost > 0U));
    CHECK(monitor->safe == ((monitor->status & (unsigned)CGL_STATUS_FAULT) != 0U));
}

/* Whether new bounds hold in this step: else counts and speed may stay outside them for a while. */
static bool hold_at_once(const cgl_monitor *monitor, const cgl_monitor_config *other)
{
    return monitor->trusted && (!(other->omega_max > CGL_R(0.0)) || cgl_abs(monitor->omega_m) < other->omega_max);
}

static void try_monitor(void)
{
    cgl_monitor_config config;
    static cgl_monitor monitor;
    cgl_monitor long_way;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_monitor(ts, random_below(4));
    } while (cgl_monitor_init(&monitor, &config, ts) != CGL_OK);
    for (int step = 0; step < 4 * STEPS_PER_CONFIG; ++step) {
        cgl_measurement now;
        next_measurement(&now, step);
        const cgl_real omega_ref = random_below(8) ? CGL_R(100.0) : random_real(CGL_R(100.0));
        const bool full = random_below(4) != 0U;
        long_way = monitor;
        cgl_monitor_step(&monitor, &now, omega_ref, full);
        cgl_monitor_look(&long_way, &now, omega_ref, full);
        hear(monitor.theta_m);
        hear(monitor.omega_m);
        hear(monitor.sensor_offset);
        hear_bits(monitor.status + (monitor.trusted ? 1U << 31 : 0U));
        check_monitor(&config, &monitor);
        check_monitor(&config, &long_way);
        CHECK(monitor.status == long_way.status && monitor.trusted == long_way.trusted);
        CHECK(!(monitor.theta_m < long_way.theta_m) && !(monitor.theta_m > long_way.theta_m));
        CHECK(!(monitor.omega_m < long_way.omega_m) && !(monitor.omega_m > long_way.omega_m));
        if (random_below(500) == 0U) {
            cgl_monitor_trust(&monitor);
        } else if (random_below(500) == 0U) {
            const cgl_monitor_config other = random_monitor(ts, random_below(4));
            config = hold_at_once(&monitor, &other) && cgl_monitor_retune(&monitor, &other) == CGL_OK ? other : config;
        } else if (random_below(1000) == 0U) {
            cgl_monitor_reset(&monitor);
        } else if (random_below(500) == 0U) { /* as after years */
            monitor.gap_periods = monitor.missing_angles > 0U ? UINT32_MAX : 0U;
            monitor.jumps = UINT32_MAX;
        }
    }
    CHECK_ANEW(monitor, &monitor, &config, ts);
    CHECK(monitor.safe);
    CHECK_ZEROS(monitor, &monitor, trusted, ref_turned);
}

static void check_quality(const cgl_quality *quality)
{
    CHECK(cgl_is_finite(quality->sum + quality->outlier_sum) && cgl_is_finite(quality->squares + quality->outlier_squares));
    CHECK(cgl_is_finite(quality->turned) && cgl_is_finite(quality->centre));
    CHECK(quality->ripple >= CGL_R(0.0) && cgl_is_finite(quality->ripple));
    CHECK(quality->ripple_before >= CGL_R(0.0) && cgl_is_finite(quality->ripple_before));
    CHECK(cgl_is_finite(quality->outlier_square) && (quality->outlier_square >= CGL_R(0.0) || quality->windows == 0U));
    CHECK(quality->run_length <= quality->outliers && quality->refused_square >= quality->outlier_square);
    CHECK(within(quality->trend, CGL_R(0.16001)));
    CHECK(quality->remaining >= 1U && quality->remaining <= quality->longest);
    CHECK(quality->missing + quality->outliers <= quality->longest - quality->remaining);
    const cgl_quality_report report = cgl_quality_read(quality);
    CHECK(report.residual >= CGL_R(0.0) && report.residual <= CGL_R(1.1e14));
    CHECK(cgl_is_finite(report.progress) && report.progress <= CGL_R(1.0));
    CHECK(!(report.improving && report.worsening));
}

static void try_quality(void)
{
    cgl_quality_config config;
    static cgl_quality quality;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_quality(ts);
    } while (cgl_quality_init(&quality, &config, ts) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_real error = random_below(10) ? CGL_R(0.1) * (cgl_real)random_below(10) : random_real(CGL_R(10.0));
        const cgl_real omega_m = random_below(10) ? CGL_R(100.0) : random_real(CGL_R(100.0));
        const bool outlier = cgl_quality_step(&quality, error, omega_m, random_below(2) != 0U);
        const cgl_quality_report report = cgl_quality_read(&quality);
        hear(report.residual);
        hear(report.progress);
        hear_bits((uint32_t)outlier + 2U * (uint32_t)report.improving + 4U * (uint32_t)report.worsening);
        CHECK(cgl_is_finite(error) || outlier);
        CHECK(!outlier || config.outlier > CGL_R(0.0) || !(cgl_abs(error) <= CGL_R(1.0e14)));
        check_quality(&quality);
        if (random_below(100) == 0U) {
            quality.windows = UINT32_MAX;
        } else if (random_below(200) == 0U) {
            cgl_quality_config other = random_quality(ts);
            other.outlier = config.outlier; /* another one holds from the next window on */
            config = cgl_quality_retune(&quality, &other) == CGL_OK ? other : config;
        }
    }
    CHECK_ANEW(quality, &quality, &config, ts);
    CHECK_ZEROS(quality, &quality, run_positive, run_remaining);
    CHECK_ZEROS(quality, &quality, missing, last_peak_square);
    CHECK_ZEROS(quality, &quality, turned, turned);
    CHECK_ZEROS(quality, &quality, ripple, trend);
}

static cgl_drive_config random_drive(cgl_real ts)
{
    cgl_drive_config config;
    config.pole_pairs = random_below(10) ? 1U + random_below(10) : random_word();
    config.divider = random_below(10) ? 1U + random_below(20) : random_word();
    config.foreign = random_below(3) == 0U;
    config.feed_forward = config.foreign && random_below(3) == 0U;
    config.learn_saturated = random_below(2) != 0U;
    config.unguarded = random_below(2) != 0U;
    config.foc = random_foc();
    config.monitor = random_monitor(ts, random_below(4));
    config.quality = random_quality((cgl_real)config.divider * ts);
    return config;
}

static void check_drive(const cgl_drive_config *config, const cgl_drive *drive, const cgl_drive_output *out)
{
    check_monitor(&config->monitor, &drive->monitor);
    check_quality(&drive->quality);
    CHECK(are_duties(out->duty));
    CHECK(cgl_is_finite(out->i_d) && cgl_is_finite(out->i_q) && cgl_is_finite(out->u_d) && cgl_is_finite(out->u_q));
    CHECK(cgl_is_finite(out->i_d_ref) && cgl_is_finite(out->i_q_ref) && cgl_is_finite(drive->i_q));
    CHECK(cgl_is_finite(drive->foc.integral_d) && cgl_is_finite(drive->foc.integral_q));
    if (drive->monitor.safe) {
        CHECK(within(out->u_d, CGL_R(0.0)) && within(out->u_q, CGL_R(0.0)) && within(out->i_q_ref, CGL_R(0.0)));
        CHECK(within(drive->foc.integral_d, CGL_R(0.0)) && within(drive->foc.integral_q, CGL_R(0.0)));
        CHECK((out->status & (unsigned)CGL_STATUS_OFF) != 0U && (out->status & (unsigned)CGL_STATUS_FAULT) != 0U);
    }
    if (drive->monitor.safe || config->foreign) {
        for (int x = 0; x < 3; ++x) {
            CHECK(within(out->duty[x] - CGL_R(0.5), CGL_R(0.0)));
        }
    }
}

/* A drive that is reset waits for its first measurement, like a new one, and its law has no input and no command. */
static void check_drive_anew(const cgl_drive_config *config, cgl_drive *drive, cgl_real ts)
{
    static const cgl_law_input no_input;
    static const cgl_foc_input no_currents;
    static cgl_drive fresh;
    cgl_drive_reset(drive);
    CHECK(cgl_drive_init(&fresh, config, ts) == CGL_OK);
    check_bytes(&drive->in, &no_input, 0U, offsetof(cgl_law_input, gentle) + sizeof no_input.gentle);
    CHECK(!drive->in.torque && within(drive->in.i_q_ref, CGL_R(0.0)));
    check_bytes(&drive->currents, &no_currents, 0U, sizeof no_currents);
    CHECK(within(drive->command.i_q_ref, CGL_R(0.0)) && drive->command.status == 0U && within(drive->i_q, CGL_R(0.0)));
    CHECK(drive->countdown == 0U && drive->status == 0U && drive->held == 0U && !drive->saturated && !drive->off);
    check_bytes(&drive->monitor, &fresh.monitor, 0U, offsetof(cgl_monitor, limits));
    check_bytes(&drive->quality, &fresh.quality, 0U, sizeof fresh.quality);
    check_bytes(&drive->guard, &fresh.guard, 0U, sizeof fresh.guard);
    check_bytes(&drive->foc, &fresh.foc, 0U, sizeof fresh.foc);
}

static void try_drive(void)
{
    cgl_drive_config config;
    static cgl_drive drive;
    cgl_pi pi;
    cgl_pi_config law;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_drive(ts);
        law = random_pi();
    } while (cgl_drive_init(&drive, &config, ts) != CGL_OK || cgl_pi_init(&pi, &law, any_loop(ts)) != CGL_OK);
    uint32_t since = config.divider;
    for (int step = 0; step < 2 * STEPS_PER_CONFIG; ++step) {
        cgl_measurement now;
        next_measurement(&now, step);
        const cgl_reference reference = {random_real(CGL_R(6.0)), random_below(4) ? CGL_R(50.0) : random_real(CGL_R(100.0)),
                                         random_real(CGL_R(10.0)), random_real(CGL_R(1.0)), random_below(8) != 0U,
                                         random_below(20) == 0U, random_real(CGL_R(1.0))};
        const bool spoilt = (drive.saturated && !config.learn_saturated) || drive.off;
        const bool due = cgl_drive_measure(&drive, &now, &reference);
        CHECK(due == (since >= config.divider));
        since = due ? 1U : since + 1U;
        if (due) {
            CHECK(!drive.in.learn || (reference.learn && drive.monitor.trusted && !spoilt));
            CHECK(drive.in.off || !drive.monitor.safe);
            CHECK(cgl_is_finite(drive.in.theta_m) && cgl_is_finite(drive.in.omega_m) && cgl_is_finite(drive.in.i_q));
            cgl_speed_pi_step(&pi, &drive.in, &drive.command);
        }
        cgl_drive_output out;
        cgl_drive_actuate(&drive, &out);
        hear_all(out.duty, 3U);
        hear(out.i_d_ref);
        hear(out.i_q_ref);
        hear(out.i_q);
        hear(drive.i_q);
        hear(out.u_d);
        hear(out.u_q);
        hear_bits(out.status + (drive.in.learn ? 1U << 31 : 0U));
        hear(drive.quality.ripple);
        check_drive(&config, &drive, &out);
        CHECK(within(out.i_q_ref, law.limit));
        if (random_below(1000) == 0U) {
            cgl_drive_reset(&drive);
            CHECK(drive.in.gentle == 0U && !drive.in.learn && !drive.in.off && within(drive.in.muted, CGL_R(0.0)));
            since = config.divider;
        } else if (random_below(200) == 0U) {
            cgl_drive_config other = random_drive(ts);
            other.pole_pairs = config.pole_pairs;
            other.divider = config.divider + (random_below(10) == 0U ? 1U : 0U);
            other.foreign = config.foreign;
            other.unguarded = config.unguarded;
            const cgl_drive before = drive;
            const bool taken = hold_at_once(&drive.monitor, &other.monitor) && cgl_drive_retune(&drive, &other) == CGL_OK;
            const cgl_drive_config *const now_in = taken ? &other : &config;
            CHECK(memcmp(&drive.monitor.config.hold, &now_in->monitor.hold, sizeof now_in->monitor.hold) == 0);
            CHECK(config.foreign || memcmp(&drive.foc.config.kp_q, &now_in->foc.kp_q, sizeof now_in->foc.kp_q) == 0);
            CHECK(drive.divider == config.divider && drive.learn_saturated == now_in->learn_saturated);
            CHECK(taken || memcmp(&before.quality.remaining, &drive.quality.remaining, sizeof drive.quality.remaining) == 0);
            config = taken ? other : config;
        }
    }
    check_drive_anew(&config, &drive, ts);
}

/* Configs of any bits: init may refuse them, and does no more than that. */
static void try_any_config(void)
{
    const uint32_t length = random_below(CELLS_MAX);
    const cgl_real ts = random_gain(CGL_R(1.0e-3));
    cgl_memory_config memory = random_memory(1U + random_below(CGL_CHANNELS));
    *(random_below(2) ? &memory.cells : &memory.q_half_width) = random_word();
    *(random_below(2) ? &memory.channels : &memory.parts) = random_word();
    cgl_memory state;
    if (cgl_memory_init(&state, &memory, ts, random_word(), fence(length), length) == CGL_OK) {
        CHECK(memory_length(&memory) <= length);
    }
    check_fence(length);
    cgl_foc_config currents = random_foc();
    currents.phases = random_below(5);
    currents.kp_q = random_real(CGL_R(1.0));
    cgl_foc foc;
    const bool valid = (currents.phases == 0U || currents.phases == 2U || currents.phases == 3U) && currents.kp_q >= CGL_R(0.0)
                       && cgl_is_finite(currents.kp_q) && ts > CGL_R(0.0);
    CHECK(cgl_foc_init(&foc, &currents, ts) != CGL_OK || valid);
    const cgl_anti_cogging_config table = {random_pi(), random_word(), random_real(CGL_R(1.0)),
                                           random_word(), random_real(CGL_R(1.0)),
                                           random_real(CGL_R(1.0))};
    cgl_anti_cogging law;
    if (cgl_anti_cogging_init(&law, &table, any_loop(ts), fence(length), length) == CGL_OK) {
        CHECK(table.cells <= length);
    }
    check_fence(length);
    cgl_pi_afc_config orders = random_pi_afc();
    *(random_below(2) ? &orders.orders : &orders.order[random_below(CGL_PI_AFC_ORDERS)]) = random_word();
    cgl_pi_afc by_order;
    if (cgl_pi_afc_init(&by_order, &orders, any_loop(ts), fence(length), length) == CGL_OK) {
        CHECK(CGL_PI_AFC_LENGTH(orders.orders) <= length);
    }
    check_fence(length);
    static cgl_real matrix[SAMPLES_MAX * SAMPLES_MAX];
    cgl_trial_config trial = random_trial(matrix);
    trial.learning_matrix = NULL; /* its length is the caller's word */
    *(random_below(2) ? &trial.samples : &trial.shift) = random_word();
    *(random_below(2) ? &trial.feedforward.numerator : &trial.feedforward.denominator) = random_bits();
    *(random_below(2) ? &trial.states : &trial.q_filter.order) = random_word();
    cgl_trial trials;
    if (cgl_trial_init(&trials, &trial, fence(length), length) == CGL_OK) {
        CHECK(CGL_TRIAL_LENGTH(trial.samples, trial.q_filter.order) - (trial.unguarded ? trial.samples : 0U) <= length);
    }
    check_fence(length);
}

static cgl_adrc_config random_adrc(cgl_real ts)
{
    const cgl_adrc_config config = {random_gain(CGL_R(1000.0)), random_gain(CGL_R(100.0)), random_gain(CGL_R(0.5) / ts),
                                    random_gain(CGL_R(5.0))};
    return config;
}

static void try_adrc(void)
{
    cgl_adrc_config config;
    static cgl_adrc law;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_adrc(ts);
    } while (cgl_adrc_init(&law, &config, any_loop(ts)) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        cgl_law_output out;
        next_input(&in, step);
        cgl_adrc_step(&law, &in, &out);
        hear(out.i_q_ref);
        hear(law.f);
        hear(law.proportional);
        hear(law.rejected);
        check_off(&in, &out);
        CHECK(within(out.i_q_ref, config.limit));
        CHECK(within(law.f, config.b * config.limit) && cgl_is_finite(law.omega) && cgl_is_finite(law.proportional));
        if (random_below(100) == 0U) {
            const cgl_adrc_config other = random_adrc(ts);
            config = cgl_adrc_retune(&law, &other) == CGL_OK ? other : config;
        }
    }
    CHECK_RESET(adrc, &law, &config, any_loop(ts));
    CHECK_ANEW(adrc, &law, &config, any_loop(ts));
    CHECK(!law.started);
    CHECK(within(law.omega, CGL_R(0.0)) && within(law.f, CGL_R(0.0)));
    CHECK_ZEROS(adrc, &law, before, rejected);
}

void random_inputs(long configs)
{
    static const random_subject subjects[] = {
        {"angle", try_angle, 0x24552c34U, 0x32ee43c6U},
        {"modulation", try_modulation, 0x3f9fb973U, 0x03e77d72U},
        {"foc", try_foc, 0x5b274328U, 0xe2d0ab4cU},
        {"pi", try_pi, 0x9c475f64U, 0xb1f1788bU},
        {"memory", try_memory, 0x2d03223fU, 0xd98b4ef0U},
        {"pi_ilc", try_pi_ilc, 0x0b83e9ffU, 0xc2006fd7U},
        {"robust_ilc", try_robust_ilc, 0x476ec3d1U, 0x761e993bU},
        {"space_position", try_space_position, 0x353b0292U, 0xd97c7802U},
        {"space_speed", try_space_speed, 0xeb447b5cU, 0xf5ded3b1U},
        {"anti_cogging", try_anti_cogging, 0x0ca661c6U, 0x9ac35564U},
        {"pi_afc", try_pi_afc, 0x6e44a02dU, 0x497f64edU},
        {"zero_phase", try_zero_phase, 0xa150822aU, 0x9e6668c9U},
        {"trial", try_trial, 0x21fcec74U, 0x68eebc9bU},
        {"monitor", try_monitor, 0x203e3558U, 0xac5eaeb9U},
        {"quality", try_quality, 0xa29dc678U, 0x8fc9d407U},
        {"drive", try_drive, 0xaee59596U, 0x086996cfU},
        {"adrc", try_adrc, 0x6d05d906U, 0x0de23e25U},
        {"harmonic", try_harmonic, 0xf86c57b1U, 0x22244692U},
        {"any_config", try_any_config, 0x00000000U, 0x00000000U},
        {"trial_basis", try_trial_basis, 0xac857a4bU, 0x130f461fU},
    };
    try_subjects(subjects, sizeof subjects / sizeof subjects[0], configs);
}
