#include "cogless/trial_basis.h"

#include "harness.h"

static cgl_trial_config config;
static cgl_trial law;
static cgl_real *y_ref, *next_ref, *matrix[2];
static bool in_a_drive;

/* ---- configs ---- */

/* Coefficients whose roots lie inside the unit circle: any reflection coefficients below 1, stepped up. */
static void random_stable(cgl_real *a, uint32_t order)
{
    a[0] = CGL_R(1.0);
    for (uint32_t n = 1; n <= order; ++n) {
        cgl_real before[CGL_FEEDFORWARD_TAPS];
        memcpy(before, a, n * sizeof a[0]);
        const cgl_real k = cgl_clamp(gain_of_any_sign(CGL_R(1.0)), CGL_R(0.999));
        for (uint32_t i = 1; i < n; ++i) {
            a[i] = before[i] + k * before[n - i];
        }
        a[n] = k;
    }
}

static void draw_filter(cgl_zero_phase_config *filter)
{
    filter->order = random_below(3) ? random_below(CGL_ZERO_PHASE_ORDER + 1U) : 0U;
    filter->odd = random_below(2) != 0U;
    random_stable(filter->a, filter->order);
    for (uint32_t i = 0; i <= filter->order; ++i) {
        filter->b[i] = random_below(20) ? random_gain(CGL_R(1.0)) : random_real(CGL_R(1.0));
    }
}

static void draw_feedforward(cgl_feedforward_config *feedforward)
{
    feedforward->numerator = random_below(2) ? random_below(CGL_FEEDFORWARD_TAPS + 1U) : 0U;
    feedforward->denominator = 1U + random_below(4);
    feedforward->preview = random_below(4) ? random_below(8) : random_word();
    random_stable(feedforward->den, feedforward->denominator - 1U);
    for (uint32_t i = 0; i < feedforward->numerator; ++i) {
        feedforward->num[i] = random_below(20) ? random_gain(CGL_R(1.0)) : random_real(CGL_R(1.0));
    }
}

static void draw_observer(cgl_trial_config *other)
{
    other->observer.response = other->observer.pole = CGL_R(0.0);
    if (random_below(3) == 0U) {
        other->observer.response = random_gain(CGL_R(0.1));
        other->observer.pole = CGL_R(0.1) * (cgl_real)random_below(11);
        other->shift = 2U;
        other->k_2 = CGL_R(0.0);
    }
}

static const cgl_real *draw_matrix(cgl_real *entry)
{
    if (random_below(4) != 0U) {
        return NULL;
    }
    const uint32_t entries = config.samples * config.samples;
    for (uint32_t i = 0; i < entries; ++i) {
        entry[i] = CGL_R(0.01);
    }
    for (int n = 0; n < 16; ++n) { /* few, so that bytes are left for the trials */
        entry[random_below(entries)] = gain_of_any_sign(CGL_R(0.1));
    }
    return entry;
}

/* All but the sizes, by which memory is lent. What is not used is NaN. */
static void draw_rest(cgl_trial_config *other)
{
    for (uint32_t i = 0; i < other->states; ++i) {
        other->k_1[i] = gain_of_any_sign(CGL_R(1.0));
        other->c[i] = gain_of_any_sign(CGL_R(1.0));
    }
    other->k_2 = gain_of_any_sign(CGL_R(0.1));
    other->n = gain_of_any_sign(CGL_R(1.0));
    other->through_integrator = random_below(2) != 0U;
    other->k_3 = gain_of_any_sign(CGL_R(1.0));
    other->shift = 1U + (random_below(4) ? random_below(4) : random_below(32));
    draw_feedforward(&other->feedforward);
    other->filter_signal = random_below(2) != 0U;
    other->limit = random_gain(CGL_R(20.0));
    other->learned_limit = random_gain(CGL_R(5.0));
    draw_observer(other);
}

