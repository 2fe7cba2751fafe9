/* Active disturbance rejection. */
#include "cogless/adrc.h"

#include "proof.h"

int main(void)
{
    cgl_adrc_config config = {any_real(), any_real(), any_real(), ANY_LIMIT};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_adrc law;
    if (cgl_adrc_init(&law, &config, &loop) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_adrc_reset(&law);
        } else {
            cgl_adrc_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
        }
        PROVE(is_number(law.omega));
        PROVE(is_number(law.f));
        PROVE_WITHIN_LIMIT(law.before);
    }
    return 0;
}
