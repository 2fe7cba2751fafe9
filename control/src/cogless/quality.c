#include "quality.h"

#define SQUARE_MAX CGL_R(1.0e28) /* so that the sum of as many as an uint32_t counts is finite in float */
#define SMALLEST CGL_R(1.0e-30)  /* a square below it is nothing */
#define TREND_SMOOTHING CGL_R(0.125)
#define TREND_STILL CGL_R(0.04) /* of the ripple's square, a window: 2 % of the ripple */

CGL_SELDOM cgl_error cgl_quality_init(const cgl_quality_config *config, cgl_quality *quality)
{
    const cgl_real longest = config->longest / config->ts; /* [samples] */
    if (!(cgl_is_positive(config->span) && cgl_is_positive(config->ts) && cgl_is_not_negative(config->longest)
          && config->longest >= config->ts && cgl_is_within(longest, CGL_R(1.0e9))
          && cgl_is_not_negative(config->floor) && cgl_is_not_negative(config->outlier)
          && !(config->outlier > CGL_R(0.0) && config->outlier < CGL_R(1.0)))) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real turned = config->span / config->ts;
    quality->turned_square = cgl_clamp(turned * turned, CGL_REAL_MAX);
    quality->longest = (uint32_t)(longest + CGL_R(0.5));
    cgl_quality_reset(quality);
    return CGL_OK;
}

CGL_SELDOM static void begin_window(cgl_quality *quality)
{
    quality->sum = quality->sum_of_squares = quality->turned = CGL_R(0.0);
    quality->left = quality->longest;
    quality->missing = 0U;
    quality->learned = false;
}

CGL_SELDOM void cgl_quality_reset(cgl_quality *quality)
{
    begin_window(quality);
    quality->usual_square = SQUARE_MAX;
    quality->ripple = quality->before = quality->trend = CGL_R(0.0);
    quality->windows = 0U;
    quality->began = false;
}

static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

CGL_SELDOM static void end_window(const cgl_quality_config *config, cgl_quality *quality)
{
    const uint32_t samples = quality->longest - quality->left - quality->missing;
    if (samples > 0U) {
        const cgl_real count = (cgl_real)samples;
        const cgl_real mean = quality->sum / count, square = quality->sum_of_squares / count;
        const cgl_real ripple = larger(square - mean * mean, CGL_R(0.0)), last = quality->ripple;
        const cgl_real largest = larger(ripple, last);
        if (quality->windows > 0U && largest > CGL_R(0.0)) {
            quality->trend += TREND_SMOOTHING * ((ripple - last) / largest - quality->trend);
        }
        if (!quality->began && !(quality->learned && quality->windows > 0U)) {
            quality->before = ripple;
        }
        quality->began = quality->began || quality->learned;
        quality->ripple = ripple;
        quality->windows += quality->windows < UINT32_MAX ? 1U : 0U;
        if (config->outlier > CGL_R(0.0)) {
            const cgl_real usual = larger(config->outlier * config->outlier * square, config->floor * config->floor);
            quality->usual_square = usual < SQUARE_MAX ? usual : SQUARE_MAX;
        }
    }
    begin_window(quality);
}

/* A sample that is an outlier, or not finite, or the last of its window. */
CGL_SELDOM static bool step_unusual(const cgl_quality_config *config, cgl_quality *quality, cgl_real error, cgl_real omega_m,
                         bool learning)
{
    const cgl_real square = error * error;
    const bool outlier = !(square <= quality->usual_square);
    if (square <= SQUARE_MAX) {
        quality->sum += error;
        quality->sum_of_squares += square;
        quality->learned = quality->learned || (learning && !outlier);
    } else {
        ++quality->missing;
    }
    const cgl_real turned = quality->turned + (cgl_is_finite(omega_m) ? omega_m : CGL_R(0.0));
    --quality->left;
    if (turned * turned < quality->turned_square && quality->left > 0U) {
        quality->turned = turned;
    } else {
        end_window(config, quality);
    }
    return outlier;
}

bool cgl_quality_step(const cgl_quality_config *config, cgl_quality *quality, cgl_real error, cgl_real omega_m,
                      bool learning)
{
    const cgl_real square = error * error;
    const cgl_real turned = quality->turned + omega_m;
    if (!(square <= quality->usual_square && turned * turned < quality->turned_square && quality->left > 1U)) {
        return step_unusual(config, quality, error, omega_m, learning);
    }
    quality->sum += error;
    quality->sum_of_squares += square;
    quality->turned = turned;
    --quality->left;
    if (learning) {
        quality->learned = true;
    }
    return false;
}

/* Newton's iteration, after steps of 2 into [1, 4]. */
CGL_SELDOM static cgl_real square_root(cgl_real x)
{
    cgl_real scale = CGL_R(1.0);
    if (!(x >= SMALLEST && x <= SQUARE_MAX)) {
        return CGL_R(0.0);
    }
    for (; x > CGL_R(4.0); x *= CGL_R(0.25)) {
        scale *= CGL_R(2.0);
    }
    for (; x < CGL_R(1.0); x *= CGL_R(4.0)) {
        scale *= CGL_R(0.5);
    }
    cgl_real root = CGL_R(0.5) + CGL_R(0.5) * x;
    for (int n = 0; n < 5; ++n) {
        root = CGL_R(0.5) * (root + x / root);
    }
    return scale * root;
}

CGL_SELDOM cgl_quality_report cgl_quality_read(const cgl_quality *quality)
{
    const cgl_real residual = square_root(quality->ripple), before = square_root(quality->before);
    const bool measured = quality->began && before > CGL_R(0.0);
    const cgl_quality_report report = {residual, measured ? CGL_R(1.0) - residual / before : CGL_R(0.0),
                                       quality->windows > 0U, quality->trend < -TREND_STILL,
                                       quality->trend > TREND_STILL};
    return report;
}
