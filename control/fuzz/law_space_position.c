#include "cogless/space_position.h"
#include "memories.h"

static cgl_space_position_config config;
static cgl_space_position law;
static cgl_real *cell;
static bool good;

bool law_begin(feed *from)
{
    config.ratio = feed_count(from, 50U);
    config.k_theta = feed_gain(from, CGL_R(50.0));
    config.k_omega = feed_gain(from, CGL_R(5.0));
    config.k_v = feed_gain(from, CGL_R(1.0));
    config.v_0 = feed_gain(from, CGL_R(1.0));
    config.v_2 = feed_gain(from, CGL_R(0.1));
    config.k_i = feed_gain(from, CGL_R(10.0));
    config.mu_alpha = feed_gain(from, CGL_R(250.0));
    config.mu_beta = feed_gain(from, CGL_R(0.1));
    config.mu_h = feed_gain(from, CGL_R(0.1));
    config.hand_over = feed_bool(from);
    config.ramp = feed_gain(from, CGL_R(0.1));
    config.omega_min = feed_gain(from, CGL_R(1.0));
    config.index = feed_bool(from) ? CGL_SPACE_BY_REFERENCE : CGL_SPACE_BY_ROTOR;
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.limit = feed_gain(from, CGL_R(5.0));
    config.memory = feed_memory(from, 1U + feed_below(from, CGL_CHANNELS));
    cell = borrow(memory_length(&config.memory));
    good = cgl_space_position_init(&law, &config, fuzzed_loop(ts), cell, memory_length(&config.memory)) == CGL_OK;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_space_position_step(&law, in, out);
    HOLDS(within(law.integral, config.limit));
}

void law_reset(void) { cgl_space_position_reset(&law); }
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
