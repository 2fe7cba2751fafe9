#include "quality.h"

#include "range.h"
#include "square_root.h"

#define LONGEST_DEFAULT CGL_R(60.0)    /* default of config.longest [s] */
#define SAMPLES_MAX CGL_R(1.0e9)       /* largest number of samples in a window */
#define SQUARE_MAX CGL_R(1.0e28)       /* an error with a larger square does not count, so that a float holds a window's sum */
#define RUN_OUTLIERS 4U                /* number of successive outliers of one sign that are neither noise nor a step of an encoder */
#define WAIT_DIVIDER 16U               /* learning waits for 1/16 of a window after a run of RUN_OUTLIERS that is not learned */
#define LASTING_SQUARE CGL_R(4.0)      /* square of 2: errors of up to twice a lasting peak are learned */
#define MOVED_SQUARE CGL_R(0.00390625) /* square of 1/16: a rotor that turns by less than this share of `span` in a window counts as at
                                          rest */
#define PART_MASK 0xFFFU               /* number of samples in a part of a window, less one; all its bits are 1 */
#define TREND_SMOOTHING CGL_R(0.25)    /* weight of the last window's change of the ripple in the trend */
#define TREND_STEADY CGL_R(0.04)       /* largest trend that counts as no change: 4 % of the variance `ripple`, 2 % of its root */
#define TREND_MOST CGL_R(0.16)         /* bound of a window's relative change of `ripple`, so that the trend soon forgets a large one */

CGL_SELDOM static void begin_window(cgl_quality *quality)
{
    quality->sum = quality->squares = quality->outlier_sum = quality->outlier_squares = CGL_R(0.0);
    quality->peak_square = quality->turned = CGL_R(0.0);
    quality->sum_before = quality->squares_before = quality->sum_lost = quality->squares_lost = CGL_R(0.0);
    quality->remaining = quality->longest;
    quality->missing = quality->outliers = quality->run_length = quality->run_remaining = 0U;
    quality->learned = quality->has_long_run = quality->run_positive = false;
}

CGL_SELDOM const char *cgl_quality_bad_field(const cgl_quality_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(quality, span, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, longest, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, outlier, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(quality, floor, CGL_NOT_NEGATIVE)};
    const cgl_real longest = cgl_or_default(config->longest, LONGEST_DEFAULT);
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (!cgl_is_positive(ts)) {
        return CGL_FIELD("ts");
    }
    if (!(longest >= ts && longest / ts <= SAMPLES_MAX)) {
        return CGL_FIELD("quality.longest");
    }
    return config->outlier > CGL_R(0.0) && config->outlier < CGL_R(1.0) ? CGL_FIELD("quality.outlier") : 0;
}

