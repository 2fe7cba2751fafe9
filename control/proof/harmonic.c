/* PI and ORDERS multiples of any order. */
#include "cogless/harmonic.h"

#include "memories.h"

static cgl_real cell[CGL_HARMONIC_LENGTH(ORDERS)];

int main(void)
{
    const cgl_harmonic_config config = {{any_real(), any_real(), ANY_LIMIT}, any_real(), any_real(), any_real(), any_real(), any_bits(), any_bits(),
                                        ORDERS, any_bits(),
                                        any_real(), any_real(), ANY_LIMIT,
                                        {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(),
                                         any_real()}};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_harmonic law;
    FILL(cell);
    if (cgl_harmonic_init(&law, &config, &loop, cell, sizeof cell / sizeof cell[0]) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_harmonic_reset(&law);
        } else {
            cgl_harmonic_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
            PROVE_WITHIN_LIMIT(law.learned);
        }
        for (uint32_t n = 0; n < 2U * ORDERS; ++n) {
            PROVE_WITHIN_LIMIT(cell[n]);
        }
    }
    return 0;
}
