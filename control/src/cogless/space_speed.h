/* Space-learning speed control (Verrelli 2016, law (4)), all mechanical, with eta = omega - omega_ref:
 *
 *   i_q_ref = sat( -k eta - delta^T f ),   f = [-1, -omega, -alpha_ref],   delta = [alpha, beta, h]
 *   delta_i(theta) = Q sat(delta_i(theta - T)) + mu_i eta f_i q,   q = 1 / |omega| or 0
 *
 * delta_i is the learned function of channel i, T the memory's period, and Q the memory's forgetting or filter. In the law of delta_i, f
 * has omega_ref in place of omega. If |eta| >= eta_bar or |omega| < omega_min, q is 0, so learning is frozen. The paper has one mu for all
 * channels, omega > 0 only, and omega in the law of delta_i. With omega in that law, the means of alpha and beta drift apart at a constant
 * speed. */
#ifndef COGLESS_SPACE_SPEED_H
#define COGLESS_SPACE_SPEED_H

#include "law.h"
#include "memory.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real k;         /* gain of the speed error [A s/rad], >= 0 */
    cgl_real mu_alpha;  /* learning gain of alpha, channel 1 of the memory [A], >= 0 */
    cgl_real mu_beta;   /* learning gain of beta, channel 2 of the memory [A s^2/rad^2], >= 0 */
    cgl_real mu_h;      /* learning gain of h, channel 3 of the memory [A s^4/rad^2], >= 0 */
    cgl_real eta_bar;   /* magnitude of the speed error eta from which on learning freezes [rad/s], > 0 */
    cgl_real omega_min; /* speed |omega| below which learning freezes [rad/s], > 0 */
    cgl_real limit;     /* bound of the output's magnitude [A], > 0, at most loop.current_limit */
    uint32_t ratio;     /* factor on theta_m for the memory, whose turns and parts count revolutions of ratio * theta_m, 1 to 65535; 0:
                           default 1 */
    cgl_memory_config memory; /* channels: 1 for alpha, 2 for alpha and beta, 3 for all; limits [A], [A s/rad], [A s^2/rad] */
} cgl_space_speed_config;

typedef struct {
    cgl_real proportional; /* -k eta [A] */
    cgl_real alpha;        /* term of alpha, alpha itself [A] */
    cgl_real beta;         /* term of beta, beta omega [A] */
    cgl_real h;            /* term of h, h alpha_ref [A] */
} cgl_space_speed_terms;

typedef struct {
    bool saturated;              /* the last output was at its limit */
    uint32_t gentle;             /* index into cgl_gentle_steps that is in effect; 0: learns as configured */
    cgl_space_speed_terms terms; /* terms of the last output */
    cgl_loop loop;
    cgl_space_speed_config config; /* config, with defaults in place of zeros */
    cgl_memory memory;     /* memory of alpha, beta and h; memory.line.p_t is P_t [s] */
} cgl_space_speed;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_space_speed_bad_field(const cgl_space_speed_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `cell` has CGL_MEMORY_LENGTH(kind, channels, cells, q_half_width) entries, which the law uses from then on. */
cgl_error cgl_space_speed_init(cgl_space_speed *law, const cgl_space_speed_config *config, const cgl_loop *loop, cgl_real *cell,
                               uint32_t length);

/* Replaces gains and limits at run time, as cgl_memory_retune() does. ratio must not change. */
cgl_error cgl_space_speed_retune(cgl_space_speed *law, const cgl_space_speed_config *config);

void cgl_space_speed_reset(cgl_space_speed *law);

/* theta_ref is not used. Learning freezes, but the learned current is still added, under any of these conditions: in->learn is false; q is
 * 0; the guard leaves no gain; the last output was at its limit; an input is not plausible; the memory does not learn. If an input is not
 * plausible, the output is that of a zero error. While in->off, learning is frozen and the output is 0. In torque mode alpha, beta omega
 * and h alpha_ref add to in->i_q_ref. */
void cgl_space_speed_step(cgl_space_speed *law, const cgl_law_input *in,
                          cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
