#include "harmonic.h"

#include "angle.h"
#include "range.h"
#include "sine.h"
#include "turns.h"

#define OBSERVER_POLE CGL_R(0.60653065971263342) /* p = exp(-1/2): the observer keeps so much of a deviation in a step */
#define ANGLE_GAIN (CGL_R(1.0) - OBSERVER_POLE * OBSERVER_POLE * OBSERVER_POLE)
#define SPEED_GAIN (CGL_R(1.5) * (CGL_R(1.0) - OBSERVER_POLE) * (CGL_R(1.0) - OBSERVER_POLE) * (CGL_R(1.0) + OBSERVER_POLE))
#define LOAD_GAIN ((CGL_R(1.0) - OBSERVER_POLE) * (CGL_R(1.0) - OBSERVER_POLE) * (CGL_R(1.0) - OBSERVER_POLE))
#define TURN_MOST CGL_R(0.4999) /* turns: a step moves the angle, the speed and the load by less than half a turn */

#define SLOW_MOST CGL_R(0.5105) /* rad in a step: up to here the load tells more of an order than e, |Z - p|^2 = 2 (1 - p)^2 */
#define TAPS_MOST CGL_R(1.5)    /* steps: a longer delay counts as a lag */
#define DELAY_MOST CGL_R(16.0)  /* steps */
#define MEAN_RATE CGL_R(0.25)   /* of the mean of the load, per rad of the base order */
#define MEAN_SHARE_MOST CGL_R(0.0625) /* the mean takes this share of the load in a step, while it settles and at most */
#define RATES_MOST CGL_R(0.0625) /* per step: bound on the sum of all acting orders' rates; slow orders settle below 0.15 */
#define FULL_TIME CGL_R(6.0)    /* learning runs at the full rate for so long, in units of 1 / rate: exp(-3) of the ripple is left then */
#define SPEED_RATIO CGL_R(1.25) /* a speed is new where it is beyond the span of those before by this factor */
#define HUNTING_RATIO CGL_R(2.0) /* a rotor that is faster than its reference by this factor swings about it, and passes no more periods than so many */
#define BEND_MOST CGL_R(0.05)   /* rad, bound of each part of the bend */
#define BEND_VARIANCE_MOST CGL_R(2.5e-7) /* rad^2, (0.5 mrad)^2: a bend that noise moves by more is not learned */
#define DRIFT_MOST CGL_R(0.02)  /* of the mean |c|^2: a drift of |c|/7 turns the orders by 1/7 rad */
#define NOISE_SHARE CGL_R(0.125) /* a mean keeps twice this share of the load's noise between two turns of the bend */
#define BEND_VARIANCES CGL_R(64.0) /* a bend whose square is less than so many variances is taken for noise */
#define SQUARES_MOST CGL_R(1.0e9) /* sums of squares, and gains, stay finite within this bound */
#define SLOW_PARTS 2U           /* a step teaches one of so many parts of the slow orders */
#define FEW_ORDERS 8U           /* up to so many acting orders, one of four steps renews a gain; beyond, each second step does */
#define BEND_STEPS 8U           /* the bend has its turn in one of so many steps */

