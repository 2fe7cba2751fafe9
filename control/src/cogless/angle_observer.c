#include "angle_observer.h"

#include "decay.h"
#include "turns.h"

#define FASTEST CGL_R(2.0) /* largest bandwidth * ts [-]: with a larger product the observer would hardly smooth */

CGL_SELDOM cgl_error cgl_angle_observer_init(cgl_angle_observer *observer, const cgl_angle_observer_config *config,
                                             cgl_real ts)
{
    if (!(ts >= CGL_R(1.0e-9) && ts <= CGL_R(1.0e3))) {
        return CGL_ERROR_CONFIG;
    }
    observer->ts = ts;
    observer->omega_max = CGL_PI / ts;
    observer->alpha_max = observer->omega_max / ts;
    cgl_angle_observer_reset(observer, 0U, CGL_R(0.0));
    return cgl_angle_observer_retune(observer, config);
}

CGL_SELDOM cgl_error cgl_angle_observer_retune(cgl_angle_observer *observer, const cgl_angle_observer_config *config)
{
    const cgl_real ts = observer->ts;
    if (!(cgl_is_positive(config->bandwidth) && config->bandwidth * ts <= FASTEST)) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real p = cgl_decay(config->bandwidth * ts), q = CGL_R(1.0) - p;
    observer->config = *config;
    observer->l1 = CGL_R(1.0) - p * p * p;
    observer->l2 = CGL_R(1.5) * q * q * (CGL_R(1.0) + p) / ts;
    observer->l3 = q * q * q / ts / ts;
    return CGL_OK;
}

CGL_SELDOM void cgl_angle_observer_reset(cgl_angle_observer *observer, uint32_t theta, cgl_real omega)
{
    observer->theta = theta;
    observer->omega = cgl_clamp(omega, observer->omega_max);
    observer->alpha = CGL_R(0.0);
}

void cgl_angle_observer_step(cgl_angle_observer *observer, uint32_t theta)
{
    const cgl_real ts = observer->ts, rise = ts * observer->alpha;
    const cgl_real way = ts * (observer->omega + CGL_R(0.5) * rise); /* predicted change of the angle [rad] */
    const uint32_t ahead = cgl_turned(observer->theta, way * (CGL_R(1.0) / CGL_TWO_PI));
    /* difference of measured and predicted angle [turns], in [-1/2, 1/2) */
    const cgl_real part = cgl_steps(ahead, theta) * (CGL_R(1.0) / CGL_TURN_BITS);
    const cgl_real error = part * CGL_TWO_PI;
    observer->theta = cgl_turned(ahead, observer->l1 * part);
    observer->omega = cgl_clamp(observer->omega + rise + observer->l2 * error, observer->omega_max);
    observer->alpha = cgl_clamp(observer->alpha + observer->l3 * error, observer->alpha_max);
}
