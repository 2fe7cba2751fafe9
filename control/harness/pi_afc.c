#include "harness.h"

static cgl_pi_afc_config config;
static cgl_pi_afc law;

static void draw(cgl_real ts)
{
    (void)ts;
    config.pi = random_pi();
    config.orders = 1U + random_below(CGL_PI_AFC_ORDERS);
    uint32_t order = 0U;
    for (uint32_t k = 0; k < CGL_PI_AFC_ORDERS; ++k) {
        order += random_below(60) ? 1U + random_below(40) : random_word();
        config.order[k] = order;
    }
    config.gain = random_gain(CGL_R(10.0));
    config.lead = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-2));
    config.omega_min = random_gain(CGL_R(1.0));
    config.limit = random_gain(CGL_R(2.0));
}

static void change(void *of)
{
    cgl_pi_afc_config *const other = of;
    other->pi = random_pi();
    other->gain = random_gain(CGL_R(10.0));
    other->limit = random_gain(CGL_R(2.0));
    other->order[random_below(40) ? CGL_PI_AFC_ORDERS - 1U : 0U] += 1U;
}

static void spoil(void *of)
{
    cgl_pi_afc_config *const other = of;
    *(random_below(2) ? &other->orders : &other->order[random_below(CGL_PI_AFC_ORDERS)]) = random_word();
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_pi_afc_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_pi_afc_retune(&law, other); }
static void reset(void) { cgl_pi_afc_reset(&law); }
static uint32_t length(void) { return CGL_PI_AFC_LENGTH(config.orders); }
static uint32_t learned(void) { return 2U * config.orders; }
static cgl_real limit(void) { return config.pi.limit; }

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_afc_step(&law, in, out);
    hear(law.learned);
    CHECK(within(law.learned, config.limit));
    CHECK(within(law.pi.integral, config.pi.limit));
    const bool frozen = (out->status & (unsigned)CGL_STATUS_FROZEN) != 0U;
    CHECK(frozen == !law.learning && (frozen || (out->status & (unsigned)CGL_STATUS_FAULT) == 0U));
    const bool forgets = frozen && in->forget && !cgl_law_stands_by(in); /* to forget is to clear, although nothing is learned */
    check_entries(law.coefficient, learned(), forgets ? CGL_R(0.0) : config.limit);
    for (uint32_t k = 0; k < config.orders; ++k) {
        CHECK((uint32_t)law.coefficient[2U * config.orders + k] == config.order[k]);
    }
}

static void check_reset(void)
{
    CHECK_ZEROS(pi_afc, &law, learned, learning);
    check_entries(law.coefficient, learned(), CGL_R(0.0));
}

const law_harness harness_pi_afc = {HARNESS_BEGIN(pi_afc, 0x6384c5c4U, 0x8b79dbd1U), .length = length, .learned = learned, .spoil = spoil,
                                    .input = next_input};