static void draw(cgl_real ts)
{
    (void)ts;
    memset(&config, 0xFF, sizeof config);
    config.samples = 2U + random_below(SAMPLES_MAX - 1U);
    config.states = random_below(4) ? 2U : 1U + random_below(CGL_TRIAL_STATES);
    config.unguarded = random_below(4) == 0U;
    draw_filter(&config.q_filter);
    draw_rest(&config);
    y_ref = borrow(config.samples);
    next_ref = borrow(config.samples);
    matrix[0] = borrow(config.samples * config.samples);
    matrix[1] = borrow(config.samples * config.samples);
    config.learning_matrix = draw_matrix(matrix[0]);
    in_a_drive = config.states == 2U;
}

static void change(void *of)
{
    cgl_trial_config *const other = of;
    draw_rest(other);
    other->learning_matrix = draw_matrix(matrix[config.learning_matrix == matrix[0] ? 1 : 0]);
    if (random_below(8) == 0U) {
        ++other->samples;
        other->learning_matrix = NULL; /* it has no entries for these */
    }
}

static void spoil(void *of)
{
    cgl_trial_config *const other = of;
    other->learning_matrix = NULL; /* its length is the caller's word */
    *(random_below(2) ? &other->samples : &other->shift) = random_word();
    *(random_below(2) ? &other->feedforward.numerator : &other->feedforward.denominator) = random_bits();
    *(random_below(2) ? &other->states : &other->q_filter.order) = random_word();
}

static cgl_error init(const cgl_loop *loop, cgl_real *cell, uint32_t entries)
{
    (void)loop;
    return cgl_trial_init(&law, &config, cell, entries);
}

static cgl_error retune(const void *other) { return cgl_trial_retune(&law, other); }
static cgl_real limit(void) { return config.limit; }
static uint32_t learned(void) { return config.samples; }

static uint32_t length(void)
{
    return CGL_TRIAL_LENGTH(config.samples, config.q_filter.order) - (config.unguarded ? config.samples : 0U);
}

static void reset(void)
{
    cgl_trial_reset(&law);
    hear_terms(&law.terms, sizeof law.terms);
}

static void check_reset(void)
{
    check_entries(law.learned, config.samples, CGL_R(0.0));
    CHECK(law.y_ref == NULL && !law.spoilt);
    CHECK_ZEROS(trial, &law, psi, psi);
    CHECK_ZEROS(trial, &law, v, theta);
    CHECK_ZEROS(trial, &law, sample, sample);
    CHECK_ZEROS(trial, &law, terms, terms);
}

/* ---- a step, with what it says checked against what it did ---- */

static void step_in_a_drive(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_trial_drive_step(&law, in, out);
    if (law.y_ref != NULL && (in->off || !in->learn || (out->status & (unsigned)CGL_STATUS_FAULT) != 0U)) {
        CHECK(law.spoilt || law.sample > config.samples);
    }
}

/* This face knows no drive, which may be off or in torque mode. */
static void step_alone(const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_trial_input x = {{in->theta_m, in->omega_m, in->theta_ref, in->omega_ref, in->alpha_ref, in->i_q, in->muted, in->i_q_ref},
                               in->learn};
    const cgl_trial before = law;
    cgl_trial_output u;
    cgl_trial_step(&law, &x, &u);
    hear(u.u);
    const cgl_trial_terms *const terms = &law.terms;
    check_sum(u.u, terms->feedback + terms->integral + terms->feedforward + terms->learned, config.limit);
    if ((u.status & (unsigned)CGL_STATUS_FAULT) != 0U || law.y_ref == NULL) {
        CHECK(within(u.u, CGL_R(0.0)));
        CHECK(memcmp(&before.psi, &law.psi, sizeof before.psi) == 0);
        CHECK((u.status & (unsigned)CGL_STATUS_FROZEN) != 0U);
        CHECK(law.spoilt || law.y_ref == NULL || before.sample >= config.samples);
    }
    out->i_q_ref = in->off ? CGL_R(0.0) : u.u;
    out->status = u.status | (cgl_law_stands_by(in) ? (unsigned)CGL_STATUS_FROZEN : 0U) | (in->off ? (unsigned)CGL_STATUS_OFF : 0U);
}

