/* PI control of speed or position, plus a learned current T. T is a sum of waves over the rotor's angle. Wave k is the order k base: it
 * repeats k base times a revolution, and has the complex amplitude c_k. There is nothing to tune:
 *
 *   i_q_ref = PI(omega_ref - omega + k_theta (theta_ref - theta)) + T
 *   T = Re sum_k c_k exp(j k base (theta + omega (ts/2 + delay)))
 *
 * An observer of angle theta, speed omega and load z gets the feedback's current only, u = i_q_ref - T. So the observer's error e shows the
 * ripple that T has not cancelled. If T cancels all the ripple, e has none, even if the observer's model has a wrong lag:
 *
 *   a = b u + z,   theta' = theta + ts omega + ts^2/2 a,   omega' = omega + ts a,   e = measured - theta'
 *   theta = theta' + (1 - p^3) e,   omega = omega' + 3/2 (1-p)^2 (1+p) e / ts,   z += (1-p)^3 e / ts^2,   p = exp(-1/2)
 *
 * Om = k base omega ts is the angle by which an order turns in a step. Each order learns from a signal s. An order with a small Om is
 * called slow, and its s is ts^2 z without the mean of z. Every other order is called fast, and its s is e. A ripple of 1 A appears in s
 * with the gain b ts^2 G(Om). The correction of c_k has the exact inverse of this gain:
 *
 *   c_k -= rate ts s exp(-j k base theta) / (b ts^2 G)
 *
 * In each step one half of the slow orders learns, from the sum of the last two s.
 *
 * After a new speed the rate is constant for a learning time of 6 / rate. After a further learning time t, the rate is
 * 1 / (1 / rate + t / 2). So each amplitude tends to the mean of what it learns over time.
 *
 * An order acts if it is a part of T at the present speed. Only an order that acts can learn. All slow orders act. A fast order acts only
 * if it is one of the lowest `fast` orders, which the user knows the motor to have, and if Om is at most CGL_HARMONIC_FASTEST. */
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
/* Largest angle by which an order that acts turns in a step [rad]. From pi on, the samples of an order look like those of another. */
#define CGL_HARMONIC_FASTEST CGL_R(2.6)
#define CGL_HARMONIC_SETTLE 64U         /* number of steps that learning waits after the cause of a freeze has ended */

/* Number of entries of the caller's memory. Each order has five: the amplitudes of its cosine and sine, its number, and a pair of gains
 * for learning. A stored map loads only if its orders have the same numbers. */
#define CGL_HARMONIC_LENGTH(orders) (5U * (orders))

typedef struct {
    cgl_pi_config pi;   /* kp [A s/rad], ki [A/rad], bound of the sum of PI and T [A] */
    cgl_real k_theta;   /* gain of the position error [1/s], >= 0; 0: only the speed is controlled. The position error is taken the shorter
                           way round */
    cgl_real b;         /* acceleration per current, K_t / J [rad/s^2/A], > 0; b ts^2 must be > 0 and finite too */
    cgl_real delay;     /* delay of the current behind its reference [s], 0 to 16 ts. The delay does not include the half period for
                           which a reference is held on average */
    cgl_real step;      /* resolution of the measured angle [rad], >= 0, if the speed is measured by the time between two edges: the law
                           computes the angle between two edges from this speed. 0: the speed is measured in another way */
    uint32_t base;      /* lowest learned order of a mechanical revolution; the others are its multiples, 1 to CGL_HARMONIC_ORDER_MAX */
    uint32_t bends;     /* number of orders of the angle sensor's error that are learned, 0 to 2. 1: the error that repeats once a turn;
                           2: also the error that repeats twice a turn. With a base of 1 or 2 none is learned, with 3 or 4 at most one.
                           Use 0 for an accurate sensor. Use 0 also for a load that varies once or twice a turn, because such a load
                           looks like the sensor's error */
    uint32_t orders;    /* number of learned orders, 1 to CGL_HARMONIC_ORDERS; base * orders is at most CGL_HARMONIC_ORDER_MAX */
    uint32_t fast;      /* number of the lowest orders that the motor is known to have, 0 to `orders`. These orders act up to
                           CGL_HARMONIC_FASTEST. The others act only while they are slow */
    cgl_real rate;      /* rate of learning at its begin [1/s], >= 0; 0: nothing is learned. The rates of all orders that act
                           add up to at most 1/16 per step */
    cgl_real rate_min;  /* lowest rate of learning, to which the rate falls in time [1/s], >= 0 */
    cgl_real limit;     /* bound of |T|, and of each cosine's and sine's amplitude [A], > 0, at most loop.current_limit */
    cgl_real held[CGL_HARMONIC_EDGES]; /* bands in which an order acts but is not learned: pairs of the least and the largest angle by
                                          which the order turns in a step [rad], >= 0, ascending; 0 and 0: no band */
} cgl_harmonic_config;

/* The bend is the error of the measured angle that repeats each turn, as in an encoder mounted off centre. The bend is learned from the
 * amplitudes c_k, because an error of the angle shifts the phases of all orders together.
 *
 * A round computes the gains with which the orders learn at the present speed, one order after the other. Then the next round begins. */
