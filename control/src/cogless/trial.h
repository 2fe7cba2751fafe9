/* Position control that learns from trial to trial (Mandra 2019, Fig. 1). The input u is the sum of state feedback with integral action,
 * feedforward, and a learned signal v. v is corrected after every trial. At sample p of a trial, p = 0 .. samples - 1, with the config's
 * gains k_1, k_2, n, c and k_3 written as K_1, K_2, N, C and K_3:
 *
 *   u(p)   = K_1 x(p) + K_2 psi(p - 1) + f(p) + N v(p)                       Fig. 1, (5); f: feedforward.h
 *   psi(p) = psi(p - 1) + y_ref(p) + v(p) - y(p),  y = C x,  psi(-1) = 0     (4)
 *
 * After the trial, with e = y_ref - y:
 *
 *   v(p) <- v(p) + K_3 e(p + shift)                                          (16), (17), (42); shift: relative degree
 *
 * As in the paper, e(p) counts as 0 for p < shift, because no input of the trial has an effect so early. Beyond the end of the trial, e(p)
 * counts as e(samples - 1).
 *
 * The filter Q (zero_phase.h) can act at two places:
 *
 *   v <- v + K_3 Q e      on the error, as in the paper
 *   v <- Q (v + K_3 e)    on the signal, with `filter_signal`
 *
 * The first form learns until Q e is zero. This form needs a plant on which every trial makes the error smaller at all frequencies of v.
 * The second form forgets v above the cut-off frequency. So v stays bounded even if the trials do not make the error smaller above this
 * frequency, as in a plant with a sampling zero outside the unit circle. But a residual error is left above the cut-off frequency.
 *
 * A matrix L (`learning_matrix`) in place of K_3 gives norm-optimal learning, v <- v + L e. In this form e is not shifted, and Q does not
 * filter e.
 *
 * With an observer (trial_observer.h), the observer's feedback takes the place of K_1, K_2 and psi. The law then learns from the input r(p)
 * that the observer finds missing at sample p: the law stores r(p - 2) in place of e(p). With n = 1, k_3 = 1, shift = 2 and Q on the
 * signal, learning is v <- Q (v + r).
 *
 * A guard (trial_guard.h) judges the error of every complete trial. If learning leaves a larger error than the best v so far, or than
 * v = 0, v goes back to the better of the two.
 *
 * The plant determines the units of x, y and u. Usually v has the unit of y, and N is a gain. If N = 1 and v does not go through the
 * integrator, v has the unit of u.
 *
 *   static cgl_real memory[CGL_TRIAL_LENGTH(SAMPLES, ORDER)];
 *   cgl_trial_init(&law, &config, memory, sizeof memory / sizeof memory[0]);   once; must return CGL_OK
 *   cgl_trial_begin(&law, y_ref);                                     before each trial
 *   cgl_trial_step(&law, &in, &out);                                  SAMPLES times, in the interrupt;
 *                                                                              in a drive cgl_trial_drive_step
 *   cgl_trial_end(&law);                                              after each trial, in the background */
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
    uint32_t samples;               /* number of samples in a trial, 2 to 16777216 */
    uint32_t states;                /* number of entries of x, 1 to CGL_TRIAL_STATES */
    cgl_real k_1[CGL_TRIAL_STATES]; /* gains of the state feedback; the first `states` entries are used [u/x], finite */
    cgl_real k_2;                   /* integral gain [u/y], finite; 0: no integral action */
    cgl_real n;                     /* gain N from v to the input [u/v], finite; n * learned_limit must be finite */
    cgl_real c[CGL_TRIAL_STATES];   /* C in y = C x [y/x], finite */
    bool through_integrator;        /* true: v also acts through the integral, as in Fig. 1; false: v acts at the input only */
    cgl_real k_3;                   /* learning gain [v/y], finite; 0: no learning */
    uint32_t shift;                 /* relative degree of the plant, or more if the loop has a delay [samples], 1 to samples - 1 */
    cgl_feedforward_config feedforward;  /* feedforward from y_ref to u; default none */
    cgl_zero_phase_config q_filter;      /* filter Q, which acts between trials; default none */
    bool filter_signal;                  /* false: Q filters e; true: Q filters v; default false */
    cgl_trial_observer_config observer;  /* observer in place of k_1 and k_2; an observer needs shift = 2 and k_2 = 0;
                                            default none */
    const cgl_real *learning_matrix;     /* NULL, or L in place of k_3: the caller's samples x samples entries, row by
                                            row [v/y], finite; default NULL */
    cgl_real limit;                      /* bound of |u| [u], > 0 */
    cgl_real learned_limit;              /* bound of |v| [v], > 0 */
    bool unguarded;                      /* true: there is no guard, and the memory has `samples` fewer entries; default false */
} cgl_trial_config;

