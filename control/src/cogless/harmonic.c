#include "harmonic.h"

#include "angle.h"
#include "range.h"
#include "sine.h"
#include "turns.h"

#define POLE CGL_R(0.60653065971263342) /* p = exp(-1/2): what the observer keeps of a deviation in a step */
#define GAIN_1 (CGL_R(1.0) - POLE * POLE * POLE)
#define GAIN_2 (CGL_R(1.5) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) + POLE))
#define GAIN_3 ((CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE) * (CGL_R(1.0) - POLE))

#define SPLIT CGL_R(0.5105) /* rad in a step of an order: up to here z tells more of it than e, |Z - p|^2 = 2 (1 - p)^2 */
#define LAG CGL_R(1.5)      /* steps: a longer delay counts as a lag */
#define LONGEST CGL_R(16.0)  /* steps: the longest delay that init takes */
#define MEAN CGL_R(0.25)    /* share of z that its mean takes per rad of the base order */
#define QUICK CGL_R(0.0625) /* share of z that its mean takes per step while nothing is learned, and the most otherwise */
#define TOGETHER CGL_R(0.0625) /* per step: bound on the sum of all acting orders' rates; slow orders settle below 0.15 */
#define FULL CGL_R(6.0)     /* learning time, times the full rate, after which the rate begins to fall; exp(-3) of the ripple is left by then */
#define HALF CGL_R(0.5)     /* turns: bound of the speed in a step, and of z */
#define NEW CGL_R(1.25)     /* a speed beyond the span of earlier speeds by this factor is new */
#define HUNTS CGL_R(2.0)    /* a rotor that is faster than this times its reference swings about it, so the rate counts no more periods than that */
#define BENT CGL_R(0.05)    /* rad: bound of each part of the bend */
#define SURE CGL_R(2.5e-7)  /* rad^2: with a larger variance the bend is not learned; (0.5 mrad)^2 */
#define CALM CGL_R(0.02)    /* share of the mean |c|^2 above which the square of the drift stops learning the bend: |c|/7 turns the orders by 1/7 rad */
#define STAYS CGL_R(0.125)  /* half of the share of z's noise that a mean over the steps between two turns of the bend keeps */
#define DOUBTED CGL_R(64.0) /* a bend whose square is below so many variances counts as none */
#define PARTS 2U            /* the slow orders are taught in so many parts, one a step */
#define FEW 8U              /* up to so many acting orders a gain is made anew every fourth step, else every second */
#define TURN 8U             /* steps from one turn of the bend to the next */

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
    if (!(config->delay <= LONGEST * loop->ts)) {
        return CGL_FIELD("harmonic.delay");
    }
    return cgl_is_positive(config->b * loop->ts * loop->ts) ? 0 : CGL_FIELD("harmonic.b");
}

