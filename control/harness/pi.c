#include "harness.h"

static cgl_pi_config config;
static cgl_pi law;

static void draw(cgl_real ts)
{
    (void)ts;
    config = random_pi();
}

static void change(void *other) { *(cgl_pi_config *)other = random_pi(); }

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    (void)cell;
    (void)entries;
    return cgl_pi_init(&law, &config, loop);
}

static cgl_error retune(const void *other) { return cgl_pi_retune(&law, other); }
static void reset(void) { cgl_pi_reset(&law); }
static cgl_real limit(void) { return config.limit; }

/* As a scalar, too. */
static void step(const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_real error = random_real(CGL_R(10.0)), feedforward = random_real(CGL_R(1.0));
    const cgl_real output = cgl_pi_step(&law, error, feedforward);
    hear(output);
    hear(law.proportional);
    hear(law.integral);
    CHECK(within(output, config.limit));
    CHECK(within(law.integral, config.limit));
    cgl_speed_pi_step(&law, in, out);
    hear(law.proportional);
    CHECK(within(law.integral, config.limit) && cgl_is_finite(law.proportional));
}

static void check_reset(void)
{
    CHECK(!law.saturated);
    CHECK_ZEROS(pi, &law, integral, proportional);
}

const law_harness harness_pi = {HARNESS_BEGIN(pi, 0xf47399beU, 0x21f2491cU), .input = next_input};
