#include "speed_pi.h"

void cgl_speed_pi_step(const cgl_pi_config *config, cgl_pi *pi, const cgl_speed_input *in, cgl_speed_output *out)
{
    const cgl_real error = in->omega_ref - in->omega_m;
    out->i_q_ref = cgl_pi_step(config, pi, error, CGL_R(0.0));
    out->status = (pi->saturated ? (unsigned)CGL_STATUS_SATURATED : 0U)
                  | (cgl_is_finite(error) ? 0U : (unsigned)CGL_STATUS_FAULT);
}
