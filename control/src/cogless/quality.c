#include "quality.h"

#include "range.h"

#define LONGEST_WINDOW CGL_R(60.0) /* [s] default */
#define LONGEST_SAMPLES CGL_R(1.0e9) /* of a window */
#define SQUARE_MAX CGL_R(1.0e28) /* so that the sum of as many as a window may have is finite in float */
#define SMALLEST CGL_R(1.0e-30)  /* a square below it is nothing */
#define IN_A_ROW 4U              /* outliers to one side: no noise, and no step of an encoder */
#define WAIT 16U                 /* after so many in a row, learning waits for one part in 16 of a window: the error is a wave,
                                    and passes through zero */
#define TWICE_SQUARE CGL_R(4.0)  /* errors of up to twice what lasts are learned; larger ones come from something else */
#define MOVED_SQUARE CGL_R(0.00390625) /* (1/16)^2, of the span's square */
#define PART 0xFFFU /* samples whose sums are added up on their own, as one bit less than a power of two */
#define TREND_SMOOTHING CGL_R(0.25)
#define TREND_STILL CGL_R(0.04) /* of the ripple's square, a window: 2 % of the ripple */
#define TREND_MOST CGL_R(0.16)  /* of one window, so that a large change is not seen for long */

CGL_SELDOM static void begin_window(cgl_quality *quality)
{
    quality->sum = quality->squares = quality->outlier_sum = quality->outlier_squares = CGL_R(0.0);
    quality->peak_square = quality->turned = CGL_R(0.0);
    quality->sum_before = quality->squares_before = quality->sum_lost = quality->squares_lost = CGL_R(0.0);
    quality->left = quality->longest;
    quality->missing = quality->outliers = quality->run = quality->run_left = 0U;
    quality->learned = quality->unusual = quality->run_above = false;
}

CGL_SELDOM const char *cgl_quality_bad_field(const cgl_quality_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(quality, span, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, longest, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, outlier, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, floor, CGL_NOT_NEGATIVE)};
    const cgl_real longest = cgl_or_default(config->longest, LONGEST_WINDOW);
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (!cgl_is_positive(ts)) {
        return CGL_FIELD("ts");
    }
    if (!(longest >= ts && longest / ts <= LONGEST_SAMPLES)) {
        return CGL_FIELD("quality.longest");
    }
    return config->outlier > CGL_R(0.0) && config->outlier < CGL_R(1.0) ? CGL_FIELD("quality.outlier") : 0;
}

