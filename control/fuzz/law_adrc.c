#include "cogless/adrc.h"
#include "law.h"

static cgl_adrc_config config;
static cgl_adrc law;

bool law_begin(feed *from)
{
    config.b = feed_gain(from, CGL_R(1.0e3));
    config.omega_c = feed_gain(from, CGL_R(100.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.omega_o = feed_gain(from, CGL_R(400.0));
    config.limit = feed_gain(from, CGL_R(5.0));
    return cgl_adrc_init(&law, &config, fuzzed_loop(ts)) == CGL_OK;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_adrc_step(&law, in, out);
    HOLDS(within(law.f, config.b * config.limit) && cgl_is_finite(law.omega) && cgl_is_finite(law.proportional));
}

void law_reset(void) { cgl_adrc_reset(&law); }
void law_other(feed *from) { (void)from; }
void law_end(void) {}
cgl_real law_limit(void) { return config.limit; }

const cgl_real *law_learned(uint32_t *length)
{
    *length = 0U;
    return &law.f;
}
