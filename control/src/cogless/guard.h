/* A guard against harmful learning. The guard compares the speed error with and without the learned current, and takes this current away if
 * it does harm. A window is a time of whole turns, or 2.5 s if a turn takes longer. The ripple of a window is the mean square of the speed
 * error's deviation from its mean over a turn. s is the share of the learned current that acts, that is, the share that is added to the
 * feedback. In a test nothing is learned. So the error changes in proportion to s, and the ripple P(s) is a parabola that opens upwards. A
 * test has two parts:
 *
 *   PART   s = 3/4. P(0) is at least 4 P(3/4) - 3 P(1). If P(1) is at most 1.18 times this bound, what is learned does no harm, and the
 *          test ends. PART adds only a sixteenth of the ripple that ALONE adds
 *   ALONE  s = 0, if PART proved nothing or was skipped after a suspicion. P(1) > 1.18 P(0) is evidence of harm, anything else is not
 *
 * Each part also gives the bar, the ripple with which every window of learning is compared: P(0) from ALONE; from PART the lower bound of
 * P(0), or P(1) if P(1) is more. A window is bad if its ripple is above 1.18 times the bar. A burst is a ripple of 16 times the bar. A
 * burst, or a bad window just before the test, is a suspicion.
 *
 *   START  Nothing has been learned yet. Measures the bar -> LEARN. If the rotor is at its reference in the first sample, LEARN begins at
 *          once, and its first window gives the bar
 *   LEARN  A test is due after 16 windows, then after 32, 64, up to 1024. A burst or two successive bad windows lead to a test -> HOLD
 *   HOLD   All of the learned current acts, but learning is frozen. The ripple that settles is P(1) -> PART, or ALONE after a suspicion. If
 *          a window is no longer bad after a suspicion, learning itself was the fault: one count of evidence -> LEARN
 *   FORGET Four counts of evidence convict: what is learned is cleared -> MUTE. A table that no law is learning goes to MUTE at once
 *   MUTE   Nothing learned acts. Measures the bar. Then learning goes on more gently, which means with a smaller gain and more forgetting
 *          -> LEARN. A table acts again after a long while */
#ifndef COGLESS_GUARD_H
#define COGLESS_GUARD_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_GUARD_STEPS 6U /* number of steps of gentle learning: each learns more gently than the one before, and the last learns
                              nothing */

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
    cgl_real error;     /* error of the speed [rad/s] */
    cgl_real omega_ref; /* reference of the speed [rad/s] */
    bool plausible;     /* false: the guard ignores this sample */
    bool saturated;     /* the current loop falls short of its reference, as on a weak bus */
    bool learn;         /* the caller wants learning */
    bool learned;       /* the law has learned in its last step */
} cgl_guard_input;

typedef struct {
    cgl_real share;     /* s, the share of the learned current that acts [-], 0 to 1 */
    uint32_t gentle;    /* step of gentle learning, an index of cgl_gentle_steps */
    uint8_t phase;      /* cgl_guard_phase */
    uint8_t evidence;   /* counts of evidence of harm since the last test without harm; at most 16 windows of LEARN clear them too */
    uint8_t bad;        /* in LEARN: number of successive bad windows; 2 lead to a test. In HOLD: 0 if there is no suspicion. In a test:
                           0 if P(1) is the ripple of a burst, else 1 */
    bool taught;        /* something has been learned since the start, or since four counts of evidence last convicted */
    cgl_real ts;        /* period of the calls [s] */
    cgl_real mean;      /* mean of the error over about a turn, by a low-pass filter [rad/s] */
    cgl_real last_error; /* error of the last sample [rad/s] */
    cgl_real squares;   /* sum over this window of the square of (mean of two successive errors, less `mean`) [rad^2/s^2] */
    cgl_real fast;      /* sum over this window of the square of half the difference of two successive errors [rad^2/s^2] */
    uint32_t count;     /* samples in this window */
    uint32_t length;    /* length of a whole window [samples]; 0: the next window has not begun */
    uint32_t limited;   /* successive samples in which the current loop fell short of its reference. A count above an eighth of the window
                           stays until the window ends */
    cgl_real ripple;    /* ripple of the last window [rad^2/s^2] */
    cgl_real acting;    /* P(1) of the last HOLD [rad^2/s^2] */
    cgl_real alone;     /* the bar: P(0), or the bound that PART gives [rad^2/s^2]; 0: unknown */
    cgl_real noise;     /* mean of the squares in `fast`, in the last window in which nothing learned acted [rad^2/s^2] */
    cgl_real speed;     /* reference of the speed when P(1) was measured [rad/s]. CGL_REAL_MAX: the reference moved in the test, so
                           another speed is no reason to test again soon */
    uint32_t age;       /* age of the last test [1/8 windows]: a window adds 8, but only 1 if learning halves the ripple's amplitude */
    uint32_t patience;  /* value of `age` at which a test is due [windows] */
    uint32_t good;      /* number of windows since `gentle` changed */
    uint32_t retry;     /* value of `good` at which `gentle` goes one step back */
} cgl_guard;

/* How gently a law learns at step k of cgl_gentle_steps. */
typedef struct {
    cgl_real most;       /* bound of the learning gain, as a multiple of the feedback's own gain [-] */
    cgl_real gain;       /* factor on the gain within that bound [-] */
    cgl_real forgetting; /* factor on what the law recalls from its memory [-] */
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
/* Returns the factor, 0 to 1, on a law's correction at step k. `gain` is the learning gain per period, `feedback` the feedback's gain.
 * Both are >= 0 and in the same unit. */
cgl_real cgl_gentle_gain(uint32_t k, cgl_real gain, cgl_real feedback);
cgl_real cgl_gentle_forgetting(uint32_t k);
#endif

/* ts: period of the calls [s], > 0. */
cgl_error cgl_guard_init(cgl_guard *guard, cgl_real ts);
void cgl_guard_reset(cgl_guard *guard);

/* Takes one sample. Decides guard->share and guard->gentle, and the results of cgl_guard_may_learn() and cgl_guard_forgets(). The share
 * stays within 0 and 1 for any input. */
void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in);

/* Whether learning is allowed: no test is under way, and all of the learned current acts. */
static inline bool cgl_guard_may_learn(const cgl_guard *guard)
{
    return guard->phase == (uint8_t)CGL_GUARD_LEARN && guard->share >= CGL_R(1.0);
}

/* Whether the law has to clear what is learned. */
static inline bool cgl_guard_forgets(const cgl_guard *guard)
{
    return guard->phase == (uint8_t)CGL_GUARD_FORGET;
}

/* Whether the guard holds learning back: learning is frozen, more gentle than at the first step, or not all of the learned current acts. */
static inline bool cgl_guard_acts(const cgl_guard *guard)
{
    return guard->phase > (uint8_t)CGL_GUARD_LEARN || guard->gentle > 1U;
}

#ifdef __cplusplus
}
#endif

#endif
