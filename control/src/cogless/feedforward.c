#include "feedforward.h"

#include "polynomial.h"

#define PREVIEW_MAX 65535U

/* The steady output for a constant reference of 1. */
CGL_SELDOM static cgl_real steady_gain(const cgl_feedforward_config *config)
{
    cgl_real num = CGL_R(0.0), den = CGL_R(0.0);
    for (uint32_t i = 0; i < config->numerator; ++i) {
        num += config->num[i];
    }
    for (uint32_t j = 0; j < config->denominator; ++j) {
        den += config->den[j];
    }
    return num / den;
}

cgl_error cgl_feedforward_init(const cgl_feedforward_config *config, cgl_feedforward *feedforward)
{
    bool valid = config->numerator <= CGL_FEEDFORWARD_TAPS;
    if (valid && config->numerator > 0U) {
        valid = config->denominator >= 1U && config->denominator <= CGL_FEEDFORWARD_TAPS
                && config->preview <= PREVIEW_MAX && cgl_is_stable(config->den, config->denominator - 1U);
        for (uint32_t i = 0; valid && i < config->numerator; ++i) {
            valid = cgl_is_finite(config->num[i]);
        }
        valid = valid && cgl_is_finite(steady_gain(config));
    }
    if (!valid) {
        return CGL_ERROR_CONFIG;
    }
    cgl_feedforward_reset(config, feedforward, CGL_R(0.0));
    return CGL_OK;
}

CGL_SELDOM void cgl_feedforward_reset(const cgl_feedforward_config *config, cgl_feedforward *feedforward, cgl_real y_ref)
{
    const cgl_real f = config->numerator > 0U ? cgl_clamped(steady_gain(config) * y_ref, CGL_REAL_MAX) : CGL_R(0.0);
    for (uint32_t j = 0; j < CGL_FEEDFORWARD_TAPS; ++j) {
        feedforward->past[j] = f;
    }
}

cgl_real cgl_feedforward_step(const cgl_feedforward_config *config, cgl_feedforward *feedforward,
                              const cgl_real *y_ref, uint32_t samples, uint32_t p)
{
    cgl_real f = CGL_R(0.0);
    if (config->numerator == 0U) {
        return f;
    }
    const uint32_t last = samples - 1U;
    const uint32_t ahead = p + config->preview;
    for (uint32_t i = 0; i < config->numerator; ++i) {
        const uint32_t place = ahead > i ? ahead - i : 0U;
        f += config->num[i] * y_ref[place < last ? place : last];
    }
    if (config->denominator > 1U) {
        for (uint32_t j = config->denominator - 1U; j > 0U; --j) {
            f -= config->den[j] * feedforward->past[j - 1U];
            feedforward->past[j] = feedforward->past[j - 1U];
        }
        feedforward->past[0] = cgl_clamp(f, CGL_REAL_MAX);
    }
    return f;
}
