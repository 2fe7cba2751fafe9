/* PI: the scalar, and the speed law. */
#include "cogless/speed_pi.h"

#include "proof.h"

int main(void)
{
    cgl_pi_config config = {any_real(), any_real(), ANY_LIMIT};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_pi pi;
    if (cgl_pi_init(&pi, &config, &loop) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_pi_reset(&pi);
        } else if (any_bool()) {
            cgl_speed_pi_step(&pi, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
        } else {
            PROVE_OUTPUT(cgl_pi_step(&pi, any_real(), any_real()));
        }
        PROVE_WITHIN_LIMIT(pi.integral);
    }
    return 0;
}
