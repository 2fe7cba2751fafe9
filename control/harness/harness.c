#include "harness.h"

#include <stdlib.h>

#ifndef FENCE
#define FENCE 8U /* entries before and behind; 0 where a sanitizer sees every access beyond */
#endif

/* ---- the caller's memory ---- */

static struct {
    cgl_real *first;
    uint32_t length;
} lent[5];
static uint32_t loans;

cgl_real *borrow(uint32_t length)
{
    const size_t size = (length + 2U * FENCE) * sizeof(cgl_real);
    cgl_real *const first = malloc(size);
    CHECK(loans < sizeof lent / sizeof lent[0] && first != NULL);
    memset(first, 0xFF, size);
    lent[loans].first = first;
    lent[loans++].length = length;
    return first + FENCE;
}

static void check_fence(const cgl_real *fence)
{
    for (size_t n = 0; n < FENCE * sizeof *fence; ++n) {
        CHECK(((const unsigned char *)fence)[n] == 0xFFU);
    }
}

void check_fences(void)
{
    for (uint32_t n = 0; n < loans; ++n) {
        check_fence(lent[n].first);
        check_fence(lent[n].first + FENCE + lent[n].length);
    }
}

void give_back(void)
{
    check_fences();
    while (loans > 0U) {
        free(lent[--loans].first);
    }
}

void check_entries(const cgl_real *entry, uint32_t length, cgl_real limit)
{
    for (uint32_t n = 0; n < length; ++n) {
        CHECK(within(entry[n], limit));
    }
}

/* ---- what is checked ---- */

void hear_terms(const void *terms, size_t size)
{
    cgl_real term[8];
    CHECK(size <= sizeof term);
    memcpy(term, terms, size);
    hear_all(term, (uint32_t)(size / sizeof term[0]));
}

void check_sum(cgl_real output, cgl_real sum, cgl_real limit)
{
    const cgl_real wanted = cgl_clamped(sum, limit);
    CHECK(!(output < wanted) && !(output > wanted));
}

void check_zeros(const void *state, size_t first, size_t end)
{
    for (size_t n = first; n < end; ++n) {
        CHECK(((const char *)state)[n] == 0);
    }
}

