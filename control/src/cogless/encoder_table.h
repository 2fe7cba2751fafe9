/* The position sensor's own error, such as that of an encoder that does not sit in the middle: learned while the motor turns fast,
 * then corrected at any speed. The correction of the angle comes before any other use of it, and the speed that is estimated from the
 * angle is corrected, too. So a map learns the motor and not the sensor.
 *
 * The error is a sum of few low orders of the angle, cos and sin of each. Its angle does not depend on speed; that of a torque
 * ripple falls with the speed's square, as the inertia holds against it. Above omega_min an observer predicts the angle from the
 * motor's current, slowly corrected by the sensor. Where sensor and prediction differ with one of the orders it is the sensor:
 *
 *   e = theta - c(theta) - predicted,   a_n += 2 gain ts cos(n theta) e,   b_n += 2 gain ts sin(n theta) e
 *   c(theta) = sum of a_n cos(n theta) + b_n sin(n theta)
 *   theta_m = theta - c(theta)
 *
 * The current matters, since the loop makes the rotor follow the sensor's error, and nothing of it would be seen.
 *
 * A measured speed is the mean over a window of time. Its error is the difference of the angle's errors at both ends of the window,
 * divided by that time. An observer takes the corrected angle. So correct the angle first, then estimate the speed:
 *
 *   now.theta_m = cgl_radians(encoder.turns);
 *   cgl_encoder_table_step(&table, &now, drive.i_q, learn);
 *   mean = cgl_speed_count_step(&speed, encoder.count);
 *   now.omega_m = cgl_encoder_table_speed(&table, mean, speed.time);
 *
 * or, with an observer,
 *
 *   cgl_angle_observer_step(&speed, cgl_encoder_table_turns(&table, encoder.turns));
 *   now.omega_m = speed.omega; */
#ifndef COGLESS_ENCODER_TABLE_H
#define COGLESS_ENCODER_TABLE_H

#include <stdint.h>

#include "angle_observer.h"
#include "monitor.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_ENCODER_TABLE_ORDERS 4

typedef struct {
    uint32_t orders;                          /* number of orders, 1 to CGL_ENCODER_TABLE_ORDERS */
    uint32_t order[CGL_ENCODER_TABLE_ORDERS]; /* of the mechanical revolution, rising, from 1 to 1000 */
    cgl_real gain;                            /* 1 / time constant of learning [1/s], >= 0, well below omega_min */
    cgl_real omega_min;                       /* learns above it [rad/s], > 0 */
    cgl_real bandwidth;                       /* of the observer [rad/s], > 0, at most a third of omega_min order[0] */
    cgl_real b;                               /* acceleration per current, K_t / J [rad/s^2/A], >= 0 */
    cgl_real limit;                           /* of each coefficient [rad], > 0, up to 1 / order[] */
} cgl_encoder_table_config;

typedef struct {
    cgl_encoder_table_config config;
    cgl_angle_observer observer;
    cgl_real a[CGL_ENCODER_TABLE_ORDERS], c[CGL_ENCODER_TABLE_ORDERS]; /* of cosine and sine [rad]; may be stored and put back */
    cgl_real theta;  /* uncorrected angle of the last step [rad] */
    cgl_real error;  /* error that the last step took out of that angle [rad] */
    uint32_t settle; /* steps after which the observer has forgotten its start */
    uint32_t wait;   /* of them, still to come */
    bool learning;   /* something was learned in the last step */
} cgl_encoder_table;

/* Takes the config, which need not stay; ts: period of the steps [s], > 0. */
cgl_error cgl_encoder_table_init(cgl_encoder_table *table, const cgl_encoder_table_config *config, cgl_real ts);

/* Forgets what was learned. */
void cgl_encoder_table_reset(cgl_encoder_table *table);

/* Other constants; the orders must stay. Keeps what was learned, within the new limit. Checked as by init. */
cgl_error cgl_encoder_table_retune(cgl_encoder_table *table, const cgl_encoder_table_config *config);

/* Corrects theta_m of `now`, and learns if `learn` is true and the rotor turns fast enough. The step reads omega_m, and leaves it as
 * it is; the speed of the last period is good enough. i_q: measured current [A]. If angle or speed is not finite, or the angle is
 * beyond CGL_ANGLE_MAX, the angle stays as it is and learning waits. */
void cgl_encoder_table_step(cgl_encoder_table *table, cgl_measurement *now, cgl_real i_q, bool learn);

/* The speed omega_m [rad/s] without the sensor's error. omega_m is the mean over `time` [s], which cgl_speed_count or cgl_speed_timed
 * gives: from the angle omega_m time before the last step's to that angle. If time is not above 0, the speed stays as it is. */
cgl_real cgl_encoder_table_speed(const cgl_encoder_table *table, cgl_real omega_m, cgl_real time);

/* `turns`, the sensor's angle of the last step, without the sensor's error: for an observer. */
uint32_t cgl_encoder_table_turns(const cgl_encoder_table *table, uint32_t turns);

#ifdef __cplusplus
}
#endif

#endif
