/* Position control that learns from trial to trial: state feedback with integral action, feedforward, and a learned
 * signal v that is corrected after every trial (Mandra 2019, Fig. 1). At sample p of a trial, p = 0 .. samples - 1:
 *
 *   u(p)   = K_1 x(p) + K_2 psi(p - 1) + f(p) + N v(p)                       Fig. 1, (5); f: feedforward.h
 *   psi(p) = psi(p - 1) + y_ref(p) + v(p) - y(p),  y = C x,  psi(-1) = 0     (4)
 *
 * and after it, with e = y_ref - y and the relative degree r,
 *
 *   v(p) <- v(p) + K_3 e(p + r)                                              (16), (17), (42)
 *
 * As in the paper, e(p) = 0 for p < r, which no input of the trial can reach, and e(p) = e(samples - 1) from the end on.
 *
 * The filter Q (zero_phase.h) acts on e before it is added: v <- v + K_3 Q e, as the paper does. Or, with
 * `filter_signal`, on the sum: v <- Q (v + K_3 e). The first keeps learning until Q e is gone, and needs the error to
 * contract at all frequencies where v once was; the second forgets v above the cut-off and so stays bounded where that
 * fails, as it does for a plant with a sampling zero outside the unit circle; it leaves a residual there.
 *
 * A matrix L in place of K_3 makes it norm-optimal learning, v <- v + L e with e neither shifted nor filtered.
 *
 * With an observer (trial_observer.h) the feedback is the observer's, in place of K_1, K_2 and psi, and what is learned
 * is an input: the law stores r(p - 2) of the observer, the input that was missing, in place of e(p). With n = 1,
 * k_3 = 1, shift = 2 and Q on the sum, v <- Q (v + r).
 *
 * A guard (trial_guard.h) judges the error of every trial that counts. Where learning leaves more of it than the best v so
 * far, or than v = 0, v goes back to the better of these.
 *
 * The unit of x, y and u is the plant's; v has the unit of what it is added to: that of y as a rule (with N a gain),
 * that of u where N = 1 and v does not go through the integrator.
 *
 *   static cgl_real memory[CGL_TRIAL_LENGTH(SAMPLES, ORDER)];
 *   cgl_trial_init(&law, &config, memory, sizeof memory / sizeof memory[0]);   once; must return CGL_OK
 *   cgl_trial_begin(&law, y_ref);                                     before each trial
 *   cgl_trial_step(&law, &in, &out);                                  SAMPLES times, in the interrupt;
 *                                                                              in a drive cgl_trial_drive_step
 *   cgl_trial_end(&law);                                              after each trial, in the background
 */
#ifndef COGLESS_TRIAL_H
#define COGLESS_TRIAL_H

#include <stdint.h>

#include "feedforward.h"
#include "law.h"
#include "real.h"
#include "status.h"
#include "trial_guard.h"
#include "trial_observer.h"
#include "zero_phase.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_TRIAL_STATES 8

typedef struct {
    uint32_t samples;               /* in a trial, 2 to 16777216 */
    uint32_t states;                /* entries of x, 1 to CGL_TRIAL_STATES */
    cgl_real k_1[CGL_TRIAL_STATES]; /* state feedback, the first `states` entries count [u/x], finite */
    cgl_real k_2;                   /* integral gain [u/y], finite; 0: no integral action */
    cgl_real n;                     /* gain from v to the input [u/v], finite; n learned_limit finite */
    cgl_real c[CGL_TRIAL_STATES];   /* y = C x [y/x], finite */
    bool through_integrator;        /* v also acts through the integral, as in Fig. 1; false: at the input only */
    cgl_real k_3;                   /* learning gain [v/y], finite; 0: no learning */
    uint32_t shift;                 /* relative degree r, or more for a loop that lags [samples], 1 to samples - 1 */
    cgl_feedforward_config feedforward;  /* from y_ref to u; default none */
    cgl_zero_phase_config q_filter;      /* between trials; default none */
    bool filter_signal;                  /* false: Q filters e; true: Q filters v; default false */
    cgl_trial_observer_config observer;  /* its feedback in place of k_1 and k_2, and what is learned from; then
                                            shift is 2 and k_2 0; default none */
    const cgl_real *learning_matrix;     /* NULL, or L in place of k_3: samples x samples entries, row by row [v/y],
                                            finite, the caller's; default NULL */
    cgl_real limit;                      /* u stays within +-limit [u], > 0 */
    cgl_real learned_limit;              /* v stays within +-learned_limit [v], > 0 */
    bool unguarded;                      /* true: no guard, and `samples` entries of memory fewer; default false */
} cgl_trial_config;