static void step(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_real v[SAMPLES_MAX];
    memcpy(v, law.learned, config.samples * sizeof v[0]);
    if (in_a_drive) {
        step_in_a_drive(in, out);
    } else {
        step_alone(in, out);
    }
    hear_terms(&law.terms, sizeof law.terms);
    CHECK(cgl_is_finite(law.psi) && cgl_is_finite(law.theta) && within(law.v, config.learned_limit));
    CHECK(cgl_is_finite(law.terms.feedback) && cgl_is_finite(law.terms.integral));
    CHECK(cgl_is_finite(law.terms.feedforward) && cgl_is_finite(law.terms.learned));
    CHECK(memcmp(v, law.learned, config.samples * sizeof v[0]) == 0);
}

/* ---- trials ---- */

static void begin_trial(bool some)
{
    in_a_drive = config.states == 2U && random_below(2) != 0U;
    cgl_trial_begin(&law, some ? y_ref : NULL);
}

static void end_trial(void)
{
    const bool whole = law.y_ref != NULL && law.sample >= config.samples && !law.spoilt;
    cgl_real v[SAMPLES_MAX];
    memcpy(v, law.learned, config.samples * sizeof v[0]);
    const bool learned_it = cgl_trial_end(&law);
    CHECK(learned_it == whole);
    CHECK(learned_it || memcmp(v, law.learned, config.samples * sizeof v[0]) == 0);
    check_entries(law.learned, config.samples, config.learned_limit);
    hear_all(law.learned, config.samples);
    CHECK(!cgl_trial_end(&law)); /* not twice */
}

static void call(void)
{
    if (random_below(2)) {
        end_trial();
        return;
    }
    for (uint32_t p = 0; p < config.samples; ++p) {
        next_ref[p] = p % 5U == 0U ? random_real(CGL_R(3.0)) : next_ref[p - 1U];
    }
    if (random_below(2)) {
        (void)cgl_trial_carry(&law, next_ref);
        check_entries(law.learned, config.samples, config.learned_limit);
    }
    cgl_real *const last_ref = y_ref;
    y_ref = next_ref;
    next_ref = last_ref;
    begin_trial(random_below(8) != 0U);
}

static cgl_law_input state_input(bool calm)
{
    cgl_real x[CGL_TRIAL_STATES];
    for (uint32_t i = 0; i < CGL_TRIAL_STATES; ++i) {
        x[i] = calm && i < config.states ? gain_of_any_sign(CGL_R(3.0)) : random_real(CGL_R(3.0));
    }
    const cgl_law_input in = {.theta_m = x[0], .omega_m = x[1], .theta_ref = x[2], .omega_ref = x[3], .alpha_ref = x[4], .i_q = x[5],
                              .muted = x[6], .i_q_ref = x[7], .learn = calm || random_below(8) != 0U};
    return in;
}

static void course(void)
{
    for (int trial = 0; trial < 8; ++trial) {
        const bool calm = random_below(4) != 0U;
        for (uint32_t p = 0; p < config.samples; ++p) {
            y_ref[p] = calm ? gain_of_any_sign(CGL_R(3.0)) : random_real(CGL_R(3.0));
        }
        if (random_below(8) != 0U) {
            begin_trial(random_below(16) != 0U);
        }
        const uint32_t steps = random_below(4) ? config.samples + random_below(3) * 20U : random_below(config.samples);
        for (uint32_t p = 0; p < steps; ++p) {
            cgl_law_input in = state_input(calm);
            cgl_law_output out;
            if (in_a_drive) {
                next_input(&in, (int)p);
            }
            step_law(&harness_trial, &in, &out);
        }
        if (random_below(16) == 0U) {
            reset_law(&harness_trial);
        }
        end_trial();
        if (random_below(4) == 0U) {
            retune_law(&harness_trial);
            check_entries(law.learned, config.samples, config.learned_limit);
            CHECK(within(law.v, config.learned_limit));
        }
    }
}

const law_harness harness_trial = {
    HARNESS_BEGIN(trial, 0x2a791371U, 0x17ac8ffbU), .length = length, .learned = learned, .spoil = spoil, .call = call, .course = course,
    .kept = offsetof(cgl_trial, guard.limited) + 1U, .kept_end = offsetof(cgl_trial, v)}; /* padding */
