/* The leaves: angles, modulation, stability of filters. */
#include "cogless/angle.h"
#include "cogless/modulation.h"
#include "cogless/polynomial.h"
#include "proof.h"

int main(void)
{
    cgl_real sine, cosine, duty[3], a[CGL_POLYNOMIAL_ORDER + 1];
    cgl_sincos(any_real(), &sine, &cosine);
    const cgl_real fraction = cgl_fraction(any_real());
    PROVE(fraction >= CGL_R(0.0) && fraction < CGL_R(1.0));
    (void)cgl_unwrap(any_real(), any_real());
    cgl_modulate(any_real(), any_real(), any_real(), duty);
    for (int x = 0; x < 3; ++x) {
        Frama_C_show_each_output(duty[x]);
        PROVE(duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0));
    }
    fill_any(a, CGL_POLYNOMIAL_ORDER + 1U);
    for (uint32_t order = 0; order <= CGL_POLYNOMIAL_ORDER + 1U; ++order) {
        (void)cgl_is_stable(a, order);
    }
    return 0;
}
