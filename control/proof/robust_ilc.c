/* Robust learning, with its memory as a map or a line. */
#include "cogless/robust_ilc.h"

#include "memories.h"

static cgl_real cell[LENGTH];

int main(void)
{
    cgl_robust_ilc_config config = {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), ANY_LIMIT, any_memory()};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_robust_ilc law;
    FILL(cell);
    if (cgl_robust_ilc_init(&law, &config, &loop, cell, sizeof cell / sizeof cell[0]) != CGL_OK) {
        return 0;
    }
    //@ widen_hints global:"all", Q_HALF_WIDTH, CELLS - 1, CELLS + Q_HALF_WIDTH, CELLS + Q_HALF_WIDTH + 1;
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_robust_ilc_reset(&law);
        } else {
            cgl_robust_ilc_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
        }
        PROVE_ENTRIES(cell);
    }
    return 0;
}
