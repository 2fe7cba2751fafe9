/* The core of cgl_sincos(), for a step that has checked its angle. */
#ifndef COGLESS_SINE_H
#define COGLESS_SINE_H

#include <stdint.h>

#include "angle.h"
#include "real.h"

/* Largest angle for which cgl_sincos_of_small() is meant [rad]. */
#define CGL_QUARTER (CGL_R(0.25) * CGL_PI)

/* Sine and cosine of r [rad], |r| up to pi/4 and slightly above. A double uses Taylor's series up to its last digit. A float uses
 * minimax polynomials with errors of 2e-9 and 1e-10. */
static inline void cgl_sincos_of_small(cgl_real r, cgl_real *sine, cgl_real *cosine)
{
    const cgl_real r2 = r * r;
#ifdef COGLESS_DOUBLE
    *sine =
        r
        * (1.0
           + r2
                 * (-1.0 / 6.0
                    + r2
                          * (1.0 / 120.0
                             + r2
                                   * (-1.0 / 5040.0
                                      + r2
                                            * (1.0 / 362880.0
                                               + r2
                                                     * (-1.0 / 39916800.0
                                                        + r2 * (1.0 / 6227020800.0 - r2 * (1.0 / 1307674368000.0))))))));
    *cosine =
        1.0
        + r2
              * (-0.5
                 + r2
                       * (1.0 / 24.0
                          + r2
                                * (-1.0 / 720.0
                                   + r2
                                         * (1.0 / 40320.0
                                            + r2
                                                  * (-1.0 / 3628800.0
                                                     + r2
                                                           * (1.0 / 479001600.0
                                                              + r2
                                                                    * (-1.0 / 87178291200.0
                                                                       + r2 * (1.0 / 20922789888000.0))))))));
#else
    *sine = r + r * r2 * (-0.166666507f + r2 * (0.00833197798f + r2 * -0.000194955489f));
    *cosine = 1.0f + r2 * (-0.5f + r2 * (0.0416666469f + r2 * (-0.00138873667f + r2 * 2.44383598e-05f)));
#endif
}

/* Sine and cosine of theta [rad], |theta| < CGL_ANGLE_MAX. */
static inline void cgl_sincos_of_angle(cgl_real theta, cgl_real *sine, cgl_real *cosine)
{
    /* theta = n pi/2 + r with |r| <= pi/4. To round n, a number is added whose last binary digit is worth 1. pi/2 is a sum of parts with
     * few digits. So the products of n with all parts but the last are exact. */
#ifdef COGLESS_DOUBLE
    const cgl_real rounded = theta * 0.63661977236758134308 + 6755399441055744.0;
    const cgl_real n = rounded - 6755399441055744.0;
    const cgl_real r = (theta - n * 1.57079632673412561417) - n * 6.07710050650619224932e-11;
#else
    const cgl_real rounded = theta * 0.63661977236758134308f + 12582912.0f;
    const cgl_real n = rounded - 12582912.0f;
    const cgl_real r = ((theta - n * 1.5703125f) - n * 4.825592041015625e-4f) - n * 1.267590795e-6f;
#endif
    cgl_real s, c;
    cgl_sincos_of_small(r, &s, &c);
    const uint32_t quadrant = (uint32_t)(int32_t)n;
    const bool odd = (quadrant & 1U) != 0U;
    const cgl_real a = odd ? c : s, b = odd ? s : c;
    *sine = (quadrant & 2U) != 0U ? -a : a;
    *cosine = ((quadrant + 1U) & 2U) != 0U ? -b : b;
}

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
