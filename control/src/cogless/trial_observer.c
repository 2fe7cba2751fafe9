#include "trial_observer.h"

CGL_SELDOM cgl_error cgl_trial_observer_init(const cgl_trial_observer_config *config, cgl_real limit)
{
    if (config->response == CGL_R(0.0)) {
        return CGL_OK;
    }
    return cgl_is_positive(config->response) && cgl_is_finite(config->response * limit)
                   && cgl_is_finite(CGL_R(1.0) / config->response) && config->pole >= CGL_R(0.0)
                   && config->pole < CGL_R(1.0)
               ? CGL_OK
               : CGL_ERROR_CONFIG;
}

void cgl_trial_observer_reset(cgl_trial_observer *observer)
{
    const cgl_real none = CGL_R(0.0);
    const cgl_trial_observer fresh = {none, none, none, none, {none, none, none}, {none, none}, false};
    *observer = fresh;
}

cgl_real cgl_trial_observer_step(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real e_m,
                                 cgl_real limit, cgl_real *held)
{
    const cgl_real p = config->pole;
    const cgl_real q = CGL_R(1.0) - p;
    if (!observer->started) { /* a trial begins at rest */
        observer->started = true;
        observer->e = e_m;
        observer->before[0] = observer->before[1] = observer->before[2] = e_m;
    }
    const cgl_real innovation = e_m - observer->e;
    observer->e += (CGL_R(1.0) - p * p * p) * innovation;
    observer->s += CGL_R(1.5) * q * q * (CGL_R(1.0) + p) * innovation;
    observer->a += q * q * q * innovation;

    cgl_real *before = observer->before;
    observer->missing = observer->feedback[1]
                        + (e_m - before[0] - before[1] + before[2]) / (CGL_R(2.0) * config->response);
    before[2] = before[1];
    before[1] = before[0];
    before[0] = e_m;

    *held = observer->a / config->response;
    const cgl_real most = CGL_R(0.25) * (CGL_R(3.0) + p) * (CGL_R(3.0) + p) * config->response * limit;
    return (cgl_clamp(q * q * observer->e, most) + CGL_R(0.5) * q * (CGL_R(3.0) + p) * observer->s) / config->response;
}

void cgl_trial_observer_act(const cgl_trial_observer_config *config, cgl_trial_observer *observer, cgl_real u_fb)
{
    if (!observer->started) {
        return;
    }
    const cgl_real push = observer->a - config->response * u_fb;
    observer->e += observer->s + CGL_R(0.5) * push;
    observer->s += push;
    observer->feedback[1] = observer->feedback[0];
    observer->feedback[0] = u_fb;
}
