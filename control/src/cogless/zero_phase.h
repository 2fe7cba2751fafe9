/* Zero-phase filter: a digital filter run forward, then backward, over a whole trial.
 *
 * At both ends the signal is continued by its reflection, and each pass starts in the filter's steady state of its first
 * sample. The magnitude acts twice, the phase cancels. The reflection is one of two:
 *
 *   even   .. x(1) x(0) | x(0) x(1) .. x(N - 1) | x(N - 1) x(N - 2) ..   over the whole signal. The filter is then the
 *          matrix Q = D^T diag(|H|^2) D with the orthogonal cosine transform D: it is symmetric, and where |H| is at most
 *          1 it enlarges the norm of no signal. So it does not when it is applied trial after trial.
 *   odd    2 x(0) - x(i), about the end's value, over 3 (order + 1) samples: scipy.signal.filtfilt(b, a, x) with its
 *          defaults. It continues a slope, and turns noise at the ends into up to three times as much and more. */
#ifndef COGLESS_ZERO_PHASE_H
#define COGLESS_ZERO_PHASE_H

#include <stdbool.h>
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
    bool odd;                             /* reflection at the ends: true odd, false even; default false */
} cgl_zero_phase_config;

/* Samples of the odd extension at each end; the signal must be longer where the order is not 0. */
#define CGL_ZERO_PHASE_PAD(order) (3U * ((order) + 1U))

/* Entries to work in. */
#define CGL_ZERO_PHASE_TAIL(samples, order) ((order) == 0U ? 0U : (samples))

/* Checks the config for signals of so many samples. There is no state. */
cgl_error cgl_zero_phase_init(const cgl_zero_phase_config *config, uint32_t samples);

/* Filters the `samples` entries of x in place. `tail`: CGL_ZERO_PHASE_TAIL(samples, order) entries to work in. Takes a
 * time that grows with the samples: nothing for an interrupt. Whatever x holds, the result is finite: input and output of each pass
 * are limited to where no sum overflows. */
void cgl_zero_phase(const cgl_zero_phase_config *config, cgl_real *x, uint32_t samples, cgl_real *tail);

#ifdef __cplusplus
}
#endif

#endif
