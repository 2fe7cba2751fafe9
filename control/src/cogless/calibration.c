#include "calibration.h"

#include "angle.h"
#include "range.h"

#define POLE_PAIRS_MAX 10000U
#define STEPS_MAX CGL_R(1.0e9)

CGL_SELDOM cgl_error cgl_offsets_init(cgl_offsets *offsets, const cgl_offsets_config *config)
{
    static const cgl_range range[] = {CGL_RANGE(offsets, samples, CGL_COUNT),
                                      CGL_RANGE(offsets, largest, CGL_POSITIVE),
                                      CGL_RANGE(offsets, spread, CGL_POSITIVE)};
    if (!(CGL_IS_IN_RANGE(config, range) && (config->phases == 2U || config->phases == 3U))) {
        return CGL_ERROR_CONFIG;
    }
    offsets->config = *config;
    cgl_offsets_reset(offsets);
    return CGL_OK;
}

CGL_SELDOM void cgl_offsets_reset(cgl_offsets *offsets)
{
    for (int x = 0; x < 3; ++x) {
        offsets->mean[x] = offsets->low[x] = offsets->high[x] = CGL_R(0.0);
    }
    offsets->count = 0U;
    offsets->result = CGL_CALIBRATION_BUSY;
}

cgl_calibration cgl_offsets_step(cgl_offsets *offsets, const cgl_real i_abc[3])
{
    if (offsets->result != CGL_CALIBRATION_BUSY) {
        return offsets->result;
    }
    const bool first = offsets->count == 0U;
    ++offsets->count;
    const bool last = offsets->count >= offsets->config.samples;
    for (uint32_t x = 0; x < offsets->config.phases; ++x) {
        const cgl_real i = i_abc[x];
        const cgl_real low = first || i < offsets->low[x] ? i : offsets->low[x];
        const cgl_real high = first || i > offsets->high[x] ? i : offsets->high[x];
        /* the comparison is false for NaN; the mean of finite numbers within the spread is finite */
        if (!(cgl_is_finite(i) && high - low <= offsets->config.spread)) {
            offsets->result = CGL_CALIBRATION_FAILED;
            return offsets->result;
        }
        offsets->low[x] = low;
        offsets->high[x] = high;
        offsets->mean[x] = first ? i : offsets->mean[x] + (i - offsets->mean[x]) / (cgl_real)offsets->count;
        if (last && !cgl_is_within(offsets->mean[x], offsets->config.largest)) {
            offsets->result = CGL_CALIBRATION_FAILED;
            return offsets->result;
        }
    }
    if (last) {
        offsets->result = CGL_CALIBRATION_DONE;
    }
    return offsets->result;
}

/* Stages of the alignment. In each stage but the last the field goes to the stage's place, the rotor comes to rest, and the rotor's angle
 * is read. In FALL the current falls to 0. */
enum { RISE, FORWARD_HALF, FORWARD_REST, BACK, FALL };

CGL_SELDOM cgl_error cgl_align_init(cgl_align *align, const cgl_align_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(align, current, CGL_POSITIVE),
                                      CGL_RANGE(align, ramp, CGL_POSITIVE),
                                      CGL_RANGE(align, sweep, CGL_POSITIVE),
                                      CGL_RANGE(align, speed, CGL_POSITIVE),
                                      CGL_RANGE(align, settle, CGL_POSITIVE),
                                      CGL_RANGE(align, tolerance, CGL_POSITIVE)};
    cgl_align_config full = *config;
    full.sweep = cgl_or_default(full.sweep, CGL_R(0.5) * CGL_PI);
    full.tolerance = cgl_or_default(full.tolerance, CGL_R(0.25));
    if (!(CGL_IS_IN_RANGE(&full, range) && cgl_is_positive(ts) && full.pole_pairs >= 1U
          && full.pole_pairs <= POLE_PAIRS_MAX && full.sweep <= CGL_PI && full.tolerance < CGL_R(1.0)
          && full.ramp <= STEPS_MAX * ts && full.settle <= STEPS_MAX * ts
          && full.sweep <= STEPS_MAX * ts * full.speed)) {
        return CGL_ERROR_CONFIG;
    }
    align->config = full;
    align->ts = ts;
    cgl_align_reset(align);
    return CGL_OK;
}

