#include "space_position.h"

#include "angle.h"

#define SAMPLES_MAX CGL_R(4294967040.0) /* the largest float below 2^32 */

static uint32_t ratio_of(const cgl_space_position_config *config)
{
    return config->ratio > 0U ? config->ratio : 1U;
}

CGL_SELDOM const char *cgl_space_position_bad_field(const cgl_space_position_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(space_position, ratio, CGL_COUNT_OR_DEFAULT),
                                      CGL_RANGE(space_position, k_theta, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, k_omega, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, k_v, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, v_0, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, v_2, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, k_i, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, mu_alpha, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, mu_beta, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, mu_h, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, ramp, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_position, omega_min, CGL_POSITIVE),
                                      CGL_RANGE(space_position, limit, CGL_POSITIVE)};
    const char *const field = CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop);
    if (field != 0) {
        return field;
    }
    if (config->index != CGL_SPACE_BY_REFERENCE && config->index != CGL_SPACE_BY_ROTOR) {
        return CGL_FIELD("space_position.index");
    }
    return cgl_memory_bad_field(&config->memory, loop->ts);
}

/* Returns the number of channels whose mean belongs to the integral. If the integral stays in use while the law learns, these are alpha
 * and beta: at a constant speed their means act like the integral. The mean of h stays in the memory. h is learned while the speed changes,
 * and gives the current that accelerates the inertia. */
static uint32_t centred(const cgl_space_position_config *config)
{
    return config->k_i > CGL_R(0.0) && !config->hand_over ? 2U : 0U;
}

/* Applies the guard's step of gentle learning, an index of cgl_gentle_steps. */
CGL_SELDOM static void follow_guard(cgl_space_position *law, uint32_t gentle)
{
    law->gentle = gentle;
    cgl_memory_soften(&law->memory, cgl_gentle_forgetting(gentle));
}

