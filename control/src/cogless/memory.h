/* The memory of a learning law. The memory recalls what was learned one period of an angle ago, for up to three functions of the angle at
 * once. Each function is a channel.
 *
 * There are three kinds. CGL_MEMORY_ANGLE is a map over the period, whose cells are written as the rotor passes them. A map allows any
 * speed, standstill and reversal. CGL_MEMORY_TIME is a delay line as long as a period at the reference speed. CGL_MEMORY_DELAY is a delay
 * line that is read at the time P_t ago, when the angle was one period less (Verrelli 2016); see delay_line.h. */
#ifndef COGLESS_MEMORY_H
#define COGLESS_MEMORY_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_CHANNELS 3
#define CGL_CELLS_MAX 65535U      /* largest number of entries of a map */
#define CGL_SAMPLES_MAX 16777216U /* largest number of samples in a delay line: a float counts exactly up to this number */

typedef enum { CGL_MEMORY_ANGLE, CGL_MEMORY_TIME, CGL_MEMORY_DELAY } cgl_memory_kind;
typedef enum { CGL_DELAY_ODE, CGL_DELAY_INVERSION } cgl_delay_method;

typedef struct {
    cgl_memory_kind kind;         /* default CGL_MEMORY_ANGLE */
    uint32_t channels;            /* number of functions of the angle, 1 to CGL_CHANNELS; 0: default 1 */
    uint32_t cells;               /* kind angle: entries per period, 4 to 65535; other kinds: longest period [samples], 4 to 16777216 */
    uint32_t turns, parts;        /* the period is turns / parts of a revolution, each 1 to 65535; 0: default 1 */
    uint32_t q_half_width;        /* half width of the Q filter [entries], 0 to cells / 2 - 1; 0: no filter; default 0. The filter is a
                                     zero-phase low-pass: the mean of an entry and of q_half_width entries on each side */
    uint32_t lead;                /* delay of the loop for which learning makes up [samples], 0 to cells / 4; default 0. A correction is
                                     stored at the place of `lead` samples ago. With a lead of 0 this is the present place, so the
                                     correction acts at once */
    cgl_real forgetting;          /* factor on the recalled value, before the correction is added [-], > 0, <= 1; 0: default 1 */
    cgl_real limit[CGL_CHANNELS]; /* bound of the magnitude of a channel's entries [unit of the entry], > 0 for each channel in use;
                                     2 (q_half_width + 1) limit must be finite */
    cgl_delay_method method;      /* kind delay: method to find P_t; default CGL_DELAY_ODE, as in the paper */
    cgl_real k_pp;                /* kind delay with CGL_DELAY_ODE: stabilising gain [1/s], > 0, k_pp ts < 1; 0: default 10 */
} cgl_memory_config;

/* State of a map. The Q filter needs the entries of one period ago on both sides of the rotor. But the cells that the rotor has just passed
 * already have new values. So a ring of entries, stored after the map's entries, keeps the old values of these cells. While the rotor turns
 * backward, cells are counted from the other end of the map, so the cell number always rises. */
typedef struct {
    bool backward;                 /* true: cell n is entry cells - 1 - n, and x is -width less the place; false: cell n is entry n, and
                                      x is the place */
    bool started;                  /* x is valid */
    bool follows;                  /* the last step learned. So the cells passed in the next step get values on the straight line between
                                      the values of both steps */
    bool lagging;                  /* lag_x and correction are valid */
    uint32_t angle;                /* last angle [2^-32 revolutions] */
    uint32_t turn;                 /* turn within a period of several turns */
    uint32_t x;                    /* place in the period, counted in the direction of motion [2^-32 periods] */
    uint32_t at;                   /* number of the cell at x or before it */
    cgl_real part;                 /* share of the way from cell `at` to the next cell at which x lies [-] */
    uint32_t width;                /* width of a cell [2^-32 periods] */
    cgl_real per_cell;             /* width of a cell, as a real number [2^-32 periods] */
    uint32_t most;                 /* longest way in a step in which the map learns [2^-32 periods] */
    uint32_t passed;               /* number of cells passed in the last step */
    uint32_t head;                 /* ring index of the cell passed last */
    uint32_t half;                 /* number of cells on each side of `at` that the channels' `sum` covers; the sum is complete when this
                                      is q_half_width */
    uint32_t anew_left;            /* cells to pass until the channels' sums `anew` are complete */
    uint32_t lag_x;                /* place of the last correction: the rotor's place `lead` samples before the last step [2^-32 periods] */
} cgl_angle_map;

/* State of one channel. A centred channel is one whose mean belongs to an integral beside the memory: see cgl_memory_centre(). */
typedef struct {
    cgl_real value;      /* value of the last step, within the limit */
    cgl_real limit;      /* limit from the config */
    cgl_real sum;        /* map: sum of the entries in the Q filter, as they were before the rotor passed them */
    cgl_real anew;       /* map: the same sum, begun anew. Once complete, it replaces `sum`, to remove rounding errors */
    cgl_real correction; /* map: last correction */
    cgl_real partial;    /* sum of the entries that have been read for the mean over this period, each divided by `cells` */
    cgl_real drain;      /* centred channel: part of the mean that the next period removes, times the number of entries in the Q filter */
    cgl_real transfer;   /* centred channel: part of the mean that the last learning step removed, for the caller to add to the integral */
} cgl_channel;

