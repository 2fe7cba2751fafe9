#include "harmonic.h"

#include "angle.h"
#include "harmonic_parts.h"
#include "range.h"
#include "sine.h"
#include "turns.h"

#define POLE CGL_R(0.60653065971263342) /* p = exp(-1/2): share of the observer's error that is left after a step */
#define GAIN_1 (CGL_R(1.0) - POLE * POLE * POLE)
#define GAIN_2 (CGL_R(1.5) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) + POLE))
#define GAIN_3 ((CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE))

/* Largest angle by which a slow order turns in a step [rad]. harmonic.h defines slow and fast orders, orders that act, bend and round.
 * At this angle z and e show the order equally: |Z - p|^2 = 2 (1 - p)^2, Z = exp(j angle). */
#define SLOW_ANGLE_MOST CGL_R(0.5105)
#define LAG_DELAY CGL_R(1.5)   /* delay above which the model is a first-order lag [steps] */
#define DELAY_MOST CGL_R(16.0) /* largest delay that init takes [steps] */
#define HALF_TURN CGL_R(0.5)   /* bound of the observer's speed [turns/ts], and of z [turns/ts^2] */

#define MEAN_SHARE_PER_RAD CGL_R(0.25)  /* weight of z in its moving mean, divided by the angle by which the base order turns in a
                                           step [1/rad] */
#define MEAN_SHARE_MOST CGL_R(0.0625)   /* largest weight of z in its moving mean; while nothing is learned, this is the weight */
#define RATE_SUM_MOST CGL_R(0.0625)     /* bound of the sum of the acting orders' rates [1/step]; slow orders settle if the sum is below
                                           0.15 */
#define FULL_RATE_LENGTH CGL_R(6.0)     /* product of full rate and learning time at which the rate begins to fall; exp(-3) of the ripple
                                           is left at that time */
#define NEW_SPEED_FACTOR CGL_R(1.25)    /* a speed is new if it is above or below all earlier speeds by this factor */
/* The bound of the rate grows with the rotor's speed, up to this multiple of the reference speed. A rotor that hunts swings about its
 * reference, and so turns faster than the reference at times. */
#define HUNTING_FACTOR CGL_R(2.0)

#define BEND_MOST CGL_R(0.05)            /* bound of each coefficient of the bend [rad] */
#define BEND_VARIANCE_MOST CGL_R(2.5e-7) /* variance of the bend above which the bend is not learned [rad^2]: (0.5 mrad)^2 */
/* The bend is learned while the square of the drift is below this share of the mean of k |c_k|^2. 0.02 is the square of 1/7: a drift of
 * |c|/7 turns the phase of an order by 1/7 rad. */
#define BEND_DRIFT_SHARE CGL_R(0.02)
/* A mean over BEND_PERIOD steps keeps a quarter of the variance of z's noise. This constant is half of that quarter, because the difference
 * of two sums has twice the variance of one sum. */
#define BEND_NOISE_SHARE CGL_R(0.125)
#define BEND_DOUBT_FACTOR CGL_R(64.0) /* the bend is not used while the sum of its squared coefficients is below this times its variance */
#define BEND_PERIOD 8U                /* steps from one update of the bend to the next */

#define SLOW_SHARES 2U /* the slow orders form this many groups; each step corrects one group */
#define FEW_ORDERS 8U  /* up to this many acting orders, a gain is computed every fourth step; with more orders, every second */

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

