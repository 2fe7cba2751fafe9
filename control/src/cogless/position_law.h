/* What every law that follows a moving reference of angle gets, once per speed-loop period. It gives a
 * cgl_speed_output. */
#ifndef COGLESS_POSITION_LAW_H
#define COGLESS_POSITION_LAW_H

#include "speed_law.h"

typedef struct {
    cgl_real theta_ref; /* mechanical angle reference [rad], any revolution below CGL_ANGLE_MAX */
    cgl_real omega_ref; /* its derivative: mechanical speed reference [rad/s] */
    cgl_real alpha_ref; /* the derivative of that [rad/s^2] */
    cgl_real theta_m;   /* measured mechanical angle [rad], any revolution below CGL_ANGLE_MAX */
    cgl_real omega_m;   /* measured mechanical speed [rad/s] */
    bool learn;         /* false freezes what is learned */
} cgl_position_input;

#endif
