/* Angles: sine and cosine without libm, and positions within a period. */
#ifndef COGLESS_ANGLE_H
#define COGLESS_ANGLE_H

#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Sine and cosine of theta [rad], to 1.5e-7 (float) or 1e-15 (double) for |theta| below CGL_ANGLE_MAX.
 * Anything else, NaN included, gives sine 0 and cosine 1. */
void cgl_sincos(cgl_real theta, cgl_real *sine, cgl_real *cosine);

/* A sine as a complex number. Its product with another phasor stands at the sum of both angles. */
typedef struct {
    cgl_real cosine, sine;
} cgl_phasor;

static inline cgl_phasor cgl_product(cgl_phasor a, cgl_phasor b)
{
    const cgl_phasor product = {a.cosine * b.cosine - a.sine * b.sine, a.cosine * b.sine + a.sine * b.cosine};
    return product;
}

/* Phasor of an angle [turns of 2^32], to 1.5e-7 (float) or 1e-15 (double). A product adds its factors' errors and rounds by
 * sqrt(5) 2^-24 at most (double: 2^-53). So the phasor of order h that products make of lower ones is off by at most h 2.9e-7, in double
 * h 1.3e-15: in float that is what the rounding of the angle itself does to it. */
cgl_phasor cgl_phasor_of(uint32_t turns);

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
