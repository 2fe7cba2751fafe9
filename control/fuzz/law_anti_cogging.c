#include "cogless/anti_cogging.h"
#include "law.h"

static cgl_anti_cogging_config config;
static cgl_anti_cogging law;
static cgl_real *table;

bool law_begin(feed *from)
{
    config.pi.kp = feed_gain(from, CGL_R(1.0));
    config.pi.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.pi.limit = feed_gain(from, CGL_R(5.0));
    config.cells = 4U + feed_below(from, CELLS_MAX - 3U);
    config.speed = feed_gain(from, CGL_R(100.0));
    config.revolutions = 1U + (feed_bool(from) ? 0U : feed_below(from, 100U));
    config.position_gain = feed_gain(from, CGL_R(20.0));
    config.lead = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1.0e-3));
    table = borrow(config.cells);
    return cgl_anti_cogging_init(&law, &config, fuzzed_loop(ts), table, config.cells) == CGL_OK;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_anti_cogging_step(&law, in, out);
    HOLDS(within(law.looked_up, config.pi.limit) && within(law.pi.integral, config.pi.limit));
    if (law.stage == CGL_ANTI_COGGING_RUN) {
        check_entries(table, config.cells, config.pi.limit);
    }
}

void law_reset(void) { cgl_anti_cogging_reset(&law); }
cgl_real law_limit(void) { return config.pi.limit; }
void law_end(void) { free(table); }

void law_other(feed *from)
{
    if (feed_bool(from)) {
        cgl_anti_cogging_calibrate(&law);
    }
}

/* The table is no learned map while it is recorded. */
const cgl_real *law_learned(uint32_t *entries)
{
    *entries = law.stage == CGL_ANTI_COGGING_RUN ? config.cells : 0U;
    return table;
}