typedef struct {
    cgl_real x[CGL_TRIAL_STATES]; /* measured state, the first `states` entries count; an angle is unwrapped */
    bool learn;                   /* false anywhere in a trial: nothing is learned from it */
} cgl_trial_input;

typedef struct {
    cgl_real u;      /* input of the plant, within +-limit */
    unsigned status; /* CGL_STATUS_SATURATED, CGL_STATUS_FAULT; CGL_STATUS_FROZEN: this sample teaches nothing;
                        CGL_STATUS_GUARDED: the guard holds learning back in this trial */
} cgl_trial_output;

typedef struct {
    cgl_real feedback;    /* K_1 x, or the observer's share of the error and its change [u] */
    cgl_real integral;    /* K_2 psi, or the disturbance that the observer found [u] */
    cgl_real feedforward; /* f [u] */
    cgl_real learned;     /* N v [u] */
} cgl_trial_terms;

typedef struct {
    cgl_trial_config config;
    cgl_real *learned;           /* v: caller's memory, `samples` entries within +-learned_limit; may be saved, and
                                    restored, between trials */
    cgl_real *error;             /* e of this trial, behind v; of the next `shift` samples: not 0 where u, `shift` samples
                                    before, was saturated. Then the filter's tail; then the best v of the guard */
    const cgl_real *y_ref;       /* of this trial; NULL before the first one */
    cgl_real psi;                /* psi(p - 1) */
    cgl_trial_observer observer;
    cgl_trial_guard guard;
    cgl_real v;                  /* of the last step */
    cgl_real theta;              /* drive: the angle without its jumps [rad] */
    cgl_feedforward feedforward;
    uint32_t sample;             /* p of the next step; goes on a little beyond the end */
    bool spoilt;                 /* nothing is learned from this trial */
    cgl_trial_terms terms;       /* of the last step */
} cgl_trial;

/* Entries of the caller's memory, where `order` is the filter's: v, e, the filter's tail, the guard's best v. An unguarded law
 * needs `samples` fewer. */
#define CGL_TRIAL_LENGTH(samples, order) (3U * (samples) + CGL_ZERO_PHASE_TAIL(samples, order))

/* Takes the caller's memory of `length` entries and clears it. */
cgl_error cgl_trial_init(cgl_trial *law, const cgl_trial_config *config, cgl_real *memory, uint32_t length);

/* Takes other gains and limits, between two trials as a rule. What is learned stays, within learned_limit; the guard forgets
 * what it measured. samples, states, the order of q_filter and unguarded must stay. */
cgl_error cgl_trial_retune(cgl_trial *law, const cgl_trial_config *config);

/* Forgets everything learned, and ends the trial: steps give u = 0 until the next begin. */
void cgl_trial_reset(cgl_trial *law);

/* Starts a trial from psi = 0. What is learned stays; the errors of a trial that was not ended are forgotten. y_ref:
 * `samples` entries, the caller's, in flash or RAM, to be left alone until the next begin or reset. NULL: no trial. */
void cgl_trial_begin(cgl_trial *law, const cgl_real *y_ref);

/* One sample. psi holds while u is at its limit and the change of psi would push it further. A sample p at which u was at
 * its limit teaches nothing: e(p + r) counts as zero. A state or reference that is not finite, or so large that a sum
 * overflows, gives u = 0, holds psi, sets CGL_STATUS_FAULT, and nothing is learned from the trial; an observer goes on
 * without the measurement. After the last sample the law holds the last reference and v, learns nothing and leaves the
 * caller's memory alone, so that end may run meanwhile. Before begin u = 0. */
void cgl_trial_step(cgl_trial *law, const cgl_trial_input *in, cgl_trial_output *out);

/* One sample of a drive, where x is the mechanical angle [rad] and speed [rad/s], `states` is 2 and u a current [A]. The
 * angle may jump by whole turns: a trial starts at the turn that is nearest to its reference. An angle that is not
 * plausible is a fault. While in->off the output and psi are 0, and nothing is learned from the trial. */
void cgl_trial_drive_step(cgl_trial *law, const cgl_law_input *in,
                          cgl_law_output *out);

/* Ends the trial and learns from it, or does with v what the guard decides. Returns false, and leaves v as it is, if the trial
 * was cut short, had a fault or a sample with learning off, or has ended before. Takes a time that grows with the samples (with a matrix, with their
 * square): call it from the background. */
bool cgl_trial_end(cgl_trial *law);

#ifdef __cplusplus
}
#endif

#endif
