/* Space-learning speed control (Verrelli 2016, law (4)), all mechanical, with eta = omega - omega_ref:
 *
 *   i_q_ref = sat( -k eta - delta^T f ),   f = [-1, -omega, -alpha_ref],   delta = [alpha, beta, h]
 *   delta_i(theta) = Q sat(delta_i(theta - T)) + mu_i eta f_i q,   q = 1 / |omega| or 0
 *
 * In delta_i, omega_ref replaces omega in f. q is 0, and so learning frozen, where |eta| >= eta_bar or |omega| < omega_min. The paper
 * has one mu for all and omega > 0. It learns with omega in f: then the means of alpha and beta drift apart at a constant speed. */
#ifndef COGLESS_SPACE_SPEED_H
#define COGLESS_SPACE_SPEED_H

#include "law.h"
#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real k;         /* speed loop [A s/rad], >= 0 */
    cgl_real mu_alpha;  /* learning gain [A], >= 0 */
    cgl_real mu_beta;   /* learning gain [A s^2/rad^2], >= 0; channel 2 of the memory */
    cgl_real mu_h;      /* learning gain [A s^4/rad^2], >= 0; channel 3 of the memory */
    cgl_real eta_bar;   /* learning freezes while |eta| is not below [rad/s], > 0 */
    cgl_real omega_min; /* and while |omega| is below [rad/s], > 0 */
    cgl_real limit;     /* the output stays within +-limit [A], > 0, at most loop.current_limit */
    uint32_t ratio;     /* turns and parts of the memory count revolutions of ratio theta; 1 to 65535; 0: default 1 */
    cgl_memory_config memory; /* channels: 1 alpha, 2 and beta, 3 and h; limits [A], [A s/rad], [A s^2/rad] */
} cgl_space_speed_config;

typedef struct {
    cgl_real proportional; /* -k eta [A] */
    cgl_real alpha;        /* [A] */
    cgl_real beta;         /* beta omega [A] */
    cgl_real h;            /* h alpha_ref [A] */
} cgl_space_speed_terms;

typedef struct {
    bool saturated;              /* the last output was at its limit */
    uint32_t gentle;             /* how gently it learns, as the guard says */
    cgl_space_speed_terms terms; /* of the last step */
    cgl_loop loop;
    cgl_space_speed_config config; /* with its defaults */
    cgl_memory memory;     /* memory.p_t: P_t [s] */
} cgl_space_speed;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_space_speed_bad_field(const cgl_space_speed_config *config, const cgl_loop *loop);

/* loop: drive.loop. `cell`: CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the state keeps using. */
cgl_error cgl_space_speed_init(cgl_space_speed *law, const cgl_space_speed_config *config, const cgl_loop *loop, cgl_real *cell,
                               uint32_t length);

/* Takes other gains and limits while it runs, as cgl_memory_retune; ratio must stay. */
cgl_error cgl_space_speed_retune(cgl_space_speed *law, const cgl_space_speed_config *config);

void cgl_space_speed_reset(cgl_space_speed *law);

/* Ignores theta_ref. Learning freezes, and what was learned acts on, while in->learn is false, q is 0, no gain is left, the output was
 * at its limit, an input is not plausible, or the memory says so. Where an input is not plausible the output is that
 * of no error. While in->off learning is frozen too, and the output is 0. In torque mode alpha, beta omega and
 * h alpha_ref act on in->i_q_ref. */
void cgl_space_speed_step(cgl_space_speed *law, const cgl_law_input *in,
                          cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
