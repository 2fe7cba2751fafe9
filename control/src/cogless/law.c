#include "law.h"

CGL_SELDOM cgl_real cgl_law_stand_by(const cgl_law_input *in, cgl_real learned, cgl_real limit, cgl_law_output *out)
{
    out->status = (unsigned)CGL_STATUS_FROZEN;
    if (in->off) {
        out->i_q_ref = CGL_R(0.0);
        out->status |= (unsigned)CGL_STATUS_OFF;
        return CGL_R(0.0);
    }
    const bool plausible = cgl_is_finite(in->i_q_ref) && cgl_is_angle(in->theta_m);
    const cgl_real current = cgl_is_finite(in->i_q_ref) ? in->i_q_ref : CGL_R(0.0);
    const cgl_real wanted = current + learned;
    out->i_q_ref = cgl_clamped(wanted, limit);
    out->status |= (cgl_is_below(wanted, limit) ? 0U : (unsigned)CGL_STATUS_SATURATED)
                   | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
    return cgl_clamped(current, limit);
}
