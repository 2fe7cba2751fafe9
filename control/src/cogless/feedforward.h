/* Dynamic feedforward from a reference that is known in advance (Mandra 2019, (41)):
 *
 *   f(p) = sum_i num[i] y_ref(p + preview - i) - sum_{j >= 1} den[j] f(p - j)
 *
 * Before the first sample the reference counts as constant at its first value, and after the last sample as constant at its last value. */
#ifndef COGLESS_FEEDFORWARD_H
#define COGLESS_FEEDFORWARD_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_FEEDFORWARD_TAPS 16

typedef struct {
    uint32_t numerator;                 /* number of coefficients in num, 0 to CGL_FEEDFORWARD_TAPS; 0: no feedforward; default 0 */
    uint32_t denominator;               /* number of coefficients in den, 1 to CGL_FEEDFORWARD_TAPS; 1: no recursion */
    uint32_t preview;                   /* number of samples by which the filter looks ahead, 0 to 65535 */
    cgl_real num[CGL_FEEDFORWARD_TAPS]; /* coefficients on the reference [output/reference], finite */
    cgl_real den[CGL_FEEDFORWARD_TAPS]; /* coefficients of the recursion [-]; den[0] is 1, and all roots are inside the unit circle */
} cgl_feedforward_config;

typedef struct {
    cgl_real past[CGL_FEEDFORWARD_TAPS]; /* earlier outputs f(p - 1), f(p - 2), ..., which only a recursion uses */
} cgl_feedforward;

cgl_error cgl_feedforward_init(const cgl_feedforward_config *config, cgl_feedforward *feedforward);

/* Starts in the steady state of a reference that rests at y_ref. */
void cgl_feedforward_reset(const cgl_feedforward_config *config, cgl_feedforward *feedforward, cgl_real y_ref);

/* Returns f(p). Call it for p = 0, 1, ... in this order, also beyond the `samples` entries of y_ref. If the reference is not finite or the
 * sum overflows, the result is not finite, but the recursion goes on from finite values. */
cgl_real cgl_feedforward_step(const cgl_feedforward_config *config, cgl_feedforward *feedforward,
                              const cgl_real *y_ref, uint32_t samples, uint32_t p);

#ifdef __cplusplus
}
#endif

#endif
