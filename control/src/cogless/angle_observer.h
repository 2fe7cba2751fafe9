/* Speed from an angle alone, by a third-order observer of angle, speed and acceleration with three equal poles. The observer needs neither
 * edge times nor the torque. At constant acceleration the estimated speed has no lasting error. Ripple of the speed above the bandwidth is
 * smoothed.
 *
 *   prediction   theta' = theta + ts omega + ts^2/2 alpha,   omega' = omega + ts alpha
 *   correction   e = measured - theta',   p = exp(-bandwidth ts)
 *                theta = theta' + (1 - p^3) e
 *                omega = omega' + 3/2 (1 - p)^2 (1 + p) / ts e
 *                alpha = alpha + (1 - p)^3 / ts^2 e */
#ifndef COGLESS_ANGLE_OBSERVER_H
#define COGLESS_ANGLE_OBSERVER_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real bandwidth; /* magnitude of each of the three equal poles [rad/s], > 0, at most 2 / ts */
} cgl_angle_observer_config;

typedef struct {
    cgl_angle_observer_config config;
    cgl_real ts;            /* period of the steps [s] */
    cgl_real l1, l2, l3;    /* gains from e to theta [-], omega [1/s] and alpha [1/s^2] */
    cgl_real omega_max;     /* largest speed: half a turn in a period [rad/s] */
    cgl_real alpha_max;     /* largest acceleration: a change by omega_max in a period [rad/s^2] */
    uint32_t theta;         /* angle [2^-32 turns] */
    cgl_real omega;         /* speed [rad/s] */
    cgl_real alpha;         /* acceleration [rad/s^2] */
} cgl_angle_observer;

/* Copies the config. ts is the period of the steps [s], 1e-9 to 1e3. The rotor counts as standing at angle 0. */
cgl_error cgl_angle_observer_init(cgl_angle_observer *observer, const cgl_angle_observer_config *config, cgl_real ts);

/* Changes the bandwidth at run time, within the range that init accepts. The state stays. */
cgl_error cgl_angle_observer_retune(cgl_angle_observer *observer, const cgl_angle_observer_config *config);

/* Starts at this angle [2^-32 turns] and speed [rad/s], with an acceleration of 0. */
void cgl_angle_observer_reset(cgl_angle_observer *observer, uint32_t theta, cgl_real omega);

/* Takes the measured angle [2^-32 turns]. Afterwards the fields theta, omega and alpha are the estimates for the instant of this angle. */
void cgl_angle_observer_step(cgl_angle_observer *observer, uint32_t theta);

#ifdef __cplusplus
}
#endif

#endif
