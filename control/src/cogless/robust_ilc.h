/* Robust iterative learning speed control by adaptive sliding mode (Liu 2018, eqs. (11) to (20)).
 *
 *   S = e + c integral(e)                                                  (11)
 *   f_k = f_{k-1} - q (beta_1 sgn S + beta_2 S)                            (15), k counts periods
 *   v = -g sgn S - eta S                                                   (16)
 *   i_q_ref = (c e + d omega_ref/dt + B(omega) - f_k - v + r) / b          (19)
 *   dr/dt = gamma S                                                        (20)
 *
 * Where gamma > 0 the mean over a period belongs to r, and f passes its own mean on to it. The state shows every term in
 * amperes. */
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
    cgl_real q;               /* learning rate [-], >= 0; 0: learn nothing. A guard wants c + eta > 0 beside q beta_2 */
    cgl_real beta_1;          /* weight of sgn S in learning [rad/s^2], >= 0 */
    cgl_real beta_2;          /* weight of S in learning [1/s], >= 0 */
    cgl_real gamma;           /* adaptation rate [1/s^2], >= 0 */
    cgl_real viscous;         /* known friction B(omega) = viscous omega + coulomb sgn omega [1/s], default 0 */
    cgl_real coulomb;         /* [rad/s^2], default 0 */
    cgl_real limit;           /* the output stays within +-limit [A], > 0, at most loop.current_limit; b limit finite */
    cgl_memory_config memory; /* of f: entries and limit in [rad/s^2] */
} cgl_robust_ilc_config;

typedef struct {
    cgl_real surface;   /* (c e + d omega_ref/dt + B) / b [A] */
    cgl_real switching; /* g sgn(S) / b [A] */
    cgl_real linear;    /* eta S / b [A] */
    cgl_real learned;   /* -f / b [A] */
    cgl_real adapted;   /* r / b [A] */
} cgl_robust_ilc_terms;

typedef struct {
    bool idle;                  /* they are 0, and nothing is being cleared: f is frozen */
    bool started;               /* last_omega_ref is valid */
    bool saturated;             /* the last output was at its limit */
    uint32_t gentle;            /* the guard's step */
    cgl_real q, beta_1;         /* as that step reduces them */
    cgl_real error_integral;    /* within +-1e9 [rad] */
    cgl_real adapted;           /* r [rad/s^2] */
    cgl_real integral_lost, adapted_lost; /* what rounding kept from error_integral and adapted */
    cgl_real last_omega_ref;    /* [rad/s] */
    cgl_robust_ilc_terms terms; /* of the last step */
    cgl_loop loop;
    cgl_robust_ilc_config config;
    cgl_memory memory;          /* f [rad/s^2] */
} cgl_robust_ilc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_robust_ilc_bad_field(const cgl_robust_ilc_config *config, const cgl_loop *loop);

/* loop: drive.loop. `cell`: CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the state keeps using. */
cgl_error cgl_robust_ilc_init(cgl_robust_ilc *law, const cgl_robust_ilc_config *config, const cgl_loop *loop, cgl_real *cell,
                              uint32_t length);

/* Takes other gains and limits while it runs, as cgl_memory_retune; the integral and r stay, within the limit. */
cgl_error cgl_robust_ilc_retune(cgl_robust_ilc *law, const cgl_robust_ilc_config *config);

void cgl_robust_ilc_reset(cgl_robust_ilc *law);

/* While the output is at its limit, the integral holds unless the error leads back, r unless S does, and f holds.
 * While the speed or its reference is not finite all three hold, with the output of a zero error; f holds too while the
 * angle is not plausible. While in->off the output is 0, the integral and r start anew, and f holds. So they do in torque
 * mode, but where gamma > 0, r starts from in->i_q_ref. */
void cgl_robust_ilc_step(cgl_robust_ilc *law, const cgl_law_input *in,
                         cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
