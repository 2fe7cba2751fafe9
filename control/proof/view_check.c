/* view.h against real.h as it is compiled for the machine: the same for every NaN of a float, and for every 509th other
 * bit pattern (of a double, as many); what is behind the point for every float. Limits: those that the library compares
 * with, and corners. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "cogless/angle.h"

static const cgl_real limits[] = {CGL_R(0.5), CGL_R(3.0), CGL_R(1.0e9), CGL_ANGLE_MAX, CGL_REAL_MAX, CGL_R(1.0e-40)};

/* As real.c has it. */
cgl_real cgl_clamped_as_written(cgl_real x, cgl_real limit) { return cgl_clamp_here_as_written(x, limit); }

static bool same(cgl_real a, cgl_real b) { return a == b || (a != a && b != b); }

static bool agrees(cgl_real x)
{
    bool good = cgl_is_finite(x) == cgl_is_finite_as_written(x) && cgl_is_angle(x) == cgl_is_angle_as_written(x)
                && cgl_is_in_turn(x) == cgl_is_in_turn_as_written(x)
                && cgl_is_positive(x) == (x > CGL_R(0.0) && x <= CGL_REAL_MAX)
                && cgl_is_not_negative(x) == (x >= CGL_R(0.0) && x <= CGL_REAL_MAX);
    for (unsigned n = 0; n < sizeof limits / sizeof limits[0]; ++n) {
        const cgl_real limit = limits[n];
        good = good && cgl_is_within(x, limit) == cgl_is_within_as_written(x, limit)
               && cgl_is_below(x, limit) == cgl_is_below_as_written(x, limit)
               && same(cgl_clamp(x, limit), cgl_clamp_as_written(x, limit))
               && same(cgl_clamp_here(x, limit), cgl_clamp_here_as_written(x, limit));
    }
    return good;
}

static cgl_real number(uint64_t n)
{
    cgl_real x;
#ifdef COGLESS_DOUBLE
    const uint64_t bits = n * 0x9E3779B97F4A7C15U; /* spread over all of them */
#else
    const uint32_t bits = (uint32_t)n;
#endif
    memcpy(&x, &bits, sizeof x);
    return x;
}

int main(void)
{
    const uint64_t patterns = 0x100000000U;
    bool good = true;
    for (uint64_t n = 0; n < patterns; n += 509U) {
        good = good && agrees(number(n));
    }
    for (uint64_t n = 0x7F800001U; n <= 0x7FFFFFFFU; ++n) { /* float: the NaNs, either sign */
        good = good && agrees(number(n)) && agrees(number(n | 0x80000000U));
    }
    for (uint64_t n = 0; n < patterns; ++n) {
        const cgl_real x = number(n);
        if (x > CGL_R(-2147483648.0) && x < CGL_R(2147483648.0)) {
            const cgl_real rest = cgl_rest_as_written(x);
            good = good && rest > CGL_R(-1.0) && rest < CGL_R(1.0);
        }
    }
    if (!good) {
        fprintf(stderr, "control/proof/view.h does not say the same as real.h\n");
    }
    return good ? 0 : 1;
}
