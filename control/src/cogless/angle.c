#include "angle.h"

#include <stdint.h>

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
    /* theta = quadrant pi/2 + r with |r| <= pi/4; pi/2 in parts so short that their products with the quadrant
     * are exact, but for the last one */
    const int32_t quadrant = floor_to_int(theta * CGL_R(0.63661977236758134308) + CGL_R(0.5));
    const cgl_real n = (cgl_real)quadrant;
#ifdef COGLESS_DOUBLE
    const cgl_real r = (theta - n * 1.57079632673412561417) - n * 6.07710050650619224932e-11;
#else
    const cgl_real near = (theta - n * 1.5703125f) - n * 4.825592041015625e-4f;
    const cgl_real r = (near - n * 1.2665987014770508e-6f) - n * 9.920936294705029e-10f;
#endif
    const cgl_real r2 = r * r;

    /* Taylor's series, as far as the type can see */
#ifdef COGLESS_DOUBLE
    const cgl_real s =
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
    const cgl_real c =
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
    const cgl_real s =
        r * (1.0f + r2 * (-1.0f / 6.0f + r2 * (1.0f / 120.0f + r2 * (-1.0f / 5040.0f + r2 * (1.0f / 362880.0f)))));
    const cgl_real c = 1.0f + r2 * (-0.5f + r2 * (1.0f / 24.0f + r2 * (-1.0f / 720.0f + r2 * (1.0f / 40320.0f))));
#endif

    switch ((uint32_t)quadrant & 3U) {
    case 0:
        *sine = s;
        *cosine = c;
        break;
    case 1:
        *sine = c;
        *cosine = -s;
        break;
    case 2:
        *sine = -s;
        *cosine = -c;
        break;
    default:
        *sine = -c;
        *cosine = s;
        break;
    }
}

cgl_real cgl_fraction(cgl_real x)
{
    if (!(x > CGL_R(-1.0e9) && x < CGL_R(1.0e9))) {
        return CGL_R(0.0);
    }
    const cgl_real fraction = x - (cgl_real)floor_to_int(x);
    return fraction < CGL_R(1.0) ? fraction : CGL_R(0.0); /* a tiny negative x rounds up to 1 */
}

cgl_real cgl_unwrap(cgl_real theta, cgl_real near)
{
    const cgl_real turns = (near - theta) * (CGL_R(1.0) / CGL_TWO_PI);
    if (!(turns > CGL_R(-1.0e9) && turns < CGL_R(1.0e9))) {
        return near;
    }
    return theta + CGL_TWO_PI * (cgl_real)floor_to_int(turns + CGL_R(0.5));
}
