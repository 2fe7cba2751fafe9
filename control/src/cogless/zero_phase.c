#include "zero_phase.h"

#include "polynomial.h"

/* Fills z with the steady state for a constant input of 1, in the transposed direct form II. z has order + 1 entries; the last is 0.
 * Returns false if there is no steady state. */
static bool rest(const cgl_zero_phase_config *config, cgl_real *z)
{
    cgl_real sum_b = CGL_R(0.0), sum_a = CGL_R(0.0);
    for (uint32_t i = 0; i <= config->order; ++i) {
        sum_b += config->b[i];
        sum_a += config->a[i];
    }
    const cgl_real y = sum_b / sum_a;
    bool finite = cgl_is_finite(y);
    z[config->order] = CGL_R(0.0);
    for (uint32_t i = config->order; i > 0U; --i) {
        z[i - 1U] = config->b[i] - config->a[i] * y + z[i];
        finite = finite && cgl_is_finite(z[i - 1U]);
    }
    return finite;
}

/* Returns the largest input and output for which all states and sums are finite. A state is a sum of past b x - a y. */
static cgl_real ceiling(const cgl_zero_phase_config *config)
{
    cgl_real sum = CGL_R(1.0);
    for (uint32_t i = 0; i <= config->order; ++i) {
        sum += cgl_abs(config->b[i]) + cgl_abs(config->a[i]);
    }
    return CGL_R(0.5) * CGL_REAL_MAX / sum;
}

CGL_SELDOM cgl_error cgl_zero_phase_init(const cgl_zero_phase_config *config, uint32_t samples)
{
    if (config->order == 0U) {
        return CGL_OK;
    }
    cgl_real z[CGL_ZERO_PHASE_ORDER + 1];
    return config->order <= CGL_ZERO_PHASE_ORDER && samples > CGL_ZERO_PHASE_PAD(config->order)
                   && cgl_is_stable(config->a, config->order) && cgl_is_positive(ceiling(config)) && rest(config, z)
               ? CGL_OK
               : CGL_ERROR_CONFIG;
}

static void start(const cgl_zero_phase_config *config, cgl_real *z, cgl_real x, cgl_real limit)
{
    (void)rest(config, z);
    for (uint32_t i = 0; i < config->order; ++i) {
        z[i] = cgl_clamped(z[i] * cgl_clamped(x, limit), limit);
    }
}

static cgl_real pass(const cgl_zero_phase_config *config, cgl_real *z, cgl_real x, cgl_real limit)
{
    const cgl_real in = cgl_clamped(x, limit);
    const cgl_real out = cgl_clamped(config->b[0] * in + z[0], limit);
    for (uint32_t i = 1; i <= config->order; ++i) {
        z[i - 1U] = config->b[i] * in - config->a[i] * out + z[i];
    }
    return out;
}

/* Returns the i-th sample beyond an end of the signal, i = 1, 2, ... x points at the last sample before that end. `inward` is the step from
 * that sample into the signal, 1 or -1. odd: the signal is reflected through that sample; otherwise it is mirrored. */
static cgl_real reflected(const cgl_real *x, int32_t inward, uint32_t i, bool odd)
{
    return odd ? CGL_R(2.0) * x[0] - x[inward * (int32_t)i] : x[inward * ((int32_t)i - 1)];
}

CGL_SELDOM void cgl_zero_phase(const cgl_zero_phase_config *config, cgl_real *x, uint32_t samples, cgl_real *tail)
{
    if (config->order == 0U) {
        return;
    }
    const bool odd = config->odd;
    const uint32_t pad = odd ? CGL_ZERO_PHASE_PAD(config->order) : samples;
    const cgl_real *const last = x + (samples - 1U);
    const cgl_real limit = ceiling(config);
    cgl_real z[CGL_ZERO_PHASE_ORDER + 1];
    for (uint32_t i = 0; i < pad; ++i) {
        tail[i] = reflected(last, -1, i + 1U, odd);
    }

    start(config, z, reflected(x, 1, pad, odd), limit);
    for (uint32_t i = pad; i > 0U; --i) {
        (void)pass(config, z, reflected(x, 1, i, odd), limit);
    }
    for (uint32_t i = 0; i < samples; ++i) {
        x[i] = pass(config, z, x[i], limit);
    }
    for (uint32_t i = 0; i < pad; ++i) {
        tail[i] = pass(config, z, tail[i], limit);
    }

    start(config, z, tail[pad - 1U], limit);
    for (uint32_t i = pad; i > 0U; --i) {
        (void)pass(config, z, tail[i - 1U], limit);
    }
    for (uint32_t i = samples; i > 0U; --i) {
        x[i - 1U] = pass(config, z, x[i - 1U], limit);
    }
}
