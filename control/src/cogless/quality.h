/* Quality of learning, read at run time: the residual ripple over a turn of the rotor, how far it has come down, whether
 * it still comes down; and which errors are so far from the usual that nothing should be learned from them.
 *
 * A window ends when the rotor has turned by `span`, either way, or after `longest`. An outlier teaches nothing. But what
 * lasts does: where two windows in a row have outliers that are no noise, four in a row to one side, errors of up to twice
 * the smaller peak of the two are learned in the next. After four in a row that were not, learning waits for a sixteenth of
 * a window, since a wave passes through zero. */
#ifndef COGLESS_QUALITY_H
#define COGLESS_QUALITY_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real span;    /* of a window, mechanical [rad], > 0; 0: default 2 pi */
    cgl_real longest; /* a window ends after this time in any case [s], one period of the calls to 1e9 of them; 0: default 60 */
    cgl_real outlier; /* an error beyond so many times the usual, root mean square over the last window, is an outlier [-],
                         >= 1; 0: none; default 0 */
    cgl_real floor;   /* but for errors below this [unit of the error], >= 0; default 0 */
} cgl_quality_config;

typedef struct {
    bool run_above;               /* which side */
    bool unusual;                 /* enough in a row, in this window */
    bool learned;                 /* something, in this window */
    bool began;                   /* learning, in a whole window */
    uint32_t outliers;            /* in this window */
    uint32_t wait;                /* a sixteenth of the last window [samples] */
    uint32_t waiting;             /* samples of it to come */
    uint32_t run;                 /* outliers in a row, to one side */
    uint32_t run_left;            /* `left` at the last of them */
    uint32_t longest;             /* samples in a window at most */
    uint32_t left;                /* samples until this window ends in any case */
    uint32_t missing;             /* samples of this window that were not finite */
    uint32_t windows;             /* whole ones; stays at its largest value */
    cgl_real centre;              /* mean of the last window; at first the first error [unit] */
    cgl_real sum, squares;        /* of what the errors in this part of the window differ from it, but for outliers */
    cgl_real sum_before, squares_before; /* and in the parts before */
    cgl_real sum_lost, squares_lost; /* what rounding kept from those */
    cgl_real outlier_sum, outlier_squares; /* and of those */
    cgl_real peak_square;         /* of the outliers in this window [unit^2] */
    cgl_real last_peak_square;    /* and in the last one; 0: not unusual [unit^2] */
    cgl_real refused_square;      /* an error with a larger square is not learned from; >= usual_square [unit^2] */
    cgl_real turned;              /* sum of the speeds in this window [rad/s] */
    cgl_real turned_square;       /* that ends a window [rad^2/s^2] */
    cgl_real quick_square;        /* up to which a sample needs no second look [unit^2] */
    cgl_real usual_square;        /* an error whose square is larger is an outlier [unit^2]; < 0 before the first */
    cgl_real ripple;              /* of the last whole window: variance of the error [unit^2] */
    cgl_real before;              /* ripple of the last whole window before something was learned, or of the first [unit^2] */
    cgl_real trend;               /* relative change of the ripple from window to window, clipped and smoothed */
    cgl_quality_config config;
    cgl_real ts;                  /* period of the calls [s] */
} cgl_quality;

typedef struct {
    cgl_real residual; /* standard deviation of the error over the last window [unit of the error]; 0 before the first */
    cgl_real progress; /* 1 - residual / the one before learning, in a window that was no run-up: 0 nothing learned, 1 all
                          gone, < 0 worse [-] */
    bool known;        /* there is a whole window */
    bool improving;    /* learning, and the residual still comes down, by more than 2 % a window on average */
    bool worsening;    /* learning, and it goes up, by more than 2 % a window on average */
} cgl_quality_report;

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_quality_bad_field(const cgl_quality_config *config, cgl_real ts);

cgl_error cgl_quality_init(cgl_quality *quality, const cgl_quality_config *config, cgl_real ts);

/* Takes other values while it runs. The window begins anew; what earlier ones told stays, and an outlier is judged by them
 * until it ends. */
cgl_error cgl_quality_retune(cgl_quality *quality, const cgl_quality_config *config);

void cgl_quality_reset(cgl_quality *quality);

/* One sample: the error, the mechanical speed [rad/s], and whether it teaches something. What is not finite, or above
 * 1e14, counts for nothing. Returns true where nothing should be learned from it: an outlier. */
bool cgl_quality_step(cgl_quality *quality, cgl_real error, cgl_real omega_m,
                      bool learning);

/* Reads the quality; takes two square roots, so for a background task. */
cgl_quality_report cgl_quality_read(const cgl_quality *quality);

#ifdef __cplusplus
}
#endif

#endif
