/* The memory of a learning law: what was done one period ago, by angle or by time.
 *
 * A law asks for the value of one period ago (recall), corrects it, and puts the new value in its place (update).
 * By angle, the period is a part of the revolution and the memory a map over it, whose entries are written as the rotor
 * passes them; any speed, standstill and reversal are allowed. By time, the memory is a delay line whose length follows
 * the reference speed and may be a fraction of a sample. */
#ifndef COGLESS_MEMORY_H
#define COGLESS_MEMORY_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_CELLS_MAX 65535U      /* entries of a map */
#define CGL_SAMPLES_MAX 16777216U /* samples in a delay line: a float counts them up to there */

typedef enum { CGL_MEMORY_ANGLE, CGL_MEMORY_TIME } cgl_memory_kind;

typedef struct {
    cgl_memory_kind kind;
    uint32_t cells;           /* angle: entries per period, 4 to 65535; time: longest period [samples], 4 to 16777216 */
    uint32_t periods_per_rev; /* periods in one mechanical revolution: pole pairs, or 1; 1 to 65535 */
    uint32_t q_half_width;    /* zero-phase low-pass (Q filter): mean of this many entries on each side; 0: none.
                                 2 q_half_width + 1 <= cells */
    uint32_t lead;            /* a correction goes to what acted this many samples ago [samples], 0 to cells / 4: makes up
                                 for the time in which the loop answers; 0: to the present, and it acts at once */
    cgl_real forgetting;      /* factor on what is recalled, in (0, 1]; 1: none */
    cgl_real limit;           /* every entry stays within +-limit [unit of the entry], > 0 */
} cgl_memory_config;

typedef struct {
    cgl_memory_config config;
    cgl_real ts;            /* sampling period [s] */
    cgl_real per_rad;       /* periods per angle [1/rad] */
    cgl_real gain;          /* forgetting, over the entries of the Q filter */
    cgl_real length;        /* cells of the config, as a number */
    cgl_real lead;          /* and its lead */
    cgl_real fastest;       /* angle: at which the short way of a step goes, a lead stays within a quarter [cells] */
    cgl_real *cell;         /* caller's memory: CGL_MEMORY_LENGTH entries; by angle the map comes first */
    cgl_real position;      /* angle: where the value below belongs [cells] */
    uint32_t at;            /* angle: the cell at or before it */
    cgl_real value;         /* the last stored value */
    cgl_real next_position; /* angle: where recall was asked [cells] */
    uint32_t next;          /* angle: the cell at or before it */
    cgl_real lag_position;  /* angle: where the correction below belongs, `lead` samples behind [cells] */
    cgl_real lag;           /* angle: how far behind `position` that is [cells] */
    uint32_t lag_cell;      /* angle: the cell at or before it */
    cgl_real correction;    /* angle: the last correction */
    uint32_t newest;        /* angle: last cell written, while not steady; time: place of the last value */
    uint32_t known;         /* angle: overwritten entries still remembered; time: values stored so far */
    uint32_t head;          /* angle: place in the ring of the entry overwritten next */
    int direction;          /* angle: of the last cells written: 1, -1, or 0 for none */
    bool started;           /* angle: position and value are valid */
    bool steady;            /* angle: goes on forward, the ring is full, all of this is valid, and so are: */
    cgl_real sum;           /* the entries of one period ago that the Q filter adds up around `at` */
    cgl_real change;        /* by which that sum changes one cell further */
    bool lagging;           /* angle: lag_position and correction are valid */
} cgl_memory;

/* Entries that the caller provides: the period, and as many as the Q filter looks back on. */
#define CGL_MEMORY_LENGTH(cells, q_half_width) ((cells) + (q_half_width) + 1U)

/* Takes the caller's memory of `length` entries and clears it. */
cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, cgl_real *cell, uint32_t length);

/* Forgets everything learned. */
void cgl_memory_reset(cgl_memory *memory);

/* Gives the value stored one period ago, within the limit: with learn, to learn on from (Q filter and forgetting
 * applied); without, to repeat while learning is frozen. Returns false, and the value 0, where no such value exists:
 * the angle is not finite or beyond CGL_ANGLE_MAX, or (by time) the reference is so slow that a period exceeds the memory,
 * or so fast that the Q filter does. theta_m [rad] and omega_ref [rad/s] are mechanical. */
bool cgl_memory_recall(cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref,
                       bool learn, cgl_real *value);

/* Puts the value at the place that recall was asked for, and adds the correction there or, with a lead, where the rotor
 * was `lead` samples ago. Returns what acts now: the value, with the correction if there is no lead. All stays within the
 * limit (not finite: 0). By angle, every cell passed since the last update gets a value on the straight line between the
 * two; a jump of more than a quarter of the period writes nothing. With learn false a map stays as it is, a delay line
 * goes on with the value given, and the correction is ignored. */
cgl_real cgl_memory_update(cgl_memory *memory, cgl_real value, cgl_real correction,
                           bool learn);

/* Multiplies what is recalled to learn on from by a further factor, 0 to 1; 1 undoes it. */
void cgl_memory_soften(cgl_memory *memory, cgl_real factor);

/* In place of a step: clears the cells that the rotor has passed since the last one; a delay line at once. */
void cgl_memory_forget(cgl_memory *memory, cgl_real theta_m);

/* Recall and update in one step: recalls, adds the correction, and returns what acts now. *learn, whether to learn, becomes
 * false where no value of one period ago exists, or angle or correction are not plausible. */
cgl_real cgl_memory_step(cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref,
                         cgl_real correction, bool *learn);

#ifdef __cplusplus
}
#endif

#endif
