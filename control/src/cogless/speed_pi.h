/* PI speed control: the baseline that every learning law stands beside. */
#ifndef COGLESS_SPEED_PI_H
#define COGLESS_SPEED_PI_H

#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Config and state are those of the scalar PI: kp [A s/rad], ki [A/rad], limit [A]. While in->off the output is 0 and the integral too; in
 * torque mode both are in->i_q_ref, but without ki there is no integral. */
void cgl_speed_pi_step(cgl_pi *pi, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
