/* PI control of speed or of position with learned amplitudes of the orders that the motor can have, and nothing to tune:
 *
 *   i_q_ref = PI(omega_ref - omega + k_theta (theta_ref - theta)) + T
 *   T = Re sum_k c_k exp(j k base (theta + omega (ts/2 + delay)))
 *
 * An observer of angle, speed and load is told the feedback's current alone, u = i_q_ref - T. Its error e holds what T leaves of
 * the ripple, and only that. Where nothing is left, e has no ripple, whatever the lag of the observer's model:
 *
 *   a = b u + z,   theta' = theta + ts omega + ts^2/2 a,   omega' = omega + ts a,   e = measured - theta'
 *   theta = theta' + (1 - p^3) e,   omega = omega' + 3/2 (1-p)^2 (1+p) e / ts,   z += (1-p)^3 e / ts^2,   p = exp(-1/2)
 *
 * An order learns from s. Where Om = k base omega ts is small, s is ts^2 z without its mean; else it is e. A ripple of 1 A in
 * current shows as b ts^2 G(Om) in s. Each order takes away what it sees of itself, by the exact inverse of that:
 *
 *   c_k -= rate ts s exp(-j k base theta) / (b ts^2 G)
 *
 * Such slow orders learn in turns, a half of them in a step, from the sum of the last two s.
 *
 * The rate falls like the weight in a mean: it is 1 / (1 / rate + t / 2). t is the time since the last new speed.
 *
 * The speed decides which orders act: all slow orders, and those fast ones that are among the lowest `fast`. The motor is known to
 * have these. */
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
#define CGL_HARMONIC_FASTEST CGL_R(2.6) /* rad in a step: beyond it the samples hardly tell an order from its image */
#define CGL_HARMONIC_SETTLE 64U         /* steps until learning goes on after it froze */

/* Entries of the caller's memory: cosines, sines, orders, pairs of gains. A stored map tells by the orders whose it is. */
#define CGL_HARMONIC_LENGTH(orders) (5U * (orders))

typedef struct {
    cgl_pi_config pi;   /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    cgl_real k_theta;   /* gain of the position's error, taken the short way round; 0: only the speed is controlled [1/s], >= 0 */
    cgl_real b;         /* acceleration per current, K_t / J [rad/s^2/A], > 0; b ts^2 is a number, > 0, too */
    cgl_real delay;     /* from the reference to the current, less the half period that a held value is late [s], 0 to 16 ts */
    cgl_real step;      /* step of the measured angle, if the speed is timed from edge to edge and so tells where between two edges the
                           rotor is; else 0 [rad], >= 0 */
    uint32_t base;      /* learned orders of a mechanical revolution are its multiples, 1 to CGL_HARMONIC_ORDER_MAX */
    uint32_t bends;     /* how much of the sensor's error is learned. 0: nothing; 1: the part that comes once a turn; 2: the part
                           that comes twice as well. A base of 1 or 2 allows 0, of 3 or 4 at most 1; more is ignored. Use 0 for an
                           accurate sensor, and if the load varies once or twice a turn, which looks the same; 0 to 2 */
    uint32_t orders;    /* number of learned orders, 1 to CGL_HARMONIC_ORDERS; base orders is at most CGL_HARMONIC_ORDER_MAX */
    uint32_t fast;      /* the lowest `fast` orders act up to CGL_HARMONIC_FASTEST: those that the motor is known to have. The
                           others act while they are slow; 0 to `orders` */
    cgl_real rate;      /* rate at which learning begins; 0: nothing is learned. The rates of all acting orders add up to 1/16 per step at most [1/s], >= 0 */
    cgl_real rate_min;  /* rate to which it falls [1/s], >= 0 */
    cgl_real limit;     /* each amplitude, and the sum, stay within +-limit [A], > 0, at most loop.current_limit */
    cgl_real held[CGL_HARMONIC_EDGES]; /* bands in which an order acts but is not learned, from and to, rising, none from 0
                                               to 0 [rad in a step of the order], >= 0 */
} cgl_harmonic_config;

