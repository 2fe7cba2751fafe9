/* PI and ORDERS Fourier coefficients, of any orders. */
#include "cogless/pi_afc.h"

#include "memories.h"

static cgl_real coefficient[CGL_PI_AFC_LENGTH(ORDERS)];

int main(void)
{
    cgl_pi_afc_config config = {{any_real(), any_real(), ANY_LIMIT}, ORDERS, {0U}, any_real(), any_real(), any_real(), ANY_LIMIT};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_pi_afc law;
    for (uint32_t k = 0; k < ORDERS; ++k) {
        config.order[k] = any_bits();
    }
    FILL(coefficient);
    if (cgl_pi_afc_init(&law, &config, &loop, coefficient, sizeof coefficient / sizeof coefficient[0]) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_pi_afc_reset(&law);
        } else {
            cgl_pi_afc_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
            PROVE_WITHIN_LIMIT(law.learned);
        }
        for (uint32_t n = 0; n < 2U * ORDERS; ++n) {
            PROVE_WITHIN_LIMIT(coefficient[n]);
        }
    }
    return 0;
}
