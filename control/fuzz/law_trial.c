#include "cogless/trial.h"
#include "cogless/trial_basis.h"
#include "law.h"

static cgl_trial_config config;
static cgl_trial law;
static cgl_real *memory, *y_ref, *next_ref, *matrix;
static bool good;

static cgl_real feed_signed(feed *from, cgl_real usual)
{
    const cgl_real x = feed_gain(from, usual);
    return feed_bool(from) ? x : -x;
}

/* Stable: reflection coefficients below 1, stepped up. */
static void feed_stable(feed *from, cgl_real *a, uint32_t order)
{
    a[0] = CGL_R(1.0);
    for (uint32_t n = 1; n <= order; ++n) {
        cgl_real before[CGL_FEEDFORWARD_TAPS];
        memcpy(before, a, n * sizeof a[0]);
        const cgl_real k = cgl_clamp(feed_real(from, CGL_R(1.0)), CGL_R(0.999));
        for (uint32_t i = 1; i < n; ++i) {
            a[i] = before[i] + k * before[n - i];
        }
        a[n] = k;
    }
}

bool law_begin(feed *from)
{
    memset(&config, 0, sizeof config);
    config.samples = 2U + feed_below(from, CELLS_MAX - 1U);
    config.states = feed_below(from, 8U) ? 2U : 1U + feed_below(from, CGL_TRIAL_STATES);
    for (uint32_t i = 0; i < config.states; ++i) {
        config.k_1[i] = feed_signed(from, CGL_R(1.0));
        config.c[i] = feed_signed(from, CGL_R(1.0));
    }
    config.k_2 = feed_signed(from, CGL_R(0.1));
    config.n = feed_signed(from, CGL_R(1.0));
    config.through_integrator = feed_bool(from);
    config.k_3 = feed_signed(from, CGL_R(1.0));
    config.shift = 1U + feed_below(from, 4U);
    config.feedforward.numerator = feed_bool(from) ? 0U : feed_below(from, 6U);
    config.feedforward.denominator = 1U + feed_below(from, 4U);
    config.feedforward.preview = feed_below(from, 8U);
    for (uint32_t i = 0; i < config.feedforward.numerator; ++i) {
        config.feedforward.num[i] = feed_signed(from, CGL_R(1.0));
    }
    feed_stable(from, config.feedforward.den, config.feedforward.denominator - 1U);
    config.q_filter.order = feed_bool(from) ? 0U : feed_below(from, CGL_ZERO_PHASE_ORDER + 1U);
    config.q_filter.odd = feed_bool(from);
    feed_stable(from, config.q_filter.a, config.q_filter.order);
    for (uint32_t i = 0; i <= config.q_filter.order; ++i) {
        config.q_filter.b[i] = feed_signed(from, CGL_R(1.0));
    }
    config.filter_signal = feed_bool(from);
    if (feed_below(from, 3U) == 0U) {
        config.observer.response = feed_gain(from, CGL_R(0.1));
        config.observer.pole = CGL_R(0.1) * (cgl_real)feed_below(from, 10U);
        config.shift = 2U;
        config.k_2 = CGL_R(0.0);
    }
    config.limit = feed_gain(from, CGL_R(5.0));
    config.learned_limit = feed_gain(from, CGL_R(5.0));
    config.unguarded = feed_bool(from);
    const uint32_t length = CGL_TRIAL_LENGTH(config.samples, config.q_filter.order) - (config.unguarded ? config.samples : 0U);
    memory = borrow(length);
    y_ref = borrow(config.samples);
    next_ref = borrow(config.samples);
    matrix = 0;
    if (feed_below(from, 8U) == 0U) {
        matrix = borrow(config.samples * config.samples);
        for (uint32_t i = 0; i < config.samples * config.samples; ++i) {
            matrix[i] = i % 7U == 0U ? feed_signed(from, CGL_R(0.1)) : CGL_R(0.01);
        }
    }
    config.learning_matrix = matrix;
    good = cgl_trial_init(&law, &config, memory, length) == CGL_OK;
    return good;
}

void law_step(const cgl_law_input *in, cgl_law_output *out)
{
    if (config.states == 2U) {
        cgl_trial_drive_step(&law, in, out);
    } else {
        cgl_trial_input x = {{in->theta_m, in->omega_m, in->theta_ref, in->omega_ref, in->i_q}, in->learn};
        cgl_trial_output u;
        cgl_trial_step(&law, &x, &u);
        out->i_q_ref = in->off ? CGL_R(0.0) : u.u;
        /* the face without an angle knows no torque mode: what the drive's would say */
        out->status = u.status | (in->torque ? (unsigned)CGL_STATUS_FROZEN : 0U);
        HOLDS(within(u.u, config.limit));
    }
    HOLDS(cgl_is_finite(law.psi) && within(law.v, config.learned_limit));
    HOLDS(cgl_is_finite(law.theta));
}

void law_reset(void) { cgl_trial_reset(&law); }
cgl_real law_limit(void) { return config.limit; }

void law_other(feed *from)
{
    if (feed_bool(from)) {
        (void)cgl_trial_end(&law);
        check_entries(memory, config.samples, config.learned_limit);
        return;
    }
    for (uint32_t p = 0; p < config.samples; ++p) {
        next_ref[p] = p % 5U == 0U ? feed_real(from, CGL_R(3.0)) : (p > 0U ? next_ref[p - 1U] : CGL_R(0.0));
    }
    if (feed_bool(from)) {
        (void)cgl_trial_carry(&law, next_ref);
        check_entries(memory, config.samples, config.learned_limit);
    }
    cgl_real *const last_ref = y_ref;
    y_ref = next_ref;
    next_ref = last_ref;
    cgl_trial_begin(&law, feed_below(from, 8U) ? y_ref : 0);
}

void law_end(void)
{
    if (good) {
        check_entries(memory, config.samples, config.learned_limit);
    }
    free(memory);
    free(y_ref);
    free(next_ref);
    free(matrix);
}

/* A step never changes what was learned. */
const cgl_real *law_learned(uint32_t *entries)
{
    *entries = config.samples;
    return memory;
}
