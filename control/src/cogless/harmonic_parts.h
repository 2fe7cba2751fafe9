/* The sum of the orders of cgl_harmonic_step(). Only the ranges of the orders decide its branches, so laws with the same ranges can take it
 * together: see choice.h. */
#ifndef COGLESS_HARMONIC_PARTS_H
#define COGLESS_HARMONIC_PARTS_H

#include <stdint.h>

#include "angle.h"
#include "choice.h"
#include "real.h"

/* begin <= end <= low <= acting are indices of orders. The sum is that of the orders 0 to acting - 1. `loads` corrects the slow orders from
 * `begin` to end - 1, and `error` corrects all fast ones, from `low` to acting - 1. */
typedef struct {
    cgl_real *cosine, *sine; /* amplitudes [A] */
    const cgl_real *gain;    /* pairs of gains for learning [A/turn] */
    uint32_t begin, end, low, acting;
    cgl_phasor first;        /* phasor of the lowest order at the angle of the sum */
    cgl_real loads, error;   /* what slow orders learn from [turns/ts^2], and what fast orders learn from [turns] */
    cgl_real limit;          /* bound of the sum, and of each amplitude [A] */
    cgl_real phase_sum;      /* as in cgl_harmonic_bend [A^2] */
} cgl_orders;

/* Corrects orders, and returns the sum of those that act [A]. */
static inline cgl_real cgl_sum_of_orders(cgl_orders *orders)
{
    cgl_real *const a = orders->cosine, *const b = orders->sine;
    const cgl_real *const w = orders->gain;
    const cgl_real limit = orders->limit;
    const cgl_phasor first = orders->first;
    cgl_phasor at = first;
    cgl_real sum = CGL_R(0.0), moved = CGL_R(0.0), seen = orders->loads;
    uint32_t k = 0U, begin = orders->begin, end = orders->end;
    for (uint32_t part = 0U; part < 2U; ++part) {
        for (; k < begin; ++k) {
            sum += a[k] * at.cosine + b[k] * at.sine;
            at = cgl_product(at, first);
        }
        for (; k < end; ++k) {
            const cgl_real p = seen * w[2U * k], q = seen * w[2U * k + 1U];
            const cgl_real less = p * at.cosine + q * at.sine, more = q * at.cosine - p * at.sine;
            moved += a[k] * more + b[k] * less;
            const cgl_real cosine = cgl_clamp_here(a[k] - less, limit), sine = cgl_clamp_here(b[k] + more, limit);
            a[k] = cosine;
            b[k] = sine;
            sum += cosine * at.cosine + sine * at.sine;
            at = cgl_product(at, first);
        }
        if (part == 0U) {
            orders->phase_sum += moved;
        }
        if (k >= orders->acting) {
            break;
        }
        begin = orders->low;
        end = orders->acting;
        seen = orders->error;
    }
    return cgl_clamp(sum, limit);
}

#endif
