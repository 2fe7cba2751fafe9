/* PI control of speed or of position with learned amplitudes of the orders that the motor can have, and nothing to tune:
 *
 *   i_q_ref = PI(omega_ref - omega + k_theta (theta_ref - theta)) + T
 *   T = Re sum_k c_k exp(j k base (theta + omega (ts/2 + delay)))
 *
 * An observer of angle, speed and load knows only the feedback's current, u = i_q_ref - T. So its error e shows the ripple that T
 * leaves. Where T leaves none, e has no ripple, even if the observer's model has a wrong lag:
 *
 *   a = b u + z,   theta' = theta + ts omega + ts^2/2 a,   omega' = omega + ts a,   e = measured - theta'
 *   theta = theta' + (1 - p^3) e,   omega = omega' + 3/2 (1-p)^2 (1+p) e / ts,   z += (1-p)^3 e / ts^2,   p = exp(-1/2)
 *
 * An order learns from a signal s. Where Om = k base omega ts is small, s is ts^2 z without its mean. Elsewhere s is e. A ripple
 * of 1 A appears in s with the gain b ts^2 G(Om). Each order is corrected by the exact inverse of that gain:
 *
 *   c_k -= rate ts s exp(-j k base theta) / (b ts^2 G)
 *
 * The orders that learn from z are called slow, the others fast. In each step one half of the slow orders learns, from the sum of the
 * last two s.
 *
 * The rate is 1 / (1 / rate + t / 2), where t is the time since the last new speed. So the amplitudes tend to a mean over time.
 *
 * The speed decides which orders act: all slow orders, and a fast order if it is among the lowest `fast`. The user says with `fast`
 * that the motor has these orders. */
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
/* Angle of an order in a step beyond which its samples look like those of another order [rad]. */
#define CGL_HARMONIC_FASTEST CGL_R(2.6)
#define CGL_HARMONIC_SETTLE 64U         /* steps from the end of what froze learning until it goes on */

/* Entries of the caller's memory: cosines, sines, orders, pairs of gains. The orders show to which law a stored map belongs. */
#define CGL_HARMONIC_LENGTH(orders) (5U * (orders))

typedef struct {
    cgl_pi_config pi;   /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    cgl_real k_theta;   /* gain of the position's error, taken the short way round; 0: only the speed is controlled [1/s], >= 0 */
    cgl_real b;         /* acceleration per current, K_t / J [rad/s^2/A], > 0; b ts^2 is a number, > 0, too */
    cgl_real delay;     /* time from the reference to the current, without the half period for which a value is held [s],
                           0 to 16 ts */
    cgl_real step;      /* step of the measured angle, if the speed is measured by the time between two edges: the speed then gives the
                           angle between two edges; else 0 [rad], >= 0 */
    uint32_t base;      /* learned orders of a mechanical revolution are its multiples, 1 to CGL_HARMONIC_ORDER_MAX */
    uint32_t bends;     /* number of orders of the sensor's error that are learned, 0 to 2. 1: the part that comes once a turn; 2: also
                           the part that comes twice. With a base of 1 or 2 none is learned, with 3 or 4 at most one. Use 0 for an
                           accurate sensor, and for a load that varies once or twice a turn: such a load looks like the error */
    uint32_t orders;    /* number of learned orders, 1 to CGL_HARMONIC_ORDERS; base orders is at most CGL_HARMONIC_ORDER_MAX */
    uint32_t fast;      /* the lowest `fast` orders, which the motor is known to have, act up to CGL_HARMONIC_FASTEST. The others
                           act only while they are slow; 0 to `orders` */
    cgl_real rate;      /* rate at which learning begins; the rates of all acting orders add up to at most 1/16 per step; 0: nothing
                           is learned [1/s], >= 0 */
    cgl_real rate_min;  /* rate to which it falls [1/s], >= 0 */
    cgl_real limit;     /* each amplitude, and the sum, stay within +-limit [A], > 0, at most loop.current_limit */
    cgl_real held[CGL_HARMONIC_EDGES]; /* pairs of angles of an order in a step, rising. An order between the two of a pair acts but
                                          is not learned; 0 and 0: no pair [rad], >= 0 */
} cgl_harmonic_config;

/* The bend: the error of the measured angle that repeats each turn, as an encoder has that is mounted off the centre. It is
 * learned from the orders: a wrong angle turns the phases of all of them together. */
