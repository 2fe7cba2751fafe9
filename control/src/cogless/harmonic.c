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
#define LONGEST CGL_R(16.0)
#define MEAN CGL_R(0.25)    /* of z, in rad of the base order */
#define QUICK CGL_R(0.0625) /* and a step, while it settles */
#define FULL CGL_R(6.0)     /* at the full rate, in its own time: exp(-3) of the ripple is left then */
#define NEW CGL_R(1.25)     /* ratio of speeds */
#define BENT CGL_R(0.05)    /* rad, bound of each part of the bend */
#define SURE CGL_R(2.5e-7)  /* rad^2: a variance of the bend beyond which it is not learned, (0.5 mrad)^2 */
#define DOUBTED CGL_R(64.0) /* a bend of up to so many variances is taken for none */

CGL_SELDOM static bool is_valid(const cgl_harmonic_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(cgl_harmonic_config, b, CGL_POSITIVE),
                                      CGL_RANGE(cgl_harmonic_config, delay, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(cgl_harmonic_config, base, CGL_COUNT),
                                      CGL_RANGE(cgl_harmonic_config, orders, CGL_COUNT),
                                      CGL_RANGE(cgl_harmonic_config, rate, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(cgl_harmonic_config, rate_min, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(cgl_harmonic_config, limit, CGL_POSITIVE)};
    return CGL_IS_IN_RANGE(config, range) && config->orders <= CGL_HARMONIC_ORDERS
           && config->base * config->orders <= CGL_HARMONIC_ORDER_MAX && cgl_is_positive(ts)
           && config->delay <= LONGEST * ts && cgl_is_positive(config->b * ts * ts);
}

/* What follows from a config that is valid. */
CGL_SELDOM static void take(cgl_harmonic *law, const cgl_harmonic_config *config, cgl_real ts)
{
    law->config = *config;
    law->gain = config->b * ts * ts;
    law->delay = cgl_clamp(config->delay / ts, LONGEST);
    const cgl_real d = law->delay, part = d < CGL_R(1.0) ? d : d - CGL_R(1.0);
    const bool lags = d > LAG;
    law->kept = lags ? d / (CGL_R(1.0) + d) : CGL_R(0.0);
    law->bends = config->base > 4U ? 2U : (config->base > 2U ? 1U : 0U);
    law->weight[0] = lags ? CGL_R(1.0) - law->kept : (d < CGL_R(1.0) ? CGL_R(1.0) - part : CGL_R(0.0));
    law->weight[1] = lags ? CGL_R(0.0) : (d < CGL_R(1.0) ? part : CGL_R(1.0) - part);
    law->weight[2] = lags || d < CGL_R(1.0) ? CGL_R(0.0) : part;
}

CGL_SELDOM cgl_error cgl_harmonic_init(cgl_harmonic *law, const cgl_harmonic_config *config, cgl_real ts, cgl_real *cell,
                                       uint32_t length)
{
    if (!is_valid(config, ts)) {
        return CGL_ERROR_CONFIG;
    }
    if (cell == 0 || length < CGL_HARMONIC_LENGTH(config->orders)) {
        return CGL_ERROR_MEMORY;
    }
    if (cgl_pi_init(&law->pi, &config->pi, ts) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    take(law, config, ts);
    law->cosine = cell;
    for (uint32_t k = 0; k < config->orders; ++k) {
        cell[2U * config->orders + k] = (cgl_real)(config->base * (k + 1U));
    }
    cgl_harmonic_reset(law);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_harmonic_retune(cgl_harmonic *law, const cgl_harmonic_config *config)
{
    if (!(is_valid(config, law->pi.ts) && config->base == law->config.base && config->orders == law->config.orders)
        || cgl_pi_retune(&law->pi, &config->pi) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    take(law, config, law->pi.ts);
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
    clear(law->told, 3U);
    clear(law->base, 2U);
    clear(law->half, 2U);
    clear(law->delayed, 2U);
    clear(law->turned, 2U);
    clear(law->bend.part, 4U);
    law->bend.share = law->bend.rate = law->bend.power = law->bend.doubt = law->bend.moved = CGL_R(0.0);
    law->current = law->omega = law->load = law->mean = CGL_R(0.0);
    law->time = law->anchor = law->slowest = law->fastest = law->rate = CGL_R(0.0);
    law->theta = law->due = law->acting = law->low = 0U;
    law->wait = CGL_HARMONIC_SETTLE;
    law->seated = law->learning = false;
    law->learned = CGL_R(0.0);
}

/* The observer at the measured angle [turns], where it has followed none. */
CGL_SELDOM static void seat(cgl_harmonic *law, uint32_t theta, cgl_real omega)
{
    law->theta = theta;
    law->omega = cgl_clamp(omega * law->pi.ts, CGL_PI);
    law->load = law->mean = CGL_R(0.0);
    law->wait = CGL_HARMONIC_SETTLE;
    law->seated = true;
}

/* One step of the observer; returns e [rad]. */
static cgl_real observe(cgl_harmonic *law, uint32_t theta)
{
    const cgl_real current = law->kept * law->current + law->weight[0] * law->told[0] + law->weight[1] * law->told[1]
                             + law->weight[2] * law->told[2];
    law->current = cgl_clamp(current, law->pi.config.limit);
    const cgl_real rise = law->gain * law->current + law->load;
    const cgl_real way = law->omega + CGL_R(0.5) * rise;
    const uint32_t ahead = cgl_turned(law->theta, way * (CGL_R(1.0) / CGL_TWO_PI));
    const cgl_real part = cgl_steps(ahead, theta) * (CGL_R(1.0) / CGL_TURN_BITS), error = part * CGL_TWO_PI;
    law->theta = cgl_turned(ahead, GAIN_1 * part);
    law->omega = cgl_clamp(law->omega + rise + GAIN_2 * error, CGL_PI);
    law->load = cgl_clamp(law->load + GAIN_3 * error, CGL_PI);
    return error;
}

static void multiply(cgl_real of[2], const cgl_real by[2])
{
    const cgl_real real = of[0] * by[0] - of[1] * by[1];
    of[1] = of[0] * by[1] + of[1] * by[0];
    of[0] = real;
}

static uint32_t smaller(uint32_t a, uint32_t b)
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

/* Phasors of an angle, once and twice in a turn. */
typedef struct {
    cgl_real x[2], y[2];
} turn_phasors;

static void take_phasors(turn_phasors *of, uint32_t theta)
{
    cgl_sincos_of_angle(cgl_steps(0U, theta) * (CGL_TWO_PI / CGL_TURN_BITS), &of->y[0], &of->x[0]);
    of->x[1] = of->x[0] * of->x[0] - of->y[0] * of->y[0];
    of->y[1] = CGL_R(2.0) * of->x[0] * of->y[0];
}

/* How fast the bend is learned in the next round, and how much of it is believed. The orders' noise makes a variance of it. */
CGL_APART static void judge_bend(cgl_harmonic *law)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real *const part = bend->part;
    const cgl_real size = cgl_clamp((cgl_real)law->config.base * bend->power, CGL_R(1.0e9));
    const cgl_real scale = law->rate * law->pi.ts * size * size, variance = CGL_R(2.0) * bend->doubt;
    bend->rate = CGL_R(0.0);
    if (law->config.rate * law->time > CGL_R(0.5) * FULL && size > CGL_R(1.0e-9) && variance < SURE * scale) {
        const cgl_real square = part[0] * part[0] + part[1] * part[1] + part[2] * part[2] + part[3] * part[3];
        const cgl_real noise = DOUBTED * variance, sum = square * scale;
        bend->rate = CGL_R(2.0) / size;
        bend->share = sum > noise ? CGL_R(1.0) - noise / sum : CGL_R(0.0);
    }
    bend->power = CGL_R(0.0);
}

/* The bend goes where the phases of all orders went together. */
static void learn_bend(cgl_harmonic *law, const turn_phasors *of)
{
    cgl_harmonic_bend *const bend = &law->bend;
    const cgl_real moved = cgl_clamp(bend->moved, CGL_R(1.0e9)), step = bend->rate * moved;
    bend->doubt += law->rate * law->pi.ts * (moved * moved - bend->doubt);
    for (uint32_t m = 0; m < law->bends; ++m) {
        bend->part[2U * m] = cgl_clamp(bend->part[2U * m] + step * of->x[m], BENT);
        bend->part[2U * m + 1U] = cgl_clamp(bend->part[2U * m + 1U] + step * of->y[m], BENT);
    }
}

/* Begins to make the gains anew: the speed of now, the orders that it leaves, the rate. */
CGL_APART static void begin_round(cgl_harmonic *law, cgl_real gentle)
{
    const cgl_harmonic_config *const config = &law->config;
    const cgl_real speed = cgl_abs(law->omega), step = (cgl_real)config->base * law->omega, size = cgl_abs(step);
    const bool is_new = speed > NEW * law->anchor || NEW * speed < law->anchor;
    if (is_new && !(speed >= law->slowest && speed <= law->fastest)) {
        const bool first = law->anchor <= CGL_R(0.0);
        law->slowest = first || speed < law->slowest ? speed : law->slowest;
        law->fastest = speed > law->fastest ? speed : law->fastest;
        law->anchor = speed;
        law->time = CGL_R(0.0);
    }
    const uint32_t acting = fitting(CGL_HARMONIC_FASTEST, size, config->orders), low = fitting(SPLIT, size, acting);
    cgl_real *const weight = law->cosine + 3U * config->orders;
    for (uint32_t k = smaller(low, law->low); k < (low < law->low ? law->low : low); ++k) {
        weight[k] = weight[config->orders + k] = CGL_R(0.0); /* they are of another signal */
    }
    law->acting = acting;
    law->low = low;
    const cgl_real begun = config->rate * law->time - FULL; /* the mean is of what came after */
    const cgl_real mean = begun > CGL_R(0.0) ? config->rate / (CGL_R(1.0) + CGL_R(0.5) * begun) : config->rate;
    const cgl_real rate = mean > config->rate_min ? mean : config->rate_min;
    const cgl_real most = size / (CGL_PI * law->pi.ts); /* half of what one period of the base order would be learned with */
    law->rate = gentle * (rate < most ? rate : most);
    cgl_sincos_of_angle(CGL_R(0.5) * (size <= CGL_HARMONIC_FASTEST ? step : CGL_R(0.0)), &law->half[1], &law->half[0]);
    cgl_sincos_of_angle((size <= CGL_HARMONIC_FASTEST ? step : CGL_R(0.0)) * law->delay, &law->base[1], &law->base[0]);
    judge_bend(law);
    law->turned[0] = law->half[0];
    law->turned[1] = law->half[1];
    law->delayed[0] = law->base[0];
    law->delayed[1] = law->base[1];
    law->due = 0U;
}

/* The gain of the order that is due. With D = (Z - p) exp(-j Om/2), 1/G is D^3 exp(-j Om/2) / (cos(Om/2) l3) for z, and
 * D^3 / (j sin Om) for e; the phasor that it meets is ahead by Om (1/2 + delay). */
CGL_APART static void make_gain(cgl_harmonic *law, cgl_real gentle)
{
    const uint32_t k = law->due, orders = law->config.orders;
    if (k >= law->acting) {
        begin_round(law, gentle);
        return;
    }
    const cgl_real c = law->turned[0], s = law->turned[1];
    const cgl_real d[2] = {(CGL_R(1.0) - POLE) * c, (CGL_R(1.0) + POLE) * s};
    cgl_real w[2] = {d[0], d[1]};
    multiply(w, d);
    multiply(w, d);
    multiply(w, law->delayed);
    cgl_real scale = law->rate / (law->config.b * law->pi.ts);
    if (k < law->low) {
        const cgl_real a = law->cosine[k], b = law->cosine[orders + k];
        law->bend.power += (cgl_real)(k + 1U) * (a * a + b * b);
        scale /= GAIN_3 * c;
        const cgl_real slow = (law->omega < CGL_R(0.0) ? MEAN : -MEAN) / (cgl_real)(k + 1U); /* what the mean takes away */
        const cgl_real without[2] = {CGL_R(1.0), slow};
        multiply(w, without);
    } else {
        multiply(w, law->turned);
        const cgl_real real = w[0]; /* times -j */
        w[0] = w[1];
        w[1] = -real;
        scale /= CGL_R(2.0) * s * c;
    }
    cgl_real *const weight = law->cosine + 3U * orders;
    weight[k] = cgl_clamp(scale * w[0], CGL_R(1.0e9));
    weight[orders + k] = cgl_clamp(scale * w[1], CGL_R(1.0e9));
    multiply(law->turned, law->half);
    multiply(law->delayed, law->base);
    law->due = k + 1U;
}

/* Orders from `first` up to `end`: takes from each what `seen` tells of it, and adds them up. phasor: of the base order, and of
 * the next one. moved: by how much all phases went on, each weighted with its amplitude's square [A^2]. */
static cgl_real take_part(cgl_harmonic *law, uint32_t first, uint32_t end, cgl_real seen, const cgl_real base[2],
                          cgl_real phasor[2], cgl_real *moved)
{
    const uint32_t orders = law->config.orders;
    const cgl_real limit = law->config.limit, x1 = base[0], y1 = base[1];
    cgl_real *const a = law->cosine, *const b = a + orders;
    const cgl_real *const w = b + 2U * orders;
    cgl_real x = phasor[0], y = phasor[1], sum = CGL_R(0.0), on = CGL_R(0.0);
    for (uint32_t k = first; k < end; ++k) {
        const cgl_real p = seen * w[k], q = seen * w[orders + k];
        const cgl_real less = p * x + q * y, more = q * x - p * y;
        on += a[k] * more + b[k] * less;
        a[k] = cgl_clamp(a[k] - less, limit);
        b[k] = cgl_clamp(b[k] + more, limit);
        sum += a[k] * x + b[k] * y;
        const cgl_real next = x * x1 - y * y1;
        y = x * y1 + y * x1;
        x = next;
    }
    *moved = on;
    phasor[0] = x;
    phasor[1] = y;
    return sum;
}

/* The orders' sum at an angle [turns] at which it will act, after what z and e teach each. */
static cgl_real sum_of_orders(cgl_harmonic *law, uint32_t angle, cgl_real load, cgl_real error)
{
    cgl_real base[2];
    cgl_sincos_of_angle(cgl_steps(0U, law->config.base * angle) * (CGL_TWO_PI / CGL_TURN_BITS), &base[1], &base[0]);
    cgl_real phasor[2] = {base[0], base[1]};
    cgl_real unused;
    const cgl_real low = take_part(law, 0U, law->low, load, base, phasor, &law->bend.moved);
    return cgl_clamp(low + take_part(law, law->low, law->acting, error, base, phasor, &unused), law->config.limit);
}

/* A step in which something is at its limit, not plausible, or not learning. */
CGL_SELDOM static void step_otherwise(cgl_harmonic *law, const cgl_law_input *in, cgl_real error, bool plausible,
                                      cgl_law_output *out)
{
    if (cgl_law_stands_by(in)) {
        cgl_pi_start(&law->pi, cgl_law_stand_by(in, law->learned, law->pi.config.limit, out));
        return;
    }
    out->i_q_ref = cgl_pi_step(&law->pi, error, law->learned);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U)
                  | (law->learning ? 0U : (unsigned)CGL_STATUS_FROZEN) | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}

/* The factor on the rate as the guard says; it may clear what is learned, too. */
CGL_SELDOM static cgl_real follow_guard(cgl_harmonic *law, const cgl_law_input *in)
{
    if (in->forget && !cgl_law_stands_by(in)) {
        clear(law->cosine, 2U * law->config.orders);
        clear(law->bend.part, 4U);
        law->time = CGL_R(0.0);
    }
    return cgl_gentle_gain(in->gentle, law->config.rate, law->config.rate);
}

/* The measured angle [turns] without its bend; `slope`: the bend's share in the measured speed. */
static uint32_t straight(const cgl_harmonic *law, uint32_t theta, const turn_phasors *of, cgl_real *slope)
{
    const cgl_real *const part = law->bend.part;
    const cgl_real share = law->bend.share;
    const cgl_real x0 = of->x[0], y0 = of->y[0], x1 = of->x[1], y1 = of->y[1];
    *slope = share * (part[1] * x0 - part[0] * y0 + CGL_R(2.0) * (part[3] * x1 - part[2] * y1));
    const cgl_real bend = share * (part[0] * x0 + part[1] * y0 + part[2] * x1 + part[3] * y1);
    return cgl_turned(theta, -bend * (CGL_R(1.0) / CGL_TWO_PI));
}

void cgl_harmonic_step(cgl_harmonic *law, const cgl_law_input *in, cgl_law_output *out)
{
    const bool is_angle = cgl_is_angle(in->theta_m);
    const uint32_t theta = is_angle ? cgl_turns(in->theta_m) : 0U;
    turn_phasors turn;
    cgl_real slope;
    take_phasors(&turn, theta);
    const uint32_t unbent = straight(law, theta, &turn, &slope);
    const cgl_real error = in->omega_ref - in->omega_m + (is_angle ? slope : CGL_R(0.0)) * in->omega_m;
    const bool plausible = cgl_is_finite(error) && is_angle;
    const bool may = in->learn && !cgl_law_stands_by(in) && plausible && !law->pi.saturated;
    const bool guarded = in->gentle > 0U || in->forget;
    const cgl_real gentle = guarded ? follow_guard(law, in) : CGL_R(1.0);
    law->learning = may && law->wait == 0U;
    law->wait = may ? law->wait - (law->wait > 0U ? 1U : 0U) : CGL_HARMONIC_SETTLE;
    law->learned = CGL_R(0.0);
    if (cgl_is_angle(in->theta_m)) {
        if (!law->seated) {
            seat(law, theta, in->omega_m);
        }
        const cgl_real unforeseen = observe(law, theta);
        const cgl_real slow = MEAN * (cgl_real)law->config.base * cgl_abs(law->omega);
        law->mean += (law->learning && slow < QUICK ? slow : QUICK) * (law->load - law->mean);
        const cgl_real load = law->learning ? law->load - law->mean : CGL_R(0.0);
        make_gain(law, gentle);
        if (!in->off) {
            const uint32_t acts = cgl_turned(unbent, law->omega * (CGL_R(0.5) + law->delay) * (CGL_R(1.0) / CGL_TWO_PI));
            law->learned = cgl_law_share(in) * sum_of_orders(law, acts, load, law->learning ? unforeseen : CGL_R(0.0));
        }
        if (law->learning && !in->off) {
            learn_bend(law, &turn);
        }
        law->time = law->learning ? cgl_clamp(law->time + law->pi.ts, CGL_R(1.0e6)) : law->time;
    } else {
        law->seated = false;
    }
    if (law->learning && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, plausible, out);
    }
    law->told[2] = law->told[1];
    law->told[1] = law->told[0];
    law->told[0] = in->off ? CGL_R(0.0) : out->i_q_ref - law->learned;
}
