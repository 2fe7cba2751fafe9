/* PI control of speed or of position, with learned amplitudes of the orders that the motor can have. It has nothing to tune:
 *
 *   i_q_ref = PI(omega_ref - omega + k_theta (theta_ref - theta)) + T
 *   T = Re sum_k c_k exp(j k base (theta + omega (ts/2 + delay)))
 *
 * An observer of angle, speed and load knows the feedback's current alone, u = i_q_ref - T. So its error e shows what T leaves of
 * the ripple, and only that. Where T leaves nothing, e has no ripple, even if the observer's model is wrong:
 *
 *   a = b u + z,   theta' = theta + ts omega + ts^2/2 a,   omega' = omega + ts a,   e = measured - theta'
 *   theta = theta' + (1 - p^3) e,   omega = omega' + 3/2 (1-p)^2 (1+p) e / ts,   z += (1-p)^3 e / ts^2,   p = exp(-1/2)
 *
 * An order turns by Om = k base omega ts in a step. It learns from a signal s: a slow order, whose Om is small, from ts^2 z less its
 * mean, a fast order from e. A ripple of 1 A shows as b ts^2 G(Om) in s, so an order divides by that what it sees of itself:
 *
 *   c_k -= rate ts s exp(-j k base theta) / (b ts^2 G)
 *
 * Slow orders learn in turns, half of them in a step, from the sum of the last two s.
 *
 * The rate is full at first and then falls like the weight in a mean: it is 1 / (1 / rate + t / 2), where t is the time since then.
 * Its time begins anew at a new speed.
 *
 * The speed decides which orders act: all slow orders act, and of the fast ones those among the lowest `fast`, which the motor is
 * known to have. */
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

/* Entries of the caller's memory: cosines, sines, orders, pairs of gains. The orders show to which law a stored map belongs. */
#define CGL_HARMONIC_LENGTH(orders) (5U * (orders))

typedef struct {
    cgl_pi_config pi;   /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    cgl_real k_theta;   /* gain from the position's error, the short way round, to speed [1/s], >= 0; 0: speed control */
    cgl_real b;         /* acceleration per current, K_t / J [rad/s^2/A], > 0; b ts^2 is a number, > 0, too */
    cgl_real delay;     /* time from the reference to the current, without the half period that a held value is late [s], 0 to 16 ts */
    cgl_real step;      /* step of the sensor's angle, if the speed is timed from edge to edge, which tells where the rotor is
                           between two; 0 for other speeds [rad], >= 0 */
    uint32_t base;      /* the learned orders of a mechanical revolution are its multiples, 1 to CGL_HARMONIC_ORDER_MAX */
    uint32_t bends;     /* 1: the law learns the part of the sensor's error that comes once a turn; 2: the part that comes twice,
                           too. A base below 3 allows none, below 5 one. Choose 0 for a true sensor, and where the load varies
                           as often, since that looks the same; 0 to 2 */
    uint32_t orders;    /* number of orders, 1 to CGL_HARMONIC_ORDERS; base * orders is at most CGL_HARMONIC_ORDER_MAX */
    uint32_t fast;      /* the lowest `fast` orders act up to CGL_HARMONIC_FASTEST: those that the motor is known to have. The
                           others act while they are slow; 0 to `orders` */
    cgl_real rate;      /* rate at which learning begins; 0: nothing is learned. The law lowers it so that the rates of all acting
                           orders add up to at most 1/16 per step [1/s], >= 0 */
    cgl_real rate_min;  /* rate to which it falls [1/s], >= 0 */
    cgl_real limit;     /* each amplitude, and the sum, stay within +-limit [A], > 0, at most loop.current_limit */
    cgl_real held[CGL_HARMONIC_EDGES]; /* bands in which an order acts but is not learned: the edges from and to, rising; 0 and 0 are
                                          no band [rad in a step of the order], >= 0 */
} cgl_harmonic_config;

