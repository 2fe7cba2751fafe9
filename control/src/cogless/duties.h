/* Duty cycles of voltages that are given as fractions of the bus voltage. Internal to cgl_modulate. */
#ifndef COGLESS_DUTIES_H
#define COGLESS_DUTIES_H

#include "real.h"

/* Duty cycles in [0, 1] of three half bridges for the voltage (alpha, beta), in parts of the bus; not finite: 0.5. */
static inline void cgl_duties(cgl_real alpha, cgl_real beta, cgl_real duty[3])
{
    const cgl_real half = CGL_R(-0.5) * alpha;
    const cgl_real side = CGL_R(0.86602540378443864676) * beta;
    const cgl_real reach = cgl_abs(side);
    const cgl_real lower = half - reach, upper = half + reach; /* of the phases b and c */
    /* the three add up to zero: the mean of highest and lowest is minus half the middle one */
    const cgl_real middle = alpha < lower ? lower : (alpha > upper ? upper : alpha);
    const cgl_real shift = CGL_R(0.5) * middle;
    const cgl_real between = half + shift;
    duty[0] = CGL_R(0.5) + cgl_clamp_here(alpha + shift, CGL_R(0.5));
    duty[1] = CGL_R(0.5) + cgl_clamp_here(between + side, CGL_R(0.5));
    duty[2] = CGL_R(0.5) + cgl_clamp_here(between - side, CGL_R(0.5));
}

/* Duty cycles of two H-bridges for the voltages a and b, in parts of the bus. */
static inline void cgl_duties_of_two(cgl_real a, cgl_real b, cgl_real duty[3])
{
    duty[0] = CGL_R(0.5) + cgl_clamp_here(CGL_R(0.5) * a, CGL_R(0.5));
    duty[1] = CGL_R(0.5) + cgl_clamp_here(CGL_R(0.5) * b, CGL_R(0.5));
    duty[2] = CGL_R(0.5);
}

#endif
