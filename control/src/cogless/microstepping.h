/* Microstepping: the currents of a two-phase step motor's coils for a commanded angle, without a sensor. The motor's field pulls the
 * rotor after the current vector, with the torque T_h sin(command - theta_e), T_h = K_t current. Errors of the coils' offsets and gains,
 * and the detent torque, turn the rotor off the command. These deviations are waves of a few electrical orders. A correction of the command
 * cancels the waves. With the electrical angle u of the reference, the corrected command is
 *
 *   u + sum of magnitude sin(order u + phase),
 *
 * with a table of waves for each direction, because friction shifts the waves' phases. A table fits only the current at which it was found.
 * In each period of the driver:
 *
 *   cgl_microstepping_step(&motor, theta_ref, omega_ref, &out);
 *   the driver's current loops: out.i_a, out.i_b */
#ifndef COGLESS_MICROSTEPPING_H
#define COGLESS_MICROSTEPPING_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_MICROSTEPPING_WAVES 8
#define CGL_MICROSTEPS_DEFAULT 256
#define CGL_MICROSTEPS_MAX 1024

typedef struct {
    uint32_t order;     /* periods of the wave in an electrical revolution, 1 to 65535; 0: the wave is not used; default 0 */
    cgl_real magnitude; /* amplitude of the wave [rad, electrical], >= 0; default 0 */
    cgl_real phase;     /* phase of the wave [rad], |phase| < CGL_ANGLE_MAX; default 0 */
} cgl_microstepping_wave;

typedef struct {
    uint32_t teeth;      /* teeth of the rotor, electrical revolutions in a mechanical one, 1 to 65535 */
    cgl_real current;    /* amplitude of both coils' currents [A], > 0 */
    uint32_t microsteps; /* microsteps in a full step, a power of two up to CGL_MICROSTEPS_MAX; 0 stands for CGL_MICROSTEPS_DEFAULT */
    cgl_microstepping_wave forward[CGL_MICROSTEPPING_WAVES];  /* correction at positive speed; the sum of order * magnitude is below 1,
                                                                 so that the command never turns back */
    cgl_microstepping_wave backward[CGL_MICROSTEPPING_WAVES]; /* the same at negative speed */
} cgl_microstepping_config;

typedef struct {
    cgl_microstepping_config config;
    uint32_t ready;     /* CGL_READY after a successful init */
    uint32_t microstep; /* angle of a microstep [2^-32 electrical turns] */
    uint32_t command;   /* commanded angle with its correction [2^-32 electrical turns], a multiple of microstep */
    uint32_t phase_forward[CGL_MICROSTEPPING_WAVES], phase_backward[CGL_MICROSTEPPING_WAVES]; /* phases of the waves [2^-32 turns] */
    bool backward;      /* true: the last speed that was not 0 was negative */
} cgl_microstepping;

typedef struct {
    cgl_real i_a, i_b; /* references of the coils' currents [A], each within +-current */
    unsigned status;   /* CGL_STATUS_ bits */
} cgl_microstepping_output;

/* The first field that init refuses, as CGL_FIELD, or NULL. */
const char *cgl_microstepping_bad_field(const cgl_microstepping_config *config);

/* Copies the config. */
cgl_error cgl_microstepping_init(cgl_microstepping *motor, const cgl_microstepping_config *config);

/* Commands the angle 0, with the table `forward` to follow. */
void cgl_microstepping_reset(cgl_microstepping *motor);

/* Replaces the config at run time, within the ranges that init accepts. */
cgl_error cgl_microstepping_retune(cgl_microstepping *motor, const cgl_microstepping_config *config);

/* Computes the coils' currents for the mechanical angle theta_ref [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX.
 * With float, angles of the first revolution are the most exact. omega_ref is the speed of theta_ref [rad/s], of which only the sign is
 * used. While theta_ref or omega_ref is not plausible, the last command stays, with CGL_STATUS_FAULT. Without a successful init the
 * currents are 0, with CGL_STATUS_FAULT and CGL_STATUS_OFF. */
void cgl_microstepping_step(cgl_microstepping *motor, cgl_real theta_ref, cgl_real omega_ref, cgl_microstepping_output *out);

#ifdef __cplusplus
}
#endif

#endif