/* Stores a valid config and the values that follow from it. */
CGL_SELDOM static void apply_config(cgl_harmonic *law, const cgl_harmonic_config *config, cgl_real ts)
{
    law->config = *config;
    law->gain = config->b * ts * ts * (CGL_R(1.0) / CGL_TWO_PI);
    law->half_step = cgl_clamp(config->step * (CGL_R(0.5) / CGL_TWO_PI), CGL_R(0.25));
    const cgl_real d = cgl_clamp(config->delay / ts, DELAY_MOST);
    law->lead = CGL_R(0.5) + d;
    const cgl_real part = d < CGL_R(1.0) ? d : d - CGL_R(1.0);
    const bool lags = d > LAG_DELAY;
    law->lag_share = lags ? d / (CGL_R(1.0) + d) : CGL_R(0.0);
    /* number of the bend's orders that are far enough below the lowest learned order */
    const uint32_t free = config->base > 4U ? 2U : (config->base > 2U ? 1U : 0U);
    law->bends = config->bends < free ? config->bends : free;
    law->weight[0] = lags ? CGL_R(1.0) - law->lag_share : (d < CGL_R(1.0) ? CGL_R(1.0) - part : CGL_R(0.0));
    law->weight[1] = lags ? CGL_R(0.0) : (d < CGL_R(1.0) ? part : CGL_R(1.0) - part);
    law->weight[2] = lags || d < CGL_R(1.0) ? CGL_R(0.0) : part;
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
    apply_config(law, config, loop->ts);
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
    apply_config(law, config, law->pi.loop.ts);
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

CGL_SELDOM void cgl_harmonic_reset(cgl_harmonic *law)
{
    const uint32_t orders = law->config.orders;
    cgl_pi_reset(&law->pi);
    clear(law->cosine, 2U * orders);
    clear(law->cosine + 3U * orders, 2U * orders);
    clear(law->pending, 2U);
    law->last_load = CGL_R(0.0);
    const cgl_phasor none = {CGL_R(0.0), CGL_R(0.0)};
    law->base = law->half = law->delayed = law->turned = none;
    clear(law->bend.part, 4U);
    law->bend.share = law->bend.rate = law->bend.slow_power = law->bend.fast_power = law->bend.variance = CGL_R(0.0);
    law->bend.drift_most = law->bend.phase_sum = law->bend.last_phase_sum = law->bend.angle = law->bend.slope = law->step = CGL_R(0.0);
    law->share = MEAN_SHARE_MOST;
    law->current = law->omega = law->load = law->mean = law->drift = CGL_R(0.0);
    law->time = law->slowest = law->fastest = law->rate = CGL_R(0.0);
    law->since_edge = CGL_R(0.0);
    law->theta_sensor = law->theta = law->next_gain = law->band = law->acting = law->low = 0U;
    law->tick = 1U; /* so the first step computes no gain, and stays short */
    law->wait = CGL_HARMONIC_SETTLE;
    law->follows = law->learning = false;
    law->learned = CGL_R(0.0);
}

/* Returns the measured angle [2^-32 turns], refined between two edges of the sensor. omega_m is measured from edge to edge, so the sum of
 * omega_m over time is exact at each edge. This sum minus the sensor's angle is the angle since the last edge, apart from a constant. */
static uint32_t refine_angle(cgl_harmonic *law, uint32_t shown, cgl_real omega_m)
{
    const cgl_real turned = cgl_steps(law->theta_sensor, shown) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->since_edge = cgl_clamp(law->since_edge + omega_m * law->pi.loop.ts * (CGL_R(1.0) / CGL_TWO_PI) - turned, law->half_step);
    law->theta_sensor = shown;
    return cgl_turned(shown, law->since_edge);
}

/* Starts the observer at the measured angle theta [2^-32 turns] and speed omega [rad/s]. */
CGL_SELDOM static void start_observer(cgl_harmonic *law, uint32_t theta, cgl_real omega)
{
    law->theta = theta;
    law->omega = cgl_clamp(omega * law->pi.loop.ts * (CGL_R(1.0) / CGL_TWO_PI), HALF_TURN);
    law->load = law->mean = law->drift = CGL_R(0.0);
    law->last_load = CGL_R(0.0);
    law->wait = CGL_HARMONIC_SETTLE;
    law->follows = true;
}

/* Steps the observer. Returns its error e, the measured angle less the predicted one [turns]. */
static cgl_real observe(cgl_harmonic *law, uint32_t theta)
{
    const cgl_real rise = law->gain * law->current + law->load;
    const uint32_t ahead = cgl_turned(law->theta, law->omega + CGL_R(0.5) * rise);
    const cgl_real error = cgl_steps(ahead, theta) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->theta = ahead + (uint32_t)(int32_t)(GAIN_1 * error * CGL_TURN_BITS); /* |error| <= 1/2 */
    law->omega = cgl_clamp(law->omega + rise + GAIN_2 * error, HALF_TURN);
    law->load = cgl_clamp(law->load + GAIN_3 * error, HALF_TURN);
    return error;
}

/* Models the delay of the feedback's current u [A]. Sets `current`, which flows in the next step. */
static void set_current(cgl_harmonic *law, cgl_real u)
{
    law->current = cgl_clamp(law->lag_share * law->current + law->weight[0] * u + law->pending[0], law->pi.config.limit);
    law->pending[0] = law->weight[1] * u + law->pending[1];
    law->pending[1] = law->weight[2] * u;
}

/* Returns the sum of (z - mean of z) over the last two steps [turns/ts^2], and updates the moving mean. */
static cgl_real two_loads(cgl_harmonic *law)
{
    law->mean += law->share * (law->load - law->mean);
    const cgl_real now = law->load - law->mean, sum = now + law->last_load;
    law->drift += law->share * (now - law->drift);
    law->last_load = now;
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

/* Returns how many of `orders` orders turn by at most `most` [rad] in a step, if the base order turns by `step` [rad]. */
static uint32_t fitting(cgl_real most, cgl_real step, uint32_t orders)
{
    if (step < CGL_R(0.003)) {
        return orders; /* All orders fit: in such a small step even the highest turns by less than `most`. */
    }
    const cgl_real count = most / step;
    return smaller((uint32_t)(int32_t)count, orders);
}

/* Sets the rate at which the next round learns the bend, and the share of the bend that is used. Both depend on the bend's variance, which
 * comes from the noise of the orders. The bend is learned from the slow orders only, and not while the fast orders have most of the ripple.
 * `begun`: learning time of the orders times their full rate. */
CGL_APART static void set_bend_rate(cgl_harmonic *law, cgl_real begun)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real *const part = bend->part;
    const cgl_real size = cgl_clamp((cgl_real)law->config.base * bend->slow_power, CGL_R(1.0e9));
    const cgl_real scale = law->rate * law->pi.loop.ts * size * size, variance = CGL_R(2.0) * bend->variance;
    const cgl_real mean = bend->slow_power / (cgl_real)larger(law->low, 1U); /* mean of k |c_k|^2 over the slow orders */
    bend->drift_most = BEND_DRIFT_SHARE * cgl_clamp(mean, CGL_R(1.0e9)) * law->gain * law->gain;
    bend->rate = CGL_R(0.0);
    const bool shows = size > CGL_R(1.0e-9) && bend->slow_power > bend->fast_power;
    if (begun > CGL_R(0.5) * FULL_RATE_LENGTH && shows && variance < BEND_VARIANCE_MOST * scale) {
        const cgl_real square = part[0] * part[0] + part[1] * part[1] + part[2] * part[2] + part[3] * part[3];
        const cgl_real noise = BEND_DOUBT_FACTOR * variance, sum = square * scale;
        bend->rate = CGL_R(2.0) / size;
        bend->share = sum > noise ? CGL_R(1.0) - noise / sum : CGL_R(0.0);
    }
    bend->slow_power = bend->fast_power = CGL_R(0.0);
}

/* Updates the bend, the learned error of the angle, at the measured angle theta [2^-32 turns]. The bend changes by the phase that all
 * orders have gained in common since the last update. */
CGL_APART static void update_bend(cgl_harmonic *law, uint32_t theta)
{
    cgl_harmonic_bend *const bend = &law->bend;
    cgl_real *const part = bend->part;
    const cgl_phasor once = cgl_phasor_of(theta), twice = cgl_product(once, once);
    const cgl_real x[2] = {once.cosine, twice.cosine}, y[2] = {once.sine, twice.sine};
    if (law->learning && law->drift * law->drift < bend->drift_most) {
        const cgl_real moved = cgl_clamp(bend->phase_sum, CGL_R(1.0e9)), step = bend->rate * moved;
        const cgl_real rate = law->rate * law->pi.loop.ts, most = CGL_R(1.0) / (cgl_real)BEND_PERIOD; /* with a larger rate the variance
                                                                                                         would not be a mean */
        const cgl_real change = moved - bend->last_phase_sum; /* only noise: an error of the angle makes two successive sums nearly alike */
        bend->variance += (rate < most ? rate : most) * (BEND_NOISE_SHARE * change * change - (cgl_real)BEND_PERIOD * bend->variance);
        bend->last_phase_sum = moved;
        for (uint32_t m = 0; m < law->bends; ++m) {
            part[2U * m] = cgl_clamp(part[2U * m] + step * x[m], BEND_MOST);
            part[2U * m + 1U] = cgl_clamp(part[2U * m + 1U] + step * y[m], BEND_MOST);
        }
    }
    bend->phase_sum = CGL_R(0.0);
    bend->slope = bend->share * (part[1] * x[0] - part[0] * y[0] + CGL_R(2.0) * (part[3] * x[1] - part[2] * y[1]));
    const cgl_real value = part[0] * x[0] + part[1] * y[0] + part[2] * x[1] + part[3] * y[1];
    bend->angle = bend->share * value * (CGL_R(1.0) / CGL_TWO_PI);
}

/* Begins a round, which computes the gain of each order for the present speed. Decides which orders act, and how fast they learn.
 * `speed_ref`: |omega_ref| [rad/s]. */
CGL_APART static void begin_round(cgl_harmonic *law, uint32_t gentle, cgl_real speed_ref)
{
    const cgl_harmonic_config *const config = &law->config;
    const cgl_real speed = cgl_abs(law->omega), step = CGL_TWO_PI * (cgl_real)config->base * law->omega;
    const cgl_real size = cgl_abs(step);
    if (speed > NEW_SPEED_FACTOR * law->fastest || NEW_SPEED_FACTOR * speed < law->slowest) {
        law->slowest = law->fastest <= CGL_R(0.0) || speed < law->slowest ? speed : law->slowest;
        law->fastest = speed > law->fastest ? speed : law->fastest;
        law->time = CGL_R(0.0);
    }
    const uint32_t low = fitting(SLOW_ANGLE_MOST, size, config->orders);
    const uint32_t acting = larger(low, fitting(CGL_HARMONIC_FASTEST, size, config->fast));
    cgl_real *const weight = law->cosine + 3U * config->orders;
    for (uint32_t n = 2U * smaller(low, law->low); n < 2U * larger(low, law->low); ++n) {
        weight[n] = CGL_R(0.0); /* these orders change from slow to fast or back, and a gain for z does not fit e */
    }
    law->acting = acting;
    law->low = low;
    const cgl_real shared = RATE_SUM_MOST / ((cgl_real)larger(acting, 1U) * law->pi.loop.ts), full = lesser(config->rate, shared);
    const cgl_real begun = full * law->time, after = begun - FULL_RATE_LENGTH; /* the rate falls from FULL_RATE_LENGTH on */
    const cgl_real mean = after > CGL_R(0.0) ? full / (CGL_R(1.0) + CGL_R(0.5) * after) : full;
    const cgl_real rate = mean > config->rate_min ? mean : lesser(config->rate_min, shared);
    const cgl_real asked = HUNTING_FACTOR * (cgl_real)config->base * law->pi.loop.ts * speed_ref;
    /* at the rate `most`, exp(-1) of an order's ripple is left after one period of the base order */
    const cgl_real most = lesser(asked, size) / (CGL_PI * law->pi.loop.ts);
    law->rate = cgl_gentle_gain(gentle, config->rate, config->rate) * lesser(rate, most);
    const cgl_real angle = size <= CGL_HARMONIC_FASTEST ? step : CGL_R(0.0);
    cgl_sincos(CGL_R(0.5) * angle, &law->half.sine, &law->half.cosine);
    cgl_sincos(angle * law->lead, &law->base.sine, &law->base.cosine);
    set_bend_rate(law, begun);
    law->turned = law->half;
    law->delayed = law->base;
    law->step = size;
    law->next_gain = law->band = 0U;
}

/* Computes the gain of the order `next_gain`, or begins the next round. With Z = exp(j Om) and D = (Z - p) exp(-j Om/2):
 *
 *   1/G = D^3 exp(-j Om/2) / (cos(Om/2) GAIN_3)   for z
 *   1/G = D^3 / (j sin Om)                        for e
 *
 * The sum of two successive z is 2 cos(Om/2) exp(-j Om/2) times one z. The phasor of an order is computed for the time at which its current
 * flows. So the gain has the further factor exp(j Om (1/2 + delay)). */
CGL_APART static void make_gain(cgl_harmonic *law, uint32_t pause, uint32_t gentle, cgl_real speed_ref)
{
    const uint32_t k = law->next_gain, orders = law->config.orders;
    const cgl_real slow = (CGL_TWO_PI * MEAN_SHARE_PER_RAD) * (cgl_real)law->config.base * cgl_abs(law->omega);
    law->share = law->learning && slow < MEAN_SHARE_MOST ? slow : MEAN_SHARE_MOST;
    law->time += law->learning && law->time < CGL_R(1.0e6) ? (cgl_real)pause * law->pi.loop.ts : CGL_R(0.0);
    if (k >= law->acting) {
        begin_round(law, gentle, speed_ref);
        return;
    }
    const cgl_real *const held = law->config.held;
    const cgl_real frequency = (cgl_real)(k + 1U) * law->step;
    while (law->band < CGL_HARMONIC_EDGES && frequency > held[law->band + 1U]) {
        law->band += 2U;
    }
    const bool holds = law->band < CGL_HARMONIC_EDGES && frequency >= held[law->band];
    const cgl_real c = law->turned.cosine, s = law->turned.sine;
    const cgl_phasor d = {(CGL_R(1.0) - POLE) * c, (CGL_R(1.0) + POLE) * s};
    cgl_phasor w = cgl_product(cgl_product(cgl_product(d, d), d), law->delayed);
    cgl_real scale = (holds ? CGL_R(0.0) : law->rate) * law->pi.loop.ts / law->gain;
    const cgl_real a = law->cosine[k], b = law->cosine[orders + k], power = (cgl_real)(k + 1U) * (a * a + b * b);
    if (k < law->low) {
        law->bend.slow_power += holds ? CGL_R(0.0) : power;
        scale /= GAIN_3 * c * c;
        /* share of the order's wave that the moving mean takes out of z */
        const cgl_real lost = (law->omega < CGL_R(0.0) ? MEAN_SHARE_PER_RAD : -MEAN_SHARE_PER_RAD) / (cgl_real)(k + 1U);
        const cgl_phasor without = {CGL_R(1.0), lost};
        w = cgl_product(w, without);
    } else {
        law->bend.fast_power += power;
        const cgl_phasor back = {w.sine, -w.cosine}; /* w times -j */
        w = back;
        scale /= CGL_R(2.0) * s * c;
    }
    cgl_real *const weight = law->cosine + 3U * orders + 2U * k;
    weight[0] = cgl_clamp(scale * w.cosine, CGL_R(1.0e9));
    weight[1] = cgl_clamp(scale * w.sine, CGL_R(1.0e9));
    law->turned = cgl_product(law->turned, law->half);
    law->delayed = cgl_product(law->delayed, law->base);
    law->next_gain = k + 1U;
}

/* What a step computes before the sum of its orders. */
typedef struct {
    uint32_t angle;        /* where the rotor will be when the current flows [2^-32 turns] */
    cgl_real loads, error; /* what slow orders learn from [turns/ts^2], and what fast orders learn from [turns]; 0: nothing is learned */
    cgl_real omega_error;  /* error that the PI controls [rad/s]; `error` is that of the observer */
} step_inputs;

/* The input of cgl_sum_of_orders() for the sum at `angle` [2^-32 turns]. Each step corrects another group of the slow orders. */
static cgl_orders orders_at(cgl_harmonic *law, uint32_t angle, cgl_real loads, cgl_real error)
{
    const uint32_t orders = law->config.orders, low = law->low, share = law->tick % SLOW_SHARES;
    cgl_real *const cosine = law->cosine, *const sine = cosine + orders;
    cgl_phasor first;
    cgl_sincos_of_turns(law->config.base * angle, &first.sine, &first.cosine);
    const cgl_orders acting = {
        cosine, sine, sine + 2U * orders, low * share / SLOW_SHARES, low * (share + 1U) / SLOW_SHARES, low, law->acting,
        {first.cosine, first.sine}, loads, error, law->config.limit, law->bend.phase_sum};
    return acting;
}

/* Corrects the orders that are due, and returns T, the sum of the orders that act [A]. The arguments are those of step_inputs. */
CGL_APART static cgl_real sum_of_orders(cgl_harmonic *law, uint32_t angle, cgl_real loads, cgl_real error)
{
    cgl_orders orders = orders_at(law, angle, loads, error);
    const cgl_real sum = cgl_sum_of_orders(&orders);
    law->bend.phase_sum = orders.phase_sum;
    return sum;
}

/* Whether the error is finite, and in position control whether theta_ref is a valid angle. The caller has checked theta_m. */
static bool is_plausible(const cgl_harmonic *law, const cgl_law_input *in, cgl_real error)
{
    const bool placed = !(law->config.k_theta > CGL_R(0.0)) || cgl_is_angle(in->theta_ref);
    return cgl_is_finite(error) && placed;
}

/* Sets the output of a step in which the output is at its limit, an input is not plausible, or nothing is learned. */
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

/* Clears the amplitudes and the bend, because in->forget asks for it. */
CGL_SELDOM static void forget_orders(cgl_harmonic *law)
{
    clear(law->cosine, 2U * law->config.orders);
    clear(law->bend.part, 4U);
    law->time = CGL_R(0.0);
}

/* Returns k_theta times the position error, the shorter way round [rad/s]; 0 if theta_ref is no valid angle. `theta` is the measured angle
 * [2^-32 turns], from which this function removes the bend. */
CGL_SELDOM static cgl_real lag_of(const cgl_harmonic *law, const cgl_law_input *in, uint32_t theta)
{
    if (!cgl_is_angle(in->theta_ref)) {
        return CGL_R(0.0);
    }
    const cgl_real way = cgl_steps(theta, cgl_turns(in->theta_ref)) * (CGL_R(1.0) / CGL_TURN_BITS) + law->bend.angle;
    return law->config.k_theta * CGL_TWO_PI * way;
}

/* Decides whether this step learns. After a freeze, learning waits for CGL_HARMONIC_SETTLE steps. */
CGL_SELDOM static void set_learning(cgl_harmonic *law, bool may)
{
    law->learning = may && law->wait == 0U;
    law->wait = may ? law->wait - (law->wait > 0U ? 1U : 0U) : CGL_HARMONIC_SETTLE;
}

/* Steps observer and gains at the measured angle theta [2^-32 turns]. `omega_error`: as in step_inputs. */
static step_inputs observed(cgl_harmonic *law, const cgl_law_input *in, uint32_t theta, cgl_real omega_error)
{
    if (!CGL_OFTEN(law->follows)) {
        start_observer(law, theta, in->omega_m);
    }
    const cgl_real error = observe(law, theta), loads = two_loads(law);
    const uint32_t pause = law->acting > FEW_ORDERS ? 2U : 4U; /* a power of two, so that the mask below gives the remainder */
    if ((law->tick & (pause - 1U)) == 1U) {
        make_gain(law, pause, in->gentle, cgl_abs(in->omega_ref));
    }
    const bool sees = CGL_OFTEN(law->learning);
    const step_inputs inputs = {cgl_turned(theta, law->omega * law->lead - law->bend.angle), sees ? loads : CGL_R(0.0),
                                sees ? error : CGL_R(0.0), omega_error};
    return inputs;
}

/* Does a step without a valid angle. */
CGL_SELDOM static void step_blind(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    set_learning(law, false);
    law->follows = false;
    law->learned = law->bend.angle = law->bend.slope = CGL_R(0.0);
    law->tick = BEND_PERIOD - 1U; /* the next step with an angle then updates the bend */
    step_otherwise(law, in, in->omega_ref - in->omega_m, out);
}

/* Does what comes before the sum of orders, in a step with a valid angle. */
static step_inputs begin_step(cgl_harmonic *law, const cgl_law_input *in)
{
    const uint32_t theta = refine_angle(law, cgl_turns(in->theta_m), in->omega_m);
    law->tick = (law->tick + 1U) % BEND_PERIOD;
    law->bend.angle += law->bend.slope * law->omega;
    if (law->tick == 0U && law->bends > 0U) {
        update_bend(law, theta);
    }
    cgl_real error = in->omega_ref - in->omega_m + law->bend.slope * in->omega_m;
    if (law->config.k_theta > CGL_R(0.0)) {
        error += lag_of(law, in, theta);
    }
    const bool turns = cgl_abs(in->omega_ref) > CGL_R(0.0);
    const bool may = in->learn && law->config.rate > CGL_R(0.0) && turns && !cgl_law_stands_by(in) && !law->pi.saturated
                     && is_plausible(law, in, error);
    if (!CGL_OFTEN(may && law->learning)) {
        set_learning(law, may);
    }
    return observed(law, in, theta, error);
}

/* Does what comes after the sum of orders, in a step with a valid angle. */
static void end_step(cgl_harmonic *law, const cgl_law_input *in, cgl_real error, cgl_law_output *out)
{
    if (law->learning && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, out);
    }
}

