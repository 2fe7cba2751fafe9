#include "space_speed.h"

static uint32_t ratio_of(const cgl_space_speed_config *config)
{
    return config->ratio > 0U ? config->ratio : 1U;
}

CGL_SELDOM const char *cgl_space_speed_bad_field(const cgl_space_speed_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(space_speed, k, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_speed, mu_alpha, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_speed, mu_beta, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_speed, mu_h, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(space_speed, eta_bar, CGL_POSITIVE),
                                      CGL_RANGE(space_speed, omega_min, CGL_POSITIVE),
                                      CGL_RANGE(space_speed, ratio, CGL_COUNT_OR_DEFAULT),
                                      CGL_RANGE(space_speed, limit, CGL_POSITIVE)};
    const char *const field = CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop);
    return field != 0 ? field : cgl_memory_bad_field(&config->memory, loop->ts);
}

/* Applies the guard's step of gentle learning, an index of cgl_gentle_steps. */
CGL_SELDOM static void follow_guard(cgl_space_speed *law, uint32_t gentle)
{
    law->gentle = gentle;
    cgl_memory_soften(&law->memory, cgl_gentle_forgetting(gentle));
}

CGL_SELDOM cgl_error cgl_space_speed_init(cgl_space_speed *law, const cgl_space_speed_config *config, const cgl_loop *loop, cgl_real *cell,
                               uint32_t length)
{
    law->memory.ready = 0U;
    if (cgl_space_speed_bad_field(config, loop) != 0) {
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
    cgl_space_speed_reset(law);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_space_speed_retune(cgl_space_speed *law, const cgl_space_speed_config *config)
{
    if (cgl_space_speed_bad_field(config, &law->loop) != 0 || ratio_of(config) != law->config.ratio
        || cgl_memory_retune(&law->memory, &config->memory) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    law->config = *config;
    law->config.ratio = ratio_of(config);
    law->gentle = UINT32_MAX; /* The next step computes the gains for the guard's step again. */
    return CGL_OK;
}

/* Resets all but what is learned. */
CGL_SELDOM static void start_anew(cgl_space_speed *law)
{
    static const cgl_space_speed_terms nothing = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    law->saturated = false;
    law->terms = nothing;
}

CGL_SELDOM void cgl_space_speed_reset(cgl_space_speed *law)
{
    cgl_memory_reset(&law->memory);
    start_anew(law);
}

/* Returns the factor by which the guard reduces the correction. As in the paper's proof, the correction grows with 1 / |omega| without
 * bound. The first step of gentle learning does not change this. */
static cgl_real factor_of(const cgl_space_speed *law, cgl_real omega, cgl_real alpha_ref)
{
    if (CGL_OFTEN(law->gentle <= 1U)) {
        return CGL_R(1.0);
    }
    const cgl_space_speed_config *const config = &law->config;
    const cgl_real gain = config->mu_alpha + config->mu_beta * omega * omega + config->mu_h * alpha_ref * alpha_ref;
    return cgl_gentle_gain(law->gentle, gain, config->k * cgl_abs(omega));
}

void cgl_space_speed_step(cgl_space_speed *law, const cgl_law_input *in,
                          cgl_law_output *out)
{
    const cgl_space_speed_config *const config = &law->config;
    if (!CGL_OFTEN(law->memory.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    const cgl_real difference = in->omega_m - in->omega_ref;
    /* one check is enough: a sum is not finite if a part of it is not */
    const bool plausible = cgl_is_finite(difference + in->alpha_ref) && cgl_is_angle(in->theta_m);
    const cgl_real omega = plausible ? in->omega_m : CGL_R(0.0);
    const cgl_real omega_ref = plausible ? in->omega_ref : CGL_R(0.0);
    const cgl_real alpha_ref = plausible ? in->alpha_ref : CGL_R(0.0);
    const cgl_real eta = plausible ? difference : CGL_R(0.0);

    const bool moving = cgl_abs(omega) >= config->omega_min;
    const bool switched_on = moving && cgl_abs(eta) < config->eta_bar; /* q is not 0 */
    cgl_real delta[CGL_CHANNELS];
    const uint32_t gentle = cgl_law_gentle(in);
    if (gentle != law->gentle) {
        follow_guard(law, gentle);
    }
    const cgl_real factor = factor_of(law, omega, alpha_ref);
    const cgl_real step = switched_on ? -eta * factor / cgl_abs(omega) : CGL_R(0.0);
    const bool gains = factor * (config->mu_alpha + config->mu_beta + config->mu_h) > CGL_R(0.0);
    const cgl_real correction[CGL_CHANNELS] = {step * config->mu_alpha, step * (config->mu_beta * omega_ref),
                                               step * (config->mu_h * alpha_ref)};
    const bool learn = cgl_memory_step(&law->memory, in->theta_m, moving ? omega : CGL_R(0.0),
                                       ((in->learn && switched_on && gains && !law->saturated) || in->forget) && !cgl_law_stands_by(in), correction, delta);

    if (in->off) {
        start_anew(law);
        (void)cgl_law_stand_by(in, CGL_R(0.0), config->limit, out);
        return;
    }
    const cgl_real acts = cgl_law_share(in);
    cgl_space_speed_terms *terms = &law->terms;
    terms->proportional = -config->k * eta;
    terms->alpha = acts * delta[0];
    terms->beta = law->memory.config.channels > 1U ? acts * delta[1] * omega : CGL_R(0.0);
    terms->h = law->memory.config.channels > 2U ? acts * delta[2] * alpha_ref : CGL_R(0.0);
    if (in->torque) {
        terms->proportional = CGL_R(0.0);
        law->saturated = false;
        (void)cgl_law_stand_by(in, terms->alpha + terms->beta + terms->h, config->limit, out);
        return;
    }
    const cgl_real wanted = terms->proportional + terms->alpha + terms->beta + terms->h;
    law->saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);
    out->status = (law->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}
