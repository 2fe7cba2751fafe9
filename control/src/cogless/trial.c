#include "trial.h"

#include "angle.h"

#define SAMPLES_MAX 16777216U

static const cgl_trial_terms no_terms = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};

CGL_SELDOM static bool all_finite(const cgl_real *x, uint32_t count)
{
    for (uint32_t i = 0; i < count; ++i) {
        if (!cgl_is_finite(x[i])) {
            return false;
        }
    }
    return true;
}

static bool is_finite_matrix(const cgl_real *row, uint32_t samples)
{
    for (uint32_t p = 0; p < samples; ++p, row += samples) {
        if (!all_finite(row, samples)) {
            return false;
        }
    }
    return true;
}

CGL_SELDOM static bool is_valid_observer(const cgl_trial_config *config)
{
    const bool none = config->observer.response == CGL_R(0.0);
    return cgl_trial_observer_init(&config->observer, config->limit) == CGL_OK
           && (none || (config->shift == 2U && config->k_2 == CGL_R(0.0)));
}

CGL_SELDOM static bool is_valid(const cgl_trial_config *config)
{
    cgl_feedforward unused;
    return config->samples >= 2U && config->samples <= SAMPLES_MAX && config->states >= 1U
           && config->states <= CGL_TRIAL_STATES && all_finite(config->k_1, config->states)
           && all_finite(config->c, config->states) && cgl_is_finite(config->k_2) && cgl_is_finite(config->n)
           && cgl_is_finite(config->k_3) && config->shift >= 1U && config->shift < config->samples
           && cgl_is_positive(config->limit)
           && cgl_is_positive(config->learned_limit) && cgl_is_finite(config->n * config->learned_limit)
           && cgl_feedforward_init(&config->feedforward, &unused) == CGL_OK
           && cgl_zero_phase_init(&config->q_filter, config->samples) == CGL_OK && is_valid_observer(config)
           && (config->learning_matrix == 0 || is_finite_matrix(config->learning_matrix, config->samples));
}

/* Number of entries in the caller's memory. */
static uint32_t entries(const cgl_trial_config *config)
{
    return CGL_TRIAL_LENGTH(config->samples, config->q_filter.order) - (config->unguarded ? config->samples : 0U);
}

/* The guard's best v, the last part of the caller's memory. */
static cgl_real *best_v(const cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    return law->error + config->samples + CGL_ZERO_PHASE_TAIL(config->samples, config->q_filter.order);
}

/* Whether the law has a guard. A law that does not learn needs none. */
static bool is_guarded(const cgl_trial_config *config)
{
    return !config->unguarded && (config->k_3 != CGL_R(0.0) || config->learning_matrix != 0);
}

cgl_error cgl_trial_init(cgl_trial *law, const cgl_trial_config *config, cgl_real *memory, uint32_t length)
{
    if (!is_valid(config)) {
        return CGL_ERROR_CONFIG;
    }
    if (memory == 0 || length < entries(config)) {
        return CGL_ERROR_MEMORY;
    }
    law->config = *config;
    law->learned = memory;
    law->error = memory + config->samples;
    cgl_trial_reset(law);
    return CGL_OK;
}

cgl_error cgl_trial_retune(cgl_trial *law, const cgl_trial_config *config)
{
    if (!(is_valid(config) && config->samples == law->config.samples && config->states == law->config.states
          && config->q_filter.order == law->config.q_filter.order && config->unguarded == law->config.unguarded)) {
        return CGL_ERROR_CONFIG;
    }
    law->config = *config;
    for (uint32_t p = 0; p < config->samples; ++p) {
        law->learned[p] = cgl_clamped(law->learned[p], config->learned_limit);
    }
    law->v = cgl_clamped(law->v, config->learned_limit);
    cgl_trial_guard_reset(&law->guard);
    return CGL_OK;
}

void cgl_trial_reset(cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    for (uint32_t p = 0, count = entries(config); p < count; ++p) {
        law->learned[p] = CGL_R(0.0);
    }
    cgl_trial_guard_reset(&law->guard);
    cgl_trial_begin(law, 0);
}

CGL_SELDOM void cgl_trial_begin(cgl_trial *law, const cgl_real *y_ref)
{
    const cgl_trial_config *const config = &law->config;
    law->y_ref = y_ref;
    law->psi = law->v = CGL_R(0.0);
    cgl_trial_observer_reset(&law->observer);
    law->theta = y_ref != 0 ? cgl_clamped(y_ref[0], CGL_REAL_MAX) : CGL_R(0.0);
    cgl_feedforward_reset(&config->feedforward, &law->feedforward, y_ref != 0 ? y_ref[0] : CGL_R(0.0));
    law->sample = 0U;
    law->spoilt = false;
    law->guard.error = CGL_R(0.0);
    law->guard.limited = false;
    law->terms = no_terms;
}