CGL_SELDOM cgl_error cgl_space_position_init(cgl_space_position *law, const cgl_space_position_config *config, const cgl_loop *loop, cgl_real *cell,
                                  uint32_t length)
{
    law->memory.ready = 0U;
    if (cgl_space_position_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    law->config = *config;
    law->config.ratio = ratio_of(config);
    law->loop = *loop;
    const cgl_error error = cgl_memory_init(&law->memory, &config->memory, loop->ts, law->config.ratio, cell, length);
    if (error != CGL_OK) {
        return error;
    }
    follow_guard(law, 0U);
    cgl_memory_centre(&law->memory, centred(config));
    cgl_space_position_reset(law);
    return CGL_OK;
}

/* Returns how far the ramp of learning has come, from 0 to 1. */
static inline cgl_real share_of_learning(const cgl_space_position *law)
{
    const cgl_space_position_config *const config = &law->config;
    const cgl_real elapsed = (cgl_real)law->learning_samples * law->loop.ts;
    return elapsed >= config->ramp ? CGL_R(1.0) : elapsed / config->ramp;
}

/* Returns the number of learning samples, at least one, after which the ramp has come to this share. */
static uint32_t samples_of_share(const cgl_space_position *law, cgl_real share)
{
    const cgl_real samples = share * law->config.ramp / law->loop.ts;
    return samples < SAMPLES_MAX ? (uint32_t)samples + 1U : (uint32_t)SAMPLES_MAX;
}

CGL_SELDOM cgl_error cgl_space_position_retune(cgl_space_position *law, const cgl_space_position_config *config)
{
    const cgl_real share = share_of_learning(law);
    if (cgl_space_position_bad_field(config, &law->loop) != 0 || ratio_of(config) != law->config.ratio || config->index != law->config.index
        || cgl_memory_retune(&law->memory, &config->memory) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    const bool same_ramp = !(config->ramp < law->config.ramp || config->ramp > law->config.ramp);
    law->config = *config;
    law->config.ratio = ratio_of(config);
    cgl_memory_centre(&law->memory, centred(config));
    law->gentle = UINT32_MAX; /* no valid index, so the next step applies the guard's step again */
    if (!same_ramp && law->learning_samples > 0U) {
        law->learning_samples = samples_of_share(law, share);
    }
    law->integral = cgl_clamped(law->integral, config->limit);
    return CGL_OK;
}

/* Resets all but what is learned. */
CGL_SELDOM static void start_anew(cgl_space_position *law)
{
    static const cgl_space_position_terms nothing = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    law->integral = law->integral_lost = CGL_R(0.0);
    law->saturated = false;
    law->terms = nothing;
}

CGL_SELDOM void cgl_space_position_reset(cgl_space_position *law)
{
    cgl_memory_reset(&law->memory);
    law->learning_samples = 0U;
    start_anew(law);
}

/* Sets the output in torque mode. Presets the integral, so that the output does not jump when torque mode ends. Clears the integral if
 * it has no part in the output. */
CGL_SELDOM static void hold(cgl_space_position *law, const cgl_law_input *in, cgl_real share_i, cgl_law_output *out)
{
    cgl_space_position_terms *const terms = &law->terms;
    const cgl_real limit = law->config.limit;
    const cgl_real current = cgl_law_stand_by(in, terms->alpha + terms->beta + terms->h, limit, out);
    const bool is_corrected = share_i * law->config.k_i > CGL_R(0.0); /* otherwise the integral would keep this current for good */
    law->integral = is_corrected ? cgl_clamped(-current / share_i, limit) : CGL_R(0.0);
    law->integral_lost = terms->proportional = terms->integral = CGL_R(0.0);
    law->saturated = false;
}

/* Returns the factor by which the guard reduces the correction. The law learns from the position error too. The gain of the
 * speed error cannot bound what is learned from the position error. So the first step of gentle learning leaves the correction as it is. */
static cgl_real factor_of(const cgl_space_position *law, cgl_real omega_ref, cgl_real alpha_ref)
{
    if (CGL_OFTEN(law->gentle <= 1U)) {
        return CGL_R(1.0);
    }
    const cgl_space_position_config *const config = &law->config;
    const cgl_real gain =
        config->mu_alpha + config->mu_beta * omega_ref * omega_ref + config->mu_h * alpha_ref * alpha_ref;
    return cgl_gentle_gain(law->gentle, gain, config->k_omega * cgl_abs(omega_ref));
}

void cgl_space_position_step(cgl_space_position *law,
                             const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_space_position_config *const config = &law->config;
    if (!CGL_OFTEN(law->memory.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    const cgl_real ratio = (cgl_real)config->ratio;
    const cgl_real difference = ratio * (in->omega_m - in->omega_ref);
    /* one check is enough: a sum is not finite if a part of it is not */
    const bool plausible =
        cgl_is_finite(difference + ratio * in->alpha_ref) && cgl_is_angle(in->theta_m) && cgl_is_angle(in->theta_ref);
    const cgl_real omega = plausible ? ratio * in->omega_m : CGL_R(0.0);
    const cgl_real omega_ref = plausible ? ratio * in->omega_ref : CGL_R(0.0);
    const cgl_real alpha_ref = plausible ? ratio * in->alpha_ref : CGL_R(0.0);

    /* atan2(sin, cos) of a difference is the difference less its whole turns */
    cgl_real theta_tg = plausible ? ratio * (in->theta_m - in->theta_ref) : CGL_R(0.0);
    if (!cgl_is_within(theta_tg, CGL_R(3.0))) {
        theta_tg = cgl_unwrap(theta_tg, CGL_R(0.0));
    }
    const cgl_real omega_t = plausible ? difference + config->k_theta * theta_tg : CGL_R(0.0);

    const bool learning = in->learn && !cgl_law_stands_by(in);
    const bool moving = plausible && cgl_abs(in->omega_ref) >= config->omega_min;
    cgl_real value[CGL_CHANNELS];
    cgl_real share = share_of_learning(law);
    const uint32_t gentle = cgl_law_gentle(in);
    if (gentle != law->gentle) {
        follow_guard(law, gentle);
    }
    const cgl_real factor = factor_of(law, omega_ref, alpha_ref);
    const cgl_real step = moving ? -share * factor * omega_t / cgl_abs(omega_ref) : CGL_R(0.0);
    const bool gains = factor * (config->mu_alpha + config->mu_beta + config->mu_h) > CGL_R(0.0);
    const cgl_real correction[CGL_CHANNELS] = {step * config->mu_alpha, step * (config->mu_beta * omega_ref),
                                               step * (config->mu_h * alpha_ref)};
    const bool learn = cgl_memory_step(&law->memory, config->index == CGL_SPACE_BY_ROTOR ? in->theta_m : in->theta_ref,
                                       moving ? in->omega_ref : CGL_R(0.0),
                                       (learning && moving && gains && !law->saturated) || (in->forget && !cgl_law_stands_by(in)),
                                       correction, value);
    if (learn && !in->forget && (law->learning_samples == 0U || (share < CGL_R(1.0) && law->learning_samples < 0xFFFFFFFFU))) {
        ++law->learning_samples;
    } else if (law->learning_samples == 0U) {
        share = CGL_R(0.0);
    }

    if (in->off) {
        start_anew(law);
        (void)cgl_law_stand_by(in, CGL_R(0.0), config->limit, out);
        return;
    }
    const cgl_real acts = cgl_law_share(in);
    cgl_space_position_terms *terms = &law->terms;
    terms->proportional =
        -(config->k_omega + config->v_0 + config->v_2 * omega * omega) * omega_t - config->k_v * theta_tg;
    terms->alpha = acts * value[0];
    terms->beta = law->memory.config.channels > 1U ? acts * value[1] * omega_ref : CGL_R(0.0);
    terms->h = law->memory.config.channels > 2U ? acts * value[2] * alpha_ref : CGL_R(0.0);
    const cgl_real share_i = config->hand_over ? CGL_R(1.0) - acts * share : CGL_R(1.0);
    if (in->torque) {
        hold(law, in, share_i, out);
        return;
    }
    const cgl_real rest = terms->proportional + terms->alpha + terms->beta + terms->h;

    if (learn) { /* the integral has the sign of the error, the channels have the opposite sign */
        const cgl_channel *const channel = law->memory.channel;
        const cgl_real transfer = channel[0].transfer + channel[1].transfer * omega_ref;
        law->integral = cgl_add(law->integral, -acts * transfer, config->limit, &law->integral_lost);
    }
    if (!(share_i > CGL_R(0.0))) { /* an integral without effect would wind up, and would act as soon as share_i is above 0 again */
        law->integral = law->integral_lost = CGL_R(0.0);
    }
    cgl_real lost = law->integral_lost;
    const cgl_real integral = cgl_add(law->integral, config->k_i * law->loop.ts * omega_t, config->limit, &lost);
    const cgl_real wanted = rest - share_i * integral;
    law->saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);
    if (!law->saturated || omega_t * out->i_q_ref > CGL_R(0.0)) {
        law->integral = integral;
        law->integral_lost = lost;
    } else {
        out->i_q_ref = cgl_clamp(rest - share_i * law->integral, config->limit);
    }
    terms->integral = -share_i * law->integral;
    out->status = (law->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}
