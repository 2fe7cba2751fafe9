/* PI control of speed or position, plus a learned current T. T is a sum of the orders k base of the rotor's angle, with the amplitudes c_k.
 * There is nothing to tune:
 *
 *   i_q_ref = PI(omega_ref - omega + k_theta (theta_ref - theta)) + T
 *   T = Re sum_k c_k exp(j k base (theta + omega (ts/2 + delay)))
 *
 * An observer of angle, speed and load gets the feedback's current only, u = i_q_ref - T. So its error e shows the ripple that T has not
 * cancelled. If T cancels all of it, e has no ripple, even if the observer's model has a wrong lag:
 *
 *   a = b u + z,   theta' = theta + ts omega + ts^2/2 a,   omega' = omega + ts a,   e = measured - theta'
 *   theta = theta' + (1 - p^3) e,   omega = omega' + 3/2 (1-p)^2 (1+p) e / ts,   z += (1-p)^3 e / ts^2,   p = exp(-1/2)
 *
 * Om = k base omega ts is the angle of an order in a step. Each order learns from a signal s. If Om is small, s is ts^2 z without its mean.
 * Otherwise s is e. A ripple of 1 A appears in s with the gain b ts^2 G(Om). Each order is corrected by the exact inverse of this gain:
 *
 *   c_k -= rate ts s exp(-j k base theta) / (b ts^2 G)
 *
 * The orders that learn from z are called slow, the others fast. In each step one half of the slow orders learns, from the sum of the last
 * two s.
 *
 * The rate is constant until 6 / rate of learning time after a new speed. After a further time t it is 1 / (1 / rate + t / 2). So the
 * amplitudes tend to a mean over time.
 *
 * The speed decides which orders act. All slow orders act. A fast order acts only if it is among the lowest `fast` orders. With `fast`
 * the user says that the motor has these orders. */
#ifndef COGLESS_HARMONIC_H
#define COGLESS_HARMONIC_H

#include <stdint.h>

#include "angle.h"
#include "law.h"
#include "pi.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_HARMONIC_ORDERS 128U
#define CGL_HARMONIC_EDGES 8U
#define CGL_HARMONIC_ORDER_MAX 65535U
/* Largest angle of an order in a step [rad]. Beyond it the samples look like those of another order. */
#define CGL_HARMONIC_FASTEST CGL_R(2.6)
#define CGL_HARMONIC_SETTLE 64U         /* after the cause of a freeze has ended, learning waits this many steps */

/* Number of entries of the caller's memory: cosines, sines, orders, pairs of gains. A load of a stored map compares the orders. */
#define CGL_HARMONIC_LENGTH(orders) (5U * (orders))

typedef struct {
    cgl_pi_config pi;   /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    cgl_real k_theta;   /* gain of the position error, the shorter way round [1/s], >= 0; 0: only the speed is controlled */
    cgl_real b;         /* acceleration per current, K_t / J [rad/s^2/A], > 0; b ts^2 must be > 0 and finite too */
    cgl_real delay;     /* delay of the current behind its reference, without the half period of the hold [s], 0 to 16 ts */
    cgl_real step;      /* step of the measured angle, if the speed is measured by the time between two edges; else 0 [rad], >= 0. That
                           speed gives the angle between two edges */
    uint32_t base;      /* lowest learned order of a mechanical revolution; the others are its multiples, 1 to CGL_HARMONIC_ORDER_MAX */
    uint32_t bends;     /* number of orders of the sensor's error that are learned, 0 to 2. 1: the error that repeats once a turn; 2:
                           also the error that repeats twice a turn. With a base of 1 or 2 none is learned, with 3 or 4 at most one. Use
                           0 for an accurate sensor. Use 0 also for a load that varies once or twice a turn, because such a load looks
                           like the error */
    uint32_t orders;    /* number of learned orders, 1 to CGL_HARMONIC_ORDERS; base * orders is at most CGL_HARMONIC_ORDER_MAX */
    uint32_t fast;      /* the motor is known to have the lowest `fast` orders: they act up to CGL_HARMONIC_FASTEST. The others act only
                           while they are slow; 0 to `orders` */
    cgl_real rate;      /* rate of learning at its begin; the rates of all acting orders add up to at most 1/16 per step; 0: nothing is
                           learned [1/s], >= 0 */
    cgl_real rate_min;  /* lowest rate of learning, to which `rate` falls in time [1/s], >= 0 */
    cgl_real limit;     /* each amplitude and the sum stay within +-limit [A], > 0, at most loop.current_limit */
    cgl_real held[CGL_HARMONIC_EDGES]; /* bands in which an order acts but is not learned: pairs of the least and the largest angle by
                                          which the order turns in a step [rad], >= 0, ascending; 0 and 0: no band */
} cgl_harmonic_config;

/* The bend is the error of the measured angle that repeats each turn, as in an encoder mounted off centre. It is learned from the
 * orders: an error of the angle turns the phases of all orders together. */
