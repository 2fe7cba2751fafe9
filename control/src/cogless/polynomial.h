/* Stability of the denominators of digital filters. */
#ifndef COGLESS_POLYNOMIAL_H
#define COGLESS_POLYNOMIAL_H

#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_POLYNOMIAL_ORDER 15

/* Whether every root of a[0] z^order + ... + a[order] lies inside the unit circle (Schur-Cohn test). Then the recursion with these
 * coefficients is stable. The result is false if a[0] is not 1, a coefficient is not finite, or the order is above CGL_POLYNOMIAL_ORDER. */
bool cgl_is_stable(const cgl_real *a, uint32_t order);

#ifdef __cplusplus
}
#endif

#endif
