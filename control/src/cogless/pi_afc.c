#include "pi_afc.h"

#include "angle.h"
#include "range.h"

#define LEAK CGL_R(12.5) /* 2.5 / (1 - 0.8): the leak is 2.5 gain / kp where the guard's step leaves 0.8 of what is learned */
#define CORRECTION_MOST CGL_R(1.0e30) /* A: a phasor of this size has finite products */

static bool is_rising(const cgl_pi_afc_config *config)
{
    uint32_t below = 0U;
    for (uint32_t k = 0; k < config->orders; ++k) {
        if (config->order[k] <= below || config->order[k] > CGL_PI_AFC_ORDER_MAX) {
            return false;
        }
        below = config->order[k];
    }
    return true;
}

CGL_SELDOM const char *cgl_pi_afc_bad_field(const cgl_pi_afc_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(pi_afc, gain, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(pi_afc, lead, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(pi_afc, omega_min, CGL_POSITIVE),
                                      CGL_RANGE(pi_afc, limit, CGL_POSITIVE)};
    const char *field = cgl_pi_bad_field(&config->pi, loop);
    field = field != 0 ? field : CGL_LAW_BAD_FIELD(config, range, loop);
    if (field != 0) {
        return field;
    }
    if (config->orders < 1U || config->orders > CGL_PI_AFC_ORDERS) {
        return CGL_FIELD("pi_afc.orders");
    }
    if (!is_rising(config)) {
        return CGL_FIELD("pi_afc.order");
    }
    return cgl_loop_can_learn(loop, config->gain, config->pi.kp) ? 0 : CGL_FIELD("pi.kp");
}

static bool are_same_orders(const cgl_pi_afc_config *one, const cgl_pi_afc_config *other)
{
    bool same = one->orders == other->orders;
    for (uint32_t k = 0; same && k < one->orders; ++k) {
        same = one->order[k] == other->order[k];
    }
    return same;
}

/* The narrowest gap between two orders, or below the first: each other gap is often made of it. */
static uint32_t narrowest_gap(const cgl_pi_afc_config *config)
{
    uint32_t narrowest = config->order[0];
    for (uint32_t k = 1; k < config->orders; ++k) {
        const uint32_t gap = config->order[k] - config->order[k - 1U];
        narrowest = gap < narrowest ? gap : narrowest;
    }
    return narrowest;
}

static void clear(cgl_pi_afc *law)
{
    for (uint32_t n = 0; n < 2U * law->config.orders; ++n) {
        law->coefficient[n] = CGL_R(0.0);
    }
}

cgl_error cgl_pi_afc_init(cgl_pi_afc *law, const cgl_pi_afc_config *config, const cgl_loop *loop, cgl_real *coefficient,
                          uint32_t length)
{
    law->pi.ready = 0U;
    if (cgl_pi_afc_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    if (cgl_check_memory(coefficient, length, CGL_PI_AFC_LENGTH(config->orders)) != CGL_OK) {
        return CGL_ERROR_MEMORY;
    }
    if (cgl_pi_init(&law->pi, &config->pi, loop) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    law->config = *config;
    law->unit = narrowest_gap(config);
    law->coefficient = coefficient;
    for (uint32_t k = 0; k < config->orders; ++k) {
        coefficient[2U * config->orders + k] = (cgl_real)config->order[k];
    }
    cgl_pi_afc_reset(law);
    return CGL_OK;
}

cgl_error cgl_pi_afc_retune(cgl_pi_afc *law, const cgl_pi_afc_config *config)
{
    if (cgl_pi_afc_bad_field(config, &law->pi.loop) != 0 || !are_same_orders(config, &law->config)) {
        return CGL_ERROR_CONFIG;
    }
    (void)cgl_pi_retune(&law->pi, &config->pi);
    law->config = *config;
    for (uint32_t n = 0; n < 2U * config->orders; ++n) {
        law->coefficient[n] = cgl_clamped(law->coefficient[n], config->limit);
    }
    return CGL_OK;
}

void cgl_pi_afc_reset(cgl_pi_afc *law)
{
    cgl_pi_reset(&law->pi);
    clear(law);
    law->learned = CGL_R(0.0);
    law->learning = false;
}

/* How many orders have more than two samples in a period, where the rotor turns by `way` [rad] in one. */
static uint32_t slow_orders(const cgl_pi_afc_config *config, cgl_real way)
{
    uint32_t count = config->orders;
    while (count > 0U && (cgl_real)config->order[count - 1U] * cgl_abs(way) >= CGL_PI) {
        --count;
    }
    return count;
}

/* The phasors of one order, or of a gap between two orders, at the two angles that a step needs. */
typedef struct {
    cgl_phasor now;    /* at the measured angle, where the current acts */
    cgl_phasor before; /* at the angle that the error tells of; the orders have it times the correction [A] */
} phasor_pair;

CGL_APART static phasor_pair pair_of(uint32_t order, uint32_t turns, uint32_t turns_before)
{
    const phasor_pair pair = {cgl_phasor_of(order * turns), cgl_phasor_of(order * turns_before)};
    return pair;
}

static inline phasor_pair product_of_pairs(phasor_pair a, phasor_pair b)
{
    const phasor_pair pair = {cgl_product(a.now, b.now), cgl_product(a.before, b.before)};
    return pair;
}

/* Adds the correction [A] to the `count` lowest orders, each at the angle before, and returns their sum at the present angle [A].
 * Angles are in turns of 2^32.
 *
 * A step from one order to the next multiplies both phasors by those of the gap between the two. A sine is taken only for a gap that
 * is not the last one, twice the last one, the last one and `unit`, or `unit`. The phasors begin anew in each step, so no error adds
 * up over time, and angle.h bounds the error of a product. */
static cgl_real sum_of_orders(cgl_pi_afc *law, uint32_t count, uint32_t turns, uint32_t turns_before, cgl_real correction)
{
    const cgl_real limit = law->config.limit;
    const uint32_t *order = law->config.order;
    const uint32_t unit = law->unit;
    cgl_real *a = law->coefficient, *b = a + law->config.orders;
    cgl_real sum = CGL_R(0.0);
    const phasor_pair of_unit = pair_of(unit, turns, turns_before);
    phasor_pair of_order = {{CGL_R(1.0), CGL_R(0.0)}, {correction, CGL_R(0.0)}}, of_gap = of_unit;
    uint32_t below = 0U, gap = unit;
    for (const cgl_real *const end = a + count; a < end; ++a, ++b, ++order) {
        if (below + gap != *order) {
            const uint32_t next_gap = *order - below;
            if (next_gap == 2U * gap) {
                of_gap = product_of_pairs(of_gap, of_gap);
            } else if (next_gap == gap + unit) {
                of_gap = product_of_pairs(of_gap, of_unit);
            } else {
                of_gap = next_gap == unit ? of_unit : pair_of(next_gap, turns, turns_before);
            }
            gap = next_gap;
        }
        below += gap;
        of_order = product_of_pairs(of_order, of_gap);
        const cgl_real cosine = cgl_clamp_here(*a + of_order.before.cosine, limit);
        const cgl_real sine = cgl_clamp_here(*b + of_order.before.sine, limit);
        *a = cosine;
        *b = sine;
        sum += cosine * of_order.now.cosine + sine * of_order.now.sine;
    }
    return cgl_clamp(sum, limit);
}

/* The output of a step that is at its limit, has an input that is not plausible, or does not learn. */
CGL_SELDOM static void step_otherwise(cgl_pi_afc *law, const cgl_law_input *in, cgl_real error, bool plausible,
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

/* Clears the coefficients where the guard says so, and returns the factor that it sets on the gain. */
CGL_SELDOM static cgl_real follow_guard(cgl_pi_afc *law, const cgl_law_input *in)
{
    if (in->forget && !cgl_law_stands_by(in)) {
        clear(law);
    }
    const cgl_real gain = law->config.gain, ki = law->pi.config.ki;
    return cgl_gentle_gain(in->gentle, gain, ki > CGL_R(0.0) ? ki : gain);
}

/* Lets the coefficients of the `count` lowest orders leak, where the guard says that they shall forget. `gain` is what it leaves
 * [A/rad]. At its last step but one a leak of 2.5 gain / kp keeps at most 0.4 of the feedback's own part. */
CGL_SELDOM static void leak(cgl_pi_afc *law, uint32_t gentle, uint32_t count, cgl_real gain)
{
    const cgl_real forgetting = CGL_R(1.0) - cgl_gentle_forgetting(gentle);
    const cgl_real loss = LEAK * forgetting * gain * law->pi.loop.ts, kp = law->pi.config.kp;
    const cgl_real left = loss < kp ? CGL_R(1.0) - loss / kp : CGL_R(0.0);
    for (uint32_t k = 0U; loss > CGL_R(0.0) && k < count; ++k) {
        cgl_real *const a = law->coefficient + k, *const b = a + law->config.orders;
        *a = CGL_R(0.0) + left * *a; /* the sum is never -0, so a step that adds 0 changes no bit */
        *b = CGL_R(0.0) + left * *b;
    }
}

/* Learns from the error [rad/s], with the gain [A/rad] that the guard leaves, and returns the learned current [A]. */
static cgl_real follow(cgl_pi_afc *law, const cgl_law_input *in, cgl_real before, cgl_real error, cgl_real gain)
{
    const cgl_real ts = law->pi.loop.ts;
    const uint32_t count = slow_orders(&law->config, in->omega_ref * ts), turns = cgl_turns(in->theta_m);
    if (!CGL_OFTEN(law->learning)) {
        return sum_of_orders(law, count, turns, turns, CGL_R(0.0));
    }
    if (in->gentle > 0U) {
        leak(law, in->gentle, count, gain);
    }
    return sum_of_orders(law, count, turns, cgl_turns(before), cgl_clamp(gain * ts * error, CORRECTION_MOST));
}

void cgl_pi_afc_step(cgl_pi_afc *law, const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_pi_afc_config *const config = &law->config;
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    const cgl_real error = in->omega_ref - in->omega_m, before = in->theta_m - in->omega_ref * config->lead;
    const bool placed = cgl_is_angle(in->theta_m), plausible = placed && cgl_is_finite(error);
    const bool guarded = in->gentle > 0U || in->forget;
    const cgl_real gain = guarded ? config->gain * follow_guard(law, in) : config->gain;
    law->learning = in->learn && gain > CGL_R(0.0) && !cgl_law_stands_by(in) && plausible && cgl_is_angle(before) && !law->pi.saturated
                    && cgl_abs(in->omega_ref) >= config->omega_min;
    law->learned = placed && !in->off ? cgl_law_share(in) * follow(law, in, before, error, gain) : CGL_R(0.0);
    if (law->learning && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, plausible, out);
    }
}