typedef struct {
    cgl_real part[4]; /* coefficients of cos theta, sin theta, cos 2 theta, sin 2 theta [rad] */
    cgl_real share;   /* share of the bend that is subtracted from the measured angle [-], 0 to 1 */
    cgl_real angle;   /* the bend at the present angle, times `share` [turns] */
    cgl_real slope;   /* derivative of `angle` with respect to the rotor's angle */
    cgl_real rate;    /* gain of the bend's learning, from phase_sum to each part [rad/A^2] */
    cgl_real slow_power; /* sum of k |c_k|^2 over the slow orders outside of the bands `held` whose gains this round has computed [A^2] */
    cgl_real fast_power; /* sum of k |c_k|^2 over the fast orders whose gains this round has computed [A^2] */
    cgl_real drift_most; /* square of `drift` below which the bend is learned [turns^2/ts^4] */
    cgl_real phase_sum;  /* sum over the slow orders of |c_k|^2 times the change of the phase since the last update of the bend [A^2] */
    cgl_real last_phase_sum; /* phase_sum of the last update that learned [A^2] */
    cgl_real variance;   /* variance that noise adds to phase_sum in a step [A^4] */
} cgl_harmonic_bend;

typedef struct {
    cgl_harmonic_config config;
    cgl_pi pi;
    cgl_real *cosine;        /* caller's memory: `orders` cosines [A], then sines [A], order numbers, and pairs of gains [A/turn] */
    cgl_real lead;           /* time from a current reference to the middle of the period in which its current flows [ts] */
    cgl_real gain;           /* b ts^2 [turns/A] */
    cgl_real weight[3];      /* shares of the feedback's current u that flow in each of the next three steps [-]: the model of the delay */
    cgl_real lag_share;      /* share of the current that is left after a step [-], if a first-order lag models the delay; else 0 */
    cgl_real pending[2];     /* parts of earlier u that flow in the next step, and in the step after that [A] */
    cgl_real current;        /* modelled current of the feedback in this step [A] */
    uint32_t theta_sensor;   /* the sensor's angle in the last step [2^-32 turns] */
    cgl_real half_step;      /* half a step of the measured angle [turns] */
    cgl_real since_edge;     /* angle since the sensor's last edge [turns], shifted by a constant so that it lies within +-half_step */
    uint32_t theta;          /* angle of the observer [2^-32 turns] */
    cgl_real omega;          /* speed of the observer [turns/ts] */
    cgl_real load;           /* z, the load of the observer [turns/ts^2] */
    cgl_real mean;           /* moving mean of z [turns/ts^2] */
    cgl_real drift;          /* moving mean of (z - mean) [turns/ts^2]: the part of z that changes more slowly than the base order */
    cgl_real share;          /* weight of the present z in its moving mean [-] */
    cgl_real last_load;      /* z - mean in the last step [turns/ts^2] */
    cgl_real time;           /* time of learning since the last new speed [s] */
    cgl_real slowest, fastest; /* lowest and highest speed so far [turns/ts]. A speed is new above 1.25 * fastest or below
                                  slowest / 1.25 */
    cgl_real rate;           /* present rate of learning [1/s] */
    cgl_real step;           /* angle by which the base order turned in a step when this round began [rad], >= 0 */
    cgl_phasor base, half;   /* phasors of the angles by which the base order turns in the time `lead`, and in half a period ts */
    cgl_phasor delayed, turned; /* the same two phasors for the order whose gain is computed next */
    cgl_harmonic_bend bend;
    uint32_t bends;          /* number of orders of the bend that are learned */
    uint32_t tick;           /* steps since the last update of the bend; the count restarts on time even if no bend is learned */
    uint32_t next_gain;      /* index of the order whose gain is computed next */
    uint32_t band;           /* index in config.held of the first band that does not end below the order whose gain was computed last */
    uint32_t acting;         /* number of orders that act at this speed, the lowest ones */
    uint32_t low;            /* number of slow orders, the lowest ones */
    uint32_t wait;           /* steps until the law may learn */
    bool follows;            /* the observer has been started, and follows the measured angle */
    bool learning;           /* the last step learned */
    cgl_real learned;        /* learned current T in the last step [A] */
} cgl_harmonic;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. loop.feed_forward must be false, because the observer needs the feedback's current. `cell` has
 * CGL_HARMONIC_LENGTH(orders) entries. Init clears them, and the law uses them from then on. */
cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop, cgl_real *cell,
                            uint32_t length);

/* Replaces gains and limits at run time, as cgl_pi_retune() does. `base` and `orders` must not change. The amplitudes are kept, but
 * clipped to the new limit. */
cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config);

void cgl_harmonic_reset(cgl_harmonic *law);

/* Learning freezes under any of these conditions: in->learn is false; the rate is 0; omega_ref is 0; the output was at its limit; an
 * input is not finite; the law is off or in torque mode. Learning goes on CGL_HARMONIC_SETTLE steps after the last of these conditions has
 * ended. While learning is frozen, T is still a part of the output, as long as theta_m is valid. While in->off, the output and the PI's
 * integral are 0. */
void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
