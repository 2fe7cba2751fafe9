#include "cogless/pi_afc.h"
#include "law.h"

static cgl_pi_afc_config config;
static cgl_pi_afc law;
static cgl_real *coefficient;

bool law_begin(feed *from)
{
    config.pi.kp = feed_gain(from, CGL_R(1.0));
    config.pi.ki = feed_gain(from, CGL_R(10.0));
    const cgl_real ts = feed_gain(from, CGL_R(1.0e-3));
    config.pi.limit = feed_gain(from, CGL_R(5.0));
    config.orders = 1U + feed_below(from, CGL_PI_AFC_ORDERS);
    uint32_t order = 0U;
    for (uint32_t k = 0; k < CGL_PI_AFC_ORDERS; ++k) {
        order += 1U + (feed_bool(from) ? feed_below(from, 40U) : feed_below(from, CGL_PI_AFC_ORDER_MAX));
        config.order[k] = order;
    }
    config.gain = feed_gain(from, CGL_R(10.0));
    config.lead = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1.0e-2));
    config.omega_min = feed_gain(from, CGL_R(1.0));
    config.limit = feed_gain(from, CGL_R(2.0));
    const uint32_t length = CGL_PI_AFC_LENGTH(config.orders);
    coefficient = borrow(length);
    const bool good = cgl_pi_afc_init(&law, &config, fuzzed_loop(ts), coefficient, length) == CGL_OK;
    config.orders = good ? config.orders : 0U;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_afc_step(&law, in, out);
    HOLDS(within(law.pi.integral, config.pi.limit) && within(law.learned, config.limit));
}

void law_reset(void) { cgl_pi_afc_reset(&law); }
void law_other(feed *from) { (void)from; }
cgl_real law_limit(void) { return config.pi.limit; }

void law_end(void)
{
    check_entries(coefficient, 2U * config.orders, config.limit);
    for (uint32_t k = 0; k < config.orders; ++k) {
        HOLDS((uint32_t)coefficient[2U * config.orders + k] == config.order[k]);
    }
    free(coefficient);
}

const cgl_real *law_learned(uint32_t *entries)
{
    *entries = 2U * config.orders;
    return coefficient;
}
