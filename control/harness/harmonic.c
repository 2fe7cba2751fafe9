#include "harness.h"

static cgl_harmonic_config config;
static cgl_harmonic law;

static cgl_harmonic_config random_harmonic(void)
{
    cgl_harmonic_config other;
    other.pi = random_pi();
    other.k_theta = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(50.0));
    other.b = random_gain(CGL_R(1000.0));
    other.delay = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(2.0e-3));
    other.step = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0e-2));
    other.base = 1U + random_below(random_below(20) ? 40U : CGL_HARMONIC_ORDER_MAX);
    other.bends = random_below(3);
    other.orders = 1U + random_below(random_below(4) ? 8U : CGL_HARMONIC_ORDERS);
    other.fast = random_below(other.orders + 1U);
    other.rate = random_gain(CGL_R(10.0));
    other.rate_min = random_gain(CGL_R(1.0));
    other.limit = random_gain(CGL_R(2.0));
    for (uint32_t n = 0; n < CGL_HARMONIC_EDGES; ++n) {
        other.held[n] = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(1.0));
    }
    return other;
}

static void draw(cgl_real ts)
{
    (void)ts;
    config = random_harmonic();
}

static void change(void *of)
{
    cgl_harmonic_config *const other = of;
    *other = random_harmonic();
    other->base = config.base;
    other->orders = config.orders + (random_below(40) == 0U ? 1U : 0U);
    other->fast = random_below(config.orders + 1U);
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    return cgl_harmonic_init(&law, &config, loop, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_harmonic_retune(&law, other); }
static void reset(void) { cgl_harmonic_reset(&law); }
static uint32_t length(void) { return CGL_HARMONIC_LENGTH(config.orders); }
static uint32_t learned(void) { return 2U * config.orders; }
static cgl_real limit(void) { return config.pi.limit; }

/* It only learns after some time without a fault. */
static void input(cgl_law_input *in, int step)
{
    static bool calm;
    next_input(in, step);
    calm = step % 200 != 0 ? calm : random_below(2) != 0U;
    if (calm) {
        *in = ordinary_input(step);
        in->forget = random_below(400) == 0U;
        in->off = random_below(400) == 0U;
    }
}

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_real since_edge = law.since_edge;
    cgl_harmonic_step(&law, in, out);
    const cgl_real state[] = {law.learned, law.rate, law.time, law.slowest, law.omega, law.load};
    hear_all(state, sizeof state / sizeof state[0]);
    hear_terms(law.bend.part, sizeof law.bend.part);
    CHECK(within(law.learned, config.limit));
    CHECK(within(law.pi.integral, config.pi.limit));
    CHECK(within(law.since_edge, law.half_step) || law.since_edge == since_edge); /* a retune may have made the half step smaller */
    CHECK(law.bend.share >= CGL_R(0.0) && law.bend.share <= CGL_R(1.0));
    for (uint32_t n = 0; n < 4U; ++n) {
        CHECK(within(law.bend.part[n], CGL_R(0.05)));
    }
    CHECK(law.acting <= config.orders && law.low <= law.acting && law.next_gain <= config.orders);
    const bool frozen = (out->status & (unsigned)CGL_STATUS_FROZEN) != 0U;
    CHECK(frozen == !law.learning && (frozen || (out->status & (unsigned)CGL_STATUS_FAULT) == 0U));
    const bool forgets = frozen && in->forget && !cgl_law_stands_by(in);
    check_entries(law.cosine, learned(), forgets ? CGL_R(0.0) : config.limit);
    for (uint32_t k = 0; k < config.orders; ++k) {
        CHECK((uint32_t)law.cosine[2U * config.orders + k] == config.base * (k + 1U));
    }
}

static void check_reset(void)
{
    CHECK_ZEROS(harmonic, &law, pending, theta_sensor);
    CHECK_ZEROS(harmonic, &law, since_edge, drift);
    CHECK_ZEROS(harmonic, &law, last_load, bend);
    CHECK_ZEROS(harmonic, &law, next_gain, low);
    CHECK_ZEROS(harmonic, &law, follows, learned);
    check_entries(law.cosine, learned(), CGL_R(0.0));
}

const law_harness harness_harmonic = {HARNESS_BEGIN(harmonic, 0x61e4fba4U, 0xdfc288b8U), .length = length, .learned = learned,
                                      .input = input};
