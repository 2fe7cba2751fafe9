/* Phasors of an angle ahead and of turns, for a step that has checked its angle. */
#ifndef COGLESS_SINE_H
#define COGLESS_SINE_H

#include <stdint.h>

#include "angle.h"
#include "real.h"

/* Phasor of a finite angle [rad], fast if the angle's magnitude is at most CGL_QUARTER. A larger angle is halved until the series holds,
 * and then the phasor is squared as many times. Each squaring doubles the error. */
static inline cgl_phasor cgl_phasor_ahead(cgl_real angle)
{
    cgl_phasor phasor;
    uint32_t halvings = 0U;
    while (!CGL_OFTEN(cgl_is_within(angle, CGL_QUARTER))) {
        angle *= CGL_R(0.5);
        ++halvings;
    }
    cgl_sincos_of_small(angle, &phasor.sine, &phasor.cosine);
    while (halvings > 0U) {
        phasor = cgl_product(phasor, phasor);
        --halvings;
    }
    return phasor;
}

/* Sine and cosine of an angle [2^-32 turns]. The two highest bits tell the quarter of the turn. */
static inline void cgl_sincos_of_turns(uint32_t turns, cgl_real *sine, cgl_real *cosine)
{
    const uint32_t ahead = turns + 0x20000000U;
    const int32_t rest = (int32_t)(ahead & 0x3FFFFFFFU) - 0x20000000;
    cgl_real s, c;
    cgl_sincos_of_small((cgl_real)rest * (CGL_TWO_PI / CGL_R(4294967296.0)), &s, &c);
    const bool odd = (ahead & 0x40000000U) != 0U;
    const cgl_real a = odd ? c : s, b = odd ? s : c;
    *sine = (ahead & 0x80000000U) != 0U ? -a : a;
    *cosine = ((ahead + 0x40000000U) & 0x80000000U) != 0U ? -b : b;
}

#endif