void check_memory(const cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    const cgl_real *entry = memory->cell;
    if (config->kind == CGL_MEMORY_DELAY) {
        for (uint32_t n = 0; n < row; ++n, ++entry) {
            CHECK(*entry >= CGL_R(0.0) && *entry <= CGL_R(1.0)); /* an angle just below a period rounds up in float */
        }
    }
    for (uint32_t c = 0; c < config->channels; ++c, entry += row) {
        check_entries(entry, row, config->limit[c]);
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
}

/* A map that does not learn, or starts anew, stays; else it writes no more cells than it passed, and with a lead as many again
 * there. */
void check_writing(const cgl_memory *memory, const cgl_memory *old, const cgl_real *before)
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

/* ---- one law, from its init to its end ---- */

#define ENTRIES_MAX (4U * CGL_MEMORY_ROW(CELLS_MAX, CELLS_MAX / 2U) + CGL_HARMONIC_LENGTH(CGL_HARMONIC_ORDERS))

static cgl_loop loop = {.current_limit = CGL_REAL_MAX};
static cgl_real *cell;
static uint32_t cells;

const cgl_loop *any_loop(cgl_real ts)
{
    loop.ts = ts;
    return &loop;
}

bool begin_law(const law_harness *harness)
{
    const cgl_real ts = random_gain(CGL_R(1.0e-3));
    give_back();
    harness->draw(ts);
    cells = harness->length != NULL ? harness->length() : 0U;
    CHECK(cells <= ENTRIES_MAX);
    cell = borrow(cells);
    return harness->init(any_loop(ts), cell, cells) == CGL_OK;
}

static uint32_t learned_entries(const law_harness *harness)
{
    return harness->learned != NULL ? harness->learned() : 0U;
}

/* What a law says of its learning against what it wrote. */
static void check_learning(const law_harness *harness, const cgl_law_input *in, const cgl_law_output *out, const cgl_memory *old,
                           const cgl_real *before, uint32_t learned)
{
    const bool frozen = (out->status & (unsigned)CGL_STATUS_FROZEN) != 0U;
    const bool fault = (out->status & (unsigned)CGL_STATUS_FAULT) != 0U;
    CHECK(frozen || (!cgl_law_stands_by(in) && (in->forget || in->learn)));
    if (harness->memory != NULL) {
        CHECK(frozen == !harness->memory->learning && (frozen || in->forget || !fault)); /* to forget, no speed is needed */
        check_writing(harness->memory, old, before);
    } else if (learned == learned_entries(harness) && (cgl_law_stands_by(in) || (frozen && !in->forget))) {
        CHECK(memcmp(before, cell, learned * sizeof before[0]) == 0);
    }
}

void step_law(const law_harness *harness, const cgl_law_input *in, cgl_law_output *out)
{
    static cgl_real before[ENTRIES_MAX];
    static cgl_memory old;
    const uint32_t learned = learned_entries(harness);
    memcpy(before, cell, cells * sizeof before[0]);
    if (harness->memory != NULL) {
        old = *harness->memory;
    }
    harness->step(in, out);
    hear(out->i_q_ref);
    hear_bits(out->status);
    const unsigned off = (unsigned)CGL_STATUS_OFF | (unsigned)CGL_STATUS_FROZEN;
    CHECK(((out->status & (unsigned)CGL_STATUS_OFF) != 0U) == in->off);
    CHECK(!in->off || (within(out->i_q_ref, CGL_R(0.0)) && (out->status & off) == off));
    CHECK(within(out->i_q_ref, harness->limit()));
    check_learning(harness, in, out, &old, before, learned);
}

void reset_law(const law_harness *harness)
{
    harness->reset();
    harness->check_reset();
}

/* Whether a law has this config, with the defaults in place of zeros that a drawn one may have. */
static bool is_in_full(const cgl_memory_config *of_law, cgl_memory_config config)
{
    config.forgetting = cgl_or_default(config.forgetting, CGL_R(1.0));
    config.k_pp = cgl_or_default(config.k_pp, CGL_R(10.0));
    return memcmp(of_law, &config, sizeof config) == 0;
}

void retune_law(const law_harness *harness)
{
    unsigned char *const other = malloc(harness->config_size), *const old = malloc(harness->state_size);
    memcpy(other, harness->config, harness->config_size);
    memcpy(old, harness->state, harness->state_size);
    harness->change(other);
    if (harness->retune(other) == CGL_OK) {
        memcpy(harness->config, other, harness->config_size);
    } else {
        check_bytes(harness->state, old, 0U, harness->state_size);
    }
    CHECK(harness->memory == NULL || is_in_full(&harness->memory->config, *harness->memory_config));
    free(other);
    free(old);
}

/* A law that is retuned keeps the gentler step that the guard asks for. */
static void check_gentle(const law_harness *harness)
{
    cgl_law_input in = ordinary_input(0);
    cgl_law_output out;
    in.gentle = 3U;
    harness->step(&in, &out);
    const cgl_real gain = harness->memory->gain;
    CHECK(harness->retune(harness->config) == CGL_OK);
    harness->step(&in, &out);
    CHECK(within(harness->memory->gain - gain, CGL_R(0.0)));
}

/* What the guard asked for before a reset ends with the next step. */
static void settle(const law_harness *harness)
{
    const cgl_law_input in = ordinary_input(0);
    cgl_law_output out;
    if (harness->memory != NULL) {
        harness->step(&in, &out);
    }
}

static void check_new(const law_harness *harness, const unsigned char *state, const cgl_real *memory)
{
    memset(cell, 0xFF, cells * sizeof *cell);
    CHECK(harness->init(&loop, cell, cells) == CGL_OK);
    settle(harness);
    check_bytes(harness->state, state, 0U, harness->kept);
    check_bytes(harness->state, state, harness->kept_end, harness->state_size);
    CHECK(harness->keeps_learned || memcmp(cell, memory, cells * sizeof *cell) == 0);
}

/* A state that is reset, and one that is initialised again, is in every byte what init makes of zeros, and so is its memory. All are
 * static, so that their padding is 0. */
static void check_anew(const law_harness *harness)
{
    static cgl_real memory[ENTRIES_MAX];
    unsigned char *const used = malloc(harness->state_size), *const state = malloc(harness->state_size);
    memcpy(used, harness->state, harness->state_size);
    reset_law(harness);
    settle(harness);
    memcpy(state, harness->state, harness->state_size);
    memcpy(memory, cell, cells * sizeof *cell);
    memset(harness->state, 0, harness->state_size);
    check_new(harness, state, memory);
    memcpy(harness->state, used, harness->state_size);
    check_new(harness, state, memory);
    free(used);
    free(state);
}

void end_law(const law_harness *harness)
{
    hear_all(cell, cells);
    if (harness->memory != NULL) {
        check_memory(harness->memory);
        check_gentle(harness);
    }
    check_anew(harness);
    check_fences();
}

void spoil_law(const law_harness *harness)
{
    const cgl_real ts = random_gain(CGL_R(1.0e-3));
    const uint32_t length = random_below(CELLS_MAX);
    give_back();
    harness->draw(ts);
    harness->spoil(harness->config);
    if (harness->init(any_loop(ts), borrow(length), length) == CGL_OK) {
        CHECK(harness->length() <= length);
    }
    check_fences();
}

/* ---- configs ---- */

cgl_real gain_of_any_sign(cgl_real usual)
{
    return random_below(2) ? random_gain(usual) : -random_gain(usual);
}

cgl_pi_config random_pi(void)
{
    const cgl_pi_config config = {random_gain(CGL_R(1.0)), random_gain(CGL_R(10.0)), random_gain(CGL_R(5.0))};
    return config;
}

uint32_t random_count(uint32_t usual)
{
    return 1U + (random_below(4) ? random_below(usual) : random_below(65535));
}

cgl_memory_config random_memory(uint32_t channels)
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

cgl_memory_config another_memory(const cgl_memory_config *now)
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

uint32_t memory_length(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

/* ---- inputs ---- */

cgl_law_input ordinary_input(int step)
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

void next_input(cgl_law_input *in, int step)
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

void next_position_input(cgl_law_input *in, int step)
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
