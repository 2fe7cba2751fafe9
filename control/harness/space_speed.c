#include "harness.h"

static cgl_space_speed_config config;
static cgl_space_speed law;

static void draw(cgl_real ts)
{
    (void)ts;
    config.k = random_gain(CGL_R(5.0));
    config.mu_alpha = random_gain(CGL_R(250.0));
    config.mu_beta = random_gain(CGL_R(0.1));
    config.mu_h = random_gain(CGL_R(0.1));
    config.eta_bar = random_gain(CGL_R(3.0));
    config.omega_min = random_gain(CGL_R(1.0));
    config.limit = random_gain(CGL_R(500.0));
    config.ratio = random_count(50);
    config.memory = random_memory(1U + random_below(CGL_CHANNELS));
}

static void change(void *of)
{
    cgl_space_speed_config *const other = of;
    other->k = random_gain(CGL_R(5.0));
    other->mu_alpha = random_gain(CGL_R(250.0));
    other->limit = random_gain(CGL_R(500.0));
    other->memory = another_memory(&config.memory);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_space_speed_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_space_speed_retune(&law, other); }
static void reset(void) { cgl_space_speed_reset(&law); }
static uint32_t length(void) { return memory_length(&config.memory); }
static cgl_real limit(void) { return config.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_space_speed_step(&law, in, out);
    const cgl_space_speed_terms *const terms = &law.terms;
    hear_terms(terms, sizeof *terms);
    if (!cgl_law_stands_by(in)) {
        check_sum(out->i_q_ref, terms->proportional + terms->alpha + terms->beta + terms->h, config.limit);
    }
}

static void check_reset(void)
{
    CHECK(!law.saturated);
    CHECK_ZEROS(space_speed, &law, terms, terms);
}

const law_harness harness_space_speed = {HARNESS_BEGIN(space_speed, 0x940b4829U, 0x01936e16U), HARNESS_MEMORY,
                                         .input = next_position_input};
