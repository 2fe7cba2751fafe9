#include "pi.h"

#include "range.h"

static bool is_valid(const cgl_pi_config *config)
{
    static const cgl_range range[] = {CGL_RANGE(cgl_pi_config, kp, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(cgl_pi_config, ki, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(cgl_pi_config, limit, CGL_POSITIVE)};
    return CGL_IS_IN_RANGE(config, range);
}

cgl_error cgl_pi_init(cgl_pi *pi, const cgl_pi_config *config, cgl_real ts)
{
    if (!(is_valid(config) && cgl_is_positive(ts))) {
        return CGL_ERROR_CONFIG;
    }
    pi->config = *config;
    pi->ts = ts;
    cgl_pi_reset(pi);
    return CGL_OK;
}

cgl_error cgl_pi_retune(cgl_pi *pi, const cgl_pi_config *config)
{
    if (!is_valid(config)) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real before = pi->config.kp, last = pi->proportional;
    const cgl_real now = before > CGL_R(0.0) ? cgl_clamped(last / before * config->kp, CGL_REAL_MAX) : CGL_R(0.0);
    pi->config = *config;
    pi->integral = cgl_clamped(pi->integral + (last - now), config->limit);
    pi->lost = CGL_R(0.0);
    pi->proportional = now;
    return CGL_OK;
}

CGL_SELDOM void cgl_pi_reset(cgl_pi *pi)
{
    cgl_pi_start(pi, CGL_R(0.0));
}

CGL_SELDOM void cgl_pi_start(cgl_pi *pi, cgl_real integral)
{
    pi->integral = cgl_clamped(integral, pi->config.limit);
    pi->lost = CGL_R(0.0);
    pi->proportional = CGL_R(0.0);
    pi->saturated = false;
}

CGL_SELDOM cgl_real cgl_pi_step(cgl_pi *pi, cgl_real error, cgl_real feedforward)
{
    const cgl_pi_config *const config = &pi->config;
    const cgl_real e = cgl_is_finite(error) ? error : CGL_R(0.0);
    const cgl_real ff = cgl_is_finite(feedforward) ? feedforward : CGL_R(0.0);
    cgl_real lost = pi->lost;
    const cgl_real integral = cgl_add(pi->integral, config->ki * pi->ts * e, config->limit, &lost);

    pi->proportional = cgl_clamped(config->kp * e, CGL_REAL_MAX);
    const cgl_real wanted = pi->proportional + integral + ff;
    const cgl_real output = cgl_clamped(wanted, config->limit);
    pi->saturated = !cgl_is_below(wanted, config->limit);
    if (!pi->saturated || e * output < CGL_R(0.0)) {
        pi->integral = integral;
        pi->lost = lost;
        return output;
    }
    return cgl_clamped(pi->proportional + pi->integral + ff, config->limit);
}
