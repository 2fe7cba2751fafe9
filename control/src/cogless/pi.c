#include "pi.h"

CGL_SELDOM cgl_error cgl_pi_init(const cgl_pi_config *config, cgl_pi *pi)
{
    if (!(cgl_is_not_negative(config->kp) && cgl_is_not_negative(config->ki) && cgl_is_positive(config->ts)
          && cgl_is_positive(config->limit))) {
        return CGL_ERROR_CONFIG;
    }
    cgl_pi_reset(pi);
    return CGL_OK;
}

CGL_SELDOM void cgl_pi_reset(cgl_pi *pi)
{
    pi->integral = CGL_R(0.0);
    pi->proportional = CGL_R(0.0);
    pi->saturated = false;
}

CGL_SELDOM cgl_real cgl_pi_step_limited(const cgl_pi_config *config, cgl_pi *pi, cgl_real error, cgl_real feedforward)
{
    const cgl_real e = cgl_is_finite(error) ? error : CGL_R(0.0);
    const cgl_real ff = cgl_is_finite(feedforward) ? feedforward : CGL_R(0.0);
    const cgl_real integral = cgl_clamped(pi->integral + config->ki * config->ts * e, config->limit);

    pi->proportional = cgl_clamped(config->kp * e, CGL_REAL_MAX);
    const cgl_real wanted = pi->proportional + integral + ff;
    const cgl_real output = cgl_clamped(wanted, config->limit);
    pi->saturated = !(wanted > -config->limit && wanted < config->limit);
    if (!pi->saturated || e * output < CGL_R(0.0)) {
        pi->integral = integral;
        return output;
    }
    return cgl_clamped(pi->proportional + pi->integral + ff, config->limit);
}
