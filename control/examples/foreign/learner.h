/* A learned current beside somebody else's loop: that loop controls, this adds to its current what it learned. */
#ifndef LEARNER_H
#define LEARNER_H

#include "cogless/drive.h"
#include "cogless/pi_ilc.h"

enum { LEARNER_CELLS = 512, LEARNER_Q = 1 };

/* What the learner must be told of the loop that it helps. */
typedef struct {
    cgl_real rate;          /* calls of learner_current a second [Hz] */
    cgl_real kp;            /* current per speed error [A s/rad] */
    cgl_real ki;            /* current per integral of the speed error, or per position error [A/rad]; 0 where it has neither */
    cgl_real delay;         /* time from a current to the speed that the loop reads, filters included [s] */
    cgl_real current_limit; /* of the loop [A] */
} loop_gains;

typedef struct {
    cgl_drive drive;
    cgl_pi_ilc law;
    cgl_real map[CGL_MEMORY_ROW(LEARNER_CELLS, LEARNER_Q)];
} learner;

/* NULL, or the field that is refused. */
const char *learner_start(learner *self, const loop_gains *gains);

/* The current to add [A]. theta_m [rad], omega_m and omega_ref [rad/s] as the loop has them. learn: false while the loop is at a limit
 * of current or voltage, or off. */
cgl_real learner_current(learner *self, cgl_real theta_m, cgl_real omega_m, cgl_real omega_ref, bool learn);

#endif
