/* Denominators of digital filters. */
#ifndef COGLESS_POLYNOMIAL_H
#define COGLESS_POLYNOMIAL_H

#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_POLYNOMIAL_ORDER 15

/* True where every root of a[0] z^order + ... + a[order] lies inside the unit circle, so that the recursion with these
 * coefficients forgets: Schur-Cohn. a[0] must be 1; an order above CGL_POLYNOMIAL_ORDER, or a coefficient that is not
 * finite, is false. */
bool cgl_is_stable(const cgl_real *a, uint32_t order);

#ifdef __cplusplus
}
#endif

#endif
