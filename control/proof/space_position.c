/* Position law that learns by angle, with a map or a line. */
#include "cogless/space_position.h"

#include "memories.h"

static cgl_real cell[LENGTH];

int main(void)
{
    cgl_space_position_config config = {any_bits(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), any_bool(), any_real(), any_real(), any_bool() ? CGL_SPACE_BY_REFERENCE : CGL_SPACE_BY_ROTOR, ANY_LIMIT, any_memory()};
    /* any_bool() would double the paths, each time */
    const cgl_loop loop = {any_real(), any_real(), (any_bits() & 1U) != 0U, (any_bits() & 1U) != 0U};
    cgl_space_position law;
    FILL(cell);
    if (cgl_space_position_init(&law, &config, &loop, cell, sizeof cell / sizeof cell[0]) != CGL_OK) {
        return 0;
    }
    //@ widen_hints global:"all", Q_HALF_WIDTH, CELLS - 1, CELLS + Q_HALF_WIDTH, CELLS + Q_HALF_WIDTH + 1;
    while (any_bool()) {
        const cgl_law_input in = any_input();
        cgl_law_output out;
        if (any_bool()) {
            cgl_space_position_reset(&law);
        } else {
            cgl_space_position_step(&law, &in, &out);
            PROVE_OUTPUT(out.i_q_ref);
        }
    }
    return 0;
}
