#include "cogless/pi_ilc.h"
#include "memories.h"

static cgl_pi_ilc_config config;
static cgl_pi_ilc law;
static cgl_real *cell;
static uint32_t length;

bool law_begin(feed *from)
{
    config.pi.kp = feed_gain(from, CGL_R(1.0));
    config.pi.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.pi.limit = feed_gain(from, CGL_R(5.0));
    config.gain = feed_gain(from, CGL_R(0.1));
    config.memory = feed_memory(from);
    length = CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width);
    cell = borrow(length);
    const bool good = cgl_pi_ilc_init(&law, &config, ts, cell, length) == CGL_OK;
    length = good ? length : 0U;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_ilc_step(&law, in, out);
    HOLDS(within(law.pi.integral, config.pi.limit) && within(law.learned, config.memory.limit));
}

void law_reset(void) { cgl_pi_ilc_reset(&law); }
void law_other(feed *from) { (void)from; }
cgl_real law_limit(void) { return config.pi.limit; }

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
