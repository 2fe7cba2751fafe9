/* Current control: duty cycles in [0, 1], integrals finite. */
#include "cogless/foc.h"

#include "proof.h"

int main(void)
{
    cgl_foc_config config = {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(),
                             any_bool(), any_real(), any_real(), any_real(), any_bits()};
    cgl_foc foc;
    if (cgl_foc_init(&foc, &config, any_real()) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_foc_input in = {{any_real(), any_real(), any_real()}, any_real(), any_real(), any_real(), any_real(), any_real()};
        cgl_foc_output out;
        if (any_bool()) {
            cgl_foc_reset(&foc);
        } else {
            cgl_foc_step(&foc, &in, &out);
            for (int x = 0; x < 3; ++x) {
                Frama_C_show_each_output(out.duty[x]);
                PROVE(out.duty[x] >= CGL_R(0.0) && out.duty[x] <= CGL_R(1.0));
            }
        }
        PROVE(is_number(foc.integral_d) && cgl_is_finite_as_written(foc.integral_q));
    }
    return 0;
}