/* The bend: the error of the measured angle that repeats each turn, as an encoder off the middle has it. */
typedef struct {
    cgl_real part[4];        /* its cosine and sine once a turn, and twice [rad] */
    cgl_real share;          /* share of it that acts, 0 to 1 */
    cgl_real angle;          /* what acts of it at the present angle [turns] */
    cgl_real slope;          /* what `angle` grows by, per turn of the rotor [turns] */
    cgl_real rate;           /* of learning it [rad/A^2] */
    cgl_real slow_power;     /* sum of k |c_k|^2 over this round's slow orders, from which the bend is learned [A^2] */
    cgl_real fast_power;     /* the same sum over the fast orders [A^2] */
    cgl_real drift_limit;    /* the bend is not learned where the square of the load's drift is larger [turns^2/ts^4] */
    cgl_real moved;          /* what the slow orders moved in phase since the bend's last turn, weighted with |c_k|^2 [A^2] */
    cgl_real moved_before;   /* `moved` at the last turn [A^2] */
    cgl_real moved_variance; /* variance of `moved` per step that noise makes [A^4] */
} cgl_harmonic_bend;

typedef struct {
    cgl_harmonic_config config;
    cgl_pi pi;
    cgl_real *cosine;        /* caller's memory: `orders` cosines [A], sines [A], orders, and pairs of gains [A/turn] */
    cgl_real turns;          /* turns in a step per speed, ts / 2 pi [s/rad] */
    cgl_real gain;           /* acceleration per current, b ts^2 [turns/ts^2/A] */
    cgl_real lead;           /* the current acts so much after the angle was measured, half a period included [ts] */
    cgl_real half_step;      /* half a step of the sensor; 0: its steps are unknown [turns] */
    cgl_real lag_share;      /* share of the thrust that a lag keeps in a step; 0: no lag */
    cgl_real tap[3];         /* shares of a command in the thrust of the next three steps, times `gain` [turns/ts^2/A] */
    cgl_real pending[2];     /* thrust that past commands leave for the step after the next, and the one after that [turns/ts^2] */
    cgl_real thrust;         /* acceleration by the feedback's current as it acts [turns/ts^2] */
    cgl_real thrust_most;    /* bound of it, which pi.limit has [turns/ts^2] */
    uint32_t sensor_angle;   /* the angle that the sensor showed last [turns of 2^32] */
    cgl_real since_edge;     /* way since the sensor's last edge, but for a constant; within half a step [turns] */
    uint32_t theta;          /* the observer's angle [turns of 2^32] */
    cgl_real omega;          /* its speed [turns/ts] */
    cgl_real load;           /* its load, z [turns/ts^2] */
    cgl_real load_mean;      /* mean of the load [turns/ts^2] */
    cgl_real load_drift;     /* mean of the load less load_mean: no multiple of the base explains it [turns/ts^2] */
    cgl_real load_before;    /* the load less its mean, in the last step [turns/ts^2] */
    cgl_real mean_share;     /* share of the load that the means take in a step */
    cgl_real time;           /* of learning since the speed was new [s] */
    cgl_real slowest, fastest; /* span of speeds; a speed a quarter beyond it is new [turns/ts] */
    cgl_real rate;           /* present rate of learning [1/s] */
    cgl_real round_angle;    /* what the base order turned in a step when the round of gains began, without sign [rad] */
    cgl_phasor base_half, base_lead;   /* phasors of what the base order turns in half a step, and in `lead` steps */
    cgl_phasor order_half, order_lead; /* the same of the order that is due */
    cgl_harmonic_bend bend;
    uint32_t bends;          /* learned parts of the bend, in pairs */
    uint32_t clock;          /* steps since the bend's turn, which comes even where no bend is learned */
    uint32_t due;            /* index of the order whose gain is renewed next */
    uint32_t band;           /* index in config.held of the first band that ends above the order before that one */
    uint32_t acting;         /* so many of the lowest orders act */
    uint32_t low;            /* so many of the lowest orders are slow, and learn from the load */
    uint32_t wait;           /* steps until it may learn */
    bool observing;          /* the observer follows an angle */
    bool learning;           /* the last step learned */
    cgl_real learned;        /* the learned part of the last step [A] */
} cgl_harmonic;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. It is refused with feed_forward, since the observer needs the feedback's current. `cell` has
 * CGL_HARMONIC_LENGTH(orders) entries, which init clears and the state keeps using. */
cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop, cgl_real *cell,
                            uint32_t length);

/* Takes other gains and limits while the law runs, as cgl_pi_retune. The amplitudes stay, within the limit. Another base or number of
 * orders is refused. */
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