/* What follows from a config that is valid. */
CGL_SELDOM static void take(cgl_harmonic *law, const cgl_harmonic_config *config, cgl_real ts)
{
    law->config = *config;
    law->gain = config->b * ts * ts * (CGL_R(1.0) / CGL_TWO_PI);
    law->half_step = cgl_clamp(config->step * (CGL_R(0.5) / CGL_TWO_PI), CGL_R(0.25));
    const cgl_real d = cgl_clamp(config->delay / ts, LONGEST);
    law->ahead = CGL_R(0.5) + d;
    const cgl_real part = d < CGL_R(1.0) ? d : d - CGL_R(1.0);
    const bool lags = d > LAG;
    law->kept = lags ? d / (CGL_R(1.0) + d) : CGL_R(0.0);
    const uint32_t free = config->base > 4U ? 2U : (config->base > 2U ? 1U : 0U); /* between the orders */
    law->bends = config->bends < free ? config->bends : free;
    law->weight[0] = lags ? CGL_R(1.0) - law->kept : (d < CGL_R(1.0) ? CGL_R(1.0) - part : CGL_R(0.0));
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

CGL_SELDOM void cgl_harmonic_reset(cgl_harmonic *law)
{
    const uint32_t orders = law->config.orders;
    cgl_pi_reset(&law->pi);
    clear(law->cosine, 2U * orders);
    clear(law->cosine + 3U * orders, 2U * orders);
    clear(law->later, 2U);
    law->last = CGL_R(0.0);
    const cgl_phasor none = {CGL_R(0.0), CGL_R(0.0)};
    law->base = law->half = law->delayed = law->turned = none;
    clear(law->bend.part, 4U);
    law->bend.share = law->bend.rate = law->bend.power = law->bend.rest = law->bend.doubt = CGL_R(0.0);
    law->bend.calm = law->bend.moved = law->bend.before = law->bend.here = law->bend.slope = law->step = CGL_R(0.0);
    law->share = QUICK;
    law->current = law->omega = law->load = law->mean = law->drift = CGL_R(0.0);
    law->time = law->slowest = law->fastest = law->rate = CGL_R(0.0);
    law->since_edge = CGL_R(0.0);
    law->shown = law->theta = law->due = law->band = law->acting = law->low = 0U;
    law->since = 1U; /* the first step has enough to do without a gain */
    law->wait = CGL_HARMONIC_SETTLE;
    law->seated = law->learning = false;
    law->learned = CGL_R(0.0);
}

/* Where the rotor is within the step that the sensor shows [turns]. A speed that is timed from edge to edge adds up to exactly the
 * way from edge to edge: what it is ahead of the steps is the way since the last edge, but for a constant. */
static uint32_t within_step(cgl_harmonic *law, uint32_t shown, cgl_real omega_m)
{
    const cgl_real turned = cgl_steps(law->shown, shown) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->since_edge = cgl_clamp(law->since_edge + omega_m * law->pi.loop.ts * (CGL_R(1.0) / CGL_TWO_PI) - turned, law->half_step);
    law->shown = shown;
    return cgl_turned(shown, law->since_edge);
}

/* The observer at the measured angle [turns], where it has followed none. */
CGL_SELDOM static void seat(cgl_harmonic *law, uint32_t theta, cgl_real omega)
{
    law->theta = theta;
    law->omega = cgl_clamp(omega * law->pi.loop.ts * (CGL_R(1.0) / CGL_TWO_PI), HALF);
    law->load = law->mean = law->drift = CGL_R(0.0);
    law->last = CGL_R(0.0);
    law->wait = CGL_HARMONIC_SETTLE;
    law->seated = true;
}

/* One step of the observer; returns e [turns]. */
static cgl_real observe(cgl_harmonic *law, uint32_t theta)
{
    const cgl_real rise = law->gain * law->current + law->load;
    const uint32_t ahead = cgl_turned(law->theta, law->omega + CGL_R(0.5) * rise);
    const cgl_real error = cgl_steps(ahead, theta) * (CGL_R(1.0) / CGL_TURN_BITS);
    law->theta = ahead + (uint32_t)(int32_t)(GAIN_1 * error * CGL_TURN_BITS); /* |error| <= 1/2 */
    law->omega = cgl_clamp(law->omega + rise + GAIN_2 * error, HALF);
    law->load = cgl_clamp(law->load + GAIN_3 * error, HALF);
    return error;
}

/* What the feedback commands, u [A], acts from the next step on. */
static void tell(cgl_harmonic *law, cgl_real u)
{
    law->current = cgl_clamp(law->kept * law->current + law->weight[0] * u + law->later[0], law->pi.config.limit);
    law->later[0] = law->weight[1] * u + law->later[1];
    law->later[1] = law->weight[2] * u;
}

/* z of the last two steps, without its mean: their sum [turns]. */
static cgl_real two_loads(cgl_harmonic *law)
{
    law->mean += law->share * (law->load - law->mean);
    const cgl_real now = law->load - law->mean, sum = now + law->last;
    law->drift += law->share * (now - law->drift);
    law->last = now;
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

/* How many multiples of `step` [rad] are within `most` [rad]. */
static uint32_t fitting(cgl_real most, cgl_real step, uint32_t orders)
{
    if (step < CGL_R(0.003)) {
        return orders; /* CGL_HARMONIC_ORDERS of them are within SPLIT */
    }
    const cgl_real count = most / step;
    return smaller((uint32_t)(int32_t)count, orders);
}

/* Sets the rate at which the next round learns the bend, and the share of the bend that is used. The noise of the orders gives the
 * bend a variance. Where fast orders have most of the ripple, the slow orders show too little of the bend. `begun`: time of the
 * orders' learning, times their full rate. */
CGL_APART static void judge_bend(cgl_harmonic *law, cgl_real begun)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real *const part = bend->part;
    const cgl_real size = cgl_clamp((cgl_real)law->config.base * bend->power, CGL_R(1.0e9));
    const cgl_real scale = law->rate * law->pi.loop.ts * size * size, variance = CGL_R(2.0) * bend->doubt;
    const cgl_real mean = bend->power / (cgl_real)larger(law->low, 1U); /* mean |c|^2, or less */
    bend->calm = CALM * cgl_clamp(mean, CGL_R(1.0e9)) * law->gain * law->gain;
    bend->rate = CGL_R(0.0);
    const bool shows = size > CGL_R(1.0e-9) && bend->power > bend->rest;
    if (begun > CGL_R(0.5) * FULL && shows && variance < SURE * scale) {
        const cgl_real square = part[0] * part[0] + part[1] * part[1] + part[2] * part[2] + part[3] * part[3];
        const cgl_real noise = DOUBTED * variance, sum = square * scale;
        bend->rate = CGL_R(2.0) / size;
        bend->share = sum > noise ? CGL_R(1.0) - noise / sum : CGL_R(0.0);
    }
    bend->power = bend->rest = CGL_R(0.0);
}

/* The bend's turn: it goes where the phases of all orders went together since the last one. At the measured angle [turns]. */
CGL_APART static void turn_bend(cgl_harmonic *law, uint32_t theta)
{
    cgl_harmonic_bend *const bend = &law->bend;
    cgl_real *const part = bend->part;
    const cgl_phasor once = cgl_phasor_of(theta), twice = cgl_product(once, once);
    const cgl_real x[2] = {once.cosine, twice.cosine}, y[2] = {once.sine, twice.sine};
    if (law->learning && law->drift * law->drift < bend->calm) {
        const cgl_real moved = cgl_clamp(bend->moved, CGL_R(1.0e9)), step = bend->rate * moved;
        const cgl_real rate = law->rate * law->pi.loop.ts, most = CGL_R(1.0) / (cgl_real)TURN; /* beyond it no mean */
        const cgl_real change = moved - bend->before; /* noise, but not what the bend moves: that is nearly the same in both */
        bend->doubt += (rate < most ? rate : most) * (STAYS * change * change - (cgl_real)TURN * bend->doubt);
        bend->before = moved;
        for (uint32_t m = 0; m < law->bends; ++m) {
            part[2U * m] = cgl_clamp(part[2U * m] + step * x[m], BENT);
            part[2U * m + 1U] = cgl_clamp(part[2U * m + 1U] + step * y[m], BENT);
        }
    }
    bend->moved = CGL_R(0.0);
    bend->slope = bend->share * (part[1] * x[0] - part[0] * y[0] + CGL_R(2.0) * (part[3] * x[1] - part[2] * y[1]));
    const cgl_real here = part[0] * x[0] + part[1] * y[0] + part[2] * x[1] + part[3] * y[1];
    bend->here = bend->share * here * (CGL_R(1.0) / CGL_TWO_PI);
}

/* Begins to make the gains anew: the present speed, the orders that it leaves, the rate. `speed_ref`: |omega_ref|, rad/s. */
CGL_APART static void begin_round(cgl_harmonic *law, uint32_t gentle, cgl_real speed_ref)
{
    const cgl_harmonic_config *const config = &law->config;
    const cgl_real speed = cgl_abs(law->omega), step = CGL_TWO_PI * (cgl_real)config->base * law->omega;
    const cgl_real size = cgl_abs(step);
    if (speed > NEW * law->fastest || NEW * speed < law->slowest) {
        law->slowest = law->fastest <= CGL_R(0.0) || speed < law->slowest ? speed : law->slowest;
        law->fastest = speed > law->fastest ? speed : law->fastest;
        law->time = CGL_R(0.0);
    }
    const uint32_t low = fitting(SPLIT, size, config->orders), acting = larger(low, fitting(CGL_HARMONIC_FASTEST, size, config->fast));
    cgl_real *const weight = law->cosine + 3U * config->orders;
    for (uint32_t n = 2U * smaller(low, law->low); n < 2U * larger(low, law->low); ++n) {
        weight[n] = CGL_R(0.0); /* they are of another signal */
    }
    law->acting = acting;
    law->low = low;
    const cgl_real shared = TOGETHER / ((cgl_real)larger(acting, 1U) * law->pi.loop.ts), full = lesser(config->rate, shared);
    const cgl_real begun = full * law->time, after = begun - FULL; /* the mean begins FULL after learning */
    const cgl_real mean = after > CGL_R(0.0) ? full / (CGL_R(1.0) + CGL_R(0.5) * after) : full;
    const cgl_real rate = mean > config->rate_min ? mean : lesser(config->rate_min, shared);
    const cgl_real asked = HUNTS * (cgl_real)config->base * law->pi.loop.ts * speed_ref;
    const cgl_real most = lesser(asked, size) / (CGL_PI * law->pi.loop.ts); /* leaves exp(-1) of an order after a period of the base order */
    law->rate = cgl_gentle_gain(gentle, config->rate, config->rate) * lesser(rate, most);
    const cgl_real turn = size <= CGL_HARMONIC_FASTEST ? step : CGL_R(0.0);
    cgl_sincos(CGL_R(0.5) * turn, &law->half.sine, &law->half.cosine);
    cgl_sincos(turn * law->ahead, &law->base.sine, &law->base.cosine);
    judge_bend(law, begun);
    law->turned = law->half;
    law->delayed = law->base;
    law->step = size;
    law->due = law->band = 0U;
}

/* The gain of the order that is due. With D = (Z - p) exp(-j Om/2), 1/G is D^3 exp(-j Om/2) / (cos(Om/2) l3) for z, and
 * D^3 / (j sin Om) for e; two z sum to 2 cos(Om/2) exp(-j Om/2) of one. The phasor that it meets is ahead by Om (1/2 + delay). */
CGL_APART static void make_gain(cgl_harmonic *law, uint32_t pause, uint32_t gentle, cgl_real speed_ref)
{
    const uint32_t k = law->due, orders = law->config.orders;
    const cgl_real slow = (CGL_TWO_PI * MEAN) * (cgl_real)law->config.base * cgl_abs(law->omega);
    law->share = law->learning && slow < QUICK ? slow : QUICK;
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
        law->bend.power += holds ? CGL_R(0.0) : power;
        scale /= GAIN_3 * c * c;
        const cgl_real lost = (law->omega < CGL_R(0.0) ? MEAN : -MEAN) / (cgl_real)(k + 1U); /* what the mean takes away */
        const cgl_phasor without = {CGL_R(1.0), lost};
        w = cgl_product(w, without);
    } else {
        law->bend.rest += power;
        const cgl_phasor back = {w.sine, -w.cosine}; /* times -j */
        w = back;
        scale /= CGL_R(2.0) * s * c;
    }
    cgl_real *const weight = law->cosine + 3U * orders + 2U * k;
    weight[0] = cgl_clamp(scale * w.cosine, CGL_R(1.0e9));
    weight[1] = cgl_clamp(scale * w.sine, CGL_R(1.0e9));
    law->turned = cgl_product(law->turned, law->half);
    law->delayed = cgl_product(law->delayed, law->base);
    law->due = k + 1U;
}

