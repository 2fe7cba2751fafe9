/* Sine and cosine without libm, and positions within a period. */
#ifndef COGLESS_ANGLE_H
#define COGLESS_ANGLE_H

#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Sine and cosine of theta [rad], to 1.5e-7 (float) or 1e-15 (double) for |theta| below CGL_ANGLE_MAX.
 * Any other theta, and NaN, gives sine 0 and cosine 1. */
void cgl_sincos(cgl_real theta, cgl_real *sine, cgl_real *cosine);

/* cos + j sin of an angle. The product of two phasors is the phasor of the sum of their angles. */
typedef struct {
    cgl_real cosine, sine;
} cgl_phasor;

static inline cgl_phasor cgl_product(cgl_phasor a, cgl_phasor b)
{
    const cgl_phasor product = {a.cosine * b.cosine - a.sine * b.sine, a.cosine * b.sine + a.sine * b.cosine};
    return product;
}

/* Phasor of an angle [2^-32 turns], to 1.5e-7 (float) or 1e-15 (double). The errors of two phasors add up in their product. The rounding of
 * the product adds at most sqrt(5) 2^-24 (double: sqrt(5) 2^-53). So the phasor of h times the angle, computed as a product of phasors, has
 * an error of at most h 2.9e-7 (double: h 1.3e-15). A float angle in [0, 2 pi) has itself a rounding error of up to 2.4e-7 rad, which makes
 * about as large an error. */
cgl_phasor cgl_phasor_of(uint32_t turns);

/* Returns theta [rad], |theta| < CGL_ANGLE_MAX, in units of 2^-32 turns. The returned integer wraps once a turn. */
static inline uint32_t cgl_turns(cgl_real theta)
{
    const cgl_real rest = cgl_rest(theta * (CGL_R(1.0) / CGL_TWO_PI));
#ifdef COGLESS_DOUBLE
    return (uint32_t)(int64_t)(rest * CGL_R(4294967296.0));
#else /* rest * 2^32 might not fit into an int32_t; the shift leaves an error below 2^-31 turns */
    return (uint32_t)(int32_t)(rest * CGL_R(2147483648.0)) << 1;
#endif
}

/* Returns the fractional part of x, in [0, 1); 0 if |x| is not below 1e9. */
cgl_real cgl_fraction(cgl_real x);

/* Returns theta [rad] plus the whole turns that bring it nearest to `near` [rad]. If `near` is the previous result, an angle that wraps is
 * turned into an angle that does not wrap. If theta or `near` is not finite, or the two are 1e9 turns or more apart, the result is
 * `near`. */
cgl_real cgl_unwrap(cgl_real theta, cgl_real near);

#ifdef __cplusplus
}
#endif

#endif