void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (in->forget && !cgl_law_stands_by(in)) {
        forget_orders(law);
    }
    if (CGL_OFTEN(cgl_is_angle(in->theta_m))) {
        const step_inputs inputs = begin_step(law, in);
        law->learned = in->off ? CGL_R(0.0) : cgl_law_share(in) * sum_of_orders(law, inputs.angle, inputs.loads, inputs.error);
        end_step(law, in, inputs.omega_error, out);
    } else {
        step_blind(law, in, out);
    }
    set_current(law, in->off ? CGL_R(0.0) : out->i_q_ref - law->learned);
}

#ifdef COGLESS_WITH_LANES
bool cgl_harmonic_begin(cgl_harmonic *law, const cgl_law_input *in, cgl_real *error, cgl_orders *orders);
void cgl_harmonic_end(cgl_harmonic *law, const cgl_law_input *in, cgl_real error, const cgl_orders *orders, cgl_real sum,
                      cgl_law_output *out);

/* Does the part of a step before the sum of orders, and writes `orders` and `error`, which the PI controls [rad/s]. Returns false, and does
 * nothing, if the step has no sum or forgets: then call cgl_harmonic_step() for the whole step. */
bool cgl_harmonic_begin(cgl_harmonic *law, const cgl_law_input *in, cgl_real *error, cgl_orders *orders)
{
    if (law->pi.ready != CGL_READY || in->off || in->forget || !cgl_is_angle(in->theta_m)) {
        return false;
    }
    const step_inputs inputs = begin_step(law, in);
    *error = inputs.omega_error;
    *orders = orders_at(law, inputs.angle, inputs.loads, inputs.error);
    return true;
}

/* Does the rest of the step that cgl_harmonic_begin() has begun. */
void cgl_harmonic_end(cgl_harmonic *law, const cgl_law_input *in, cgl_real error, const cgl_orders *orders, cgl_real sum,
                      cgl_law_output *out)
{
    law->bend.phase_sum = orders->phase_sum;
    law->learned = cgl_law_share(in) * sum;
    end_step(law, in, error, out);
    set_current(law, out->i_q_ref - law->learned);
}
#endif
