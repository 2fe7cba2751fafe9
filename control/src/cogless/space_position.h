/* Space-learning position control (Verrelli 2016, law (6)), and the sampled form that Section 5 runs in a drive. All angles and speeds
 * below are the mechanical ones times `ratio`. In Section 4 ratio is 1. In Section 5 ratio is the number of the rotor's teeth or pole
 * pairs, so the angles and speeds are electrical. T is the period of the memory in this angle. Q is the memory's forgetting or filter.
 *
 *   theta_tg = atan2(sin, cos) of theta - theta_ref
 *   omega_t  = omega - omega_ref + k_theta theta_tg
 *   i_q_ref  = sat( -(k_omega + v_0 + v_2 omega^2) omega_t - k_v theta_tg - share_i k_i integral(omega_t) + i_hat )
 *   i_hat    = alpha + beta omega_ref + h alpha_ref
 *   alpha(theta_ref) = Q sat(alpha(theta_ref - T)) - share mu_alpha / |omega_ref| omega_t
 *   beta (theta_ref) = Q sat(beta (theta_ref - T)) - share mu_beta omega_ref / |omega_ref| omega_t
 *   h    (theta_ref) = Q sat(h    (theta_ref - T)) - share mu_h alpha_ref / |omega_ref| omega_t
 *
 * The paper has omega_ref > 0; |omega_ref| makes learning work in both directions. The factor `share` rises from 0 to 1 over the time
 * `ramp` of learning. While learning is frozen, share stays as it is. With hand_over, share_i is 1 - share. Otherwise share_i is 1. While
 * share_i is 0, the integral is 0. With k_i > 0 and without hand_over, alpha and beta move their means into the integral. */
#ifndef COGLESS_SPACE_POSITION_H
#define COGLESS_SPACE_POSITION_H

#include "law.h"
#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The angle over which the memory learns. */
typedef enum { CGL_SPACE_BY_REFERENCE, CGL_SPACE_BY_ROTOR } cgl_space_index;

/* The rad in the units of the gains are those of an angle or speed multiplied by `ratio`. */
typedef struct {
    uint32_t ratio;        /* rotor teeth or pole pairs for gains in electrical rad, 1 for mechanical rad; 1 to 65535; 0: default 1 */
    cgl_real k_theta;      /* gain of the position error theta_tg in omega_t [1/s], >= 0 */
    cgl_real k_omega;      /* gain of omega_t [A s/rad], >= 0 */
    cgl_real k_v;          /* direct gain of the position error theta_tg [A/rad], >= 0; default 0, as in Section 5 */
    cgl_real v_0;          /* constant part of the robustifying term v = v_0 + v_2 omega^2 [A s/rad], >= 0; default 0 */
    cgl_real v_2;          /* quadratic part of v [A s^3/rad^3], >= 0; default 0 */
    cgl_real k_i;          /* integral gain [A/rad], >= 0 */
    cgl_real mu_alpha;     /* learning gain of alpha, channel 1 of the memory [A], >= 0 */
    cgl_real mu_beta;      /* learning gain of beta, channel 2 of the memory [A s^2/rad^2], >= 0 */
    cgl_real mu_h;         /* learning gain of h, channel 3 of the memory [A s^4/rad^2], >= 0 */
    bool hand_over;        /* true: the integral fades out as learning fades in, as in Section 5; default false */
    cgl_real ramp;         /* time of learning in which the learning gains rise from 0 to their full values [s], >= 0 */
    cgl_real omega_min;    /* mechanical |omega_ref| below which learning freezes [rad/s], > 0 */
    cgl_space_index index; /* angle of the memory; default CGL_SPACE_BY_REFERENCE, as in the paper */
    cgl_real limit;        /* bound of the output's magnitude [A], > 0, at most loop.current_limit */
    cgl_memory_config memory; /* channels: 1 for alpha, 2 for alpha and beta, 3 for all; limits [A], [A s/rad], [A s^2/rad];
                                 turns and parts count revolutions of ratio theta */
} cgl_space_position_config;

typedef struct {
    cgl_real proportional; /* -(k_omega + v) omega_t - k_v theta_tg [A] */
    cgl_real integral;     /* -share_i k_i integral(omega_t) [A] */
    cgl_real alpha;        /* term of alpha, alpha itself [A] */
    cgl_real beta;         /* term of beta, beta omega_ref [A] */
    cgl_real h;            /* term of h, h alpha_ref [A] */
} cgl_space_position_terms;

typedef struct {
    bool saturated;                 /* the last output was at its limit */
    uint32_t gentle;                /* index into cgl_gentle_steps that is in effect; 0: learns as configured */
    uint32_t learning_samples;      /* number of samples that learned, up to the end of the ramp */
    cgl_real integral;              /* k_i integral(omega_t), within +-limit [A] */
    cgl_real integral_lost;         /* rounding error of the integral, added in the next step [A] */
    cgl_space_position_terms terms; /* terms of the last output */
    cgl_loop loop;
    cgl_space_position_config config; /* config, with defaults in place of zeros */
    cgl_memory memory;        /* memory of alpha, beta and h; memory.line.p_t is P_t [s] */
} cgl_space_position;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_space_position_bad_field(const cgl_space_position_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `cell` has CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the law uses from then on. */
cgl_error cgl_space_position_init(cgl_space_position *law, const cgl_space_position_config *config, const cgl_loop *loop, cgl_real *cell,
                                  uint32_t length);

/* Replaces gains and limits at run time, as cgl_memory_retune() does. ratio and index must not change. `share` stays. The integral
 * stays, clipped to the new limit. */
cgl_error cgl_space_position_retune(cgl_space_position *law, const cgl_space_position_config *config);

void cgl_space_position_reset(cgl_space_position *law);

/* Learning freezes, but the learned current is still added, under any of these conditions: in->learn is false; |omega_ref| is below
 * omega_min; the guard leaves no gain; the last output was at its limit; an input is not plausible; the memory does not learn. The integral
 * stays as it is while the output is at its limit and the error would push the output further. If an input is not plausible, the output is
 * that of a zero error. While in->off, learning and its ramp are frozen, and the output and the integral are 0. */
void cgl_space_position_step(cgl_space_position *law,
                             const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
