/* Clarke and Park transforms, amplitude invariant: a balanced set of amplitude A gives |alpha beta| = |dq| = A. */
#ifndef COGLESS_TRANSFORM_H
#define COGLESS_TRANSFORM_H

#include "real.h"

/* From phase quantities to the stationary frame, without the zero sequence. */
static inline void cgl_clarke(const cgl_real abc[3], cgl_real *alpha, cgl_real *beta)
{
    *alpha = (CGL_R(2.0) * abc[0] - abc[1] - abc[2]) * CGL_R(0.33333333333333333333);
    *beta = (abc[1] - abc[2]) * CGL_R(0.57735026918962576451);
}

/* From the stationary frame to phase quantities without a zero sequence. */
static inline void cgl_clarke_inverse(cgl_real alpha, cgl_real beta, cgl_real abc[3])
{
    const cgl_real half = CGL_R(-0.5) * alpha;
    const cgl_real side = CGL_R(0.86602540378443864676) * beta;
    abc[0] = alpha;
    abc[1] = half + side;
    abc[2] = half - side;
}

/* From the stationary frame to the rotor's frame, whose d axis is at the angle of this sine and cosine. */
static inline void cgl_park(cgl_real alpha, cgl_real beta, cgl_real sine, cgl_real cosine, cgl_real *d, cgl_real *q)
{
    *d = cosine * alpha + sine * beta;
    *q = cosine * beta - sine * alpha;
}

/* From the rotor's frame to the stationary frame. */
static inline void cgl_park_inverse(cgl_real d, cgl_real q, cgl_real sine, cgl_real cosine, cgl_real *alpha,
                                    cgl_real *beta)
{
    *alpha = cosine * d - sine * q;
    *beta = sine * d + cosine * q;
}

#endif
