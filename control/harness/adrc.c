#include "harness.h"

static cgl_adrc_config config;
static cgl_adrc law;
static cgl_real period;

static void change(void *other)
{
    const cgl_adrc_config drawn = {random_gain(CGL_R(1000.0)), random_gain(CGL_R(100.0)), random_gain(CGL_R(0.5) / period),
                                   random_gain(CGL_R(5.0))};
    *(cgl_adrc_config *)other = drawn;
}

static void draw(cgl_real ts)
{
    period = ts;
    change(&config);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    (void)cell;
    (void)entries;
    return cgl_adrc_init(&law, &config, loop);
}

static cgl_error retune(const void *other) { return cgl_adrc_retune(&law, other); }
static void reset(void) { cgl_adrc_reset(&law); }
static cgl_real limit(void) { return config.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_adrc_step(&law, in, out);
    hear(law.f);
    hear(law.proportional);
    hear(law.rejected);
    CHECK(within(law.f, config.b * config.limit) && cgl_is_finite(law.omega) && cgl_is_finite(law.proportional));
}

static void check_reset(void)
{
    CHECK(!law.started);
    CHECK(within(law.omega, CGL_R(0.0)) && within(law.f, CGL_R(0.0)));
    CHECK_ZEROS(adrc, &law, before, rejected);
}

const law_harness harness_adrc = {HARNESS_BEGIN(adrc, 0xea866e0bU, 0x31a552e4U), .input = next_input};
