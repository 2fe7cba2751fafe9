/* PI speed control with adaptive feedforward cancellation beside it: a learned current with the Fourier coefficients a_k and b_k for each
 * chosen order h_k of the mechanical angle (Espindola-Lopez 2016; Messner and Bodson 1995):
 *
 *   i_q_ref = PI + sum_k (a_k cos(h_k theta) + b_k sin(h_k theta)),    e = omega_ref - omega
 *   a_k += gain ts e cos(h_k (theta - omega_ref lead)),    b_k likewise with sin
 *
 * At a constant speed the path from e to the current of an order is a resonator at the order's frequency, in parallel with the PI. */
#ifndef COGLESS_PI_AFC_H
#define COGLESS_PI_AFC_H

#include <stdint.h>

#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_PI_AFC_ORDERS 16U
#define CGL_PI_AFC_ORDER_MAX 65535U

/* Number of entries of the caller's memory: a_k, b_k and h_k for each order. A stored map loads only if its h_k are the same. */
#define CGL_PI_AFC_LENGTH(orders) (3U * (orders))

typedef struct {
    cgl_pi_config pi;                  /* kp [A s/rad], ki [A/rad], bound of the law's output [A] */
    uint32_t orders;                   /* number of orders, 1 to CGL_PI_AFC_ORDERS */
    uint32_t order[CGL_PI_AFC_ORDERS]; /* orders of a mechanical revolution, rising, 1 to CGL_PI_AFC_ORDER_MAX */
    cgl_real gain;                     /* learning gain [A/rad], >= 0; 0: nothing is learned. With a guard a gain above 0 needs pi.kp > 0 */
    cgl_real lead;                     /* delay from a current to the speed measured from it [s], >= 0; default 0. The present error is
                                          learned at the angle of this time ago */
    cgl_real omega_min;                /* speed |omega_ref| below which learning freezes [rad/s], > 0 */
    cgl_real limit;                    /* bound of the learned current and of each coefficient's magnitude [A], > 0, at most
                                          loop.current_limit */
} cgl_pi_afc_config;

typedef struct {
    cgl_pi_afc_config config;
    cgl_pi pi;
    cgl_real *coefficient; /* caller's memory: `orders` a_k [A], then b_k [A], then h_k */
    cgl_real learned;      /* learned current in the last step [A] */
    bool learning;         /* the last step learned */
} cgl_pi_afc;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_pi_afc_bad_field(const cgl_pi_afc_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `coefficient` has CGL_PI_AFC_LENGTH(orders) entries. Init clears them, and the law uses them from then on. */
cgl_error cgl_pi_afc_init(cgl_pi_afc *law, const cgl_pi_afc_config *config, const cgl_loop *loop, cgl_real *coefficient,
                          uint32_t length);

/* Replaces gains and limits at run time, as cgl_pi_retune() does. The coefficients stay, clipped to the new limit. The orders must
 * not change. */
cgl_error cgl_pi_afc_retune(cgl_pi_afc *law, const cgl_pi_afc_config *config);

void cgl_pi_afc_reset(cgl_pi_afc *law);

/* Learning freezes under any of these conditions: in->learn is false; torque mode; the gain is 0; |omega_ref| is below omega_min; the
 * output was at its limit; an input is not finite; an angle is beyond CGL_ANGLE_MAX. While learning is frozen, the learned current is still
 * added, unless theta_m is no valid angle. An order with a period of two samples or less is neither learned nor added. While in->off,
 * learning is frozen too, and the output and the PI's integral are 0. */
void cgl_pi_afc_step(cgl_pi_afc *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
