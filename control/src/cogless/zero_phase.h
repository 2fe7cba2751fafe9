/* Zero-phase filter: a digital filter that runs forward and then backward over a whole trial.
 *
 * The magnitude of the filter acts twice, and its phase cancels. At both ends a reflection continues the signal. Each pass starts in the
 * filter's steady state for its first sample. There are two kinds of reflection:
 *
 *   even   .. x(1) x(0) | x(0) x(1) .. x(N - 1) | x(N - 1) x(N - 2) ..   over the whole signal. The filter is then the
 *          symmetric matrix Q = D^T diag(|H|^2) D with the orthogonal cosine transform D. If |H| is at most 1, the filter
 *          does not enlarge the norm of any signal, even if it is applied trial after trial.
 *   odd    2 x(0) - x(i), about the end's value, over 3 (order + 1) samples. The filter is then scipy.signal.filtfilt(b, a, x)
 *          with its defaults. The reflection continues a slope, but can enlarge noise at the ends more than three times. */
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
    cgl_real b[CGL_ZERO_PHASE_ORDER + 1]; /* numerator, finite; the first order + 1 entries are used */
    cgl_real a[CGL_ZERO_PHASE_ORDER + 1]; /* denominator with a[0] = 1 and all roots inside the unit circle; the first order + 1 entries
                                             are used */
    bool odd;                             /* reflection at the ends: true odd, false even; default false */
} cgl_zero_phase_config;

/* Number of samples of the odd reflection at each end. The signal must have more samples than this, unless the order is 0. */
#define CGL_ZERO_PHASE_PAD(order) (3U * ((order) + 1U))

/* Number of entries that the filter needs as working memory. */
#define CGL_ZERO_PHASE_TAIL(samples, order) ((order) == 0U ? 0U : (samples))

/* Checks the config for signals of this length. There is no state. */
cgl_error cgl_zero_phase_init(const cgl_zero_phase_config *config, uint32_t samples);

/* Filters the `samples` entries of x in place. `tail` is working memory of CGL_ZERO_PHASE_TAIL(samples, order) entries. The run time
 * grows with the samples, so do not call it in an interrupt. The result is finite for any x: input and output of each pass are limited
 * so that no sum overflows. */
void cgl_zero_phase(const cgl_zero_phase_config *config, cgl_real *x, uint32_t samples, cgl_real *tail);

#ifdef __cplusplus
}
#endif

#endif
