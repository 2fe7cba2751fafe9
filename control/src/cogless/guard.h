/* A guard that acts: learning stops and fades out where it leaves more speed ripple than the same feedback without it.
 *
 * It judges by windows: four quarters, each of whole quarter turns of the reference and at least a sixteenth of a second. What
 * a window says is the variance v of the speed error, averaged over two samples, so that the counts of an encoder telescope. To
 * it comes what a mean of two samples hides: the mean square of half their difference, as far as it is above 1.18 times the
 * same without learning. The bar at a speed is b, the variance without learning: that of a calm window before learning begins,
 * else of a probe. Where the rotor runs up, learning waits for such a window, but for no more than 3 s and a turn. Where it is
 * with its reference from the first sample on, learning begins at once, and goes on for three turns and two seconds; then as
 * long as there is less ripple than in the first window, or than in its first quarter if it fell by half since. After sixteen
 * turns and four seconds a fifth of that window's is proof enough; anything else is probed, also what fell: that may have been
 * the drive's own start. A burst is 72 times the squares of a quarter: it need not end.
 *
 *   LEARN   too much, beyond 1.18 b for three windows (beyond 4 b counts twice), or a burst -> HOLD
 *   HOLD    learning stands still, what is learned acts. Below the bar -> LEARN; not, and not falling, or a burst -> PROBE
 *   PROBE   nothing learned acts: measures b. It was too much, and learned here -> CLEAR and gentler;
 *           learned elsewhere -> MUTE; it was not -> LEARN with more patience
 *   CLEAR   what is learned is forgotten, cell by cell, for one turn -> LEARN
 *   MUTE    nothing learned acts, for some windows or until the speed is another
 *
 * Gentler steps hold from a speed on, and are taken back after a while without trouble, later each time. At the last of them
 * nothing is learned. Not seen: ripple that the sampled speed does not show, and speeds whose reference never rests. */
#ifndef COGLESS_GUARD_H
#define COGLESS_GUARD_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_GUARD_SPEEDS 8U /* speeds for which a baseline is remembered */
#define CGL_GUARD_STEPS 6U  /* each learns more gently than the one before, and at the last nothing is learned */

typedef enum { CGL_GUARD_IDLE, CGL_GUARD_LEARN, CGL_GUARD_HOLD, CGL_GUARD_PROBE, CGL_GUARD_CLEAR, CGL_GUARD_MUTE } cgl_guard_phase;

typedef struct {
    cgl_real error;     /* of the speed [rad/s] */
    cgl_real omega_m;   /* measured mechanical speed [rad/s] */
    cgl_real omega_ref; /* and its reference [rad/s] */
    bool plausible;     /* false: this sample counts for nothing */
    bool saturated;     /* nor does it where the current loop has fallen short for long, as on a weak bus */
    bool learn;         /* the caller wants learning */
    bool learned;       /* the law did learn in its last step */
} cgl_guard_input;

/* Of the speed error in a window, [rad^2/s^2]. */
typedef struct {
    cgl_real slow; /* variance of the mean of two samples */
    cgl_real fast; /* mean square of half their difference */
} cgl_guard_ripple;