typedef struct {
    cgl_real part[4]; /* coefficients of cos theta, sin theta, cos 2 theta, sin 2 theta [rad] */
    cgl_real share;   /* share of the bend that is used, 0 to 1 */
    cgl_real angle;   /* the bend at the present angle, times `share` [turns] */
    cgl_real slope;   /* derivative of `angle` with respect to the rotor's angle */
    cgl_real rate;    /* change of each part per `phase_sum` [rad/A^2] */
    cgl_real slow_power; /* sum of k |c_k|^2 over the slow orders whose gains this round has computed [A^2] */
    cgl_real fast_power; /* the same sum over the fast orders [A^2] */
    cgl_real drift_most; /* the bend is learned while the square of `drift` is below this [turns^2/ts^4] */
    cgl_real phase_sum;  /* change of the orders' phases since the last update of the bend, each weighted with |c_k|^2 [A^2] */
    cgl_real last_phase_sum; /* phase_sum before the last update [A^2] */
    cgl_real variance;   /* variance per step that noise gives to phase_sum [A^4] */
} cgl_harmonic_bend;

typedef struct {
    cgl_harmonic_config config;
    cgl_pi pi;
    cgl_real *cosine;        /* caller's memory: `orders` cosines [A], sines [A], orders, and pairs of gains [A/rad] */
    cgl_real lead;           /* time from a command to the middle of the period in which it acts [ts] */
    cgl_real gain;           /* b ts^2 [turns/A] */
    cgl_real weight[3];      /* shares of u that act in each of the next three steps; they model the delay, or a lag */
    cgl_real lag_share;      /* share of the current that is left after a step, if a lag models the delay; else 0 */
    cgl_real pending[2];     /* parts of past u that act in the next step, and in the step after that [A] */
    cgl_real current;        /* part of u that acts in this step [A] */
    uint32_t theta_sensor;   /* the sensor's angle in the last step [turns of 2^32] */
    cgl_real half_step;      /* half a step of the measured angle [turns] */
    cgl_real since_edge;     /* angle since the sensor's last edge, shifted by a constant so that it lies within +-half_step [turns] */
    uint32_t theta;          /* angle of the observer [turns of 2^32] */
    cgl_real omega;          /* speed of the observer [turns/ts] */
    cgl_real load;           /* z, the load of the observer [turns/ts^2] */
    cgl_real mean;           /* moving mean of z [turns/ts^2] */
    cgl_real drift;          /* moving mean of (z - mean): what is slower than the base order [turns/ts^2] */
    cgl_real share;          /* weight of the present z in its moving mean */
    cgl_real last_load;      /* z - mean in the last step [turns/ts^2] */
    cgl_real time;           /* time of learning since the last new speed [s] */
    cgl_real slowest, fastest; /* lowest and highest speed so far [turns/ts]. A speed is new above 1.25 * fastest or below
                                  slowest / 1.25 */
    cgl_real rate;           /* present rate of learning [1/s] */
    cgl_real step;           /* angle of the base order in a step when this round of gains began [rad] */
    cgl_phasor base, half;   /* base: phasor of the angle by which the base order turns in the time `lead`; half: in half a period */
    cgl_phasor delayed, turned; /* the same two phasors for the order `next_gain` */
    cgl_harmonic_bend bend;
    uint32_t bends;          /* number of orders of the bend that are learned */
    uint32_t tick;           /* steps since the last update of the bend; it counts without a bend too */
    uint32_t next_gain;      /* index of the order whose gain is computed next */
    uint32_t band;           /* index in `held` of the first pair that ends above the last order whose gain was computed */
    uint32_t acting;         /* number of orders that act at this speed */
    uint32_t low;            /* number of slow orders among the acting ones */
    uint32_t wait;           /* steps until the law may learn */
    bool follows;            /* the observer follows an angle */
    bool learning;           /* the last step learned */
    cgl_real learned;        /* the learned part of the last step [A] */
} cgl_harmonic;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. loop.feed_forward must be false, because the observer needs the feedback's current. `cell` has
 * CGL_HARMONIC_LENGTH(orders) entries, which are cleared and stay in use. */
cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop, cgl_real *cell,
                            uint32_t length);

/* Replaces gains and limits at run time, as cgl_pi_retune() does. `base` and `orders` must not change. The amplitudes stay, within the
 * new limit. */
cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config);

void cgl_harmonic_reset(cgl_harmonic *law);

/* Learning freezes under any of these conditions: in->learn is false; the rate is 0; omega_ref is 0; the output was at its limit; an
 * input is not finite; the law is off or in torque mode. It goes on CGL_HARMONIC_SETTLE steps after the last of them. Meanwhile the
 * learned orders still act, as long as theta_m is valid. An order neither acts nor learns if it turns faster than CGL_HARMONIC_FASTEST,
 * or if it is fast and not among the lowest `fast`. While in->off, the output and the PI's integral are 0. */
void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