CGL_SELDOM static cgl_error apply_config(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts)
{
    if (cgl_quality_bad_field(config, ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    quality->config = *config;
    quality->config.span = cgl_or_default(config->span, CGL_TWO_PI);
    quality->config.longest = cgl_or_default(config->longest, LONGEST_DEFAULT);
    quality->ts = ts;
    const cgl_real turned = quality->config.span / ts;
    quality->span_square = cgl_clamped(turned * turned, CGL_REAL_MAX);
    quality->longest = (uint32_t)(cgl_clamped(quality->config.longest / ts, SAMPLES_MAX) + CGL_R(0.5));
    begin_window(quality);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_quality_init(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts)
{
    const cgl_error error = apply_config(quality, config, ts);
    if (error == CGL_OK) {
        cgl_quality_reset(quality);
    }
    return error;
}

CGL_SELDOM cgl_error cgl_quality_retune(cgl_quality *quality, const cgl_quality_config *config)
{
    return apply_config(quality, config, quality->ts);
}

CGL_SELDOM void cgl_quality_reset(cgl_quality *quality)
{
    begin_window(quality);
    quality->centre = CGL_R(0.0);
    quality->ordinary_square = quality->outlier_square = quality->refused_square = CGL_R(-1.0);
    quality->wait = quality->waiting = 0U;
    quality->last_peak_square = CGL_R(0.0);
    quality->ripple = quality->ripple_before = quality->trend = CGL_R(0.0);
    quality->windows = 0U;
    quality->began = false;
}

CGL_SELDOM static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

/* Adds the sum of a part, and the rounding error of the last addition, to the sum of the earlier parts. Clears the part's sum. */
CGL_SELDOM static void gather(cgl_real *part, cgl_real *before, cgl_real *lost)
{
    *before = cgl_added(*before, *part, CGL_REAL_MAX, lost);
    *part = CGL_R(0.0);
}

/* Ends a part of the window. */
CGL_SELDOM static void end_part(cgl_quality *quality)
{
    gather(&quality->sum, &quality->sum_before, &quality->sum_lost);
    gather(&quality->squares, &quality->squares_before, &quality->squares_lost);
}

/* Sets the next window's bounds of outliers from the sums of this window. An outlier enters the sums only with the value of the present
 * bound, so a shock hardly raises the next bound. */
CGL_SELDOM static void set_bounds(cgl_quality *quality, uint32_t samples)
{
    const cgl_quality_config *const config = &quality->config;
    const cgl_real count = (cgl_real)samples, share = (cgl_real)quality->outliers / count, centre = quality->centre;
    const cgl_real square = quality->squares_before / count
                            + centre * (CGL_R(2.0) * (quality->sum_before / count) + (CGL_R(1.0) - share) * centre)
                            + share * quality->outlier_square;
    const cgl_real bound = larger(config->outlier * config->outlier * square, config->floor * config->floor);
    const cgl_real peak = quality->has_long_run ? quality->peak_square : CGL_R(0.0);
    const cgl_real lasting = LASTING_SQUARE * (peak < quality->last_peak_square ? peak : quality->last_peak_square);
    /* A window whose errors are all 0, as at rest, does not tell which error is usual. If config.floor is
     * also 0, no error of the next window is an outlier. */
    quality->outlier_square = bound > CGL_R(0.0) && bound < SQUARE_MAX ? bound : SQUARE_MAX;
    quality->refused_square = larger(quality->outlier_square, lasting);
    quality->last_peak_square = peak;
}

/* Adds the change of the ripple to the trend. */
static void update_trend(cgl_quality *quality, cgl_real ripple)
{
    const cgl_real largest = larger(ripple, quality->ripple);
    if (quality->windows > 0U && largest > CGL_R(0.0)) {
        const cgl_real change = cgl_clamped((ripple - quality->ripple) / largest, TREND_MOST);
        quality->trend += TREND_SMOOTHING * (change - quality->trend);
    }
}

/* Stores the ripple before learning, until a window with learning has ended. A window at rest or in a run-up does not count. In a run-up
 * the mean error is larger than the ripple, and learning could not remove the mean error. */
static void update_ripple_before(cgl_quality *quality, cgl_real ripple, cgl_real mean_square, cgl_real turned)
{
    const bool moved = turned * turned >= quality->span_square * MOVED_SQUARE, settled = mean_square <= ripple;
    if (moved && settled && !quality->began) {
        quality->ripple_before = quality->learned && quality->ripple_before > CGL_R(0.0) ? quality->ripple_before : ripple;
        quality->began = quality->learned;
    }
}

CGL_SELDOM static void end_window(cgl_quality *quality, cgl_real turned)
{
    const cgl_quality_config *const config = &quality->config;
    const uint32_t samples = quality->longest - quality->remaining - quality->missing;
    end_part(quality);
    if (samples > 0U) {
        const cgl_real sum = quality->sum_before + quality->outlier_sum;
        const cgl_real squares = quality->squares_before + quality->outlier_squares;
        const cgl_real count = (cgl_real)samples, mean = sum / count; /* `mean` is the mean deviation from `centre` */
        const cgl_real ripple = larger(squares / count - mean * mean, CGL_R(0.0));
        update_trend(quality, ripple);
        update_ripple_before(quality, ripple, mean * mean, turned);
        quality->ripple = ripple;
        quality->windows += quality->windows < UINT32_MAX ? 1U : 0U;
        if (config->outlier > CGL_R(0.0)) {
            set_bounds(quality, samples);
            quality->wait = samples / WAIT_DIVIDER;
        }
        quality->centre += mean;
    }
    begin_window(quality);
}

/* Counts an outlier, and the length of its run of successive outliers of one sign. */
CGL_SELDOM static void count_outlier(cgl_quality *quality, cgl_real error, cgl_real deviation)
{
    quality->outlier_sum += deviation;
    quality->outlier_squares += deviation * deviation;
    ++quality->outliers;
    quality->peak_square = larger(quality->peak_square, error * error);
    const bool goes_on = quality->run_remaining == quality->remaining + 1U && (error > CGL_R(0.0)) == quality->run_positive;
    quality->run_length = goes_on ? quality->run_length + 1U : 1U;
    quality->run_remaining = quality->remaining;
    quality->run_positive = error > CGL_R(0.0);
    quality->has_long_run = quality->has_long_run || quality->run_length >= RUN_OUTLIERS;
}

/* Adds the error to the sums of the window. */
static void count_error(cgl_quality *quality, cgl_real error)
{
    const cgl_real square = error * error;
    if (!(square <= SQUARE_MAX)) {
        ++quality->missing;
        return;
    }
    if (quality->outlier_square < CGL_R(0.0)) { /* the first error */
        quality->centre = error;
        quality->outlier_square = quality->refused_square = SQUARE_MAX;
    }
    const cgl_real deviation = error - quality->centre;
    if (square <= quality->outlier_square) {
        quality->sum += deviation;
        quality->squares += deviation * deviation;
    } else {
        count_outlier(quality, error, deviation);
    }
}

/* Whether the law may learn from an error with this square. */
static bool may_learn(cgl_quality *quality, cgl_real square)
{
    if (square > quality->refused_square && quality->run_length >= RUN_OUTLIERS) {
        quality->waiting = quality->wait;
    } else if (quality->waiting > 0U) {
        --quality->waiting;
    }
    return square <= quality->refused_square && quality->waiting == 0U;
}

/* Takes any sample, also one that is an outlier, not finite, the first of all, or the last of a part or of a window. */
CGL_SELDOM static bool step_unusual(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                         bool learning)
{
    count_error(quality, error);
    const bool taught = may_learn(quality, error * error);
    quality->learned = quality->learned || (learning && taught);
    const cgl_real turned = quality->turned + cgl_finite_or_zero(omega_m);
    --quality->remaining;
    if (turned * turned < quality->span_square && quality->remaining > 0U) {
        quality->turned = turned;
        if ((quality->remaining & PART_MASK) == 0U) {
            end_part(quality);
        }
    } else {
        end_window(quality, turned);
    }
    quality->ordinary_square = quality->waiting > 0U ? CGL_R(-1.0) : quality->outlier_square;
    return !taught;
}

bool cgl_quality_step(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                      bool learning)
{
    const cgl_real square = error * error;
    const cgl_real turned = quality->turned + omega_m;
    if (!(square <= quality->ordinary_square && turned * turned < quality->span_square && (quality->remaining & PART_MASK) > 1U)) {
        return step_unusual(quality, error, omega_m, learning);
    }
    const cgl_real deviation = error - quality->centre;
    quality->sum += deviation;
    quality->squares += deviation * deviation;
    quality->turned = turned;
    --quality->remaining;
    if (learning) {
        quality->learned = true;
    }
    return false;
}

cgl_quality_report cgl_quality_read(const cgl_quality *quality)
{
    const cgl_real residual = cgl_square_root(quality->ripple), before = cgl_square_root(quality->ripple_before);
    const bool has_before = quality->began && before > CGL_R(0.0);
    const cgl_quality_report report = {residual, has_before ? CGL_R(1.0) - residual / before : CGL_R(0.0),
                                       quality->windows > 0U, quality->began && quality->trend < -TREND_STEADY,
                                       quality->began && quality->trend > TREND_STEADY};
    return report;
}