CGL_SELDOM void cgl_align_reset(cgl_align *align)
{
    align->theta_e = -align->config.sweep;
    align->current = align->theta_m = align->zero = align->apart = CGL_R(0.0);
    align->far[0] = align->far[1] = align->near[0] = align->near[1] = CGL_R(0.0);
    align->stage = RISE;
    align->wait = 0U;
    align->result = CGL_CALIBRATION_BUSY;
}

/* Returns x, moved towards `to` by at most `step`. */
static cgl_real toward(cgl_real x, cgl_real to, cgl_real step)
{
    return cgl_is_within(to - x, step) ? to : x + (to > x ? step : -step);
}

/* Whether the rotor has gone as far as the field, within the tolerance and in the same direction. */
static bool has_followed(const cgl_align *align)
{
    const cgl_real way = CGL_R(2.0) * align->config.sweep / (cgl_real)align->config.pole_pairs;
    return cgl_is_within(align->far[1] - align->far[0] - way, align->config.tolerance * way);
}

/* Stores the rotor's angle at the end of a stage, with the rotor at rest. Begins the next stage. */
static void read(cgl_align *align)
{
    switch (align->stage) {
    case RISE:
        align->far[0] = align->theta_m;
        break;
    case FORWARD_HALF:
        align->near[0] = align->theta_m;
        break;
    case FORWARD_REST:
        align->far[1] = align->theta_m;
        break;
    default:
        align->near[1] = align->theta_m;
        align->zero = CGL_R(0.5) * (align->near[0] + align->near[1]);
        align->apart = CGL_R(0.5) * (align->near[1] - align->near[0]);
        break;
    }
    ++align->stage;
}

/* Ends the alignment with its result. */
static void end(cgl_align *align)
{
    /* a rotor that sticks or turns against the field also ends where it began: only its way from far[0] to far[1] shows the fault */
    const bool followed = has_followed(align) && cgl_abs(align->apart) * (cgl_real)align->config.pole_pairs
                                                     <= align->config.sweep;
    align->zero = cgl_unwrap(align->zero, CGL_R(0.0));
    align->result = followed ? CGL_CALIBRATION_DONE : CGL_CALIBRATION_FAILED;
}

cgl_calibration cgl_align_step(cgl_align *align, cgl_real theta_m, cgl_align_output *out)
{
    /* electrical angle of the field at the end of each stage, as a multiple of config->sweep */
    static const cgl_real place[] = {CGL_R(-1.0), CGL_R(0.0), CGL_R(1.0), CGL_R(0.0), CGL_R(0.0)};
    const cgl_align_config *const config = &align->config;
    const cgl_real ts = align->ts;
    if (align->result == CGL_CALIBRATION_BUSY && !cgl_is_angle(theta_m)) {
        align->result = CGL_CALIBRATION_FAILED;
    }
    if (align->result != CGL_CALIBRATION_BUSY) {
        align->current = CGL_R(0.0);
        out->theta_e = align->theta_e;
        out->omega_e = out->i_d_ref = CGL_R(0.0);
        return align->result;
    }
    align->theta_m = cgl_unwrap(theta_m, align->theta_m);
    const bool falls = align->stage == FALL;
    const cgl_real before = align->theta_e, to = place[align->stage] * config->sweep;
    const cgl_real wanted = falls ? CGL_R(0.0) : config->current;
    align->current = toward(align->current, wanted, config->current * (ts / config->ramp));
    const bool there = !(align->current < wanted) && !(align->current > wanted);
    if (there && !falls) {
        align->theta_e = toward(before, to, config->speed * ts);
    }
    if (there && falls) {
        end(align);
    } else if (there && !(align->theta_e < to) && !(align->theta_e > to)) {
        if (align->wait == 0U) {
            align->wait = (uint32_t)(config->settle / ts) + 2U;
        }
        if (--align->wait == 1U) {
            align->wait = 0U;
            read(align);
        }
    }
    out->theta_e = align->theta_e;
    out->omega_e = (align->theta_e - before) / ts;
    out->i_d_ref = align->current;
    return align->result;
}