/* The bend: the measured angle's error that repeats each turn, as of an encoder mounted off the middle. */
typedef struct {
    cgl_real part[4]; /* coefficients of cos theta, sin theta, cos 2 theta, sin 2 theta [rad] */
    cgl_real share;   /* share of the bend that is used, 0 to 1 */
    cgl_real here;    /* that share of the bend at the present angle [turns] */
    cgl_real slope;   /* derivative of `here` with respect to the angle */
    cgl_real rate;    /* step of each part per `moved` [rad/A^2] */
    cgl_real power;   /* sum of k |c_k|^2 over this round's slow orders, from which the bend is learned [A^2] */
    cgl_real rest;    /* the same sum over the fast orders [A^2] */
    cgl_real calm;    /* square of the drift above which the bend is not learned [turns^2/ts^4] */
    cgl_real moved;   /* how far the orders' phases have moved on since the last turn of the bend, weighted with |c_k|^2 [A^2] */
    cgl_real before;  /* `moved` at the last turn of the bend [A^2] */
    cgl_real doubt;   /* variance of `moved` per step that noise makes [A^4] */
} cgl_harmonic_bend;

typedef struct {
    cgl_harmonic_config config;
    cgl_pi pi;
    cgl_real *cosine;        /* caller's memory: `orders` cosines [A], sines [A], orders, and pairs of gains [A/rad] */
    cgl_real ahead;          /* time from now until what is commanded now acts, half a period included [ts] */
    cgl_real gain;           /* b ts^2 [turns/A] */
    cgl_real weight[3];      /* shares of u in the current of the next steps: a delay between samples, or a lag */
    cgl_real kept;           /* share of the current that a lag keeps in a step */
    cgl_real later[2];       /* parts of past u that act in the steps after the next [A] */
    cgl_real current;        /* u as it acts [A] */
    uint32_t shown;          /* the sensor's angle in the last step [turns of 2^32] */
    cgl_real half_step;      /* half a step of the measured angle [turns] */
    cgl_real since_edge;     /* way since the sensor's last edge, less a constant; within half a step [turns] */
    uint32_t theta;          /* the observer's angle [turns of 2^32], */
    cgl_real omega;          /* speed [turns/ts], */
    cgl_real load;           /* z [turns/ts^2], */
    cgl_real mean;           /* mean of z [turns/ts^2] */
    cgl_real drift;          /* mean of z less `mean`: the part that no multiple of the base explains [turns/ts^2] */
    cgl_real share;          /* share of z that the mean takes in a step */
    cgl_real last;           /* z without its mean, of the last step */
    cgl_real time;           /* learning time since the speed was new [s] */
    cgl_real slowest, fastest; /* span of speeds; a speed a quarter beyond it is new [turns/ts] */
    cgl_real rate;           /* present rate of learning [1/s] */
    cgl_real step;           /* angle by which the base order moves in a step, as of the begin of this round of gains [rad] */
    cgl_phasor base, half;   /* phasors of the base order: as far ahead as it acts, by half a period; */
    cgl_phasor delayed, turned; /* and those of the order `due`, whose gain is made anew next */
    cgl_harmonic_bend bend;
    uint32_t bends;          /* pairs of parts of the bend that are learned */
    uint32_t since;          /* steps since the last turn of the bend; it counts without a bend too */
    uint32_t due;            /* index of the order whose gain is made anew next */
    uint32_t band;           /* index of the first held band that ends above the order before `due` */
    uint32_t acting;         /* number of orders that have samples enough at this speed */
    uint32_t low;            /* number of those that learn from z: the slow orders */
    uint32_t wait;           /* steps until it may learn */
    bool seated;             /* the observer follows an angle */
    bool learning;           /* the last step learned */
    cgl_real learned;        /* the learned part of the last step [A] */
} cgl_harmonic;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop);

/* loop: drive.loop, without feed_forward: the observer needs the feedback's current. `cell`: CGL_HARMONIC_LENGTH(orders) entries,
 * which the state keeps using; they are cleared. */
cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop, cgl_real *cell,
                            uint32_t length);

/* Takes other gains and limits while it runs, as cgl_pi_retune. Amplitudes stay, within the limit; the orders must. */
cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config);

void cgl_harmonic_reset(cgl_harmonic *law);

/* Learning freezes while in->learn is false, the rate is 0, the output was at its limit, or an input is not finite, and for CGL_HARMONIC_SETTLE
 * steps after. Meanwhile the learned orders still act, but not without an angle. An order neither acts nor is learned if it turns
 * faster than CGL_HARMONIC_FASTEST, or if it is fast and not among the lowest `fast`. While in->off the output and the PI's integral
 * are 0. */
void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
