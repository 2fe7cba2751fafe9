#include "pi.h"

CGL_SELDOM const char *cgl_pi_bad_field(const cgl_pi_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(pi, kp, CGL_NOT_NEGATIVE), CGL_RANGE(pi, ki, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(pi, limit, CGL_POSITIVE)};
    return CGL_LAW_BAD_FIELD(config, range, loop);
}

CGL_SELDOM static void take(cgl_pi *pi, const cgl_pi_config *config)
{
    pi->config = *config;
    pi->kp = pi->loop.feed_forward ? CGL_R(0.0) : config->kp;
    pi->ki = pi->loop.feed_forward ? CGL_R(0.0) : config->ki;
}

CGL_SELDOM cgl_error cgl_pi_init(cgl_pi *pi, const cgl_pi_config *config, const cgl_loop *loop)
{
    pi->ready = 0U;
    if (cgl_pi_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    pi->loop = *loop;
    take(pi, config);
    cgl_pi_reset(pi);
    pi->ready = CGL_READY;
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_pi_retune(cgl_pi *pi, const cgl_pi_config *config)
{
    if (cgl_pi_bad_field(config, &pi->loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real before = pi->kp, last = pi->proportional;
    take(pi, config);
    const cgl_real now = before > CGL_R(0.0) ? cgl_clamped(last / before * pi->kp, CGL_REAL_MAX) : CGL_R(0.0);
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
    pi->integral = pi->ki > CGL_R(0.0) ? cgl_clamped(integral, pi->config.limit) : CGL_R(0.0);
    pi->lost = CGL_R(0.0);
    pi->proportional = CGL_R(0.0);
    pi->saturated = false;
}

CGL_SELDOM cgl_real cgl_pi_step(cgl_pi *pi, cgl_real error, cgl_real feedforward)
{
    const cgl_pi_config *const config = &pi->config;
    const cgl_real e = cgl_finite_or_zero(error);
    const cgl_real ff = cgl_finite_or_zero(feedforward);
    cgl_real lost = pi->lost;
    const cgl_real integral = cgl_added(pi->integral, pi->ki * pi->loop.ts * e, config->limit, &lost);

    pi->proportional = cgl_clamped(pi->kp * e, CGL_REAL_MAX);
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
