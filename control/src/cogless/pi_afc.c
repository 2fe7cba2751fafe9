#include "pi_afc.h"

#include "angle.h"
#include "range.h"

#define LEAK CGL_R(12.5) /* 2.5 / (1 - 0.8): the leak is 2.5 gain / kp at the guard's step with a forgetting of 0.8 */

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
    (void)cgl_pi_init(&law->pi, &config->pi, loop);
    law->config = *config;
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
    const cgl_pi_afc_config *const config = &law->config;
    cgl_pi_reset(&law->pi);
    for (uint32_t n = 0; n < 2U * config->orders; ++n) {
        law->coefficient[n] = CGL_R(0.0);
    }
    law->learned = CGL_R(0.0);
    law->learning = false;
}

/* Returns the number of orders with a period of more than two samples. `moved` is the angle by which the rotor turns in a sample [rad]. */
static uint32_t slow_orders(const cgl_pi_afc_config *config, cgl_real moved)
{
    uint32_t count = config->orders;
    while (count > 0U && (cgl_real)config->order[count - 1U] * cgl_abs(moved) >= CGL_PI) {
        --count;
    }
    return count;
}

/* Returns the phasor of the order `gap` at the angle `turns` [2^-32 turns]. If `doubled`, the result is the square of `half`, the phasor
 * of gap / 2. */
static cgl_phasor phasor_of_gap(uint32_t gap, uint32_t turns, bool doubled, cgl_phasor half)
{
    return doubled ? cgl_product(half, half) : cgl_phasor_of(gap * turns);
}

/* Learns, and returns the sum of the orders' currents [A] at the angle `turns` [2^-32 turns]. `correction` [A] belongs to the angle
 * `turns_before` [2^-32 turns]. The phasor of an order is the phasor of the order before, times the phasor of the gap between both orders.
 * So sines are computed only where the gap changes. */
static cgl_real sum_of_orders(cgl_pi_afc *law, uint32_t turns, uint32_t turns_before,
                              uint32_t count, cgl_real correction, cgl_real kept)
{
    const cgl_real limit = law->config.limit;
    const bool learning = law->learning;
    const uint32_t *order = law->config.order;
    cgl_real *a = law->coefficient, *b = a + law->config.orders;
    cgl_real sum = CGL_R(0.0);
    cgl_phasor now = {CGL_R(1.0), CGL_R(0.0)}, before = now, gap_now = now, gap_before = now;
    uint32_t last = 0U, gap = 0U;
    for (const cgl_real *const end = a + count; a < end; ++a, ++b, ++order) {
        const uint32_t wide = *order - last;
        if (wide != gap) {
            const bool doubled = wide == 2U * gap;
            gap_now = phasor_of_gap(wide, turns, doubled, gap_now);
            gap_before = phasor_of_gap(wide, turns_before, doubled, gap_before);
            gap = wide;
        }
        last = *order;
        now = cgl_product(now, gap_now);
        if (learning) {
            before = cgl_product(before, gap_before);
            *a = cgl_clamp_here(kept * *a + correction * before.cosine, limit);
            *b = cgl_clamp_here(kept * *b + correction * before.sine, limit);
        }
        sum += *a * now.cosine + *b * now.sine;
    }
    return cgl_clamp(sum, limit);
}

/* Sets the output of a step in which the output is at its limit, an input is not plausible, or nothing is learned. */
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

/* Returns the guard's factor on the learning gain, for which the PI's ki, if above 0, is the bound. Clears the coefficients if the guard
 * says so. *kept is a factor on the coefficients in each sample: a leak, which grows with the guard's step of gentle learning. At the last
 * step but one, the leak lets at most 0.4 of the feedback's own current be learned. */
CGL_SELDOM static cgl_real follow_guard(cgl_pi_afc *law, const cgl_law_input *in, cgl_real *kept)
{
    for (uint32_t n = 0U; in->forget && !cgl_law_stands_by(in) && n < 2U * law->config.orders; ++n) {
        law->coefficient[n] = CGL_R(0.0);
    }
    const cgl_pi_config *const pi = &law->pi.config;
    const cgl_real configured = law->config.gain;
    const cgl_real factor = cgl_gentle_gain(in->gentle, configured, pi->ki > CGL_R(0.0) ? pi->ki : configured);
    const cgl_real leak = LEAK * (CGL_R(1.0) - cgl_gentle_forgetting(in->gentle)) * factor * configured * law->pi.loop.ts;
    *kept = leak > CGL_R(0.0) ? (leak < pi->kp ? CGL_R(1.0) - leak / pi->kp : CGL_R(0.0)) : CGL_R(1.0);
    return factor;
}

void cgl_pi_afc_step(cgl_pi_afc *law, const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_pi_afc_config *const config = &law->config;
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    const cgl_real error = in->omega_ref - in->omega_m, before = in->theta_m - in->omega_ref * config->lead;
    const bool is_angle = cgl_is_angle(in->theta_m), plausible = cgl_is_finite(error) && is_angle;
    const bool guarded = in->gentle > 0U || in->forget;
    cgl_real kept = CGL_R(1.0);
    const cgl_real gain = guarded ? config->gain * follow_guard(law, in, &kept) : config->gain;
    law->learning = in->learn && gain > CGL_R(0.0) && !cgl_law_stands_by(in) && plausible && cgl_is_angle(before) && !law->pi.saturated
                    && cgl_abs(in->omega_ref) >= config->omega_min;
    law->learned = CGL_R(0.0);
    if (cgl_is_angle(in->theta_m) && !in->off) {
        const uint32_t turns = cgl_turns(in->theta_m), turns_before = cgl_is_angle(before) ? cgl_turns(before) : turns;
        law->learned = cgl_law_share(in) * sum_of_orders(law, turns, turns_before, slow_orders(config, in->omega_ref * law->pi.loop.ts),
                                     cgl_clamp(gain * law->pi.loop.ts * error, CGL_REAL_MAX), kept);
    }
    if (law->learning && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, plausible, out);
    }
}
