#include "angle.h"

#include <stdint.h>

#include "sine.h"

/* Largest integer not above x, for |x| < 2^31. */
static int32_t floor_to_int(cgl_real x)
{
    const int32_t truncated = (int32_t)x;
    return (cgl_real)truncated > x ? truncated - 1 : truncated;
}

void cgl_sincos(cgl_real theta, cgl_real *sine, cgl_real *cosine)
{
    if (!cgl_is_angle(theta)) {
        *sine = CGL_R(0.0);
        *cosine = CGL_R(1.0);
        return;
    }
    cgl_real s, c;
    cgl_sincos_of_angle(theta, &s, &c);
    *sine = s;
    *cosine = c;
}

CGL_APART cgl_phasor cgl_phasor_of(uint32_t turns)
{
    cgl_phasor phasor;
    cgl_sincos_of_turns(turns, &phasor.sine, &phasor.cosine);
    return phasor;
}

cgl_real cgl_fraction(cgl_real x)
{
    if (!cgl_is_below(x, CGL_R(1.0e9))) {
        return CGL_R(0.0);
    }
    const cgl_real rest = cgl_rest(x), fraction = rest < CGL_R(0.0) ? rest + CGL_R(1.0) : rest;
    return fraction < CGL_R(1.0) ? fraction : CGL_R(0.0); /* for a tiny negative x, rest + 1 rounds up to 1 */
}

cgl_real cgl_unwrap(cgl_real theta, cgl_real near)
{
    const cgl_real turns = (near - theta) * (CGL_R(1.0) / CGL_TWO_PI);
    if (!cgl_is_below(turns, CGL_R(1.0e9))) {
        return near;
    }
    return theta + CGL_TWO_PI * (cgl_real)floor_to_int(turns + CGL_R(0.5));
}