typedef struct {
    cgl_real share;  /* of what is learned that acts, 0 to 1 */
    uint32_t gentle; /* 0: learn as configured; k >= 1: cgl_guard_gentle(k) */
    bool learn;      /* learning is allowed */
    bool forget;     /* clear what is learned */

    cgl_real ts;                           /* period of the calls [s] */
    cgl_real quarter_turn;                 /* sum of speeds in a quarter of a turn [rad/s] */
    cgl_real target;                       /* of the share */
    cgl_real slope;                        /* of the share, a step */
    cgl_real last_error;                   /* [rad/s] */
    cgl_real centre;                       /* mean of the last window, or of what came since if it moved far [rad/s] */
    cgl_real drift;                        /* of the centre in this window [rad/s] */
    cgl_real reference, tolerance;         /* at the start of this window, and what it may differ by [rad/s] */
    cgl_real sum, squares, turned;         /* in this quarter; the last where what is learned is cleared */
    cgl_real sum_before, squares_before;   /* in the quarters before */
    cgl_real fast;                         /* squares of half the differences, in this window */
    cgl_real last;                         /* v of the last window, of the first of a probe [rad^2/s^2] */
    cgl_guard_ripple suspect;              /* when a probe began */
    cgl_real most;                         /* what `squares` may come to in this quarter */
    cgl_real first;                        /* variance of a window's first quarter [rad^2/s^2] */
    cgl_real quietest;                     /* and of its quietest; then of that which learning is compared with */
    cgl_real best;                         /* v since the baseline was supposed, or since a first quarter that fell [rad^2/s^2] */
    cgl_real way;                          /* turned in this phase, as a sum of speeds [rad/s] */
    cgl_real here;                         /* speed at which the lessons were learned [rad/s] */
    cgl_real omega[CGL_GUARD_SPEEDS];      /* speeds with a baseline; 0: none [rad/s] */
    cgl_guard_ripple baseline[CGL_GUARD_SPEEDS]; /* and these, b the slow part */
    cgl_real from[CGL_GUARD_STEPS];        /* speed from which on gentler step k + 1 holds [rad/s] */
    uint32_t count, count_before;          /* samples in this quarter and those before */
    uint32_t taught;                       /* samples that taught something, in this window */
    uint32_t length, shortest, longest;    /* samples in this quarter, and in any */
    uint32_t short_of;                     /* samples in a row in which the current loop fell short */
    uint32_t limited;                      /* and all of them since the last window */
    uint32_t settling;                     /* samples until a window begins */
    uint32_t settle;                       /* so long [samples] */
    uint32_t time;                         /* samples in this phase */
    uint32_t wait;                         /* windows left in MUTE; before learning begins, samples since a calm window */
    uint16_t good;                         /* windows since the last step */
    uint8_t phase;                         /* cgl_guard_phase */
    uint8_t quarter;                       /* of the window */
    uint8_t strikes, alarms, doubts;
    uint8_t windows;                       /* in this phase */
    uint8_t lessons;                       /* windows in which it learned here */
    uint8_t backoff;
    uint8_t next;                          /* place of the baseline that is forgotten next */
    bool moved, last_moved;                /* the reference did, in this window and the last */
    bool compared;                         /* `quietest` is of the window in which learning began */
    bool supposed;                         /* the baseline: of a rotor that did not turn with it, or of learning that helped */
    bool elsewhere;                        /* something was learned at another speed */
    bool stalled;                          /* in the last window the rotor did not turn with its reference */
} cgl_guard;

/* How gently a law learns at step k. */
typedef struct {
    cgl_real most;       /* the learning gain is at most so much of the feedback's own [-], */
    cgl_real gain;       /* and then times this [-] */
    cgl_real forgetting; /* factor on what is recalled [-] */
} cgl_gentle;

extern const cgl_gentle cgl_gentle_steps[CGL_GUARD_STEPS + 1U];

#ifdef COGLESS_NO_GUARD
static inline cgl_real cgl_gentle_gain(uint32_t k, cgl_real gain, cgl_real feedback)
{
    (void)k;
    (void)gain;
    (void)feedback;
    return CGL_R(1.0);
}

static inline cgl_real cgl_gentle_forgetting(uint32_t k)
{
    (void)k;
    return CGL_R(1.0);
}
#else
/* Factor, 0 to 1, on a law's correction at step k. gain: of learning in a period, and of the feedback, in one unit; >= 0. */
cgl_real cgl_gentle_gain(uint32_t k, cgl_real gain, cgl_real feedback);
cgl_real cgl_gentle_forgetting(uint32_t k);
#endif

/* ts: period of the calls [s], > 0. */
cgl_error cgl_guard_init(cgl_guard *guard, cgl_real ts);
void cgl_guard_reset(cgl_guard *guard);

/* One sample; decides share, gentle, learn and forget. Whatever comes in, the share stays within 0 and 1. */
void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in);

/* The guard holds learning back. */
static inline bool cgl_guard_acts(const cgl_guard *guard)
{
    return guard->phase > (uint8_t)CGL_GUARD_LEARN || guard->gentle > 1U;
}

#ifdef __cplusplus
}
#endif

#endif
