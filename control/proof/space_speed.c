/* Speed law that learns by angle, with a map or a line. */
#include "cogless/space_speed.h"

#include "memories.h"

static cgl_real cell[LENGTH];

int main(void)
{
    cgl_space_speed_config config = {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), ANY_LIMIT, any_bits(), any_memory()};
    const cgl_loop loop = {any_real(), any_real(), any_bool(), any_bool()};
    cgl_space_speed law;
    FILL(cell);
    if (cgl_space_speed_init(&law, &config, &loop, cell, sizeof cell / sizeof cell[0]) != CGL_OK) {
        return 0;
    }
    //@ widen_hints global:"all", Q_HALF_WIDTH, CELLS - 1, CELLS + Q_HALF_WIDTH, CELLS + Q_HALF_WIDTH + 1;
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_space_speed_reset(&law);
        } else {
            cgl_space_speed_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
        }
    }
    return 0;
}
