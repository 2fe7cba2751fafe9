/* The loop that steps a law, and the law's input and output, which are the same for every law. */
#ifndef COGLESS_LAW_H
#define COGLESS_LAW_H

#include "guard.h"
#include "range.h"
#include "real.h"
#include "status.h"

/* The loop that steps a law. cgl_drive_init fills in drive.loop; without a cgl_drive, fill in one of your own. */
typedef struct {
    cgl_real ts;            /* period of the law [s], > 0 */
    cgl_real current_limit; /* largest current of the loop [A], > 0; no limit of a law may be higher */
    bool feed_forward;      /* foreign firmware controls the speed. The law returns only what it learns, and its pi.kp and pi.ki are the
                               gains of the foreign feedback: see README.md. A law that learns from its own feedback refuses this flag */
    bool guarded;           /* the guard watches the learning. The guard bounds the learning gain by the feedback gain, so init refuses a
                               law that learns without a feedback gain */
} cgl_loop;

typedef struct {
    cgl_real theta_ref; /* mechanical angle reference [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX. Only
                           position laws read it. In torque mode theta_ref, omega_ref and alpha_ref are theta_m, omega_m and 0 */
    cgl_real omega_ref; /* mechanical speed reference, the derivative of theta_ref [rad/s] */
    cgl_real alpha_ref; /* derivative of omega_ref [rad/s^2]; only the space-learning laws read it */
    cgl_real theta_m;   /* measured mechanical angle [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX */
    cgl_real omega_m;   /* measured mechanical speed [rad/s] */
    cgl_real i_q;       /* measured q-axis current [A]; only a calibration run reads it */
    bool learn;         /* false freezes what is learned */
    bool off;           /* true: the output and the integrals are 0, and what is learned is frozen */
    bool forget;        /* true: what is learned is cleared, cell by cell as the rotor passes, even if learn is false. While the law is
                           off or in torque mode, this flag has no effect */
    cgl_real muted;     /* share of the learned current that is not in the output [-], 0 to 1, default 0; any other value counts as 0 */
    uint32_t gentle;    /* 0: the law learns as configured; k >= 1: it learns with a smaller gain and more forgetting, as
                           cgl_gentle_steps[k] */
    bool torque;        /* true: torque mode. The output is i_q_ref plus the learned current, without feedback, and learning is frozen */
    cgl_real i_q_ref;   /* q-axis current reference of torque mode [A] */
} cgl_law_input;

typedef struct {
    cgl_real i_q_ref; /* reference for the current loop [A], within the law's limit */
    unsigned status;  /* CGL_STATUS_ bits */
} cgl_law_output;

/* Returns the number of the step in cgl_gentle_steps with which the law learns. While `forget` is true, this is the last step, which
 * learns and recalls nothing. With COGLESS_NO_GUARD it is 0. */
static inline uint32_t cgl_law_gentle(const cgl_law_input *in)
{
#ifdef COGLESS_NO_GUARD
    (void)in;
    return 0U;
#else
    return in->forget ? CGL_GUARD_STEPS : in->gentle;
#endif
}

/* The share, 0 to 1, of the learned output that is applied: 1 - `muted`, or 1 if `muted` is not within 0 to 1. */
static inline cgl_real cgl_law_share(const cgl_law_input *in)
{
    const cgl_real share = CGL_R(1.0) - in->muted;
    return CGL_OFTEN(share >= CGL_R(0.0) && share <= CGL_R(1.0)) ? share : CGL_R(1.0);
}

/* Whether the output is without the feedback, because the law is off or in torque mode. */
static inline bool cgl_law_stands_by(const cgl_law_input *in)
{
    return in->off || in->torque;
}

#ifdef __cplusplus
extern "C" {
#endif

/* The check with which every law's init begins. Returns the first field that is refused, as CGL_FIELD; NULL: none. Refused are a field of
 * the loop or of the config outside its range, and a limit above loop.current_limit. The last row of `range` is the config's limit of the
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

/* Whether a law can learn with these gains, which are in the same unit. With a guard, a learning gain > 0 needs a feedback gain > 0. */
bool cgl_loop_can_learn(const cgl_loop *loop, cgl_real gain, cgl_real feedback);

/* Sets the output of a law that has had no successful init: 0, with CGL_STATUS_FAULT and CGL_STATUS_OFF. */
void cgl_law_refuse(cgl_law_output *out);

/* Sets the output of a law that is off or in torque mode: 0 if the law is off, else i_q_ref plus the current `learned` [A], within the
 * limit [A]. Returns the current [A] from which the feedback has to start when this mode ends, so that the output does not jump. An i_q_ref
 * that is not finite counts as 0. */
cgl_real cgl_law_stand_by(const cgl_law_input *in, cgl_real learned, cgl_real limit, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
