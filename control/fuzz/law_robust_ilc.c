#include "cogless/robust_ilc.h"
#include "memories.h"

static cgl_robust_ilc_config config;
static cgl_robust_ilc law;
static cgl_real *cell;
static bool good;

bool law_begin(feed *from)
{
    config.b = feed_gain(from, CGL_R(500.0));
    config.c = feed_gain(from, CGL_R(10.0));
    config.g = feed_gain(from, CGL_R(60.0));
    config.eta = feed_gain(from, CGL_R(200.0));
    config.q = feed_gain(from, CGL_R(0.3));
    config.beta_1 = feed_gain(from, CGL_R(1.0));
    config.beta_2 = feed_gain(from, CGL_R(1.0));
    config.gamma = feed_gain(from, CGL_R(5.0));
    config.viscous = feed_real(from, CGL_R(1.0));
    config.coulomb = feed_real(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.limit = feed_gain(from, CGL_R(5.0));
    config.memory = feed_memory(from, 1U);
    cell = borrow(memory_length(&config.memory));
    good = cgl_robust_ilc_init(&law, &config, fuzzed_loop(ts), cell, memory_length(&config.memory)) == CGL_OK;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_robust_ilc_step(&law, in, out);
    HOLDS(within(law.error_integral, CGL_R(1.0e9)) && within(law.adapted, config.b * config.limit));
}

void law_reset(void) { cgl_robust_ilc_reset(&law); }
void law_other(feed *from) { (void)from; }
cgl_real law_limit(void) { return config.limit; }

void law_end(void)
{
    if (good) {
        check_memory(&law.memory);
    }
    free(cell);
}

const cgl_real *law_learned(uint32_t *entries) { return map_of(&law.memory, entries); }
