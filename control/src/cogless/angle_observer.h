/* Speed from an angle alone: an observer of third order, of angle, speed and acceleration, with its three poles at one place. It
 * needs no edge times and no torque. At constant acceleration its speed is right; ripple beyond the bandwidth is smoothed.
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
    cgl_real bandwidth; /* of the three poles [rad/s], above 0, at most 2 / ts */
} cgl_angle_observer_config;

typedef struct {
    cgl_angle_observer_config config;
    cgl_real ts;            /* [s] */
    cgl_real l1, l2, l3;    /* gains [1], [1/s], [1/s^2] */
    cgl_real omega_max;     /* half a turn in a period [rad/s] */
    cgl_real alpha_max;     /* as fast a change in a period [rad/s^2] */
    uint32_t theta;         /* angle [turns of 2^32] */
    cgl_real omega;         /* speed [rad/s] */
    cgl_real alpha;         /* acceleration [rad/s^2] */
} cgl_angle_observer;

/* Takes the config, which need not stay; ts: period of the steps [s], > 0. The rotor counts as standing at 0. */
cgl_error cgl_angle_observer_init(cgl_angle_observer *observer, const cgl_angle_observer_config *config, cgl_real ts);

/* Another bandwidth while it runs: the state stays. Checked as by init. */
cgl_error cgl_angle_observer_retune(cgl_angle_observer *observer, const cgl_angle_observer_config *config);

/* The rotor is at this angle [turns] and turns at this speed [rad/s]. */
void cgl_angle_observer_reset(cgl_angle_observer *observer, uint32_t theta, cgl_real omega);

/* Takes in the measured angle [turns]; theta, omega and alpha are then those of this instant. */
void cgl_angle_observer_step(cgl_angle_observer *observer, uint32_t theta);

#ifdef __cplusplus
}
#endif

#endif
