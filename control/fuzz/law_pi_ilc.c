#include "cogless/pi_ilc.h"
#include "memories.h"

static cgl_pi_ilc_config config;
static cgl_pi_ilc law;
static cgl_real *cell;
static bool good;

bool law_begin(feed *from)
{
    config.pi.kp = feed_gain(from, CGL_R(1.0));
    config.pi.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.pi.limit = feed_gain(from, CGL_R(5.0));
    config.gain = feed_gain(from, CGL_R(0.1));
    config.memory = feed_memory(from, 1U);
    cell = borrow(memory_length(&config.memory));
    good = cgl_pi_ilc_init(&law, &config, fuzzed_loop(ts), cell, memory_length(&config.memory)) == CGL_OK;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_ilc_step(&law, in, out);
    HOLDS(within(law.pi.integral, config.pi.limit) && within(law.learned, config.memory.limit[0]));
}

void law_reset(void) { cgl_pi_ilc_reset(&law); }
void law_other(feed *from) { (void)from; }
cgl_real law_limit(void) { return config.pi.limit; }

void law_end(void)
{
    if (good) {
        check_memory(&law.memory);
    }
    free(cell);
}

const cgl_real *law_learned(uint32_t *entries) { return map_of(&law.memory, entries); }
