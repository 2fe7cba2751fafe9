#include "cogless/speed_pi.h"
#include "law.h"

static cgl_pi_config config;
static cgl_pi law;

bool law_begin(feed *from)
{
    config.kp = feed_gain(from, CGL_R(1.0));
    config.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.limit = feed_gain(from, CGL_R(5.0));
    return cgl_pi_init(&law, &config, fuzzed_loop(ts)) == CGL_OK;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_speed_pi_step(&law, in, out);
    HOLDS(within(law.integral, config.limit) && cgl_is_finite(law.proportional));
}

void law_reset(void) { cgl_pi_reset(&law); }
void law_other(feed *from) { (void)from; }
void law_end(void) {}
cgl_real law_limit(void) { return config.limit; }

const cgl_real *law_learned(uint32_t *length)
{
    *length = 0U;
    return &law.integral;
}
