/* PI and a table, with calibration runs begun at any time. */
#include "cogless/anti_cogging.h"

#include "memories.h"

static cgl_real table[CELLS];

int main(void)
{
    cgl_anti_cogging_config config = {{any_real(), any_real(), ANY_LIMIT}, CELLS, any_real(), any_bits(), any_real(), any_real()};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_anti_cogging law;
    FILL(table);
    if (cgl_anti_cogging_init(&law, &config, &loop, table, sizeof table / sizeof table[0]) != CGL_OK) {
        return 0;
    }
    /*@ loop widen_hints law.turns, -1000, 1000; */
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_anti_cogging_calibrate(&law);
        } else if (any_bool()) {
            cgl_anti_cogging_reset(&law);
        } else {
            cgl_anti_cogging_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
            PROVE_WITHIN_LIMIT(law.looked_up);
        }
    }
    return 0;
}