/* The orders' sum at an angle [turns] at which it will act, after what z teaches a part of the slow ones and e the others. */
CGL_APART static cgl_real sum_of_orders(cgl_harmonic *law, uint32_t angle, cgl_real loads, cgl_real error)
{
    const uint32_t orders = law->config.orders, low = law->low, turn = law->since % PARTS;
    const cgl_real limit = law->config.limit;
    cgl_real *const a = law->cosine, *const b = a + orders;
    const cgl_real *const w = b + 2U * orders;
    cgl_real sum = CGL_R(0.0), moved = CGL_R(0.0), seen = loads;
    cgl_phasor first;
    cgl_sincos_of_turns(law->config.base * angle, &first.sine, &first.cosine);
    cgl_phasor at = first;
    uint32_t k = 0U, begin = low * turn / PARTS, end = low * (turn + 1U) / PARTS;
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

/* Whether a law that has an angle has all that it needs. */
static bool is_plausible(const cgl_harmonic *law, const cgl_law_input *in, cgl_real error)
{
    const bool placed = !(law->config.k_theta > CGL_R(0.0)) || cgl_is_angle(in->theta_ref);
    return cgl_is_finite(error) && placed;
}

/* A step in which something is at its limit, not plausible, or not learning. */
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

/* What is learned is cleared, as the guard says. */
CGL_SELDOM static void forget(cgl_harmonic *law)
{
    clear(law->cosine, 2U * law->config.orders);
    clear(law->bend.part, 4U);
    law->time = CGL_R(0.0);
}

/* What is fed back of the position, whose angle is bent [turns]: the short way round [rad/s]; 0 without a reference. */
CGL_SELDOM static cgl_real lag_of(const cgl_harmonic *law, const cgl_law_input *in, uint32_t theta)
{
    if (!cgl_is_angle(in->theta_ref)) {
        return CGL_R(0.0);
    }
    const cgl_real way = cgl_steps(theta, cgl_turns(in->theta_ref)) * (CGL_R(1.0) / CGL_TURN_BITS) + law->bend.here;
    return law->config.k_theta * CGL_TWO_PI * way;
}

/* Whether this step learns: it waits after what froze it. */
CGL_SELDOM static void settle(cgl_harmonic *law, bool may)
{
    law->learning = may && law->wait == 0U;
    law->wait = may ? law->wait - (law->wait > 0U ? 1U : 0U) : CGL_HARMONIC_SETTLE;
}

/* The learned current at an angle [turns]. */
static cgl_real follow(cgl_harmonic *law, const cgl_law_input *in, uint32_t theta)
{
    if (!CGL_OFTEN(law->seated)) {
        seat(law, theta, in->omega_m);
    }
    const cgl_real error = observe(law, theta), loads = two_loads(law);
    const uint32_t pause = law->acting > FEW ? 2U : 4U; /* a power of two: what follows is a remainder */
    if ((law->since & (pause - 1U)) == 1U) {
        make_gain(law, pause, in->gentle, cgl_abs(in->omega_ref));
    }
    if (in->off) {
        return CGL_R(0.0);
    }
    const uint32_t acts = cgl_turned(theta, law->omega * law->ahead - law->bend.here);
    const bool sees = CGL_OFTEN(law->learning);
    return cgl_law_share(in) * sum_of_orders(law, acts, sees ? loads : CGL_R(0.0), sees ? error : CGL_R(0.0));
}

/* A step without an angle. */
CGL_SELDOM static void step_blind(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    settle(law, false);
    law->seated = false;
    law->learned = law->bend.here = law->bend.slope = CGL_R(0.0);
    law->since = TURN - 1U; /* the first angle that comes is the bend's */
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
        const uint32_t theta = within_step(law, cgl_turns(in->theta_m), in->omega_m);
        law->since = (law->since + 1U) % TURN;
        law->bend.here += law->bend.slope * law->omega;
        if (law->since == 0U && law->bends > 0U) {
            turn_bend(law, theta);
        }
        cgl_real error = in->omega_ref - in->omega_m + law->bend.slope * in->omega_m;
        if (law->config.k_theta > CGL_R(0.0)) {
            error += lag_of(law, in, theta);
        }
        const bool turns = cgl_abs(in->omega_ref) > CGL_R(0.0);
        const bool may = in->learn && law->config.rate > CGL_R(0.0) && turns && !cgl_law_stands_by(in) && !law->pi.saturated && is_plausible(law, in, error);
        if (!CGL_OFTEN(may && law->learning)) {
            settle(law, may);
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
    tell(law, in->off ? CGL_R(0.0) : out->i_q_ref - law->learned);
}
