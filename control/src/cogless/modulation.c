#include "modulation.h"

#include "transform.h"

void cgl_modulate(cgl_real u_alpha, cgl_real u_beta, cgl_real u_dc, cgl_real duty[3])
{
    cgl_real u[3];
    cgl_clarke_inverse(u_alpha, u_beta, u);
    if (!(u_dc > CGL_R(0.0) && cgl_is_finite(u_dc) && cgl_is_finite(u[0]) && cgl_is_finite(u[1])
          && cgl_is_finite(u[2]))) {
        duty[0] = duty[1] = duty[2] = CGL_R(0.5);
        return;
    }
    cgl_real highest = u[0] > u[1] ? u[0] : u[1];
    cgl_real lowest = u[0] < u[1] ? u[0] : u[1];
    highest = u[2] > highest ? u[2] : highest;
    lowest = u[2] < lowest ? u[2] : lowest;
    const cgl_real centre = CGL_R(0.5) * (highest + lowest);
    for (int x = 0; x < 3; ++x) {
        duty[x] = CGL_R(0.5) + cgl_clamp((u[x] - centre) / u_dc, CGL_R(0.5));
    }
}
