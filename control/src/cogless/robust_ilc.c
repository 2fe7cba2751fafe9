#include "robust_ilc.h"

CGL_SELDOM cgl_error cgl_robust_ilc_init(const cgl_robust_ilc_config *config, cgl_robust_ilc *law, cgl_real *cell,
                              uint32_t length)
{
    if (!(cgl_is_positive(config->b) && cgl_is_not_negative(config->c) && cgl_is_not_negative(config->g) && cgl_is_not_negative(config->eta)
          && cgl_is_not_negative(config->q) && cgl_is_not_negative(config->beta_1) && cgl_is_not_negative(config->beta_2)
          && cgl_is_not_negative(config->gamma) && cgl_is_finite(config->viscous) && cgl_is_finite(config->coulomb)
          && cgl_is_positive(config->ts) && cgl_is_positive(config->limit) && cgl_is_positive(config->b * config->limit)
          && cgl_is_positive(CGL_R(1.0) / config->b))) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_memory_init(&config->memory, &law->memory, cell, length);
    law->gentle = 0U;
    law->q = config->q;
    if (error == CGL_OK) {
        cgl_robust_ilc_reset(config, law);
    }
    return error;
}

/* Resets all but what is learned. */
CGL_SELDOM static void start_anew(cgl_robust_ilc *law)
{
    static const cgl_robust_ilc_terms nothing = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    law->error_integral = law->adapted = law->last_omega_ref = CGL_R(0.0);
    law->started = law->saturated = false;
    law->terms = nothing;
}

CGL_SELDOM void cgl_robust_ilc_reset(const cgl_robust_ilc_config *config, cgl_robust_ilc *law)
{
    cgl_memory_reset(&config->memory, &law->memory);
    start_anew(law);
}

/* What the guard has just changed, or clears. */
CGL_SELDOM static void follow_guard(const cgl_robust_ilc_config *config, cgl_robust_ilc *law, const cgl_law_input *in)
{
    law->gentle = in->gentle;
    law->q = config->q * cgl_gentle_gain(in->gentle, config->q * config->beta_2, config->c + config->eta);
    cgl_memory_soften(&config->memory, &law->memory, cgl_gentle_forgetting(in->gentle));
    if (in->forget) {
        cgl_memory_forget(&config->memory, &law->memory, in->theta_m);
    }
}

void cgl_robust_ilc_step(const cgl_robust_ilc_config *config, cgl_robust_ilc *law, const cgl_law_input *in,
                         cgl_law_output *out)
{
    const bool finite = cgl_is_finite(in->omega_ref - in->omega_m);
    const cgl_real omega = finite ? in->omega_m : CGL_R(0.0);
    const cgl_real error = finite ? in->omega_ref - in->omega_m : CGL_R(0.0);
    const cgl_real acceleration =
        finite && law->started ? (in->omega_ref - law->last_omega_ref) / config->ts : CGL_R(0.0);
    law->last_omega_ref = finite ? in->omega_ref : CGL_R(0.0);
    law->started = finite; /* a change over a gap is not one over ts */

    /* (11); more than this integral could never be commanded */
    const cgl_real error_integral = cgl_clamp(law->error_integral + config->ts * error, CGL_R(1.0e9));
    const cgl_real surface = finite ? error + config->c * error_integral : config->c * law->error_integral;
    const cgl_real sign = cgl_sign(surface);

    bool learn = in->learn && !in->off && finite && !law->saturated;
    if (in->gentle != law->gentle || in->forget) {
        follow_guard(config, law, in);
    }
    const cgl_real correction = -law->q * (config->beta_1 * sign + config->beta_2 * surface); /* (15) */
    const cgl_real f = in->share *
        cgl_memory_step(&config->memory, &law->memory, in->theta_m, in->omega_ref, correction, &learn);

    if (in->off) {
        start_anew(law);
        cgl_law_off(out);
        return;
    }
    /* (16) and (19), term by term */
    const cgl_real friction = config->viscous * omega + config->coulomb * cgl_sign(omega);
    const cgl_real per_b = CGL_R(1.0) / config->b;
    law->terms.surface = (config->c * error + acceleration + friction) * per_b;
    law->terms.switching = config->g * sign * per_b;
    law->terms.linear = config->eta * surface * per_b;
    law->terms.learned = -f * per_b;
    law->terms.adapted = law->adapted * per_b;
    const cgl_real wanted = law->terms.surface + law->terms.switching + law->terms.linear + law->terms.learned
                            + law->terms.adapted;
    if (learn && cgl_is_below(wanted, config->limit)) {
        law->saturated = false;
        law->error_integral = error_integral;
        law->adapted = cgl_clamp(law->adapted + config->ts * config->gamma * surface, config->b * config->limit); /* (20) */
        out->i_q_ref = wanted;
        out->status = 0U;
        return;
    }
    law->saturated = !cgl_is_below(wanted, config->limit);
    out->i_q_ref = cgl_clamp(wanted, config->limit);

    if (finite && (!law->saturated || error * out->i_q_ref < CGL_R(0.0))) {
        law->error_integral = error_integral;
    }
    if (finite && in->learn && (!law->saturated || surface * out->i_q_ref < CGL_R(0.0))) { /* (20) */
        law->adapted = cgl_clamp(law->adapted + config->ts * config->gamma * surface, config->b * config->limit);
    }
    out->status = law->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U;
    if (!learn) {
        const bool plausible = finite && cgl_is_angle(in->theta_m);
        out->status |= (unsigned)CGL_STATUS_FROZEN | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
    }
}
