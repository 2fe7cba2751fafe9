#include "robust_ilc.h"

CGL_SELDOM const char *cgl_robust_ilc_bad_field(const cgl_robust_ilc_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(robust_ilc, b, CGL_POSITIVE),
                                      CGL_RANGE(robust_ilc, c, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, g, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, eta, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, q, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, beta_1, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, beta_2, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, gamma, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(robust_ilc, viscous, CGL_FINITE),
                                      CGL_RANGE(robust_ilc, coulomb, CGL_FINITE),
                                      CGL_RANGE(robust_ilc, limit, CGL_POSITIVE)};
    const char *field = CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop);
    field = field != 0 ? field : cgl_memory_bad_field(&config->memory, loop->ts);
    if (field != 0) {
        return field;
    }
    if (config->memory.channels > 1U) {
        return CGL_FIELD("memory.channels");
    }
    if (!cgl_is_positive(CGL_R(1.0) / config->b)) {
        return CGL_FIELD("robust_ilc.b");
    }
    if (!cgl_is_positive(config->b * config->limit)) {
        return CGL_FIELD("robust_ilc.limit");
    }
    return cgl_loop_can_learn(loop, config->q * config->beta_2, config->c + config->eta) ? 0 : CGL_FIELD("robust_ilc.eta");
}

/* Returns the number of channels whose mean belongs to r. */
static uint32_t centred(const cgl_robust_ilc_config *config)
{
    return config->gamma > CGL_R(0.0) ? 1U : 0U;
}

/* Applies the guard's step of gentle learning, an index of cgl_gentle_steps. */
CGL_SELDOM static void follow_guard(cgl_robust_ilc *law, uint32_t gentle)
{
    const cgl_robust_ilc_config *const config = &law->config;
    const cgl_real forgetting = cgl_gentle_forgetting(gentle);
    law->gentle = gentle;
    cgl_memory_soften(&law->memory, forgetting);
    law->q = config->q * cgl_gentle_gain(gentle, config->q * config->beta_2, config->c + config->eta);
    law->beta_1 = gentle > 1U ? CGL_R(0.0) : config->beta_1; /* beta_1 sgn S has no gain that the guard could bound, so gentle learning
                                                                leaves it out */
    law->idle = !(law->q * (law->beta_1 + config->beta_2) > CGL_R(0.0)) && forgetting > CGL_R(0.0);
}

