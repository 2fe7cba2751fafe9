/* exp(-x) for 0 <= x <= 2, to the last digits. It is computed as 1 / exp(x), because the series of exp(x) has positive terms only. */
#ifndef COGLESS_DECAY_H
#define COGLESS_DECAY_H

#include <stdint.h>

#include "real.h"

static inline cgl_real cgl_decay(cgl_real x)
{
    cgl_real sum = CGL_R(1.0), term = CGL_R(1.0);
    for (uint32_t n = 1U; n <= 24U; ++n) {
        term *= x / (cgl_real)n;
        sum += term;
    }
    return CGL_R(1.0) / sum;
}

#endif
