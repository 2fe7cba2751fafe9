#include "space_speed.h"

CGL_SELDOM cgl_error cgl_space_speed_init(const cgl_space_speed_config *config, cgl_space_speed *law, cgl_real *cell,
                               uint32_t length)
{
    if (!(cgl_is_not_negative(config->k) && cgl_is_not_negative(config->mu_alpha)
          && cgl_is_not_negative(config->mu_beta) && cgl_is_not_negative(config->mu_h)
          && cgl_is_positive(config->eta_bar) && cgl_is_positive(config->omega_min) && cgl_is_positive(config->limit)
          && config->ratio >= 1U && config->ratio <= 65535U)) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_space_memory_init(&config->memory, &law->memory, cell, length);
    law->gentle = 0U;
    if (error == CGL_OK) {
        cgl_space_speed_reset(config, law);
    }
    return error;
}

/* Resets all but what is learned. */
CGL_SELDOM static void start_anew(cgl_space_speed *law)
{
    static const cgl_space_speed_terms nothing = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    law->saturated = false;
    law->terms = nothing;
}

CGL_SELDOM void cgl_space_speed_reset(const cgl_space_speed_config *config, cgl_space_speed *law)
{
    cgl_space_memory_reset(&config->memory, &law->memory);
    start_anew(law);
}

/* The factor on the correction while the guard holds learning back. */
CGL_SELDOM static cgl_real be_guarded(const cgl_space_speed_config *config, cgl_space_speed *law, const cgl_law_input *in,
                                      cgl_real omega, cgl_real alpha_ref)
{
    if (in->forget) {
        cgl_space_memory_forget(&config->memory, &law->memory, (cgl_real)config->ratio * in->theta_m, omega > CGL_R(0.0));
    }
    if (in->gentle != law->gentle) {
        law->gentle = in->gentle;
        cgl_space_memory_soften(&config->memory, &law->memory, cgl_gentle_forgetting(in->gentle));
    }
    const cgl_real gain = config->mu_alpha + config->mu_beta * omega * omega + config->mu_h * alpha_ref * alpha_ref;
    return cgl_gentle_gain(in->gentle, gain, config->k * cgl_abs(omega));
}

void cgl_space_speed_step(const cgl_space_speed_config *config, cgl_space_speed *law, const cgl_law_input *in,
                          cgl_law_output *out)
{
    const cgl_real difference = in->omega_m - in->omega_ref, theta = (cgl_real)config->ratio * in->theta_m;
    /* a sum is not finite if a part of it is not */
    const bool plausible = cgl_is_finite(difference + in->alpha_ref) && cgl_is_angle(theta);
    const cgl_real omega = plausible ? in->omega_m : CGL_R(0.0);
    const cgl_real alpha_ref = plausible ? in->alpha_ref : CGL_R(0.0);
    const cgl_real eta = plausible ? difference : CGL_R(0.0);

    const bool moving = cgl_abs(omega) >= config->omega_min;
    const bool switched_on = moving && cgl_abs(eta) < config->eta_bar; /* q is not 0 */
    cgl_real delta[CGL_SPACE_CHANNELS];
    const cgl_real gain[CGL_SPACE_CHANNELS] = {config->mu_alpha, config->mu_beta * omega, config->mu_h * alpha_ref};
    const bool guarded = in->gentle != 0U || law->gentle != 0U || in->forget;
    const cgl_real factor = CGL_OFTEN(!guarded) ? CGL_R(1.0) : be_guarded(config, law, in, omega, alpha_ref);
    const bool learn = cgl_space_memory_step(&config->memory, &law->memory, theta, moving && omega > CGL_R(0.0),
                                             in->learn && !in->off && switched_on && !law->saturated, gain,
                                             switched_on ? factor * eta / cgl_abs(omega) : CGL_R(0.0), delta);

    if (in->off) {
        start_anew(law);
        cgl_law_off(out);
        return;
    }
    cgl_space_speed_terms *terms = &law->terms;
    terms->proportional = -config->k * eta;
    terms->alpha = in->share * delta[0];
    terms->beta = config->memory.channels > 1U ? in->share * delta[1] * omega : CGL_R(0.0);
    terms->h = config->memory.channels > 2U ? in->share * delta[2] * alpha_ref : CGL_R(0.0);
    const cgl_real wanted = terms->proportional + terms->alpha + terms->beta + terms->h;
    if (learn && cgl_is_below(wanted, config->limit)) {
        law->saturated = false;
        out->i_q_ref = wanted;
        out->status = 0U;
        return;
    }
    law->saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);
    out->status = (law->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}
