/* Controller "${controller}" of the study ${study}:
${title_comment}
 *
 * Written by cogless ${version}; change the study and export again rather than this file. The configured constants are
 * in ${stem}.c.
 *
 * law              ${law}: the currents of a step motor's coils at a commanded angle, without a sensor
 * study            ${study}, sha256 of its tables:
 *                  ${hash}
 * precision        ${precision}
 * ${name}_step is called in each period of the coils' current loops, ${rate} times a second in the study
 */
#ifndef ${NAME}_CONTROLLER_H
#define ${NAME}_CONTROLLER_H

${macro_checks}

#include "cogless/microstepping.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All that changes, without a heap or pointers. */
typedef struct {
    cgl_microstepping law;
} ${name}_controller;

/* The configured constants; they can stay in flash. */
extern const cgl_microstepping_config ${name}_law_config;

/* Once. Do not switch the coils on where this is not CGL_OK. */
cgl_error ${name}_init(${name}_controller *controller);

/* Commands the angle 0, with the correction of positive speed to follow. */
void ${name}_reset(${name}_controller *controller);

/* One period: the commanded angle [rad, mechanical] and its speed [rad/s] in, the references of the coils' currents [A] and the
 * status out. Never fails, whatever comes in. */
void ${name}_step(${name}_controller *controller, cgl_real theta_ref, cgl_real omega_ref, cgl_microstepping_output *out);

#ifdef __cplusplus
}
#endif

#endif
