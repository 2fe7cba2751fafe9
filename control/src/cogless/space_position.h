/* Space-learning position control (Verrelli 2016, law (6)), and the sampled form that Section 5 runs in a drive. With
 * theta, omega and their references multiplied by `ratio` (1: mechanical, as in Section 4; teeth or pole pairs:
 * electrical, as in Section 5):
 *
 *   theta_tg = atan2(sin, cos) of theta - theta_ref
 *   omega_t  = omega - omega_ref + k_theta theta_tg
 *   i_q_ref  = sat( -(k_omega + v_0 + v_2 omega^2) omega_t - k_v theta_tg - share_i k_i integral(omega_t) + i_hat )
 *   i_hat    = alpha + beta omega_ref + h alpha_ref
 *   alpha(theta_ref) = Q sat(alpha(theta_ref - T)) - share mu_alpha / |omega_ref| omega_t
 *   beta (theta_ref) = Q sat(beta (theta_ref - T)) - share mu_beta omega_ref / |omega_ref| omega_t
 *   h    (theta_ref) = Q sat(h    (theta_ref - T)) - share mu_h alpha_ref / |omega_ref| omega_t
 *
 * |omega_ref| in place of the paper's omega_ref > 0 lets a map learn in both directions. share rises from 0 to 1
 * within `ramp` of learning, and waits while learning is frozen. share_i = 1 - share with hand_over, else 1. Where share_i is 0 the
 * integral is 0. With k_i > 0 and without hand_over, alpha and beta pass their means on to the integral. */
#ifndef COGLESS_SPACE_POSITION_H
#define COGLESS_SPACE_POSITION_H

#include "law.h"
#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The angle by which the memory counts. */
typedef enum { CGL_SPACE_BY_REFERENCE, CGL_SPACE_BY_ROTOR } cgl_space_index;

/* All angles and speeds of the gains are those multiplied by `ratio`. */
typedef struct {
    uint32_t ratio;        /* rotor teeth or pole pairs for electrical quantities, 1 for mechanical; 1 to 65535; 0: default 1 */
    cgl_real k_theta;      /* position loop [1/s], >= 0 */
    cgl_real k_omega;      /* speed loop [A s/rad], >= 0 */
    cgl_real k_v;          /* [A/rad], >= 0; default 0, as in Section 5 */
    cgl_real v_0;          /* robustifying term v = v_0 + v_2 omega^2 [A s/rad], >= 0; default 0 */
    cgl_real v_2;          /* [A s^3/rad^3], >= 0; default 0 */
    cgl_real k_i;          /* integral action, until learning takes over [A/rad], >= 0 */
    cgl_real mu_alpha;     /* learning gain [A], >= 0 */
    cgl_real mu_beta;      /* learning gain [A s^2/rad^2], >= 0; channel 2 of the memory */
    cgl_real mu_h;         /* learning gain [A s^4/rad^2], >= 0; channel 3 of the memory */
    bool hand_over;        /* integral action fades out as learning fades in, as in Section 5; default false */
    cgl_real ramp;         /* of learning, over the time that it learns [s], >= 0 */
    cgl_real omega_min;    /* learning freezes while the mechanical |omega_ref| is below [rad/s], > 0 */
    cgl_space_index index; /* default CGL_SPACE_BY_REFERENCE, as in the paper */
    cgl_real limit;        /* the output stays within +-limit [A], > 0, at most loop.current_limit */
    cgl_memory_config memory; /* channels: 1 alpha, 2 and beta, 3 and h; limits [A], [A s/rad], [A s^2/rad]; turns
                                       and parts of a revolution of ratio theta */
} cgl_space_position_config;

typedef struct {
    cgl_real proportional; /* -(k_omega + v) omega_t - k_v theta_tg [A] */
    cgl_real integral;     /* -share_i k_i integral(omega_t) [A] */
    cgl_real alpha;        /* [A] */
    cgl_real beta;         /* beta omega_ref [A] */
    cgl_real h;            /* h alpha_ref [A] */
} cgl_space_position_terms;

typedef struct {
    bool saturated;                 /* the last output was at its limit */
    uint32_t gentle;                /* how gently it learns, as the guard says */
    uint32_t learning_samples;      /* in which it learned; counts no further than the ramp */
    cgl_real integral;              /* k_i integral(omega_t), within +-limit [A] */
    cgl_real integral_lost;         /* what rounding kept from it [A] */
    cgl_space_position_terms terms; /* of the last step */
    cgl_loop loop;
    cgl_space_position_config config; /* with its defaults */
    cgl_memory memory;        /* memory.p_t: P_t [s] */
} cgl_space_position;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_space_position_bad_field(const cgl_space_position_config *config, const cgl_loop *loop);

/* loop: drive.loop. `cell`: CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the state keeps using. */
cgl_error cgl_space_position_init(cgl_space_position *law, const cgl_space_position_config *config, const cgl_loop *loop, cgl_real *cell,
                                  uint32_t length);

/* Takes other gains and limits while it runs, as cgl_memory_retune; ratio and index must stay. The integral stays, within
 * the limit, and so does share. */
cgl_error cgl_space_position_retune(cgl_space_position *law, const cgl_space_position_config *config);

void cgl_space_position_reset(cgl_space_position *law);

/* Learning freezes, and what was learned acts on, while in->learn is false, |omega_ref| is below omega_min, no gain is left, the output
 * was at its limit, an input is not plausible, or the memory says so. The integral holds while the output is at its
 * limit and the error would push it further. Where an input is not plausible the output is that of no error.
 * While in->off learning is frozen too, its ramp as well, and the output and the integral are 0. */
void cgl_space_position_step(cgl_space_position *law,
                             const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