typedef struct {
    cgl_real part[4]; /* coefficients of cos theta, sin theta, cos 2 theta, sin 2 theta [rad] */
    cgl_real share;   /* share of the bend that is used, 0 to 1 */
    cgl_real angle;   /* that share of the bend at the present angle [turns] */
    cgl_real slope;   /* derivative of `angle` with respect to the rotor's angle */
    cgl_real rate;    /* change of each part per `phase_sum` [rad/A^2] */
    cgl_real slow_power; /* sum of k |c_k|^2 over the slow orders whose gains this round has made, [A^2] */
    cgl_real fast_power; /* and over the fast orders [A^2] */
    cgl_real drift_most; /* the bend is learned while the square of `drift` is below this [turns^2/ts^4] */
    cgl_real phase_sum;  /* change of the orders' phases since the last update of the bend, each weighted with |c_k|^2 [A^2] */
    cgl_real last_phase_sum; /* phase_sum before the last update [A^2] */
    cgl_real variance;   /* variance of phase_sum per step that noise makes [A^4] */
} cgl_harmonic_bend;

typedef struct {
    cgl_harmonic_config config;
    cgl_pi pi;
    cgl_real *cosine;        /* caller's memory: `orders` cosines [A], sines [A], orders, and pairs of gains [A/rad] */
    cgl_real lead;           /* time from a command to the middle of the period in which it acts [ts] */
    cgl_real gain;           /* b ts^2 [turns/A] */
    cgl_real weight[3];      /* shares of u in the current of the next three steps: they make the delay, or a lag */
    cgl_real lag_share;      /* share of the current that is left after a step, where the delay counts as a lag */
    cgl_real pending[2];     /* parts of past u that act in the next step, and in the step after that [A] */
    cgl_real current;        /* part of u that acts in this step [A] */
    uint32_t theta_sensor;   /* the sensor's angle in the last step [turns of 2^32] */
    cgl_real half_step;      /* half a step of the measured angle [turns] */
    cgl_real since_edge;     /* angle since the sensor's last edge, less a constant that puts it within +-half_step [turns] */
    uint32_t theta;          /* the observer's angle [turns of 2^32], */
    cgl_real omega;          /* speed [turns/ts], */
    cgl_real load;           /* z [turns/ts^2], */
    cgl_real mean;           /* moving mean of z [turns/ts^2] */
    cgl_real drift;          /* moving mean of z - mean: what z holds below the base order [turns/ts^2] */
    cgl_real share;          /* weight of the present z in its moving mean */
    cgl_real last_load;      /* z - mean in the last step [turns/ts^2] */
    cgl_real time;           /* time of learning since the last new speed [s] */
    cgl_real slowest, fastest; /* span of the speeds so far; a speed a quarter beyond it is new [turns/ts] */
    cgl_real rate;           /* present rate of learning [1/s] */
    cgl_real step;           /* angle of the base order in a step, at the begin of this round of gains [rad] */
    cgl_phasor base, half;   /* phasors of the base order's angle in `lead`, and in half a period; */
    cgl_phasor delayed, turned; /* and the same two of the order `next_gain` */
    cgl_harmonic_bend bend;
    uint32_t bends;          /* number of orders of the bend that are learned */
    uint32_t tick;           /* steps since the last update of the bend; it counts without a bend too */
    uint32_t next_gain;      /* index of the order whose gain is made next */
    uint32_t band;           /* index in `held` of the first pair that ends above the last order whose gain was made */
    uint32_t acting;         /* number of orders that act at this speed */
    uint32_t low;            /* number of the slow ones among them */
    uint32_t wait;           /* steps until it may learn */
    bool follows;            /* the observer follows an angle */
    bool learning;           /* the last step learned */
    cgl_real learned;        /* the learned part of the last step [A] */
} cgl_harmonic;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop);

/* loop: drive.loop, without feed_forward: the observer needs the feedback's current. `cell`: CGL_HARMONIC_LENGTH(orders) entries,
 * which the state keeps using; they are cleared. */
cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop, cgl_real *cell,
                            uint32_t length);

/* Replaces gains and limits while it runs, as cgl_pi_retune does. `base` and `orders` must not change. The amplitudes stay, within
 * the limit. */
cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config);

void cgl_harmonic_reset(cgl_harmonic *law);

/* Learning freezes while in->learn is false, the rate is 0, the output was at its limit, or an input is not finite, and for
 * CGL_HARMONIC_SETTLE steps after. Meanwhile the learned orders act on, as long as there is an angle. An order does not act, and is
 * not learned, if it turns faster than CGL_HARMONIC_FASTEST, or if it is fast and not among the lowest `fast`. While in->off is
 * true the output and the PI's integral are 0. */
void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
