#include "cogless/space_speed.h"
#include "memories.h"

static cgl_space_speed_config config;
static cgl_space_speed law;
static cgl_real *cell;
static bool good;

bool law_begin(feed *from)
{
    config.k = feed_gain(from, CGL_R(5.0));
    config.mu_alpha = feed_gain(from, CGL_R(250.0));
    config.mu_beta = feed_gain(from, CGL_R(0.1));
    config.mu_h = feed_gain(from, CGL_R(0.1));
    config.eta_bar = feed_gain(from, CGL_R(30.0));
    config.omega_min = feed_gain(from, CGL_R(1.0));
    config.limit = feed_gain(from, CGL_R(5.0));
    config.ratio = feed_count(from, 50U);
    config.memory = feed_memory(from, 1U + feed_below(from, CGL_CHANNELS));
    cell = borrow(memory_length(&config.memory));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    good = cgl_space_speed_init(&law, &config, fuzzed_loop(ts), cell, memory_length(&config.memory)) == CGL_OK;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out) { cgl_space_speed_step(&law, in, out); }
void law_reset(void) { cgl_space_speed_reset(&law); }
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
