/* What every speed law gets and gives, once per speed-loop period. */
#ifndef COGLESS_SPEED_LAW_H
#define COGLESS_SPEED_LAW_H

#include "real.h"
#include "status.h"

typedef struct {
    cgl_real omega_ref; /* mechanical speed reference [rad/s] */
    cgl_real omega_m;   /* measured mechanical speed [rad/s] */
    cgl_real theta_m;   /* measured mechanical angle [rad], any revolution below CGL_ANGLE_MAX */
    cgl_real i_q;       /* measured q-axis current [A]; only a calibration run reads it */
    bool learn;         /* false freezes what is learned */
} cgl_speed_input;

typedef struct {
    cgl_real i_q_ref; /* reference for the current loop [A], within the law's limit */
    unsigned status;  /* CGL_STATUS_ bits */
} cgl_speed_output;

#endif
