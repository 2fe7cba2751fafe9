/* The memory of a learning law: what was learned one period of an angle ago, for up to three functions of it at once.
 *
 * Angle: a map over the period, whose cells are written as the rotor passes them. Any speed, standstill and reversal are
 * allowed. Time: a delay line as long as a period of the reference speed. Delay: a delay line read where the angle was one
 * period less, at the time P_t ago, as in Verrelli 2016; delay_line.h. */
#ifndef COGLESS_MEMORY_H
#define COGLESS_MEMORY_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_CHANNELS 3
#define CGL_CELLS_MAX 65535U      /* entries of a map */
#define CGL_SAMPLES_MAX 16777216U /* samples in a delay line: a float counts them up to there */

typedef enum { CGL_MEMORY_ANGLE, CGL_MEMORY_TIME, CGL_MEMORY_DELAY } cgl_memory_kind;
typedef enum { CGL_DELAY_ODE, CGL_DELAY_INVERSION } cgl_delay_method;

typedef struct {
    cgl_memory_kind kind;         /* default CGL_MEMORY_ANGLE */
    uint32_t channels;            /* functions of the angle, 1 to CGL_CHANNELS; 0: default 1 */
    uint32_t cells;               /* map: entries per period, 4 to 65535; lines: longest period [samples], 4 to 16777216 */
    uint32_t turns, parts;        /* period: turns / parts of a revolution, each 1 to 65535; 0: default 1 */
    uint32_t q_half_width;        /* zero-phase low-pass (Q filter): mean of this many entries on each side, 0 to
                                     cells / 2 - 1; 0: none; default 0 */
    uint32_t lead;                /* a correction goes to what acted this many samples ago [samples], 0 to cells / 4: makes up
                                     for the time in which the loop answers; 0: to the present, and it acts at once; default 0 */
    cgl_real forgetting;          /* factor on what is recalled to learn on from [-], > 0, <= 1; 0: default 1 */
    cgl_real limit[CGL_CHANNELS]; /* entries of the channels in use stay within +-limit [unit of the entry], > 0,
                                     2 (q_half_width + 1) limit finite */
    cgl_delay_method method;      /* kind delay: how P_t is found; default CGL_DELAY_ODE, as in the paper */
    cgl_real k_pp;                /* kind delay, CGL_DELAY_ODE: stabilising gain [1/s], > 0, k_pp ts < 1; 0: default 10 */
} cgl_memory_config;

/* A map's state. The cells last passed wait as they were in a ring behind the map, as many as the Q filter looks back on: it
 * sees what is one period old on both sides, although the map is written meanwhile. On the way back cells are counted from the
 * other end, so that a rotor always goes on. */
typedef struct {
    bool backward;                 /* number n is entry cells - 1 - n, a place x is at -width - x; forward n and x */
    bool started;                  /* x is valid */
    bool follows;                  /* the last step learned: the next values have a line back to its own */
    bool lagging;                  /* lag_x and correction are valid */
    uint32_t angle;                /* last one [2^-32 revolutions] */
    uint32_t turn;                 /* of the period's turns */
    uint32_t x;                    /* the place in the period, as it is counted [2^-32 periods] */
    uint32_t at;                   /* the cell at or before it */
    cgl_real part;                 /* of the way from there to the next cell */
    uint32_t width;                /* of a cell [2^-32 periods] */
    cgl_real per_cell;             /* 2^-32 periods in a cell */
    uint32_t most;                 /* way of a step in which it learns [2^-32 periods] */
    uint32_t passed;               /* cells passed in the last step */
    uint32_t head;                 /* place in the ring of the cell passed last */
    uint32_t half;                 /* the sum is over the cell `at` and this many on each side; q_half_width: all */
    uint32_t anew_left;            /* cells until the channels' new sums are whole */
    uint32_t lag_x;                /* where the last correction went, `lead` samples behind [2^-32 periods] */
} cgl_angle_map;

/* What a channel has of its own. */
typedef struct {
    cgl_real value;      /* of the last step, within the limit */
    cgl_real limit;      /* of the config */
    cgl_real sum;        /* map: of what was one period ago in the cells of the Q filter */
    cgl_real anew;       /* map: the same from its beginning, as changes to the sum round */
    cgl_real correction; /* map: the last one */
    cgl_real partial;    /* mean over the period, summed so far */
    cgl_real drain;      /* centred: the part of the mean that the next period takes away, times the Q filter's entries */
    cgl_real transfer;   /* centred: the part that the last learning step took away; the integral takes it over */
} cgl_channel;

/* A delay line's state: a ring of samples in which newer ones come later. */
typedef struct {
    uint32_t newest;   /* place of the last sample */
    uint32_t known;    /* samples stored so far */
    cgl_real x;        /* delay: the angle, in [0, 1) of a period */
    cgl_real p_t;      /* delay: P_t [s]; 0 where it is not known */
    cgl_real distance; /* delay: from the sample `then` to the last one [periods] */
    cgl_real part;     /* of the way from the sample `then` to the one before */
    cgl_real span;     /* samples in the mean's sum so far */
    uint32_t then;     /* place of the sample of one period ago */
    bool tracking;     /* delay: `then` and `part` are those of P_t */
} cgl_delay_line;

