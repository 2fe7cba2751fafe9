#include "speed_pi.h"

CGL_SELDOM static void limited(cgl_pi *pi, cgl_real error, cgl_law_output *out)
{
    out->i_q_ref = cgl_pi_step(pi, error, CGL_R(0.0));
    out->status = (unsigned)CGL_STATUS_FROZEN | (pi->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U)
                  | (cgl_is_finite(error) ? 0U : (unsigned)CGL_STATUS_FAULT);
}

void cgl_speed_pi_step(cgl_pi *pi, const cgl_law_input *in, cgl_law_output *out)
{
    if (!CGL_OFTEN(pi->ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (cgl_law_stands_by(in)) {
        cgl_pi_start(pi, cgl_law_stand_by(in, CGL_R(0.0), pi->config.limit, out));
        return;
    }
    const cgl_real error = in->omega_ref - in->omega_m;
    if (cgl_pi_step_free(pi, error, CGL_R(0.0), &out->i_q_ref)) {
        out->status = (unsigned)CGL_STATUS_FROZEN;
    } else {
        limited(pi, error, out);
    }
}
