#include "harness.h"

static cgl_space_position_config config;
static cgl_space_position law;

static void draw(cgl_real ts)
{
    (void)ts;
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
}

static void change(void *of)
{
    cgl_space_position_config *const other = of;
    other->k_omega = random_gain(CGL_R(5.0));
    other->mu_alpha = random_gain(CGL_R(250.0));
    other->ramp = random_below(2) ? config.ramp : random_gain(CGL_R(0.1));
    other->limit = random_gain(CGL_R(500.0));
    other->memory = another_memory(&config.memory);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_space_position_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_space_position_retune(&law, other); }
static void reset(void) { cgl_space_position_reset(&law); }
static uint32_t length(void) { return memory_length(&config.memory); }
static cgl_real limit(void) { return config.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_space_position_step(&law, in, out);
    const cgl_space_position_terms *const terms = &law.terms;
    hear_terms(terms, sizeof *terms);
    if (!cgl_law_stands_by(in)) {
        check_sum(out->i_q_ref, terms->proportional + terms->alpha + terms->beta + terms->h + terms->integral, config.limit);
    }
    CHECK(within(law.integral, config.limit));
}

static void check_reset(void)
{
    CHECK(!law.saturated);
    CHECK_ZEROS(space_position, &law, learning_samples, terms);
}

const law_harness harness_space_position = {HARNESS_BEGIN(space_position, 0x5babfaf8U, 0xaae708ddU), HARNESS_MEMORY,
                                            .input = next_position_input};
