#include "dead_time.h"

#include "range.h"
#include "sine.h"
#include "transform.h"

#define BUS_MIN CGL_R(1.0e-30) /* lowest bus voltage with a finite reciprocal, as in foc.c [V] */

CGL_SELDOM static bool is_valid(const cgl_dead_time_config *config, cgl_real ts)
{
    static const cgl_range range[] = {
        CGL_RANGE(dead_time, time, CGL_NOT_NEGATIVE), CGL_RANGE(dead_time, drop, CGL_NOT_NEGATIVE),
        CGL_RANGE(dead_time, band, CGL_POSITIVE), CGL_RANGE(dead_time, lag, CGL_NOT_NEGATIVE),
        CGL_RANGE(dead_time, advance, CGL_NOT_NEGATIVE)};
    return CGL_IS_IN_RANGE(config, range) && config->time <= CGL_R(0.5) * ts
           && cgl_is_finite(CGL_R(1.0) / config->band) && cgl_is_finite(config->lag + ts)
           && cgl_is_finite(config->advance * ts)
           && (config->phases == 0U || config->phases == 2U || config->phases == 3U);
}

CGL_SELDOM cgl_error cgl_dead_time_init(cgl_dead_time *dead_time, const cgl_dead_time_config *config, cgl_real ts)
{
    if (!(cgl_is_positive(ts) && is_valid(config, ts))) {
        return CGL_ERROR_CONFIG;
    }
    dead_time->ts = ts;
    cgl_dead_time_reset(dead_time);
    return cgl_dead_time_retune(dead_time, config);
}

CGL_SELDOM void cgl_dead_time_reset(cgl_dead_time *dead_time)
{
    dead_time->i_d = dead_time->i_q = CGL_R(0.0);
}

CGL_SELDOM cgl_error cgl_dead_time_retune(cgl_dead_time *dead_time, const cgl_dead_time_config *config)
{
    const cgl_real ts = dead_time->ts;
    if (!is_valid(config, ts)) {
        return CGL_ERROR_CONFIG;
    }
    dead_time->config = *config;
    dead_time->ahead = config->advance * ts;
    dead_time->share = config->time / ts;
    dead_time->per_band = CGL_R(1.0) / config->band;
    dead_time->follow = ts / (config->lag + ts);
    return CGL_OK;
}

/* Returns the duty cycle that makes up for the lost voltage. `loss` is this voltage as a share of the bus voltage, and i is the phase
 * current divided by the band. */
static cgl_real corrected(cgl_real duty, cgl_real loss, cgl_real i)
{
    if (!(duty > CGL_R(0.0) && duty < CGL_R(1.0))) {
        return duty;
    }
    return CGL_R(0.5) + cgl_clamp(duty - CGL_R(0.5) + loss * cgl_clamp(i, CGL_R(1.0)), CGL_R(0.5));
}

void cgl_dead_time_step(cgl_dead_time *dead_time, const cgl_foc_input *in, cgl_real duty[3])
{
    const cgl_real theta_e = in->theta_e + dead_time->ahead * in->omega_e;
    const cgl_real to_d = in->i_d_ref - dead_time->i_d;
    const cgl_real to_q = in->i_q_ref - dead_time->i_q;
    if (!(cgl_is_angle(theta_e) && in->u_dc >= BUS_MIN && cgl_is_finite(in->u_dc) && cgl_is_finite(to_d)
          && cgl_is_finite(to_q))) {
        return;
    }
    dead_time->i_d += dead_time->follow * to_d;
    dead_time->i_q += dead_time->follow * to_q;
    const cgl_real loss = cgl_clamp(dead_time->share + dead_time->config.drop / in->u_dc, CGL_R(1.0));
    cgl_real sine, cosine, i_alpha, i_beta;
    cgl_sincos_of_angle(theta_e, &sine, &cosine);
    cgl_park_inverse(dead_time->i_d, dead_time->i_q, sine, cosine, &i_alpha, &i_beta);
    if (dead_time->config.phases == 2U) {
        duty[0] = corrected(duty[0], loss, i_alpha * dead_time->per_band);
        duty[1] = corrected(duty[1], loss, i_beta * dead_time->per_band);
        return;
    }
    cgl_real i_abc[3];
    cgl_clarke_inverse(i_alpha, i_beta, i_abc);
    for (int x = 0; x < 3; ++x) {
        duty[x] = corrected(duty[x], loss, i_abc[x] * dead_time->per_band);
    }
}
