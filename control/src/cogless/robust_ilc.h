/* Robust iterative learning speed control by adaptive sliding mode (Liu 2018, eqs. (11) to (20)).
 *
 *   S = e + c integral(e)                                                  (11)
 *   f_k = f_{k-1} - q (beta_1 sgn S + beta_2 S)                            (15), k counts periods
 *   v = -g sgn S - eta S                                                   (16)
 *   i_q_ref = (c e + d omega_ref/dt + B(omega) - f_k - v + r) / b          (19)
 *   dr/dt = gamma S                                                        (20)
 *
 * e = omega_ref - omega is the speed error, S the sliding variable, f the learned acceleration, and r the adapted constant acceleration. If
 * gamma > 0, the mean over a period belongs to r: f moves its own mean into r. The terms in the state are in amperes. */
#ifndef COGLESS_ROBUST_ILC_H
#define COGLESS_ROBUST_ILC_H

#include "memory.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real b;               /* acceleration per current, K_t / J [rad/s^2/A], > 0 */
    cgl_real c;               /* slope of the sliding surface [1/s], >= 0 */
    cgl_real g;               /* switching gain [rad/s^2], >= 0 */
    cgl_real eta;             /* linear reaching gain [1/s], >= 0 */
    cgl_real q;               /* learning rate [-], >= 0; 0: nothing is learned. With a guard: if q beta_2 > 0, c + eta must be > 0 too */
    cgl_real beta_1;          /* weight of sgn S in learning [rad/s^2], >= 0 */
    cgl_real beta_2;          /* weight of S in learning [1/s], >= 0 */
    cgl_real gamma;           /* adaptation rate [1/s^2], >= 0 */
    cgl_real viscous;         /* viscous friction over the inertia [1/s], default 0. The known friction is
                                 B(omega) = viscous * omega + coulomb * sgn(omega) */
    cgl_real coulomb;         /* Coulomb friction over the inertia [rad/s^2], default 0 */
    cgl_real limit;           /* bound of the output's magnitude [A], > 0, at most loop.current_limit; b * limit must be finite */
    cgl_memory_config memory; /* memory of f, with one channel; entries and limit in [rad/s^2] */
} cgl_robust_ilc_config;

typedef struct {
    cgl_real surface;   /* (c e + d omega_ref/dt + B) / b [A] */
    cgl_real switching; /* g sgn(S) / b [A] */
    cgl_real linear;    /* eta S / b [A] */
    cgl_real learned;   /* -f / b [A] */
    cgl_real adapted;   /* r / b [A] */
} cgl_robust_ilc_terms;

typedef struct {
    bool idle;                  /* f is frozen, because the learning rate in use is 0, and the guard clears nothing */
    bool started;               /* last_omega_ref is valid */
    bool saturated;             /* the last output was at its limit */
    uint32_t gentle;            /* index into cgl_gentle_steps that is in effect; 0: learns as configured */
    cgl_real q, beta_1;         /* q [-] and beta_1 [rad/s^2] in use: the guard's step `gentle` reduces q, and from step 2 on beta_1 is 0 */
    cgl_real error_integral;    /* integral of e [rad], within +-1e9 */
    cgl_real adapted;           /* r [rad/s^2] */
    cgl_real integral_lost, adapted_lost; /* rounding errors of error_integral [rad] and adapted [rad/s^2], added in the next step */
    cgl_real last_omega_ref;    /* omega_ref of the last step [rad/s] */
    cgl_robust_ilc_terms terms; /* terms of the last output */
    cgl_loop loop;
    cgl_robust_ilc_config config;
    cgl_memory memory;          /* memory of f [rad/s^2] */
} cgl_robust_ilc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_robust_ilc_bad_field(const cgl_robust_ilc_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `cell` has CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the law uses from then on. */
cgl_error cgl_robust_ilc_init(cgl_robust_ilc *law, const cgl_robust_ilc_config *config, const cgl_loop *loop, cgl_real *cell,
                              uint32_t length);

/* Replaces gains and limits at run time, as cgl_memory_retune() does. The integral of e stays. r stays, clipped to the new limit. */
cgl_error cgl_robust_ilc_retune(cgl_robust_ilc *law, const cgl_robust_ilc_config *config);

void cgl_robust_ilc_reset(cgl_robust_ilc *law);

/* While the output is at its limit, f is frozen. The integral of e changes in this case only if e leads the output back from the limit, and
 * r only if S does. While the speed or its reference is not finite, f, the integral and r are frozen, and the output is that of a zero
 * error. While the angle is not plausible, f is frozen. While in->off, the output is 0, f is frozen, and the integral and r are 0. In
 * torque mode f is frozen too, and the output is in->i_q_ref plus the learned current. The integral is 0. r takes the value that goes with
 * in->i_q_ref if gamma > 0, else 0. */
void cgl_robust_ilc_step(cgl_robust_ilc *law, const cgl_law_input *in,
                         cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