CGL_SELDOM cgl_error cgl_robust_ilc_init(cgl_robust_ilc *law, const cgl_robust_ilc_config *config, const cgl_loop *loop, cgl_real *cell,
                              uint32_t length)
{
    law->memory.ready = 0U;
    if (cgl_robust_ilc_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_memory_init(&law->memory, &config->memory, loop->ts, 1U, cell, length);
    if (error == CGL_OK) {
        law->config = *config;
        law->loop = *loop;
        follow_guard(law, 0U);
        cgl_memory_centre(&law->memory, centred(config));
        cgl_robust_ilc_reset(law);
    }
    return error;
}

CGL_SELDOM cgl_error cgl_robust_ilc_retune(cgl_robust_ilc *law, const cgl_robust_ilc_config *config)
{
    if (cgl_robust_ilc_bad_field(config, &law->loop) != 0 || cgl_memory_retune(&law->memory, &config->memory) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    law->config = *config;
    cgl_memory_centre(&law->memory, centred(config));
    law->gentle = UINT32_MAX; /* no valid index, so the next step applies the guard's step again */
    law->adapted = cgl_clamped(law->adapted, config->b * config->limit);
    return CGL_OK;
}

/* Resets all but what is learned. */
CGL_SELDOM static void start_anew(cgl_robust_ilc *law)
{
    static const cgl_robust_ilc_terms nothing = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    law->error_integral = law->integral_lost = law->adapted = law->adapted_lost = law->last_omega_ref = CGL_R(0.0);
    law->started = law->saturated = false;
    law->terms = nothing;
}

CGL_SELDOM void cgl_robust_ilc_reset(cgl_robust_ilc *law)
{
    cgl_memory_reset(&law->memory);
    start_anew(law);
}

/* Sets the output while the law is off or in torque mode. In torque mode r becomes b times the present current, less the friction term that
 * the law will add [rad/s^2]. */
CGL_SELDOM static void stand_by(cgl_robust_ilc *law, const cgl_law_input *in, cgl_real learned, cgl_real friction,
                                cgl_law_output *out)
{
    const cgl_robust_ilc_config *const config = &law->config;
    const cgl_real current = cgl_law_stand_by(in, learned, config->limit, out);
    start_anew(law);
    if (!in->off) {
        law->terms.learned = learned;
        law->adapted = config->gamma > CGL_R(0.0)
                           ? cgl_clamped(config->b * current - friction, config->b * config->limit)
                           : CGL_R(0.0);
    }
}

void cgl_robust_ilc_step(cgl_robust_ilc *law, const cgl_law_input *in,
                         cgl_law_output *out)
{
    const cgl_robust_ilc_config *const config = &law->config;
    if (!CGL_OFTEN(law->memory.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    const bool finite = cgl_is_finite(in->omega_ref - in->omega_m);
    const cgl_real omega = finite ? in->omega_m : CGL_R(0.0);
    const cgl_real error = finite ? in->omega_ref - in->omega_m : CGL_R(0.0);
    const cgl_real acceleration =
        finite && law->started ? (in->omega_ref - law->last_omega_ref) / law->loop.ts : CGL_R(0.0);
    law->last_omega_ref = finite ? in->omega_ref : CGL_R(0.0);
    law->started = finite; /* after a missing sample, the next difference of omega_ref would span more than one period */

    /* eq. (11); the magnitude of the integral of e is limited to 1e9 rad, which no motion reaches */
    cgl_real lost = law->integral_lost;
    const cgl_real error_integral = cgl_add(law->error_integral, law->loop.ts * error, CGL_R(1.0e9), &lost);
    const cgl_real surface = finite ? error + config->c * error_integral : config->c * law->error_integral;
    const cgl_real sign = cgl_sign(surface);

    const uint32_t gentle = cgl_law_gentle(in);
    if (gentle != law->gentle) {
        follow_guard(law, gentle);
    }
    const cgl_real correction = -law->q * (law->beta_1 * sign + config->beta_2 * surface); /* (15) */
    cgl_real value;
    const bool learn = cgl_memory_step(&law->memory, in->theta_m, in->omega_ref,
                                       ((in->learn && !law->idle && !law->saturated) || in->forget) && !cgl_law_stands_by(in) && finite, &correction, &value);
    const cgl_real share = cgl_law_share(in);
    const cgl_real f = share * cgl_clamp(value, config->memory.limit[0]);
    if (learn) {
        law->adapted = cgl_add(law->adapted, -share * law->memory.channel[0].transfer, config->b * config->limit, &law->adapted_lost);
    }

    const cgl_real friction = config->viscous * omega + config->coulomb * cgl_sign(omega);
    const cgl_real per_b = CGL_R(1.0) / config->b;
    if (cgl_law_stands_by(in)) {
        stand_by(law, in, -f * per_b, friction, out);
        return;
    }
    /* (16) and (19), term by term */
    law->terms.surface = (config->c * error + acceleration + friction) * per_b;
    law->terms.switching = config->g * sign * per_b;
    law->terms.linear = config->eta * surface * per_b;
    law->terms.learned = -f * per_b;
    law->terms.adapted = law->adapted * per_b;
    const cgl_real wanted = law->terms.surface + law->terms.switching + law->terms.linear + law->terms.learned
                            + law->terms.adapted;
    law->saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);

    if (finite && (!law->saturated || error * out->i_q_ref < CGL_R(0.0))) {
        law->error_integral = error_integral;
        law->integral_lost = lost;
    }
    if (finite && in->learn && (!law->saturated || surface * out->i_q_ref < CGL_R(0.0))) { /* (20) */
        law->adapted =
            cgl_add(law->adapted, law->loop.ts * config->gamma * surface, config->b * config->limit, &law->adapted_lost);
    }
    out->status = law->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U;
    if (!learn) {
        const bool plausible = finite && cgl_is_angle(in->theta_m);
        out->status |= (unsigned)CGL_STATUS_FROZEN | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
    }
}
