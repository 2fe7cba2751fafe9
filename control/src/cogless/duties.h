/* Duty cycles from voltages, which are given as shares of the bus voltage. foc.c and modulation.c use this file. */
#ifndef COGLESS_DUTIES_H
#define COGLESS_DUTIES_H

#include "choice.h"
#include "real.h"

/* Fills in the voltages that three half bridges must give, measured from the middle of the bus, for the voltage (alpha, beta). All voltages
 * are shares of the bus voltage. */
static inline void cgl_centred(cgl_real alpha, cgl_real beta, cgl_real part[3])
{
    const cgl_real half = CGL_R(-0.5) * alpha;
    const cgl_real side = CGL_R(0.86602540378443864676) * beta;
    const cgl_real reach = cgl_abs(side);
    const cgl_real lower = half - reach, upper = half + reach; /* the voltages of phases b and c */
    /* the phase voltages add up to zero, so the mean of the highest and the lowest is minus half the third one, `middle` */
    const cgl_real middle = CGL_CHOICE(alpha < lower, lower, CGL_CHOICE(alpha > upper, upper, alpha));
    const cgl_real shift = CGL_R(0.5) * middle;
    const cgl_real between = half + shift;
    part[0] = alpha + shift;
    part[1] = between + side;
    part[2] = between - side;
}

/* Duty cycles in [0, 1] for these voltages; 0.5 for NaN. */
static inline void cgl_duties(const cgl_real part[3], cgl_real duty[3])
{
    duty[0] = CGL_R(0.5) + cgl_clamp(part[0], CGL_R(0.5));
    duty[1] = CGL_R(0.5) + cgl_clamp(part[1], CGL_R(0.5));
    duty[2] = CGL_R(0.5) + cgl_clamp(part[2], CGL_R(0.5));
}

#endif