CGL_SELDOM static cgl_error take(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts)
{
    if (cgl_quality_bad_field(config, ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    quality->config = *config;
    quality->config.span = cgl_or_default(config->span, CGL_TWO_PI);
    quality->config.longest = cgl_or_default(config->longest, LONGEST_WINDOW);
    quality->ts = ts;
    const cgl_real turned = quality->config.span / ts;
    quality->turned_square = cgl_clamped(turned * turned, CGL_REAL_MAX);
    quality->longest = (uint32_t)(cgl_clamped(quality->config.longest / ts, LONGEST_SAMPLES) + CGL_R(0.5));
    begin_window(quality);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_quality_init(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts)
{
    const cgl_error error = take(quality, config, ts);
    if (error == CGL_OK) {
        cgl_quality_reset(quality);
    }
    return error;
}

CGL_SELDOM cgl_error cgl_quality_retune(cgl_quality *quality, const cgl_quality_config *config)
{
    return take(quality, config, quality->ts);
}

CGL_SELDOM void cgl_quality_reset(cgl_quality *quality)
{
    begin_window(quality);
    quality->centre = CGL_R(0.0);
    quality->quick_square = quality->usual_square = quality->refused_square = CGL_R(-1.0);
    quality->wait = quality->waiting = 0U;
    quality->last_peak_square = CGL_R(0.0);
    quality->ripple = quality->before = quality->trend = CGL_R(0.0);
    quality->windows = 0U;
    quality->began = false;
}

CGL_SELDOM static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

/* Moves the sum of a part to that of the parts before, where small terms add up beside large sums. */
CGL_SELDOM static void gather(cgl_real *part, cgl_real *before, cgl_real *lost)
{
    *before = cgl_added(*before, *part, CGL_REAL_MAX, lost);
    *part = CGL_R(0.0);
}

/* A part of the window is over. */
CGL_SELDOM static void end_part(cgl_quality *quality)
{
    gather(&quality->sum, &quality->sum_before, &quality->sum_lost);
    gather(&quality->squares, &quality->squares_before, &quality->squares_lost);
}

/* The bounds of the next window. An outlier counts as one that just was none, so that a shock raises the usual little. */
CGL_SELDOM static void set_bounds(cgl_quality *quality, uint32_t samples)
{
    const cgl_quality_config *const config = &quality->config;
    const cgl_real count = (cgl_real)samples, share = (cgl_real)quality->outliers / count, centre = quality->centre;
    const cgl_real square = quality->squares_before / count
                            + centre * (CGL_R(2.0) * (quality->sum_before / count) + (CGL_R(1.0) - share) * centre)
                            + share * quality->usual_square;
    const cgl_real usual = larger(config->outlier * config->outlier * square, config->floor * config->floor);
    const cgl_real peak = quality->unusual ? quality->peak_square : CGL_R(0.0);
    const cgl_real lasting = TWICE_SQUARE * (peak < quality->last_peak_square ? peak : quality->last_peak_square);
    /* no error at all, as at rest, says nothing of what is usual */
    quality->usual_square = usual > CGL_R(0.0) && usual < SQUARE_MAX ? usual : SQUARE_MAX;
    quality->refused_square = larger(quality->usual_square, lasting);
    quality->last_peak_square = peak;
}

CGL_SELDOM static void end_window(cgl_quality *quality, cgl_real turned)
{
    const cgl_quality_config *const config = &quality->config;
    const uint32_t samples = quality->longest - quality->left - quality->missing;
    end_part(quality);
    if (samples > 0U) {
        const cgl_real sum = quality->sum_before + quality->outlier_sum;
        const cgl_real squares = quality->squares_before + quality->outlier_squares;
        const cgl_real count = (cgl_real)samples, mean = sum / count;
        const cgl_real ripple = larger(squares / count - mean * mean, CGL_R(0.0)), last = quality->ripple;
        const cgl_real largest = larger(ripple, last);
        if (quality->windows > 0U && largest > CGL_R(0.0)) {
            const cgl_real change = cgl_clamped((ripple - last) / largest, TREND_MOST);
            quality->trend += TREND_SMOOTHING * (change - quality->trend);
        }
        const bool moved = turned * turned >= quality->turned_square * MOVED_SQUARE; /* at rest nothing begins */
        const bool settled = mean * mean <= ripple; /* a run-up is no ripple that learning could take away */
        if (moved && settled && !quality->began) {
            quality->before = quality->learned && quality->before > CGL_R(0.0) ? quality->before : ripple;
            quality->began = quality->learned;
        }
        quality->ripple = ripple;
        quality->windows += quality->windows < UINT32_MAX ? 1U : 0U;
        if (config->outlier > CGL_R(0.0)) {
            set_bounds(quality, samples);
            quality->wait = samples / WAIT;
        }
        quality->centre += mean;
    }
    begin_window(quality);
}

CGL_SELDOM static void count_outlier(cgl_quality *quality, cgl_real error, cgl_real deviation)
{
    quality->outlier_sum += deviation;
    quality->outlier_squares += deviation * deviation;
    ++quality->outliers;
    quality->peak_square = larger(quality->peak_square, error * error);
    const bool goes_on = quality->run_left == quality->left + 1U && (error > CGL_R(0.0)) == quality->run_above;
    quality->run = goes_on ? quality->run + 1U : 1U;
    quality->run_left = quality->left;
    quality->run_above = error > CGL_R(0.0);
    quality->unusual = quality->unusual || quality->run >= IN_A_ROW;
}

/* A sample that is an outlier, or not finite, or the first, or the last of its window. */
CGL_SELDOM static bool step_unusual(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                         bool learning)
{
    const cgl_real square = error * error;
    const bool counts = square <= SQUARE_MAX;
    if (counts && quality->usual_square < CGL_R(0.0)) {
        quality->centre = error;
        quality->usual_square = quality->refused_square = SQUARE_MAX;
    }
    const bool outlier = !(square <= quality->usual_square);
    const cgl_real deviation = counts ? error - quality->centre : CGL_R(0.0);
    if (!counts) {
        ++quality->missing;
    } else if (outlier) {
        count_outlier(quality, error, deviation);
    } else {
        quality->sum += deviation;
        quality->squares += deviation * deviation;
    }
    if (square > quality->refused_square && quality->run >= IN_A_ROW) {
        quality->waiting = quality->wait;
    } else if (quality->waiting > 0U) {
        --quality->waiting;
    }
    const bool taught = square <= quality->refused_square && quality->waiting == 0U;
    quality->learned = quality->learned || (learning && taught);
    const cgl_real turned = quality->turned + cgl_finite_or_zero(omega_m);
    --quality->left;
    if (turned * turned < quality->turned_square && quality->left > 0U) {
        quality->turned = turned;
        if ((quality->left & PART) == 0U) {
            end_part(quality);
        }
    } else {
        end_window(quality, turned);
    }
    quality->quick_square = quality->waiting > 0U ? CGL_R(-1.0) : quality->usual_square;
    return !taught;
}

bool cgl_quality_step(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                      bool learning)
{
    const cgl_real square = error * error;
    const cgl_real turned = quality->turned + omega_m;
    if (!(square <= quality->quick_square && turned * turned < quality->turned_square && (quality->left & PART) > 1U)) {
        return step_unusual(quality, error, omega_m, learning);
    }
    const cgl_real deviation = error - quality->centre;
    quality->sum += deviation;
    quality->squares += deviation * deviation;
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

cgl_quality_report cgl_quality_read(const cgl_quality *quality)
{
    const cgl_real residual = square_root(quality->ripple), before = square_root(quality->before);
    const bool measured = quality->began && before > CGL_R(0.0);
    const cgl_quality_report report = {residual, measured ? CGL_R(1.0) - residual / before : CGL_R(0.0),
                                       quality->windows > 0U, quality->began && quality->trend < -TREND_STILL,
                                       quality->began && quality->trend > TREND_STILL};
    return report;
}