CGL_SELDOM const char *cgl_harmonic_bad_field(const cgl_harmonic_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(harmonic, k_theta, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(harmonic, b, CGL_POSITIVE),
                                      CGL_RANGE(harmonic, delay, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(harmonic, step, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(harmonic, base, CGL_COUNT),
                                      CGL_RANGE(harmonic, orders, CGL_COUNT),
                                      CGL_RANGE(harmonic, rate, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(harmonic, rate_min, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(harmonic, limit, CGL_POSITIVE)};
    const char *field = cgl_pi_bad_field(&config->pi, loop);
    field = field != 0 ? field : CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop);
    if (field != 0) {
        return field;
    }
    for (uint32_t n = 0; n < CGL_HARMONIC_EDGES; ++n) {
        if (!cgl_is_not_negative(config->held[n])) {
            return CGL_FIELD("harmonic.held");
        }
    }
    if (config->orders > CGL_HARMONIC_ORDERS) {
        return CGL_FIELD("harmonic.orders");
    }
    if (config->base * config->orders > CGL_HARMONIC_ORDER_MAX) {
        return CGL_FIELD("harmonic.base");
    }
    if (config->bends > 2U) {
        return CGL_FIELD("harmonic.bends");
    }
    if (config->fast > config->orders) {
        return CGL_FIELD("harmonic.fast");
    }
    if (!(config->delay <= DELAY_MOST * loop->ts)) {
        return CGL_FIELD("harmonic.delay");
    }
    return cgl_is_positive(config->b * loop->ts * loop->ts) ? 0 : CGL_FIELD("harmonic.b");
}

/* Shares of a command in the current of the next three steps, for a delay of so many steps. A long delay is a lag of first order,
 * which keeps `lag_share` of its state. */
CGL_SELDOM static void set_delay(cgl_harmonic *law, cgl_real steps)
{
    const bool lags = steps > TAPS_MOST, soon = steps < CGL_R(1.0);
    const cgl_real late = soon ? steps : steps - CGL_R(1.0), gain = law->gain;
    law->lag_share = lags ? steps / (CGL_R(1.0) + steps) : CGL_R(0.0);
    law->tap[0] = gain * (lags ? CGL_R(1.0) - law->lag_share : (soon ? CGL_R(1.0) - late : CGL_R(0.0)));
    law->tap[1] = gain * (lags ? CGL_R(0.0) : (soon ? late : CGL_R(1.0) - late));
    law->tap[2] = gain * (lags || soon ? CGL_R(0.0) : late);
}

/* Takes a config that is valid, and all that follows from it alone. */
CGL_SELDOM static void take(cgl_harmonic *law, const cgl_harmonic_config *config, cgl_real ts)
{
    const uint32_t free_orders = config->base > 4U ? 2U : (config->base > 2U ? 1U : 0U); /* below the base order */
    const cgl_real delay = cgl_clamp(config->delay / ts, DELAY_MOST);
    law->config = *config;
    law->turns = ts * (CGL_R(1.0) / CGL_TWO_PI);
    law->gain = config->b * ts * law->turns;
    law->half_step = cgl_clamp(config->step * (CGL_R(0.5) / CGL_TWO_PI), CGL_R(0.25));
    law->bends = config->bends < free_orders ? config->bends : free_orders;
    law->lead = CGL_R(0.5) + delay;
    law->thrust_most = cgl_clamp(law->gain * config->pi.limit, TURN_MOST);
    set_delay(law, delay);
}

CGL_SELDOM cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, const cgl_loop *loop,
                                       cgl_real *cell, uint32_t length)
{
    law->pi.ready = 0U;
    if (cgl_harmonic_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    if (cgl_check_memory(cell, length, CGL_HARMONIC_LENGTH(config->orders)) != CGL_OK) {
        return CGL_ERROR_MEMORY;
    }
    if (cgl_pi_init(&law->pi, &config->pi, loop) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    take(law, config, loop->ts);
    law->cosine = cell;
    for (uint32_t k = 0; k < config->orders; ++k) {
        cell[2U * config->orders + k] = (cgl_real)(config->base * (k + 1U));
    }
    cgl_harmonic_reset(law);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config)
{
    if (cgl_harmonic_bad_field(config, &law->pi.loop) != 0 || config->base != law->config.base
        || config->orders != law->config.orders) {
        return CGL_ERROR_CONFIG;
    }
    (void)cgl_pi_retune(&law->pi, &config->pi);
    take(law, config, law->pi.loop.ts);
    for (uint32_t n = 0; n < 2U * config->orders; ++n) {
        law->cosine[n] = cgl_clamped(law->cosine[n], config->limit);
    }
    return CGL_OK;
}

CGL_SELDOM static void clear(cgl_real *entry, uint32_t count)
{
    for (uint32_t n = 0; n < count; ++n) {
        entry[n] = CGL_R(0.0);
    }
}

/* The observer's state where it follows an angle [turns of 2^32] from now on; `speed` is in turns in a step. */
CGL_SELDOM static void start_observer(cgl_harmonic *law, uint32_t theta, cgl_real speed)
{
    law->theta = theta;
    law->omega = cgl_clamp(speed, TURN_MOST);
    law->load = law->load_mean = law->load_drift = law->load_before = CGL_R(0.0);
    law->wait = CGL_HARMONIC_SETTLE;
}

CGL_SELDOM static void reset_bend(cgl_harmonic_bend *bend)
{
    clear(bend->part, 4U);
    bend->share = bend->rate = bend->slow_power = bend->fast_power = bend->drift_limit = CGL_R(0.0);
    bend->moved = bend->moved_before = bend->moved_variance = bend->angle = bend->slope = CGL_R(0.0);
}

CGL_SELDOM void cgl_harmonic_reset(cgl_harmonic *law)
{
    const uint32_t orders = law->config.orders;
    const cgl_phasor none = {CGL_R(0.0), CGL_R(0.0)};
    cgl_pi_reset(&law->pi);
    clear(law->cosine, 2U * orders);
    clear(law->cosine + 3U * orders, 2U * orders);
    clear(law->pending, 2U);
    start_observer(law, 0U, CGL_R(0.0));
    reset_bend(&law->bend);
    law->base_half = law->base_lead = law->order_half = law->order_lead = none;
    law->thrust = law->round_angle = law->since_edge = law->learned = CGL_R(0.0);
    law->time = law->slowest = law->fastest = law->rate = CGL_R(0.0);
    law->mean_share = MEAN_SHARE_MOST;
    law->sensor_angle = law->due = law->band = law->acting = law->low = 0U;
    law->clock = 1U; /* the first step has enough to do without a gain */
    law->observing = law->learning = false;
}

/* The angle [turns] within the step that the sensor shows. A speed that is timed from edge to edge adds up to exactly the way from
 * edge to edge. So its sum less the way that the sensor shows is the way since the last edge, but for a constant. */
static uint32_t angle_within_step(cgl_harmonic *law, uint32_t shown, cgl_real omega_m)
{
    const cgl_real way = cgl_steps(law->sensor_angle, shown) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->since_edge = cgl_clamp(law->since_edge + omega_m * law->turns - way, law->half_step);
    law->sensor_angle = shown;
    return shown + (uint32_t)(int32_t)(law->since_edge * CGL_TURN_BITS); /* |since_edge| <= 1/4 */
}

/* One step of the observer, which predicts the angle and corrects all that it holds by the error e. Returns e [turns]. */
static cgl_real observe(cgl_harmonic *law, uint32_t theta)
{
    const cgl_real rise = law->thrust + law->load, way = law->omega + CGL_R(0.5) * rise; /* |way| < 1, as all three are bounded */
    const uint32_t predicted = law->theta + ((uint32_t)(int32_t)(way * (CGL_R(0.5) * CGL_TURN_BITS)) << 1U);
    const cgl_real error = cgl_steps(predicted, theta) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->theta = predicted + (uint32_t)(int32_t)(ANGLE_GAIN * error * CGL_TURN_BITS); /* |error| <= 1/2 */
    law->omega = cgl_clamp(law->omega + rise + SPEED_GAIN * error, TURN_MOST);
    law->load = cgl_clamp(law->load + LOAD_GAIN * error, TURN_MOST);
    return error;
}

/* Tells the observer what the feedback commands, u [A], which accelerates the rotor from the next step on. */
static void command(cgl_harmonic *law, cgl_real u)
{
    law->thrust = cgl_clamp(law->lag_share * law->thrust + law->tap[0] * u + law->pending[0], law->thrust_most);
    law->pending[0] = law->tap[1] * u + law->pending[1];
    law->pending[1] = law->tap[2] * u;
}

/* The sum of the load in the last two steps, less its mean [turns]. */
static cgl_real two_loads(cgl_harmonic *law)
{
    law->load_mean += law->mean_share * (law->load - law->load_mean);
    const cgl_real load = law->load - law->load_mean, sum = load + law->load_before;
    law->load_drift += law->mean_share * (load - law->load_drift);
    law->load_before = load;
    return sum;
}

static uint32_t smaller(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static uint32_t larger(uint32_t a, uint32_t b)
{
    return a > b ? a : b;
}

static cgl_real lesser(cgl_real a, cgl_real b)
{
    return a < b ? a : b;
}

/* How many multiples of an angle [rad] are within `most` [rad], at most `orders`. */
static uint32_t multiples_within(cgl_real most, cgl_real angle, uint32_t orders)
{
    if (angle < CGL_R(0.003)) {
        return orders; /* CGL_HARMONIC_ORDERS of them are within SLOW_MOST */
    }
    const cgl_real count = most / angle;
    return smaller((uint32_t)(int32_t)count, orders);
}

/* Sets the rate at which the next round learns the bend, and the share of the bend that acts. The noise of the orders gives the bend
 * a variance. Where fast orders have most of the ripple, the slow ones show too little of the bend. `begun` is the time of learning,
 * times its full rate. */
CGL_APART static void judge_bend(cgl_harmonic *law, cgl_real begun)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real *const part = bend->part;
    const cgl_real size = cgl_clamp((cgl_real)law->config.base * bend->slow_power, SQUARES_MOST);
    const cgl_real scale = law->rate * law->pi.loop.ts * size * size, variance = CGL_R(2.0) * bend->moved_variance;
    const cgl_real mean = bend->slow_power / (cgl_real)larger(law->low, 1U); /* at least the mean |c|^2, as k >= 1 weighs it */
    bend->drift_limit = DRIFT_MOST * cgl_clamp(mean, SQUARES_MOST) * law->gain * law->gain;
    bend->rate = CGL_R(0.0);
    const bool shows = size > CGL_R(1.0e-9) && bend->slow_power > bend->fast_power;
    if (begun > CGL_R(0.5) * FULL_TIME && shows && variance < BEND_VARIANCE_MOST * scale) {
        const cgl_real square = part[0] * part[0] + part[1] * part[1] + part[2] * part[2] + part[3] * part[3];
        const cgl_real noise = BEND_VARIANCES * variance, sum = square * scale;
        bend->rate = CGL_R(2.0) / size;
        bend->share = sum > noise ? CGL_R(1.0) - noise / sum : CGL_R(0.0);
    }
    bend->slow_power = bend->fast_power = CGL_R(0.0);
}

/* Moves the bend where the phases of all orders moved together since its last turn. `x`, `y`: cosine and sine of once and twice the
 * measured angle. What differs from one turn to the next is noise; what the bend itself moves is nearly the same in both. */
static void learn_bend(cgl_harmonic *law, const cgl_real *x, const cgl_real *y)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real moved = cgl_clamp(bend->moved, SQUARES_MOST), way = bend->rate * moved, change = moved - bend->moved_before;
    const cgl_real share = lesser(law->rate * law->pi.loop.ts, CGL_R(1.0) / (cgl_real)BEND_STEPS); /* a larger one makes no mean */
    bend->moved_variance += share * (NOISE_SHARE * change * change - (cgl_real)BEND_STEPS * bend->moved_variance);
    bend->moved_before = moved;
    for (uint32_t m = 0; m < law->bends; ++m) {
        bend->part[2U * m] = cgl_clamp(bend->part[2U * m] + way * x[m], BEND_MOST);
        bend->part[2U * m + 1U] = cgl_clamp(bend->part[2U * m + 1U] + way * y[m], BEND_MOST);
    }
}

/* The bend's turn, at the measured angle [turns]: it is learned, and its value and slope are computed anew. */
CGL_APART static void turn_bend(cgl_harmonic *law, uint32_t theta)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real *const part = bend->part;
    const cgl_phasor once = cgl_phasor_of(theta), twice = cgl_product(once, once);
    const cgl_real x[2] = {once.cosine, twice.cosine}, y[2] = {once.sine, twice.sine};
    if (law->learning && law->load_drift * law->load_drift < bend->drift_limit) {
        learn_bend(law, x, y);
    }
    bend->moved = CGL_R(0.0);
    bend->slope = bend->share * (part[1] * x[0] - part[0] * y[0] + CGL_R(2.0) * (part[3] * x[1] - part[2] * y[1]));
    const cgl_real angle = part[0] * x[0] + part[1] * y[0] + part[2] * x[1] + part[3] * y[1];
    bend->angle = bend->share * angle * (CGL_R(1.0) / CGL_TWO_PI);
}

/* Begins the time of learning anew where the speed is a new one [turns in a step]. */
static void watch_speed(cgl_harmonic *law, cgl_real speed)
{
    if (speed > SPEED_RATIO * law->fastest || SPEED_RATIO * speed < law->slowest) {
        law->slowest = law->fastest <= CGL_R(0.0) || speed < law->slowest ? speed : law->slowest;
        law->fastest = speed > law->fastest ? speed : law->fastest;
        law->time = CGL_R(0.0);
    }
}

/* Chooses the orders that act and the slow ones among them, where the base order turns by an angle in a step [rad]. */
static void choose_orders(cgl_harmonic *law, cgl_real angle)
{
    const cgl_harmonic_config *const config = &law->config;
    cgl_real *const weight = law->cosine + 3U * config->orders;
    const uint32_t low = multiples_within(SLOW_MOST, angle, config->orders);
    for (uint32_t n = 2U * smaller(low, law->low); n < 2U * larger(low, law->low); ++n) {
        weight[n] = CGL_R(0.0); /* these orders learn from the other signal now */
    }
    law->low = low;
    law->acting = larger(low, multiples_within(CGL_HARMONIC_FASTEST, angle, config->fast));
}

/* The rate of learning [1/s]: full for FULL_TIME, then that of a mean since, but not below rate_min. `shared` bounds it for all acting
 * orders together. `begun` is the time of learning, times the full rate. */
static cgl_real mean_rate(const cgl_harmonic_config *config, cgl_real full, cgl_real shared, cgl_real begun)
{
    const cgl_real after = begun - FULL_TIME;
    const cgl_real mean = after > CGL_R(0.0) ? full / (CGL_R(1.0) + CGL_R(0.5) * after) : full;
    return mean > config->rate_min ? mean : lesser(config->rate_min, shared);
}

/* Begins a round, in which each order's gain is renewed once: it takes the present speed, the orders that act at it, and the rate.
 * `speed_ref` is |omega_ref| [rad/s]. */
CGL_APART static void begin_round(cgl_harmonic *law, uint32_t gentle, cgl_real speed_ref)
{
    const cgl_harmonic_config *const config = &law->config;
    const cgl_real ts = law->pi.loop.ts;
    const cgl_real turned = CGL_TWO_PI * (cgl_real)config->base * law->omega, angle = cgl_abs(turned);
    watch_speed(law, cgl_abs(law->omega));
    choose_orders(law, angle);
    const cgl_real shared = RATES_MOST / ((cgl_real)larger(law->acting, 1U) * ts), full = lesser(config->rate, shared);
    const cgl_real begun = full * law->time;
    const cgl_real periods = lesser(HUNTING_RATIO * (cgl_real)config->base * ts * speed_ref, angle);
    const cgl_real most = periods / (CGL_PI * ts); /* it leaves exp(-1) of an order after a period of the base order */
    const cgl_real rate = lesser(mean_rate(config, full, shared, begun), most);
    law->rate = cgl_gentle_gain(gentle, config->rate, config->rate) * rate;
    judge_bend(law, begun);
    const cgl_real sampled = angle <= CGL_HARMONIC_FASTEST ? turned : CGL_R(0.0);
    law->base_half = law->order_half = cgl_phasor_of(cgl_turns(CGL_R(0.5) * sampled));
    law->base_lead = law->order_lead = cgl_phasor_of(cgl_turns(sampled * law->lead));
    law->round_angle = angle;
    law->due = law->band = 0U;
}

/* Whether an order is held, that is acts and is not learned, at a frequency [rad in a step]. In a round the frequencies rise. */
static bool is_held(cgl_harmonic *law, cgl_real frequency)
{
    const cgl_real *const held = law->config.held;
    while (law->band < CGL_HARMONIC_EDGES && frequency > held[law->band + 1U]) {
        law->band += 2U;
    }
    return law->band < CGL_HARMONIC_EDGES && frequency >= held[law->band];
}

/* Renews the gain of the order that is due, or begins a round. With D = (Z - p) exp(-j Om/2), 1/G is D^3 exp(-j Om/2) / (cos(Om/2)
 * l3) for z, and D^3 / (j sin Om) for e; two z sum to 2 cos(Om/2) exp(-j Om/2) of one. The phasor that the gain meets is ahead by
 * Om (1/2 + delay). `pause` is the number of steps since the last gain. */
CGL_APART static void renew_gain(cgl_harmonic *law, uint32_t pause, uint32_t gentle, cgl_real speed_ref)
{
    const uint32_t k = law->due, orders = law->config.orders;
    const cgl_real ts = law->pi.loop.ts;
    const cgl_real quick = (CGL_TWO_PI * MEAN_RATE) * (cgl_real)law->config.base * cgl_abs(law->omega);
    law->mean_share = law->learning ? lesser(quick, MEAN_SHARE_MOST) : MEAN_SHARE_MOST;
    law->time += law->learning && law->time < CGL_R(1.0e6) ? (cgl_real)pause * ts : CGL_R(0.0);
    if (k >= law->acting) {
        begin_round(law, gentle, speed_ref);
        return;
    }
    const bool held = is_held(law, (cgl_real)(k + 1U) * law->round_angle);
    const cgl_real c = law->order_half.cosine, s = law->order_half.sine;
    const cgl_phasor d = {(CGL_R(1.0) - OBSERVER_POLE) * c, (CGL_R(1.0) + OBSERVER_POLE) * s};
    cgl_phasor w = cgl_product(cgl_product(cgl_product(d, d), d), law->order_lead);
    cgl_real scale = (held ? CGL_R(0.0) : law->rate) * ts / law->gain;
    const cgl_real a = law->cosine[k], b = law->cosine[orders + k], power = (cgl_real)(k + 1U) * (a * a + b * b);
    if (k < law->low) {
        const cgl_real lost = (law->omega < CGL_R(0.0) ? MEAN_RATE : -MEAN_RATE) / (cgl_real)(k + 1U); /* the mean takes it away */
        const cgl_phasor without_mean = {CGL_R(1.0), lost};
        w = cgl_product(w, without_mean);
        scale /= LOAD_GAIN * c * c;
        law->bend.slow_power += held ? CGL_R(0.0) : power;
    } else {
        const cgl_phasor back = {w.sine, -w.cosine}; /* times -j */
        w = back;
        scale /= CGL_R(2.0) * s * c;
        law->bend.fast_power += power;
    }
    cgl_real *const weight = law->cosine + 3U * orders + 2U * k;
    weight[0] = cgl_clamp(scale * w.cosine, SQUARES_MOST);
    weight[1] = cgl_clamp(scale * w.sine, SQUARES_MOST);
    law->order_half = cgl_product(law->order_half, law->base_half);
    law->order_lead = cgl_product(law->order_lead, law->base_lead);
    law->due = k + 1U;
}

/* The sum of all acting orders at the angle [turns] where it will act [A], after the loads [turns] have taught one part of the slow
 * orders, and the observer's error [turns] all fast ones. The phasors begin anew from the angle in each step, so no error adds up
 * over time. */
CGL_APART static cgl_real sum_of_orders(cgl_harmonic *law, uint32_t angle, cgl_real loads, cgl_real error)
{
    const uint32_t orders = law->config.orders, low = law->low, turn = law->clock % SLOW_PARTS;
    const cgl_real limit = law->config.limit;
    cgl_real *const a = law->cosine, *const b = a + orders;
    const cgl_real *const w = b + 2U * orders;
    cgl_real sum = CGL_R(0.0), moved = CGL_R(0.0), seen = loads;
    cgl_phasor first;
    cgl_sincos_of_turns(law->config.base * angle, &first.sine, &first.cosine);
    cgl_phasor at = first;
    uint32_t k = 0U, begin = low * turn / SLOW_PARTS, end = low * (turn + 1U) / SLOW_PARTS;
    for (uint32_t part = 0U; part < 2U; ++part) {
        for (; k < begin; ++k) {
            sum += a[k] * at.cosine + b[k] * at.sine;
            at = cgl_product(at, first);
        }
        for (; k < end; ++k) {
            const cgl_real p = seen * w[2U * k], q = seen * w[2U * k + 1U];
            const cgl_real less = p * at.cosine + q * at.sine, more = q * at.cosine - p * at.sine;
            moved += a[k] * more + b[k] * less;
            const cgl_real cosine = cgl_clamp_here(a[k] - less, limit), sine = cgl_clamp_here(b[k] + more, limit);
            a[k] = cosine;
            b[k] = sine;
            sum += cosine * at.cosine + sine * at.sine;
            at = cgl_product(at, first);
        }
        if (part == 0U) {
            law->bend.moved += moved;
        }
        if (k >= law->acting) {
            break;
        }
        begin = low;
        end = law->acting;
        seen = error;
    }
    return cgl_clamp(sum, limit);
}

/* Whether the inputs of a step that has an angle can be true. */
static bool is_plausible(const cgl_harmonic *law, const cgl_law_input *in, cgl_real error)
{
    const bool has_reference = !(law->config.k_theta > CGL_R(0.0)) || cgl_is_angle(in->theta_ref);
    return cgl_is_finite(error) && has_reference;
}

/* The output of a step that is at its limit, has an input that is not plausible, or does not learn. */
CGL_SELDOM static void step_otherwise(cgl_harmonic *law, const cgl_law_input *in, cgl_real error, cgl_law_output *out)
{
    if (cgl_law_stands_by(in)) {
        cgl_pi_start(&law->pi, cgl_law_stand_by(in, law->learned, law->pi.config.limit, out));
        return;
    }
    out->i_q_ref = cgl_pi_step(&law->pi, error, law->learned);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U)
                  | (law->learning ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (cgl_is_angle(in->theta_m) && is_plausible(law, in, error) ? 0U : (unsigned)CGL_STATUS_FAULT);
}

/* Clears what is learned, as the guard says. */
CGL_SELDOM static void forget(cgl_harmonic *law)
{
    clear(law->cosine, 2U * law->config.orders);
    clear(law->bend.part, 4U);
    law->time = CGL_R(0.0);
}

/* The speed that the position's feedback adds to the error: k_theta times the short way from the angle [turns], which is bent, to its
 * reference [rad/s]. Without a reference it is 0. */
CGL_SELDOM static cgl_real position_feedback(const cgl_harmonic *law, const cgl_law_input *in, uint32_t theta)
{
    if (!cgl_is_angle(in->theta_ref)) {
        return CGL_R(0.0);
    }
    const cgl_real way = cgl_steps(theta, cgl_turns(in->theta_ref)) * (CGL_R(1.0) / CGL_TURN_BITS) + law->bend.angle;
    return law->config.k_theta * CGL_TWO_PI * way;
}

/* Sets whether this step learns. It waits for CGL_HARMONIC_SETTLE steps after any in which it may not. */
CGL_SELDOM static void settle(cgl_harmonic *law, bool may_learn)
{
    law->learning = may_learn && law->wait == 0U;
    law->wait = may_learn ? law->wait - (law->wait > 0U ? 1U : 0U) : CGL_HARMONIC_SETTLE;
}

/* Follows the measured angle [turns] by one step and returns the learned current [A]. */
static cgl_real follow(cgl_harmonic *law, const cgl_law_input *in, uint32_t theta)
{
    if (!CGL_OFTEN(law->observing)) {
        start_observer(law, theta, in->omega_m * law->turns);
        law->observing = true;
    }
    const cgl_real error = observe(law, theta), loads = two_loads(law);
    const bool many = law->acting > FEW_ORDERS;
    if ((law->clock & 1U) == 1U && (many || (law->clock & 2U) == 0U)) {
        renew_gain(law, many ? 2U : 4U, in->gentle, cgl_abs(in->omega_ref));
    }
    if (in->off) {
        return CGL_R(0.0);
    }
    const uint32_t acts_at = cgl_turned(theta, law->omega * law->lead - law->bend.angle);
    const bool learns = CGL_OFTEN(law->learning);
    const cgl_real sum = sum_of_orders(law, acts_at, learns ? loads : CGL_R(0.0), learns ? error : CGL_R(0.0));
    return in->muted > CGL_R(0.0) ? cgl_law_share(in) * sum : sum;
}

/* The bend goes on by its slope, and has its turn in one of BEND_STEPS steps. */
static void advance_bend(cgl_harmonic *law, uint32_t theta)
{
    law->clock = (law->clock + 1U) % BEND_STEPS;
    law->bend.angle += law->bend.slope * law->omega;
    if (law->clock == 0U && law->bends > 0U) {
        turn_bend(law, theta);
    }
}

/* A step without an angle. */
CGL_SELDOM static void step_blind(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    settle(law, false);
    law->observing = false;
    law->learned = law->bend.angle = law->bend.slope = CGL_R(0.0);
    law->clock = BEND_STEPS - 1U; /* the bend has its turn at the first angle that comes */
    step_otherwise(law, in, in->omega_ref - in->omega_m, out);
}

void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (in->forget && !cgl_law_stands_by(in)) {
        forget(law);
    }
    if (CGL_OFTEN(cgl_is_angle(in->theta_m))) {
        const uint32_t shown = cgl_turns(in->theta_m);
        const uint32_t theta = law->half_step > CGL_R(0.0) ? angle_within_step(law, shown, in->omega_m) : shown;
        advance_bend(law, theta);
        cgl_real error = in->omega_ref - in->omega_m + law->bend.slope * in->omega_m;
        bool has_reference = cgl_abs(in->omega_ref) > CGL_R(0.0); /* at rest nothing is learned */
        if (law->config.k_theta > CGL_R(0.0)) {
            error += position_feedback(law, in, theta);
            has_reference = has_reference && cgl_is_angle(in->theta_ref);
        }
        const bool may_learn = in->learn && law->config.rate > CGL_R(0.0) && has_reference && cgl_is_finite(error)
                               && !cgl_law_stands_by(in) && !law->pi.saturated;
        if (!CGL_OFTEN(may_learn && law->learning)) {
            settle(law, may_learn);
        }
        law->learned = follow(law, in, theta);
        if (law->learning && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
            out->status = 0U;
        } else {
            step_otherwise(law, in, error, out);
        }
    } else {
        step_blind(law, in, out);
    }
    command(law, in->off ? CGL_R(0.0) : out->i_q_ref - law->learned);
}
