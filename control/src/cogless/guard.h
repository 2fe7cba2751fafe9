/* A guard that acts: what is learned is tested against the same feedback without it, and taken away where it does harm.
 *
 * The ripple of a window is the mean square of the speed error about its mean over a turn. In a test nothing is learned, so a share s
 * of what is learned changes the error in proportion, and the ripple P(s) is a parabola that opens upwards. Hence a test has two parts:
 *
 *   PART   s = 3/4. P(3/4) > P(1) proves that P(0) > P(1): what is learned helps, and the test ends, at a sixteenth of its price
 *   ALONE  s = 0, if PART proved nothing. P(1) > 1.18 P(0) is evidence of harm, anything else acquits
 *
 * Both give the bar, with which each window of learning is compared: P(0), or its bound (P(s) - s P(1)) / (1 - s).
 *
 *   START  nothing has been learned yet: measures the bar -> LEARN. A rotor that begins at its reference learns at once, and the first
 *          window of LEARN is the bar
 *   LEARN  a test is due after 16 windows, then after 32, 64, up to 1024, or after a burst or two windows above the bar -> HOLD
 *   HOLD   what is learned is frozen and acts. The ripple that settles is P(1) -> PART, or ALONE after a suspicion. If it is below the
 *          bar again, learning itself was the fault, which is one count of evidence -> LEARN
 *   FORGET four counts of evidence: what is learned is cleared -> MUTE. What nobody learns on, a table, goes to MUTE at once
 *   MUTE   nothing learned acts: measures the bar. Then it is learned more gently; a table acts again after a long while -> LEARN */
#ifndef COGLESS_GUARD_H
#define COGLESS_GUARD_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_GUARD_STEPS 6U /* each learns more gently than the one before, and at the last nothing is learned */

typedef enum {
    CGL_GUARD_START,
    CGL_GUARD_LEARN,
    CGL_GUARD_HOLD,
    CGL_GUARD_PART,
    CGL_GUARD_ALONE,
    CGL_GUARD_FORGET,
    CGL_GUARD_MUTE
} cgl_guard_phase;

typedef struct {
    cgl_real error;     /* of the speed [rad/s] */
    cgl_real omega_ref; /* reference of the speed [rad/s] */
    bool plausible;     /* false: the guard ignores this sample */
    bool saturated;     /* the current loop falls short of its reference, as on a weak bus */
    bool learn;         /* the caller wants learning */
    bool learned;       /* the law did learn in its last step */
} cgl_guard_input;

typedef struct {
    cgl_real share;     /* of what is learned that acts, 0 to 1 */
    uint32_t gentle;    /* step of gentle learning, cgl_gentle_steps[gentle] */
    uint8_t phase;      /* cgl_guard_phase */
    uint8_t evidence;   /* counts of harm since the last test without harm; good windows clear them too */
    uint8_t bad;        /* windows above the bar, in a row; 2 lead to a test. In a test: 1 if P(1) was no burst, else 0 */
    bool taught;        /* something was learned since the start or the last conviction */
    cgl_real ts;        /* period of the calls [s] */
    cgl_real mean;      /* of the error over about a turn, by a low-pass filter [rad/s] */
    cgl_real last_error; /* of the last sample [rad/s] */
    cgl_real squares;   /* sum in this window, of the mean of two samples less the mean over a turn [rad^2/s^2] */
    cgl_real fast;      /* sum in this window of the squares of half the difference of two samples [rad^2/s^2] */
    uint32_t count;     /* samples in this window */
    uint32_t length;    /* samples of a whole window; 0: the next one has not begun */
    uint32_t limited;   /* samples in a row in which the current loop fell short; it stays above an eighth of the window */
    cgl_real ripple;    /* of the last window [rad^2/s^2] */
    cgl_real acting;    /* P(1) of the last HOLD [rad^2/s^2] */
    cgl_real alone;     /* the bar: P(0), or the lower bound of P(0) that PART gives; 0: unknown [rad^2/s^2] */
    cgl_real noise;     /* mean of the fast squares when nothing learned acted last [rad^2/s^2] */
    cgl_real speed;     /* reference when P(1) was measured [rad/s] */
    uint32_t age;       /* of the last test: windows since then; those in which learning gains little count eight times */
    uint32_t patience;  /* a test is due after so many windows in which learning gains little */
    uint32_t good;      /* windows since the step changed */
    uint32_t retry;     /* at so many the step is taken back */
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

/* One sample; decides the share, the step, and what the next two tell. Whatever comes in, the share stays within 0 and 1. */
void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in);

/* Learning is allowed: nothing is tested, and all of what is learned acts. */
static inline bool cgl_guard_may_learn(const cgl_guard *guard)
{
    return guard->phase == (uint8_t)CGL_GUARD_LEARN && guard->share >= CGL_R(1.0);
}

/* What is learned is to be cleared. */
static inline bool cgl_guard_forgets(const cgl_guard *guard)
{
    return guard->phase == (uint8_t)CGL_GUARD_FORGET;
}

/* The guard holds learning back. */
static inline bool cgl_guard_acts(const cgl_guard *guard)
{
    return guard->phase > (uint8_t)CGL_GUARD_LEARN || guard->gentle > 1U;
}

#ifdef __cplusplus
}
#endif

#endif