/* State of a delay line, which is a ring of samples. */
typedef struct {
    uint32_t newest;   /* index of the newest sample */
    uint32_t known;    /* number of samples stored */
    cgl_real x;        /* kind delay: the angle [periods], in [0, 1) */
    cgl_real p_t;      /* kind delay: P_t [s]; 0 if it is unknown */
    cgl_real distance; /* kind delay: angle from the sample `then` to the newest one [periods] */
    cgl_real part;     /* share of the way from the sample `then` to the one before it */
    cgl_real span;     /* number of samples in the sum for the mean */
    uint32_t then;     /* index of the oldest sample that is at most one period old */
    bool tracking;     /* kind delay: `then` and `part` belong to P_t */
} cgl_delay_line;

typedef struct {
    uint32_t ready;               /* CGL_READY after init */
    bool learning;                /* the last step learned */
    cgl_angle_map map;
    uint32_t row;                 /* entries of a channel: CGL_MEMORY_ROW */
    uint32_t fewest;              /* smallest number of samples in a period with which the memory learns */
    uint32_t periods;             /* number of periods in `turns` revolutions of theta */
    uint32_t centred;             /* number of centred channels: the first ones */
    uint32_t scan_cell;           /* next cell to add to the sum for the mean */
    cgl_real *cell;               /* caller's memory: one row of CGL_MEMORY_ROW entries per channel. A row has the cells and the ring of
                                     a map, or the samples of a delay line. In kind delay one more row, the first, has the angle x of
                                     each sample */
    cgl_real gain;                /* forgetting, divided by the number of entries in the Q filter */
    cgl_real per_entry;           /* weight of an entry in the mean */
    cgl_real ts;                  /* sampling period [s] */
    cgl_memory_config config;     /* config, with defaults in place of zeros */
    cgl_channel channel[CGL_CHANNELS];
    cgl_delay_line line;
} cgl_memory;

/* CGL_MEMORY_ROW is the number of entries of one channel, CGL_MEMORY_LENGTH that of the caller's memory. */
#define CGL_MEMORY_ROW(cells, q_half_width) ((cells) + (q_half_width) + 1U)
#define CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width)                                                         \
    (((channels) + ((channels) == 0U ? 1U : 0U) + ((kind) == CGL_MEMORY_DELAY ? 1U : 0U)) * CGL_MEMORY_ROW(cells, q_half_width))

/* CGL_MAP defines the memory of a map with one channel, and CGL_ENTRIES is its number of entries:
 *
 *   CGL_MAP(ripple, 256, 2);
 *   cgl_pi_ilc_init(&law, &config, &drive.loop, ripple, CGL_ENTRIES(ripple)); */
#define CGL_MAP(name, cells, q_half_width) static cgl_real name[CGL_MEMORY_ROW((cells), (q_half_width))]
#define CGL_ENTRIES(array) ((uint32_t)(sizeof(array) / sizeof((array)[0])))

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_memory_bad_field(const cgl_memory_config *config, cgl_real ts);

/* Copies the config, and clears the caller's memory. `length` must be exactly CGL_MEMORY_LENGTH, a number of entries: a sizeof is
 * refused. ts is the sampling period [s], > 0. One revolution of theta counts as `ratio` revolutions in the config, 1 to 65535. With
 * COGLESS_NO_DELAY_LINE, delay_line.c is left out, and a map is the only kind. */
cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, uint32_t ratio, cgl_real *cell,
                          uint32_t length);

/* Replaces forgetting, limit, lead, method and k_pp at run time; the other fields must not change. What is learned stays, but is clipped to
 * the new limits. The run time grows with the number of cells. */
cgl_error cgl_memory_retune(cgl_memory *memory, const cgl_memory_config *config);

/* Sets a second factor, 0 to 1, on the recalled value, beside `forgetting`. 1 has no effect. 0, with corrections of 0, clears the cells
 * that the rotor passes. */
void cgl_memory_soften(cgl_memory *memory, cgl_real factor);

/* Declares that an integral beside the memory has the means of the first `centred` channels. After init, `centred` is 0. Two integrators
 * of the same mean would drift apart. So each learning period keeps at most 15/16 of a centred channel's mean. The deviation from the mean
 * is not reduced. A learning step removes `transfer` from the channel. Add `transfer` to the integral: then the sum of channel and integral
 * stays the same. */
void cgl_memory_centre(cgl_memory *memory, uint32_t centred);

/* Forgets everything learned. */
void cgl_memory_reset(cgl_memory *memory);

/* Does one step: recalls what was learned one period ago, adds each channel's correction, and stores the result. `value` gets each
 * channel's present value, before the limit. Without a lead the correction is a part of it. Returns whether the step has learned. A step
 * that does not learn adds no correction, and does not change a map by a single bit.
 *
 * theta is the angle [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX. `speed` is the speed of theta [rad/s]. Kind
 * time uses |speed|. Kind delay runs while `speed` is > 0.
 *
 * No kind learns if `learn` is false, the angle is not plausible, a correction is not finite, or the speed is above cgl_memory_fastest().
 * After a jump or a reversal of the rotor, a map does not learn until the sum of its Q filter is complete again. This takes q_half_width
 * steps. A delay line stops while the period is longer than the line. Kind time also stops above cgl_memory_fastest(). While a delay line
 * stops, or the angle is not plausible, `value` is the last value.
 *
 * A rotor that turns back by less than a cell counts as standing. A jump is a step by more than a quarter of the period, or by more cells
 * than 16 plus twice those of the last step. */
bool cgl_memory_step(cgl_memory *memory, cgl_real theta, cgl_real speed, bool learn, const cgl_real *correction,
                     cgl_real *value);

/* Returns the highest speed of theta at which the memory learns [rad/s]. Up to this speed a sample and the lead each take at most a
 * quarter of the period, and the Q filter of a delay line fits into the period. */
cgl_real cgl_memory_fastest(const cgl_memory *memory);

#ifdef __cplusplus
}
#endif

#endif
