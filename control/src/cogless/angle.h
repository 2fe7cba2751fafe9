/* Angles: sine and cosine without libm, and positions within a period. */
#ifndef COGLESS_ANGLE_H
#define COGLESS_ANGLE_H

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Sine and cosine of theta [rad], to 1.5e-7 (float) or 1e-15 (double) for |theta| below CGL_ANGLE_MAX.
 * Anything else, NaN included, gives sine 0 and cosine 1. */
void cgl_sincos(cgl_real theta, cgl_real *sine, cgl_real *cosine);

/* theta [rad], which is an angle, in revolutions of which 2^32 are one: they wrap as an angle does. */
static inline uint32_t cgl_turns(cgl_real theta)
{
    const cgl_real rest = cgl_rest(theta * (CGL_R(1.0) / CGL_TWO_PI));
#ifdef COGLESS_DOUBLE
    return (uint32_t)(int64_t)(rest * CGL_R(4294967296.0));
#else /* no bit is lost: a float has 24 */
    return (uint32_t)(int32_t)(rest * CGL_R(2147483648.0)) << 1;
#endif
}

/* Fractional part of x in [0, 1); 0 for what is not a plausible number. */
cgl_real cgl_fraction(cgl_real x);

/* theta [rad] plus the whole turns that bring it nearest to `near`: the angle without its jumps, where `near` is the last
 * one. `near` itself where either is not finite, or they are more than 1e9 turns apart. */
cgl_real cgl_unwrap(cgl_real theta, cgl_real near);

#ifdef __cplusplus
}
#endif

#endif
