/* PI speed control, the baseline with which every learning law is compared. */
#ifndef COGLESS_SPEED_PI_H
#define COGLESS_SPEED_PI_H

#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Config and state are those of the scalar PI, with kp [A s/rad], ki [A/rad] and limit [A]. While in->off, the output and the integral
 * are 0. In torque mode both are in->i_q_ref, but the integral is 0 if the integral gain in use is 0. */
void cgl_speed_pi_step(cgl_pi *pi, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
