/* Corrects the position sensor's own error, such as that of an eccentric encoder. The table learns this error while the motor turns fast,
 * and corrects it at any speed. Correct the angle before any other use. Also correct the speed that is estimated from the angle. Then a map
 * learns the motor and not the sensor.
 *
 * The error is a sum of waves of a few low orders n of the angle. Their amplitudes do not depend on the speed. The angle ripple that a
 * torque ripple makes falls with the square of the speed, because of the inertia. An observer predicts the angle from the motor's current,
 * and the sensor slowly corrects the prediction. So above omega_min, a wave of one of the orders in the difference of sensor and observer
 * is an error of the sensor. With n = order[k]:
 *
 *   error = sum over k of a[k] cos(n theta) + c[k] sin(n theta)
 *   theta_m = theta - error,   e = theta_m - (angle of the observer)
 *   a[k] += 2 gain ts cos(n theta) e,   c[k] += 2 gain ts sin(n theta) e
 *
 * The prediction needs the current, because the control loop makes the rotor follow the sensor's error. A prediction without the current
 * would follow the sensor's error as well, and the error would not show.
 *
 * A measured speed is the mean over a window of time. The error of this speed is the difference of the angle errors at both ends of the
 * window, divided by the window's time. Correct the angle first, then the speed:
 *
 *   now.theta_m = cgl_radians(encoder.turns);
 *   cgl_encoder_table_step(&table, &now, drive.i_q, learn);
 *   mean = cgl_speed_count_step(&speed, encoder.count);
 *   now.omega_m = cgl_encoder_table_speed(&table, mean, speed.time);
 *
 * An observer takes the corrected angle instead:
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
    uint32_t order[CGL_ENCODER_TABLE_ORDERS]; /* learned orders: periods of a wave per mechanical revolution, rising, 1 to 1000 */
    cgl_real gain;                            /* 1 / time constant of learning [1/s], >= 0, well below omega_min, at most 0.1 / ts */
    cgl_real omega_min;                       /* lowest mechanical speed at which the table learns [rad/s], > 0 */
    cgl_real bandwidth;                       /* bandwidth of the observer [rad/s], > 0, at most a third of omega_min order[0] */
    cgl_real b;                               /* acceleration per current, K_t / J [rad/s^2/A], >= 0 */
    cgl_real limit;                           /* bound of the magnitude of each a[k] and c[k] [rad], > 0, at most 1 / (highest order) */
} cgl_encoder_table_config;

typedef struct {
    cgl_encoder_table_config config;
    cgl_angle_observer observer;
    cgl_real a[CGL_ENCODER_TABLE_ORDERS], c[CGL_ENCODER_TABLE_ORDERS]; /* learned coefficients of cosine and of sine [rad]; the
                                                                          caller may save and restore them */
    cgl_real theta;  /* uncorrected angle of the last step [rad] */
    cgl_real error;  /* error that the last step subtracted from theta [rad] */
    uint32_t settle; /* number of steps in which the observer settles: 10 / (bandwidth ts) */
    uint32_t wait;   /* steps until the observer has settled; until then nothing is learned */
    bool learning;   /* the last step has learned */
} cgl_encoder_table;

/* Copies the config. ts is the period of the steps [s], > 0. */
cgl_error cgl_encoder_table_init(cgl_encoder_table *table, const cgl_encoder_table_config *config, cgl_real ts);

/* Clears what is learned. */
void cgl_encoder_table_reset(cgl_encoder_table *table);

/* Replaces the config at run time, within the ranges that init accepts. The orders must not change. What is learned stays, within the
 * new limit. */
cgl_error cgl_encoder_table_retune(cgl_encoder_table *table, const cgl_encoder_table_config *config);

/* Corrects theta_m of `now`, and learns if `learn` is true and the rotor turns fast enough. omega_m of `now` is read and not changed; the
 * speed of the last period is good enough for it. i_q is the measured current [A]. If angle or speed is not finite, or the angle is beyond
 * CGL_ANGLE_MAX, the angle stays as it is and learning waits. */
void cgl_encoder_table_step(cgl_encoder_table *table, cgl_measurement *now, cgl_real i_q, bool learn);

/* Returns the speed omega_m [rad/s] without the sensor's error. omega_m is the mean speed over the window `time` [s], as cgl_speed_count or
 * cgl_speed_timed gives it; the window ends at the last step. If `time` is not above 0, omega_m is returned as it is. */
cgl_real cgl_encoder_table_speed(const cgl_encoder_table *table, cgl_real omega_m, cgl_real time);

/* Returns the sensor's angle of the last step, `turns`, without the sensor's error [2^-32 turns]. Pass the result to an observer. */
uint32_t cgl_encoder_table_turns(const cgl_encoder_table *table, uint32_t turns);

#ifdef __cplusplus
}
#endif

#endif
