/* A guard that acts: where learning leaves more speed ripple than the same feedback alone, it stops and fades out.
 *
 * A window is four quarters. Each quarter is whole quarter turns of the reference, and at least a sixteenth of a second. The
 * ripple of a window has two parts. The slow part is the variance of the speed error averaged over two samples, so that the
 * counts of an encoder cancel. The fast part is the mean square of half the difference of two samples, which that average hides.
 * A window is judged by its slow part, and by as much of its fast part as exceeds 1.18 times that without learning.
 *
 * The baseline b of a speed is the ripple without learning. It is that of a calm window before learning begins, or that of a
 * probe. A drive that runs up waits for a calm window, but no longer than 3 s and a turn. A drive that is at its reference in
 * the first sample learns at once, without a baseline. Its first window of learning, or a first quarter that was twice as large,
 * stands in for it. After three turns and two seconds learning goes on only while there is less ripple than that. After sixteen
 * turns and four seconds a fifth of it is proof, and anything else leads to a probe. A fall that began in the first quarter
 * leads to one too, since it may have been the drive's own start. A burst needs no whole window: a quarter with 72 times its
 * squares ends at once.
 *
 *   IDLE    nothing has been learned yet: measures b -> LEARN
 *   LEARN   a window is a strike beyond 1.18 b, and two beyond 4 b; three strikes or a burst -> HOLD
 *   HOLD    learning stands still, and what is learned acts. Below the bar -> LEARN; above it and not falling, or a burst -> PROBE
 *   PROBE   nothing learned acts: measures b. The ripple was too much, and was learned at this speed -> CLEAR, then gentler;
 *           it was learned at another speed -> MUTE; it was not too much -> LEARN, with more strikes from then on
 *   CLEAR   what is learned is cleared cell by cell, for one turn -> LEARN
 *   MUTE    nothing learned acts for some windows, or until the speed is another -> CLEAR, or LEARN at the other speed
 *
 * A gentler step holds from a speed upwards. It is taken back after a while without trouble, and later each time. At the last
 * step nothing is learned. The guard does not see ripple that the sampled speed does not show, nor speeds whose reference never
 * rests. */
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
    bool plausible;     /* false: the guard ignores this sample */
    bool saturated;     /* the current loop falls short of its reference, as on a weak bus; if that lasts, samples are ignored */
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
    uint32_t gentle; /* 0: learn as configured; k >= 1: cgl_gentle_steps[k] */
    bool learn;      /* learning is allowed */
    bool forget;     /* what is learned is to be cleared */

    cgl_real ts;                     /* period of the calls [s] */
    cgl_real quarter_turn;           /* sum of the speeds of all samples in a quarter of a turn [rad/s] */
    cgl_real target_share;           /* the share fades to it */
    cgl_real share_step;             /* by so much in a sample */
    cgl_real last_error;             /* of the sample before [rad/s] */
    cgl_real error_centre;           /* from which deviations are: mean of the last window, or of what followed a jump [rad/s] */
    cgl_real centre_drift;           /* of the centre in this window [rad/s] */
    cgl_real window_reference;       /* reference of the speed in the window's first sample [rad/s] */
    cgl_real reference_tolerance;    /* within which it has not moved; negative before that sample [rad/s] */
    cgl_real quarter_sum;            /* of the deviations in this quarter [rad/s] */
    cgl_real quarter_squares;        /* of their squares [rad^2/s^2] */
    cgl_real quarter_way;            /* sum of measured speeds in this quarter, while what is learned is cleared [rad/s] */
    cgl_real window_sum;             /* of the deviations in the quarters before [rad/s] */
    cgl_real window_squares;         /* of their squares [rad^2/s^2] */
    cgl_real window_fast;            /* sum of squares of half the differences in this window [rad^2/s^2] */
    cgl_real last_variance;          /* of the last window in HOLD or PROBE [rad^2/s^2] */
    cgl_guard_ripple suspected_ripple; /* of the window that led to a probe */
    cgl_real squares_limit;          /* a quarter with more squares is a burst [rad^2/s^2] */
    cgl_real first_quarter_variance; /* of this window [rad^2/s^2] */
    cgl_real start_variance;         /* that learning without a baseline is compared with; until it begins, that of the window's
                                        quietest quarter [rad^2/s^2] */
    cgl_real least_variance;         /* since the baseline was measured or learning began; 0: it has no meaning [rad^2/s^2] */
    cgl_real phase_way;              /* turned in this phase, as a sum of speeds [rad/s] */
    cgl_real lesson_speed;           /* at which lessons are counted [rad/s] */
    cgl_real baseline_speed[CGL_GUARD_SPEEDS];   /* speeds with a baseline; 0: none [rad/s] */
    cgl_guard_ripple baseline[CGL_GUARD_SPEEDS]; /* and the ripple without learning at each */
    cgl_real step_speed[CGL_GUARD_STEPS];        /* speed from which on gentler step k + 1 holds [rad/s] */
    uint32_t quarter_count;          /* samples in this quarter */
    uint32_t window_count;           /* samples in the quarters before */
    uint32_t lesson_samples;         /* samples in this window in which the law learned */
    uint32_t quarter_length;         /* samples in this quarter at its end */
    uint32_t shortest_quarter;       /* samples in the shortest of all quarters */
    uint32_t longest_quarter;        /* and in the longest */
    uint32_t shortfall_samples;      /* in a row in which the current loop fell short of its reference */
    uint32_t limited_samples;        /* all such samples since the last window */
    uint32_t settling_samples;       /* left until a window begins */
    uint32_t settling_length;        /* as many in all after a change of the share */
    uint32_t phase_samples;          /* in this phase */
    uint32_t wait_count;             /* in MUTE, windows left; in IDLE, samples since a calm window */
    uint16_t good_windows;           /* since the last change of the step */
    uint8_t phase;                   /* cgl_guard_phase */
    uint8_t quarter_index;           /* of this quarter in the window, 0 to 3 */
    uint8_t strike_count;            /* of bad windows in a row, some of which count twice */
    uint8_t recovery_score;          /* rises where the ripple ends as soon as learning stands still, and falls in good windows */
    uint8_t extra_strikes;           /* needed since probes found no harm */
    uint8_t phase_windows;           /* in this phase; in LEARN, windows in a row that gain little */
    uint8_t lesson_windows;          /* in which it learned at this speed */
    uint8_t retry_doublings;         /* of the time until a gentler step is taken back */
    uint8_t next_baseline;           /* place of the baseline that is replaced next */
    bool reference_moved;            /* in this window */
    bool reference_moved_before;     /* in the window before */
    bool start_is_measured;          /* start_variance is of the window in which learning began */
    bool baseline_is_supposed;       /* it is of a rotor that did not turn with its reference, or of the begin of learning */
    bool learned_elsewhere;          /* something was learned at another speed */
    bool stalled;                    /* in the last window the rotor did not turn with its reference */
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
