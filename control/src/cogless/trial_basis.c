#include "trial_basis.h"

/* The functions of trial_basis.h. The constant comes first: a function that the fit cannot tell from the constant gets no coefficient. */
enum { CONSTANT, ACCELERATION, SPEED, DIRECTION, JERK, FUNCTIONS };

/* A function is left out of the fit if the functions before it in the list explain all but this share of its sum of squares. */
#define PIVOT_LEAST CGL_R(1.0e-3)

typedef struct {
    cgl_real gram[FUNCTIONS][FUNCTIONS]; /* sums of products of two functions; the upper half is not used */
    cgl_real moment[FUNCTIONS];          /* sums of products of a function and w */
} sums;

/* Fills in the functions of the reference at sample p. Before its first and after its last sample the reference is taken as constant. */
static void functions(const cgl_real *y_ref, uint32_t samples, uint32_t p, cgl_real f[FUNCTIONS])
{
    const uint32_t last = samples - 1U;
    const cgl_real before = y_ref[p > 0U ? p - 1U : 0U], now = y_ref[p];
    const cgl_real next = y_ref[p < last ? p + 1U : last], second = y_ref[last - p > 1U ? p + 2U : last];
    const cgl_real speed = next - now;
    const cgl_real earlier = now - before, later = second - next;
    f[CONSTANT] = CGL_R(1.0);
    f[ACCELERATION] = CGL_R(0.5) * (later - earlier);
    f[SPEED] = speed;
    f[DIRECTION] = speed > CGL_R(0.0) ? CGL_R(1.0) : (speed < CGL_R(0.0) ? CGL_R(-1.0) : CGL_R(0.0));
    f[JERK] = (later - speed) - (speed - earlier);
}

/* Solves the equations gram theta = moment of the least squares, by the factors L D L^T of gram. */
static void solve(const sums *s, cgl_real theta[FUNCTIONS])
{
    cgl_real lower[FUNCTIONS][FUNCTIONS], pivot[FUNCTIONS];
    for (uint32_t j = 0; j < (uint32_t)FUNCTIONS; ++j) {
        pivot[j] = s->gram[j][j];
        theta[j] = s->moment[j];
        for (uint32_t k = 0; k < j; ++k) {
            pivot[j] -= lower[j][k] * lower[j][k] * pivot[k];
            theta[j] -= lower[j][k] * theta[k];
        }
        const bool is_new = pivot[j] > PIVOT_LEAST * s->gram[j][j];
        pivot[j] = is_new ? pivot[j] : CGL_R(0.0);
        for (uint32_t i = j + 1U; i < (uint32_t)FUNCTIONS; ++i) {
            cgl_real product = s->gram[i][j];
            for (uint32_t k = 0; k < j; ++k) {
                product -= lower[i][k] * lower[j][k] * pivot[k];
            }
            lower[i][j] = is_new ? product / pivot[j] : CGL_R(0.0);
        }
    }
    for (uint32_t j = (uint32_t)FUNCTIONS; j-- > 0U;) {
        theta[j] = pivot[j] > CGL_R(0.0) ? theta[j] / pivot[j] : CGL_R(0.0);
        for (uint32_t i = j + 1U; pivot[j] > CGL_R(0.0) && i < (uint32_t)FUNCTIONS; ++i) {
            theta[j] -= lower[i][j] * theta[i];
        }
    }
}

/* Fits theta, the constant and the coefficients, to v and the reference of the last trial. Returns false if a sum is not finite. */
static bool fit(const cgl_trial *law, cgl_real k_2, const cgl_real *y_ref, cgl_real theta[FUNCTIONS])
{
    const cgl_trial_config *const config = &law->config;
    sums s = {0};
    cgl_real psi = CGL_R(0.0), total = CGL_R(0.0);
    for (uint32_t p = 0; p < config->samples; ++p) {
        cgl_real f[FUNCTIONS], other[FUNCTIONS];
        functions(law->y_ref, config->samples, p, f);
        functions(y_ref, config->samples, p, other);
        const cgl_real w = config->n * law->learned[p] + k_2 * psi;
        psi += law->learned[p];
        for (uint32_t i = 0; i < (uint32_t)FUNCTIONS; ++i) {
            s.moment[i] += f[i] * w;
            total += cgl_abs(f[i] * w) + cgl_abs(other[i]);
            for (uint32_t j = 0; j <= i; ++j) {
                s.gram[i][j] += f[i] * f[j];
            }
        }
    }
    solve(&s, theta);
    for (uint32_t i = 0; i < (uint32_t)FUNCTIONS; ++i) {
        total += s.gram[i][i] + cgl_abs(theta[i]);
    }
    return cgl_is_finite(total);
}

bool cgl_trial_carry(cgl_trial *law, const cgl_real *y_ref)
{
    const cgl_trial_config *const config = &law->config;
    const cgl_real k_2 = config->through_integrator ? config->k_2 : CGL_R(0.0), n = config->n;
    /* the recursion psi <- (1 - k_2 / n) psi + .. has to be stable */
    const bool is_invertible = n != CGL_R(0.0) && k_2 * n >= CGL_R(0.0) && cgl_abs(k_2) < CGL_R(2.0) * cgl_abs(n);
    cgl_real theta[FUNCTIONS];
    if (law->y_ref == 0 || y_ref == 0 || !is_invertible || !fit(law, k_2, y_ref, theta)) {
        return false;
    }
    cgl_real psi = CGL_R(0.0);
    for (uint32_t p = 0; p < config->samples; ++p) {
        cgl_real f[FUNCTIONS], other[FUNCTIONS], change = -k_2 * psi;
        functions(law->y_ref, config->samples, p, f);
        functions(y_ref, config->samples, p, other);
        for (uint32_t i = (uint32_t)CONSTANT + 1U; i < (uint32_t)FUNCTIONS; ++i) {
            change += theta[i] * (other[i] - f[i]);
        }
        change /= n;
        psi += change;
        law->learned[p] = cgl_clamped(law->learned[p] + change, config->learned_limit);
    }
    cgl_trial_guard_reset(&law->guard);
    law->spoilt = true; /* the error of the last trial belongs to the old reference */
    return true;
}