/* Whether the law has an observer. */
static bool observes(const cgl_trial_config *config)
{
    return config->observer.response != CGL_R(0.0);
}

/* Sets u to 0, and marks the trial so that nothing is learned from it. `ahead` is f + N v, which this sample leaves out of u [u]. */
CGL_SELDOM static void give_up(cgl_trial *law, uint32_t p, cgl_real ahead, unsigned status, cgl_law_output *out)
{
    const cgl_trial_config *const config = &law->config;
    if (observes(config)) {
        cgl_trial_observer_act(&config->observer, &law->observer, -ahead);
        if (!cgl_is_finite(law->observer.e + law->observer.s + law->observer.a)) {
            cgl_trial_observer_reset(&law->observer);
        }
    }
    out->i_q_ref = CGL_R(0.0);
    out->status = status | (unsigned)CGL_STATUS_FROZEN;
    law->spoilt = law->spoilt || p < config->samples;
    law->terms = no_terms;
}

/* Steps one sample. `state_feedback` is K_1 x, and `y` is C x. `plausible` says whether the state x is plausible. */
static void step(cgl_trial *law, cgl_real state_feedback, cgl_real y, bool plausible, bool learn,
                 cgl_law_output *out)
{
    const cgl_trial_config *const config = &law->config;
    const uint32_t p = law->sample;
    const bool within = p < config->samples;
    if (within) {
        law->v = law->guard.phase == CGL_TRIAL_COMPARE ? CGL_R(0.0) : law->learned[p];
    }
    const cgl_real e = law->y_ref[within ? p : config->samples - 1U] - y;
    const cgl_real f = cgl_feedforward_step(&config->feedforward, &law->feedforward, law->y_ref, config->samples, p);
    law->sample = p + (p < config->samples + CGL_FEEDFORWARD_TAPS ? 1U : 0U);

    cgl_real feedback = state_feedback;
    cgl_real integral = config->k_2 * law->psi;
    if (observes(config) && plausible && cgl_is_finite(state_feedback + e)) {
        feedback = cgl_trial_observer_step(&config->observer, &law->observer, e, config->limit, &integral);
    }
    const cgl_real learned = config->n * law->v;
    const cgl_real wanted = feedback + integral + f + learned;                    /* Fig. 1 */
    const cgl_real psi = law->psi + (config->through_integrator ? e + law->v : e); /* (4) */

    /* x needs no check of its own: state_feedback contains K_1 x, which is NaN for an infinite x even where K_1 is 0. */
    const cgl_real besides = observes(config) ? state_feedback + law->observer.missing : CGL_R(0.0);
    if (!(plausible && cgl_is_finite(wanted + psi) && cgl_is_finite(besides))) {
        give_up(law, p, f + learned, (unsigned)CGL_STATUS_FAULT, out);
        return;
    }
    law->terms.feedback = feedback;
    law->terms.integral = integral;
    law->terms.feedforward = f;
    law->terms.learned = learned;
    const bool saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);
    out->status = saturated ? (unsigned)CGL_STATUS_SATURATED | (unsigned)CGL_STATUS_FROZEN : 0U;
    if (observes(config)) {
        cgl_trial_observer_act(&config->observer, &law->observer, out->i_q_ref - f - learned);
    }
    if (!saturated || config->k_2 * (psi - law->psi) * wanted < CGL_R(0.0)) {
        law->psi = psi;
    }
    if (within) {
        const cgl_real lesson = observes(config) ? law->observer.missing : e;
        const bool blocked = p < config->shift || law->error[p] != CGL_R(0.0);
        law->error[p] = blocked ? CGL_R(0.0) : lesson;
        if (config->shift < config->samples - p) {
            law->error[p + config->shift] = saturated ? CGL_R(1.0) : CGL_R(0.0);
        }
        law->guard.error += e * e;
        law->guard.limited = law->guard.limited || saturated;
        law->spoilt = law->spoilt || !learn;
    }
    out->status |= !within || law->spoilt ? (unsigned)CGL_STATUS_FROZEN : 0U;
    const bool gentle = law->guard.phase != CGL_TRIAL_LEARN || law->guard.strikes > 0U;
    out->status |= gentle ? (unsigned)CGL_STATUS_GUARDED : 0U;
}