typedef struct {
    uint32_t ready;               /* CGL_READY after init */
    bool learning;                /* the last step learned */
    cgl_angle_map map;
    uint32_t row;                 /* entries of a channel: CGL_MEMORY_ROW */
    uint32_t fewest;              /* samples in a period, with fewer of which it does not learn */
    uint32_t periods;             /* of the memory in `turns` revolutions of theta */
    uint32_t centred;             /* number of first channels whose mean over the period belongs to an integral */
    uint32_t scan_cell;           /* the map's next cell for the mean's sum */
    cgl_real *cell;               /* caller's memory, a row of CGL_MEMORY_ROW entries for each channel: a map's cells, then its
                                     ring; a line's samples. Kind delay: a row of x comes first */
    cgl_real gain;                /* forgetting, over the entries of the Q filter */
    cgl_real per_entry;           /* weight of an entry in the mean */
    cgl_real ts;                  /* sampling period [s] */
    cgl_memory_config config;     /* with its defaults */
    cgl_channel channel[CGL_CHANNELS];
    cgl_delay_line line;
} cgl_memory;

/* Entries of a row, and entries that the caller provides. */
#define CGL_MEMORY_ROW(cells, q_half_width) ((cells) + (q_half_width) + 1U)
#define CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width)                                                         \
    (((channels) + ((channels) == 0U ? 1U : 0U) + ((kind) == CGL_MEMORY_DELAY ? 1U : 0U)) * CGL_MEMORY_ROW(cells, q_half_width))

/* Defines the memory of a map with one channel, and the number of its entries for init: CGL_MAP(ripple, 256, 2);
 * cgl_pi_ilc_init(&law, &config, &drive.loop, ripple, CGL_ENTRIES(ripple)). */
#define CGL_MAP(name, cells, q_half_width) static cgl_real name[CGL_MEMORY_ROW((cells), (q_half_width))]
#define CGL_ENTRIES(array) ((uint32_t)(sizeof(array) / sizeof((array)[0])))

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_memory_bad_field(const cgl_memory_config *config, cgl_real ts);

/* Takes the config, and the caller's memory, which it clears. `length`: its entries, CGL_MEMORY_LENGTH and no
 * other, so that sizeof is refused. ts: sampling period [s], > 0; ratio:
 * revolutions of the angle that the config counts in one of theta, 1 to 65535. With COGLESS_NO_DELAY_LINE, which leaves
 * delay_line.c out, a map is the only kind. */
cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, uint32_t ratio, cgl_real *cell,
                          uint32_t length);

/* Takes other values of forgetting, limit, lead, method and k_pp while it runs; the rest must stay. What is learned stays,
 * within the new limits: takes a time that grows with the cells. */
cgl_error cgl_memory_retune(cgl_memory *memory, const cgl_memory_config *config);

/* Multiplies what is recalled to learn on from by a further factor, 0 to 1; 1 undoes it, 0 clears the cells that it passes
 * while it learns with corrections of 0. */
void cgl_memory_soften(cgl_memory *memory, cgl_real factor);

/* Says that an integral beside the memory has the mean over the period of the first `centred` channels; 0 after init. Two integrators
 * of one mean drift apart. So a learning period keeps at most 15/16 of such a channel's mean, and all of the rest. `transfer` is the
 * part that a step takes away. Add it to the integral: then the sum of channel and integral stays the same. */
void cgl_memory_centre(cgl_memory *memory, uint32_t centred);

/* Forgets everything learned. */
void cgl_memory_reset(cgl_memory *memory);

/* One step: recalls what was learned one period ago, adds a correction a channel if it learns, stores, and fills `value` with
 * what acts now, one a channel: with the correction if there is no lead, and before the limit. Returns whether it learned.
 * Where it does not, it repeats what it holds, as it is; a map stays, bit for bit.
 *
 * theta [rad]: the angle, any revolution below CGL_ANGLE_MAX. speed [rad/s]: of theta, by which a line goes on: kind time by
 * its size, kind delay while it is > 0. It does not learn where `learn` is false, the angle is not plausible or a correction
 * is not finite, or above cgl_memory_fastest; a map, after a jump or a reversal of the rotor, until the Q filter's sum is
 * whole again, a cell a step; a line, while the period is longer than it. A line then waits, and a line by time above
 * cgl_memory_fastest too: what acts is what acted last, as with an angle that is not plausible.
 *
 * A rotor that turns back by less than a cell counts as one that stands. A jump is more than a quarter of the period, or more
 * cells at once than 16 and twice as many as in the step before. */
bool cgl_memory_step(cgl_memory *memory, cgl_real theta, cgl_real speed, bool learn, const cgl_real *correction,
                     cgl_real *value);

/* The highest speed of theta at which a memory learns [rad/s]: a sample, and the lead, are at most a quarter of the period, and a
 * line's Q filter is within the period. */
cgl_real cgl_memory_fastest(const cgl_memory *memory);

#ifdef __cplusplus
}
#endif

#endif
