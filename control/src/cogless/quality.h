/* Measures the quality of learning at run time: the residual ripple over a turn of the rotor, how far the ripple has come down, and whether
 * the ripple still comes down. Finds outliers: errors from which nothing should be learned. The error is any that the caller passes, in a
 * drive the speed error.
 *
 * A window ends when the rotor has turned by `span`, in either direction, or after `longest`. An outlier is an error far beyond the usual
 * errors. Nothing is learned from an outlier. But a large error that lasts should be learned. A run of four outliers of one sign is no
 * noise: it may be a lasting error. The peak of a window is its largest outlier. If two successive windows each have such a run, the next
 * window allows learning from errors of up to twice the smaller of the two peaks.
 *
 * After a run that is not learned, learning waits for a sixteenth of a window. The error swings in this time. Nothing should be learned
 * from an error that swings, even where it is small because it passes through zero. */
#ifndef COGLESS_QUALITY_H
#define COGLESS_QUALITY_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real span;    /* mechanical angle by which the rotor turns in a window [rad], > 0; 0: default 2 pi */
    cgl_real longest; /* longest time of a window [s], 1 to 1e9 periods of the calls; 0: default 60 */
    cgl_real outlier; /* ratio of the least outlier to the root mean square of the last window's errors [-], >= 1; 0: nothing is an
                         outlier; default 0 */
    cgl_real floor;   /* error up to which nothing is an outlier [unit of the error], >= 0; default 0 */
} cgl_quality_config;

/* A window is summed in parts. A part has few samples, so its sum stays exact. At the end of the part, its sum is added to the sum of
 * the window's earlier parts. [unit] is the unit of the error. The config comes last: a processor reaches the first bytes of a struct with
 * shorter instructions. */
typedef struct {
    bool run_positive;            /* true: the errors of the present run are positive */
    bool has_long_run;            /* this window has had a run of at least four outliers of one sign */
    bool learned;                 /* something was learned in this window */
    bool began;                   /* a window in which something was learned has ended */
    uint32_t outliers;            /* outliers in this window */
    uint32_t wait;                /* samples for which learning waits after a run: a sixteenth of the last window */
    uint32_t waiting;             /* samples of the present wait that are still to come */
    uint32_t run_length;          /* length of the run: successive outliers of one sign, up to the last outlier */
    uint32_t run_remaining;       /* value of `remaining` at the last outlier */
    uint32_t longest;             /* largest number of samples in a window */
    uint32_t remaining;           /* samples until this window ends at the latest */
    uint32_t missing;             /* samples of this window without a usable error */
    uint32_t windows;             /* number of windows that have ended; the count stops at its largest value */
    cgl_real centre;              /* mean error of the last window, or the first error [unit] */
    cgl_real sum, squares;        /* sums over this part, without outliers: deviation of the error from `centre`, and its square */
    cgl_real sum_before, squares_before;   /* the same sums over the earlier parts of this window */
    cgl_real sum_lost, squares_lost;       /* rounding errors of sum_before and squares_before, added with the next part */
    cgl_real outlier_sum, outlier_squares; /* the same sums over the window's outliers */
    cgl_real peak_square;         /* largest square of an outlier in this window [unit^2] */
    cgl_real last_peak_square;    /* peak_square of the last window [unit^2]; 0 if that window had no long run */
    cgl_real refused_square;      /* largest square of an error from which the law may learn [unit^2], >= outlier_square */
    cgl_real turned;              /* sum of the speeds in this window [rad/s] */
    cgl_real span_square;         /* least square of `turned` at which a window ends [rad^2/s^2] */
    cgl_real ordinary_square;     /* largest square of an error that the short form of a step handles [unit^2]; < 0: it handles none */
    cgl_real outlier_square;      /* largest square of an error that is no outlier [unit^2]; < 0 before the first error */
    cgl_real ripple;              /* variance of the error in the last window [unit^2] */
    cgl_real ripple_before;       /* `ripple` of the last settled window before learning, or else of the first with learning [unit^2] */
    cgl_real trend;               /* relative change of the ripple from window to window [-], clipped and smoothed */
    cgl_quality_config config;
    cgl_real ts;                  /* period of the calls [s] */
} cgl_quality;

typedef struct {
    cgl_real residual; /* standard deviation of the error over the last window [unit of the error]; 0 before the first window has ended */
    cgl_real progress; /* 1 - residual / (residual before learning) [-]; 0: no change, 1: no ripple is left, < 0: more ripple than
                          before. A window in a run-up gives no residual before learning */
    bool known;        /* at least one window has ended */
    bool improving;    /* learning has begun, and the residual comes down by more than 2 % a window on average */
    bool worsening;    /* learning has begun, and the residual goes up by more than 2 % a window on average */
} cgl_quality_report;

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_quality_bad_field(const cgl_quality_config *config, cgl_real ts);

cgl_error cgl_quality_init(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts);

/* Replaces the config at run time. The present window begins anew. The results of earlier windows stay. Until the new window ends, the
 * bounds of outliers from the earlier windows stay too. */
cgl_error cgl_quality_retune(cgl_quality *quality, const cgl_quality_config *config);

void cgl_quality_reset(cgl_quality *quality);

/* Takes one sample: the error, the mechanical speed [rad/s], and whether the law learns from it. An error that is not finite or beyond
 * 1e14 does not count. Returns true if nothing should be learned from this error. */
bool cgl_quality_step(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                      bool learning);

/* Reads the quality. This function computes two square roots, so call it in a background task. */
cgl_quality_report cgl_quality_read(const cgl_quality *quality);

#ifdef __cplusplus
}
#endif

#endif
