/* The memory of the space-learning laws (Verrelli 2016): what was learned one period of an angle ago, for up to three
 * functions of the angle at once.
 *
 * Map: cells over the period. Any speed, standstill and reversal are allowed. Where memory.h counts mechanical
 * revolutions for one function, this one counts any period and looks up the place once for all of them.
 * Delay: a line of the last samples, read where the angle was one period less, at the time P_t ago; as in the paper.
 * Only for an angle that rises; while it does not, the line waits. P_t is found by the paper's differential equation,
 *
 *   dP_t/dt = 1 - (dx(t) + k_pp (x(t) - T - x(t - P_t))) / dx(t - P_t),   dx = dx/dt of the angle x      (Section 5)
 *
 * or by inversion, x(t - P_t) = x(t) - T with x linear between samples. */
#ifndef COGLESS_SPACE_MEMORY_H
#define COGLESS_SPACE_MEMORY_H

#include <stdint.h>

#include "memory.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_SPACE_CHANNELS 3

typedef enum { CGL_SPACE_MAP, CGL_SPACE_DELAY } cgl_space_kind;
typedef enum { CGL_DELAY_ODE, CGL_DELAY_INVERSION } cgl_delay_method;

typedef struct {
    cgl_space_kind kind;     /* default CGL_SPACE_MAP */
    uint32_t channels;       /* functions of the angle, 1 to CGL_SPACE_CHANNELS */
    uint32_t cells;          /* map: entries per period, 4 to 65535; delay: longest period [samples], 4 to 16777216 */
    uint32_t turns, parts;   /* period: turns / parts of a revolution, each 1 to 65535; default 1, 1 */
    uint32_t q_half_width;   /* zero-phase low-pass (Q filter): mean of this many cells or samples on each side; 0: none,
                                the printed scheme. 2 q_half_width + 1 <= cells; from about 3/4 of them on a map's steps
                                take longer */
    cgl_real limit[CGL_SPACE_CHANNELS]; /* entries of the channels in use stay within +-limit [unit of the entry], but for
                                           rounding; > 0, 2 (q_half_width + 1) limit finite */
    cgl_delay_method method; /* delay: how P_t is found; default CGL_DELAY_ODE, as in the paper */
    cgl_real k_pp;           /* delay, CGL_DELAY_ODE: stabilising gain [1/s], > 0, k_pp ts < 1; default 10 */
} cgl_space_memory_config;

typedef struct {
    cgl_space_memory_config config;
    cgl_real ts;                        /* sampling period [s] */
    cgl_real *cell;                     /* caller's memory, row by row of CGL_MEMORY_LENGTH(cells, q_half_width)
                                           entries. Map: a row for each channel, its cells and then a ring. Delay: a
                                           ring of x, and one for each channel */
    cgl_real periods_per_rad;           /* [1/rad] */
    cgl_real length;                    /* cells of the config, as a number */
    cgl_real per_width;                 /* kept / entries of the Q filter */
    cgl_real kept;                      /* factor on what is recalled to learn on from */
    cgl_real x;                         /* the angle, in [0, 1) of a period */
    cgl_real value[CGL_SPACE_CHANNELS]; /* the last stored; map: where the angle was `position` */
    uint32_t newest;                    /* map: last cell passed; delay: place of the last sample */
    uint32_t known;                     /* map: cells waiting in the ring; delay: samples stored so far */
    bool placed;                        /* x is that of a plausible angle; delay: that rises */
    /* map */
    cgl_real position, next_position;   /* of the last update and recall [cells] */
    uint32_t head;                      /* place in the ring of the cell passed last */
    int direction;                      /* of the cells waiting: 1, -1, or 0 for none */
    uint32_t at, next;                  /* the cells at or before them */
    bool started;                       /* position and value are valid */
    bool steady;                        /* goes on forward, the ring is full, and these are valid: */
    cgl_real sum[CGL_SPACE_CHANNELS];   /* over the Q filter's cells around `at` */
    cgl_real change[CGL_SPACE_CHANNELS]; /* by which that sum changes one cell further */
    /* delay */
    cgl_real p_t;                       /* P_t [s]; 0 where it is not known */
    cgl_real distance;                  /* from the sample `then` to the last one [periods] */
    cgl_real part;                      /* of the way from the sample `then` to the one before, for P_t */
    uint32_t then;                      /* place of that sample */
    bool tracking;                      /* `then` and `part` are those of P_t */
} cgl_space_memory;

/* Entries that the caller provides. */
#define CGL_SPACE_MEMORY_LENGTH(kind, channels, cells, q_half_width)                                                   \
    (((channels) + ((kind) == CGL_SPACE_DELAY ? 1U : 0U)) * CGL_MEMORY_LENGTH(cells, q_half_width))

/* Takes the caller's memory of `length` entries and clears it. */
cgl_error cgl_space_memory_init(cgl_space_memory *memory, const cgl_space_memory_config *config, cgl_real ts, cgl_real *cell,
                                uint32_t length);

/* Forgets everything learned. */
void cgl_space_memory_reset(cgl_space_memory *memory);

/* Gives the values stored one period ago, one a channel, within the limit but for rounding. theta [rad]: the angle by which
 * it repeats, any revolution below CGL_ANGLE_MAX. moving: false where the speed is too low for learning; then a delay
 * line waits. Returns whether the law may learn: then the Q filter is applied to the values, else they are to be
 * repeated as they are. False too where learn is; where the angle is not plausible; and, by delay, while the line
 * waits, or where the period exceeds the memory or is shorter than the Q filter. With an angle that is not plausible,
 * or a line that waits, the values are the last ones. */
bool cgl_space_memory_recall(cgl_space_memory *memory, cgl_real theta,
                             bool moving, bool learn, cgl_real *value);

/* Stores the values at the place that recall was asked for, within the limits (not finite: 0). Map: every cell passed
 * since the last update gets a value on the straight line between the two; a jump of more than a quarter of the period
 * writes nothing. With learn false a map stays as it is, and a delay line goes on with the values given, unless it
 * waits. */
void cgl_space_memory_update(cgl_space_memory *memory, const cgl_real *value,
                             bool learn);

/* Multiplies what is recalled to learn on from by a further factor, 0 to 1; 1 undoes it. */
void cgl_space_memory_soften(cgl_space_memory *memory, cgl_real factor);

/* In place of a step: clears the cells that the rotor has passed since the last one. */
void cgl_space_memory_forget(cgl_space_memory *memory, cgl_real theta, bool moving);

/* Recall and update in one step: recalls, subtracts gain step from each channel's value if learn is true, stores, and
 * returns whether it learned. The values are those before the limit. */
bool cgl_space_memory_step(cgl_space_memory *memory, cgl_real theta, bool moving,
                           bool learn, const cgl_real *gain, cgl_real step, cgl_real *value);

#ifdef __cplusplus
}
#endif

#endif
