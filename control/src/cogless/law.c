#include "law.h"

CGL_SELDOM const char *cgl_law_bad_field(const void *config, const cgl_range *range, uint32_t count, const cgl_loop *loop)
{
    static const cgl_range loop_range[] = {CGL_RANGE_OF(cgl_loop, "loop.ts", ts, CGL_POSITIVE),
                                           CGL_RANGE_OF(cgl_loop, "loop.current_limit", current_limit, CGL_POSITIVE)};
    const char *field = CGL_OUT_OF_RANGE(loop, loop_range);
    field = field != 0 ? field : cgl_out_of_range(config, range, count);
    if (field != 0) {
        return field;
    }
    const cgl_range *const last = range + count - 1U;
    const cgl_real limit = *(const cgl_real *)(const void *)((const char *)config + last->offset);
    return limit <= loop->current_limit ? 0 : CGL_RANGE_NAME(last);
}

CGL_SELDOM bool cgl_loop_can_learn(const cgl_loop *loop, cgl_real gain, cgl_real feedback)
{
    return !loop->guarded || !(gain > CGL_R(0.0)) || feedback > CGL_R(0.0);
}

CGL_SELDOM void cgl_law_refuse(cgl_law_output *out)
{
    out->i_q_ref = CGL_R(0.0);
    out->status = (unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_FROZEN | (unsigned)CGL_STATUS_OFF;
}

CGL_SELDOM cgl_real cgl_law_stand_by(const cgl_law_input *in, cgl_real learned, cgl_real limit, cgl_law_output *out)
{
    out->status = (unsigned)CGL_STATUS_FROZEN;
    if (in->off) {
        out->i_q_ref = CGL_R(0.0);
        out->status |= (unsigned)CGL_STATUS_OFF;
        return CGL_R(0.0);
    }
    const bool plausible = cgl_is_finite(in->i_q_ref) && cgl_is_angle(in->theta_m);
    const cgl_real current = cgl_finite_or_zero(in->i_q_ref);
    const cgl_real wanted = current + learned;
    out->i_q_ref = cgl_clamped(wanted, limit);
    out->status |= (cgl_is_below(wanted, limit) ? 0U : (unsigned)CGL_STATUS_SATURATED)
                   | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
    return cgl_clamped(current, limit);
}

#ifndef COGLESS_NO_GUARD
static const cgl_gentle *gentle_step(uint32_t k)
{
    return cgl_gentle_steps + (k < CGL_GUARD_STEPS ? k : CGL_GUARD_STEPS);
}

CGL_SELDOM cgl_real cgl_gentle_gain(uint32_t k, cgl_real gain, cgl_real feedback)
{
    if (k == 0U) {
        return CGL_R(1.0);
    }
    const cgl_gentle *const how = gentle_step(k);
    const cgl_real most = how->most * feedback;
    return how->gain * (gain > most ? most / gain : CGL_R(1.0));
}

CGL_SELDOM cgl_real cgl_gentle_forgetting(uint32_t k)
{
    return gentle_step(k)->forgetting;
}
#endif