void cgl_trial_step(cgl_trial *law, const cgl_trial_input *in, cgl_trial_output *out)
{
    const cgl_trial_config *const config = &law->config;
    cgl_law_output result = {CGL_R(0.0), (unsigned)CGL_STATUS_FROZEN};
    if (law->y_ref != 0) {
        cgl_real feedback = CGL_R(0.0), y = CGL_R(0.0);
        for (uint32_t i = 0; i < config->states; ++i) {
            feedback += config->k_1[i] * in->x[i];
            y += config->c[i] * in->x[i];
        }
        step(law, feedback, y, true, in->learn, &result);
    }
    out->u = result.i_q_ref;
    out->status = result.status;
}

void cgl_trial_drive_step(cgl_trial *law, const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_trial_config *const config = &law->config;
    const bool stands_by = cgl_law_stands_by(in);
    if (law->y_ref != 0) {
        law->theta = cgl_unwrap(in->theta_m, law->theta);
        step(law, config->k_1[0] * law->theta + config->k_1[1] * in->omega_m,
             config->c[0] * law->theta + config->c[1] * in->omega_m, cgl_is_angle(in->theta_m), in->learn && !stands_by, out);
    } else {
        out->i_q_ref = CGL_R(0.0);
        out->status = (unsigned)CGL_STATUS_FROZEN;
    }
    if (stands_by) {
        law->psi = CGL_R(0.0);
        cgl_trial_observer_reset(&law->observer);
        law->terms = no_terms;
        (void)cgl_law_stand_by(in, CGL_R(0.0), config->limit, out);
    }
}

/* v(p) <- v(p) + K_3 e(p + shift), or v <- v + L e with a learning matrix L, within the limit. */
CGL_SELDOM static void correct(cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    const uint32_t samples = config->samples;
    const cgl_real *row = config->learning_matrix;
    for (uint32_t p = 0; p < samples; ++p) {
        cgl_real correction = CGL_R(0.0);
        if (row != 0) {
            for (uint32_t q = 0; q < samples; ++q) {
                correction += row[q] * law->error[q];
            }
            row += samples;
        } else {
            const uint32_t place = p + config->shift;
            correction = config->k_3 * law->error[place < samples ? place : samples - 1U];
        }
        law->learned[p] = cgl_clamped(law->learned[p] + correction, config->learned_limit);
    }
}

/* Corrects v by the error of the trial, and filters the error or v by Q. */
static void learn(cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    cgl_real *tail = law->error + config->samples;
    if (config->learning_matrix == 0 && !config->filter_signal) {
        cgl_zero_phase(&config->q_filter, law->error, config->samples, tail);
    }
    correct(law);
    if (config->filter_signal) {
        cgl_zero_phase(&config->q_filter, law->learned, config->samples, tail);
        for (uint32_t p = 0; p < config->samples; ++p) {
            law->learned[p] = cgl_clamped(law->learned[p], config->learned_limit);
        }
    }
}

static bool has_learned_nothing(const cgl_trial *law)
{
    for (uint32_t p = 0; p < law->config.samples; ++p) {
        if (law->learned[p] != CGL_R(0.0)) {
            return false;
        }
    }
    return true;
}

CGL_SELDOM static void learn_guarded(cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    cgl_trial_guard *const guard = &law->guard;
    cgl_real *const best = best_v(law);
    const cgl_trial_verdict verdict = cgl_trial_guard_judge(guard, has_learned_nothing(law));
    for (uint32_t p = 0; p < config->samples; ++p) {
        best[p] = verdict.clear ? CGL_R(0.0) : verdict.store ? law->learned[p] : best[p];
        if (verdict.clear || verdict.back) {
            law->learned[p] = cgl_clamped(best[p], config->learned_limit);
        }
    }
    if (!verdict.learn) {
        return;
    }
    learn(law);
    for (uint32_t p = 0; guard->strikes > 0U && p < config->samples; ++p) {
        const cgl_real mixed = (CGL_R(1.0) - guard->share) * best[p] + guard->share * law->learned[p];
        law->learned[p] = cgl_clamped(mixed, config->learned_limit);
    }
}

bool cgl_trial_end(cgl_trial *law)
{
    const cgl_trial_config *const config = &law->config;
    const bool whole = law->y_ref != 0 && law->sample >= config->samples && !law->spoilt;
    law->spoilt = true; /* a second call of cgl_trial_end() then learns nothing */
    if (!whole) {
        return false;
    }
    if (is_guarded(config)) {
        learn_guarded(law);
    } else {
        learn(law);
    }
    return true;
}
