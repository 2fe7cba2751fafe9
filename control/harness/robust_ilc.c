#include "harness.h"

static cgl_robust_ilc_config config;
static cgl_robust_ilc law;

static void draw(cgl_real ts)
{
    (void)ts;
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
}

static void change(void *of)
{
    cgl_robust_ilc_config *const other = of;
    other->c = random_gain(CGL_R(10.0));
    other->beta_2 = random_gain(CGL_R(1.0));
    other->limit = random_gain(CGL_R(5.0));
    other->memory = another_memory(&config.memory);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_robust_ilc_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_robust_ilc_retune(&law, other); }
static void reset(void) { cgl_robust_ilc_reset(&law); }
static uint32_t length(void) { return memory_length(&config.memory); }
static cgl_real limit(void) { return config.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_robust_ilc_step(&law, in, out);
    const cgl_robust_ilc_terms *const terms = &law.terms;
    hear_terms(terms, sizeof *terms);
    if (!cgl_law_stands_by(in)) {
        check_sum(out->i_q_ref, terms->surface + terms->switching + terms->linear + terms->learned + terms->adapted, config.limit);
    }
    CHECK(within(law.error_integral, CGL_R(1.0e9)));
    CHECK(within(law.adapted, config.gamma > CGL_R(0.0) ? config.b * config.limit : CGL_R(0.0)));
}

static void check_reset(void)
{
    CHECK(!law.started && !law.saturated);
    CHECK_ZEROS(robust_ilc, &law, error_integral, terms);
}

const law_harness harness_robust_ilc = {HARNESS_BEGIN(robust_ilc, 0x8c1cd705U, 0xa4574f60U), HARNESS_MEMORY, .input = next_input};
