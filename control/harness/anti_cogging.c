#include "harness.h"

static cgl_anti_cogging_config config;
static cgl_anti_cogging law;

static void draw(cgl_real ts)
{
    (void)ts;
    config.pi = random_pi();
    config.cells = 4U + random_below(CELLS_MAX - 3U);
    config.speed = random_gain(CGL_R(100.0));
    config.revolutions = 1U + (random_below(2) ? 0U : random_below(100));
    config.position_gain = random_gain(CGL_R(20.0));
    config.lead = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-3));
}

static void change(void *of)
{
    cgl_anti_cogging_config *const other = of;
    other->pi = random_pi();
    other->lead = random_gain(CGL_R(1.0e-3));
    other->cells += random_below(8) ? 0U : 1U;
}

static void spoil(void *of)
{
    cgl_anti_cogging_config *const other = of;
    other->cells = random_word();
    other->revolutions = random_word();
    other->speed = random_real(CGL_R(1.0));
    other->position_gain = random_real(CGL_R(1.0));
    other->lead = random_real(CGL_R(1.0));
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    const cgl_error error = cgl_anti_cogging_init(&law, &config, loop, cell, entries);
    if (error == CGL_OK) { /* a reset keeps what a calibration left */
        check_entries(cell, config.cells, CGL_R(0.0));
        CHECK(within(law.friction, CGL_R(0.0)));
    }
    return error;
}

static cgl_error retune(const void *of)
{
    const cgl_anti_cogging_config *const other = of;
    const cgl_error error = cgl_anti_cogging_retune(&law, other);
    check_entries(law.table, config.cells, error == CGL_OK ? other->pi.limit : CGL_REAL_MAX);
    return error;
}

static void reset(void) { cgl_anti_cogging_reset(&law); }
static void call(void) { cgl_anti_cogging_calibrate(&law); }
static uint32_t length(void) { return config.cells; }
static cgl_real limit(void) { return config.pi.limit; }

/* The table is no learned map while it is recorded. */
static uint32_t learned(void) { return law.stage == CGL_ANTI_COGGING_RUN ? config.cells : 0U; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_anti_cogging_step(&law, in, out);
    hear(law.looked_up);
    hear(law.friction);
    CHECK(within(law.looked_up, config.pi.limit) && within(law.pi.integral, config.pi.limit));
    CHECK(within(law.friction, config.pi.limit));
    check_entries(law.table, learned(), config.pi.limit);
}

static void check_reset(void)
{
    CHECK(law.stage == CGL_ANTI_COGGING_RUN);
    CHECK_ZEROS(anti_cogging, &law, looked_up, looked_up);
    CHECK_ZEROS(anti_cogging, &law, place, started);
    check_entries(law.table, config.cells, config.pi.limit);
}

const law_harness harness_anti_cogging = {
    HARNESS_BEGIN(anti_cogging, 0x71ffee82U, 0x1e41acebU), .length = length, .learned = learned, .spoil = spoil, .call = call,
    .input = next_input, .steps = 1200, .keeps_learned = true,
    .kept = offsetof(cgl_anti_cogging, friction), .kept_end = offsetof(cgl_anti_cogging, place)};
