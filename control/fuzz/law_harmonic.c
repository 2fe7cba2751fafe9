#include "cogless/harmonic.h"
#include "law.h"

static cgl_harmonic_config config;
static cgl_harmonic law;
static cgl_real *cell;

bool law_begin(feed *from)
{
    config.pi.kp = feed_gain(from, CGL_R(1.0));
    config.pi.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.pi.limit = feed_gain(from, CGL_R(5.0));
    config.k_theta = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(50.0));
    config.b = feed_gain(from, CGL_R(1000.0));
    config.delay = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(2.0e-3));
    config.step = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1.0e-2));
    config.base = 1U + (feed_bool(from) ? feed_below(from, 40U) : feed_below(from, CGL_HARMONIC_ORDER_MAX));
    config.bends = feed_below(from, 3U);
    config.orders = 1U + feed_below(from, feed_bool(from) ? 8U : CGL_HARMONIC_ORDERS);
    config.fast = feed_below(from, config.orders + 1U);
    config.rate = feed_gain(from, CGL_R(10.0));
    config.rate_min = feed_gain(from, CGL_R(1.0));
    config.limit = feed_gain(from, CGL_R(2.0));
    for (uint32_t n = 0; n < CGL_HARMONIC_EDGES; ++n) {
        config.held[n] = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1.0));
    }
    const uint32_t length = CGL_HARMONIC_LENGTH(config.orders);
    cell = borrow(length);
    const bool good = cgl_harmonic_init(&law, &config, fuzzed_loop(ts), cell, length) == CGL_OK;
    config.orders = good ? config.orders : 0U;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_harmonic_step(&law, in, out);
    HOLDS(within(law.pi.integral, config.pi.limit) && within(law.learned, config.limit));
    HOLDS(within(law.since_edge, law.half_step));
    HOLDS(law.bend.share >= CGL_R(0.0) && law.bend.share <= CGL_R(1.0));
    for (uint32_t n = 0; n < 4U; ++n) {
        HOLDS(within(law.bend.part[n], CGL_R(0.05)));
    }
    HOLDS(law.acting <= config.orders && law.low <= law.acting && law.next_gain <= config.orders);
}

void law_reset(void) { cgl_harmonic_reset(&law); }
void law_other(feed *from) { (void)from; }
cgl_real law_limit(void) { return config.pi.limit; }

void law_end(void)
{
    check_entries(cell, 2U * config.orders, config.limit);
    for (uint32_t k = 0; k < config.orders; ++k) {
        HOLDS((uint32_t)cell[2U * config.orders + k] == config.base * (k + 1U));
    }
    free(cell);
}

const cgl_real *law_learned(uint32_t *entries)
{
    *entries = 2U * config.orders;
    return cell;
}