typedef struct {
    cgl_real x[CGL_TRIAL_STATES]; /* measured state, of which the first `states` entries are used; an angle in it must be unwrapped */
    bool learn;                   /* false in any sample of a trial: the law learns nothing from this trial */
} cgl_trial_input;

typedef struct {
    cgl_real u;      /* input of the plant, within +-limit */
    unsigned status; /* CGL_STATUS_SATURATED; CGL_STATUS_FAULT; CGL_STATUS_FROZEN: nothing is learned from this sample;
                        CGL_STATUS_GUARDED: the guard holds learning back in this trial */
} cgl_trial_output;

typedef struct {
    cgl_real feedback;    /* K_1 x, or the observer's feedback of the error and its change [u] */
    cgl_real integral;    /* K_2 psi, or the observer's estimate of the disturbance [u] */
    cgl_real feedforward; /* f(p) [u] */
    cgl_real learned;     /* N v [u] */
} cgl_trial_terms;

typedef struct {
    cgl_trial_config config;
    cgl_real *learned;           /* v: caller's memory, `samples` entries within +-learned_limit; it may be saved
                                    and restored between trials */
    cgl_real *error;             /* e of this trial, up to the present sample. The next `shift` entries are flags: 1 where u was at its
                                    limit `shift` samples earlier. The caller's memory has v, e, the filter's working memory and the
                                    guard's best v, in this order */
    const cgl_real *y_ref;       /* reference of this trial; NULL before the first one */
    cgl_real psi;                /* psi(p - 1), the integral of the error in (4) [y] */
    cgl_trial_observer observer;
    cgl_trial_guard guard;
    cgl_real v;                  /* v in the last step [v] */
    cgl_real theta;              /* in a drive: unwrapped mechanical angle [rad] */
    cgl_feedforward feedforward;
    uint32_t sample;             /* p of the next step; after the last sample it rises by CGL_FEEDFORWARD_TAPS at most */
    bool spoilt;                 /* nothing will be learned from this trial */
    cgl_trial_terms terms;       /* terms of the last step */
} cgl_trial;

/* Number of entries in the caller's memory for v, e, the filter's working memory and the guard's best v. `order` is the order of Q. An
 * unguarded law needs `samples` fewer. */
#define CGL_TRIAL_LENGTH(samples, order) (3U * (samples) + CGL_ZERO_PHASE_TAIL(samples, order))

/* Copies the config, and clears the caller's memory of `length` entries. The law uses this memory from then on. */
cgl_error cgl_trial_init(cgl_trial *law, const cgl_trial_config *config, cgl_real *memory, uint32_t length);

/* Replaces gains and limits, usually between two trials. v stays, clipped to learned_limit. The guard forgets its measurements.
 * samples, states, the order of q_filter and unguarded must not change. */
cgl_error cgl_trial_retune(cgl_trial *law, const cgl_trial_config *config);

/* Clears what is learned, and ends the trial: u is 0 until the next begin. */
void cgl_trial_reset(cgl_trial *law);

/* Begins a trial with psi = 0. v stays. If cgl_trial_end() has not run, the errors of the last trial are lost. y_ref has `samples`
 * entries of the caller, in flash or RAM, which must not change until the next begin or reset. With NULL no trial begins. */
void cgl_trial_begin(cgl_trial *law, const cgl_real *y_ref);

/* Steps one sample. psi stays as it is while u is at its limit and the change of psi would push u further. If u is at its limit at
 * sample p, the error that u(p) makes, e(p + shift), counts as zero, so v(p) does not change.
 *
 * If a state or the reference is not finite, or so large that a sum overflows, u is 0, psi keeps its value, the status has
 * CGL_STATUS_FAULT, and nothing is learned from the trial. An observer predicts this sample without the measurement.
 *
 * After the last sample the law keeps the last reference and the last v, and learns nothing. From then on it does not write to the
 * caller's memory. So cgl_trial_end() may run while an interrupt still calls this function. Before a begin, u is 0. */
void cgl_trial_step(cgl_trial *law, const cgl_trial_input *in, cgl_trial_output *out);

/* Steps one sample of a drive. x is the mechanical angle [rad] and speed [rad/s], `states` is 2, and u is a current [A]. The angle may
 * wrap. At the start of a trial the angle is unwrapped to the turn nearest to the first reference. An angle that is not plausible has the
 * effect of a state that is not finite. While in->off, the output and psi are 0, and nothing is learned from the trial. */
void cgl_trial_drive_step(cgl_trial *law, const cgl_law_input *in,
                          cgl_law_output *out);

/* Ends the trial. Learns from it, or changes v as the guard decides. Returns false, with v unchanged, if the trial was incomplete, had a
 * fault or a sample with learning off, or has already ended. The run time grows with the samples; with a matrix it grows with their
 * square. So call it in the background. */
bool cgl_trial_end(cgl_trial *law);

#ifdef __cplusplus
}
#endif

#endif
