#include "modulation.h"

#include "duties.h"

CGL_SELDOM void cgl_modulate(cgl_real u_alpha, cgl_real u_beta, cgl_real u_dc, cgl_real duty[3])
{
    if (!(cgl_is_positive(u_dc) && cgl_is_finite(u_alpha) && cgl_is_finite(u_beta))) {
        duty[0] = duty[1] = duty[2] = CGL_R(0.5);
        return;
    }
    cgl_real part[3];
    /* a voltage of 1e9 times the bus voltage is far beyond the limit of every duty cycle */
    cgl_centred(cgl_clamped(u_alpha / u_dc, CGL_R(1.0e9)), cgl_clamped(u_beta / u_dc, CGL_R(1.0e9)), part);
    cgl_duties(part, duty);
}
