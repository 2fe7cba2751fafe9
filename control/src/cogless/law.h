/* What every law is told of the loop that steps it, and its input and output, once per period of the law. */
#ifndef COGLESS_LAW_H
#define COGLESS_LAW_H

#include "guard.h"
#include "range.h"
#include "real.h"
#include "status.h"

/* The loop that steps a law. cgl_drive_init fills in drive.loop; without a cgl_drive, fill in one of your own. */
typedef struct {
    cgl_real ts;            /* period of the law [s], > 0 */
    cgl_real current_limit; /* the largest current that the loop gives; a law's limits of current are at most this [A], > 0 */
    bool feed_forward;      /* somebody else's feedback acts. The law gives only what it learns, and its pi.kp and pi.ki tell the
                               gains of that feedback: see README.md. Laws that learn from their own feedback refuse it */
    bool guarded;           /* the guard acts: a law without any feedback gain could never learn, and is refused */
} cgl_loop;

typedef struct {
    cgl_real theta_ref; /* mechanical angle reference [rad], any revolution below CGL_ANGLE_MAX; laws of position read it. In
                           torque mode these three follow the rotor: theta_m, omega_m and 0 */
    cgl_real omega_ref; /* its derivative: mechanical speed reference [rad/s] */
    cgl_real alpha_ref; /* the derivative of that [rad/s^2]; the space-learning laws read it */
    cgl_real theta_m;   /* measured mechanical angle [rad], any revolution below CGL_ANGLE_MAX */
    cgl_real omega_m;   /* measured mechanical speed [rad/s] */
    cgl_real i_q;       /* measured q-axis current [A]; only a calibration run reads it */
    bool learn;         /* false freezes what is learned */
    bool off;           /* true: the output is 0 and integrals start anew; what is learned stays, frozen */
    bool forget;        /* clear what is learned, cell by cell as the rotor passes, even where learn is false; not while off,
                           nor in torque mode */
    cgl_real muted;     /* share of what is learned that does not act, 0 to 1; default 0, and so is whatever is no share */
    uint32_t gentle;    /* 0: learn as configured; k >= 1: with a smaller gain and more forgetting, cgl_gentle_steps[k] */
    bool torque;        /* torque mode: the output is i_q_ref and what is learned, frozen; the feedback does not act */
    cgl_real i_q_ref;   /* somebody else's current, in torque mode [A] */
} cgl_law_input;

typedef struct {
    cgl_real i_q_ref; /* reference for the current loop [A], within the law's limit */
    unsigned status;  /* CGL_STATUS_ bits */
} cgl_law_output;

/* How gently a law learns: to forget is to learn nothing and to recall nothing. */
static inline uint32_t cgl_law_gentle(const cgl_law_input *in)
{
#ifdef COGLESS_NO_GUARD
    (void)in;
    return 0U;
#else
    return in->forget ? CGL_GUARD_STEPS : in->gentle;
#endif
}

/* The share of what is learned that acts, 0 to 1; whatever is no share acts. */
static inline cgl_real cgl_law_share(const cgl_law_input *in)
{
    const cgl_real share = CGL_R(1.0) - in->muted;
    return CGL_OFTEN(share >= CGL_R(0.0) && share <= CGL_R(1.0)) ? share : CGL_R(1.0);
}

/* The feedback does not act: the law is off, or in torque mode. */
static inline bool cgl_law_stands_by(const cgl_law_input *in)
{
    return in->off || in->torque;
}

#ifdef __cplusplus
extern "C" {
#endif

/* The check with which every law's init begins. It returns the first field that it refuses, as CGL_FIELD, or NULL: a field of the
 * loop or of the config outside its range, or a limit above loop.current_limit. The last row of `range` is the config's limit of the
 * output [A]. */
const char *cgl_law_bad_field(const void *config, const cgl_range *range, uint32_t count, const cgl_loop *loop);
#define CGL_LAW_BAD_FIELD(config, range, loop) cgl_law_bad_field((config), (range), CGL_ROWS(range), (loop))

/* The same check for a law that learns from its own feedback: it refuses loop.feed_forward too. */
static inline const char *cgl_own_feedback_bad_field(const void *config, const cgl_range *range, uint32_t count, const cgl_loop *loop)
{
    const char *const field = cgl_law_bad_field(config, range, count, loop);
    return field == 0 && loop->feed_forward ? CGL_FIELD("loop.feed_forward") : field;
}
#define CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop) cgl_own_feedback_bad_field((config), (range), CGL_ROWS(range), (loop))

/* Whether the guard leaves anything of a learning gain beside a feedback's gain, in one unit. */
bool cgl_loop_can_learn(const cgl_loop *loop, cgl_real gain, cgl_real feedback);

/* The output of a law whose state no init has made: 0, with CGL_STATUS_FAULT and CGL_STATUS_OFF. */
void cgl_law_refuse(cgl_law_output *out);

/* The output of a law that stands by: 0 where it is off, else i_q_ref and what is learned [A] within the limit [A]. Returns the
 * current that the feedback takes over from, so that the output does not jump when it acts again [A]. An i_q_ref that is not
 * finite counts as 0. */
cgl_real cgl_law_stand_by(const cgl_law_input *in, cgl_real learned, cgl_real limit, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
