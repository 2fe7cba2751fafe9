#include "harness.h"

static cgl_pi_ilc_config config;
static cgl_pi_ilc law;

static void draw(cgl_real ts)
{
    (void)ts;
    config.pi = random_pi();
    config.gain = random_below(8) ? random_gain(CGL_R(0.1)) : CGL_R(0.0);
    config.memory = random_memory(1U);
}

static void change(void *of)
{
    cgl_pi_ilc_config *const other = of;
    other->pi = random_pi();
    other->gain = random_below(8) ? random_gain(CGL_R(0.1)) : CGL_R(0.0);
    other->memory = another_memory(&config.memory);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_pi_ilc_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_pi_ilc_retune(&law, other); }
static void reset(void) { cgl_pi_ilc_reset(&law); }
static uint32_t length(void) { return memory_length(&config.memory); }
static cgl_real limit(void) { return config.pi.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_ilc_step(&law, in, out);
    hear(law.learned);
    CHECK(within(law.learned, config.memory.limit[0]));
    CHECK(within(law.pi.integral, config.pi.limit));
}

static void check_reset(void) { CHECK(within(law.learned, CGL_R(0.0))); }

const law_harness harness_pi_ilc = {HARNESS_BEGIN(pi_ilc, 0x75ebf1aeU, 0x34ce6723U), HARNESS_MEMORY, .input = next_input};
