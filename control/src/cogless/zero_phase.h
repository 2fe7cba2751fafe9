/* Zero-phase filter: a digital filter run forward, then backward, over a whole trial.
 *
 * Equals scipy.signal.filtfilt(b, a, x) with its defaults: the signal is continued by an odd extension at both ends, and
 * each pass starts in the filter's steady state of its first sample. The magnitude acts twice, the phase cancels. */
#ifndef COGLESS_ZERO_PHASE_H
#define COGLESS_ZERO_PHASE_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_ZERO_PHASE_ORDER 4

typedef struct {
    uint32_t order;                       /* 0 to CGL_ZERO_PHASE_ORDER; 0: no filter; default 0 */
    cgl_real b[CGL_ZERO_PHASE_ORDER + 1]; /* numerator, the first order + 1 entries count; finite */
    cgl_real a[CGL_ZERO_PHASE_ORDER + 1]; /* denominator likewise; a[0] = 1, all roots inside the unit circle */
} cgl_zero_phase_config;

/* Samples of the extension at each end; the signal must be longer where the order is not 0. */
#define CGL_ZERO_PHASE_PAD(order) (3U * ((order) + 1U))

/* Checks the config for signals of so many samples. There is no state. */
cgl_error cgl_zero_phase_init(const cgl_zero_phase_config *config, uint32_t samples);

/* Filters the `samples` entries of x in place. `tail`: CGL_ZERO_PHASE_PAD(order) entries to work in. Takes a time that
 * grows with the samples: nothing for an interrupt. Whatever x holds, the result is finite: input and output of each pass
 * are limited to where no sum overflows. */
void cgl_zero_phase(const cgl_zero_phase_config *config, cgl_real *x, uint32_t samples, cgl_real *tail);

#ifdef __cplusplus
}
#endif

#endif
