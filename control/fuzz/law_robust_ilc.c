#include "cogless/robust_ilc.h"
#include "memories.h"

static cgl_robust_ilc_config config;
static cgl_robust_ilc law;
static cgl_real *cell;
static uint32_t length;

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
    config.memory = feed_memory(from);
    length = CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width);
    cell = borrow(length);
    const bool good = cgl_robust_ilc_init(&law, &config, ts, cell, length) == CGL_OK;
    length = good ? length : 0U;
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
    check_entries(cell, length, config.memory.limit);
    free(cell);
}

const cgl_real *law_learned(uint32_t *entries)
{
    *entries = config.memory.kind == CGL_MEMORY_ANGLE ? config.memory.cells : 0U;
    return cell;
}
