#include "polynomial.h"

CGL_SELDOM bool cgl_is_stable(const cgl_real *a, uint32_t order)
{
    cgl_real p[CGL_POLYNOMIAL_ORDER + 1];
    if (order > CGL_POLYNOMIAL_ORDER || a[0] < CGL_R(1.0) || a[0] > CGL_R(1.0)) {
        return false;
    }
    for (uint32_t i = 0; i <= order; ++i) {
        p[i] = a[i];
    }
    /* p'(z) = (p(z) - k z^n p(1/z)) / (1 - k^2) with k = p_n. The filter is stable if |k| < 1 at every order n. The comparison is false
     * for NaN. */
    for (uint32_t n = order; n > 0U; --n) {
        const cgl_real k = p[n];
        if (!(p[0] > CGL_R(0.0) && cgl_abs(k) < CGL_R(1.0))) {
            return false;
        }
        const cgl_real scale = CGL_R(1.0) / ((CGL_R(1.0) - k) * (CGL_R(1.0) + k));
        for (uint32_t i = 1, j = n - 1U; i <= j; ++i, --j) {
            const cgl_real low = p[i], high = p[j];
            p[i] = (low - k * high) * scale;
            p[j] = (high - k * low) * scale;
        }
    }
    return true;
}
