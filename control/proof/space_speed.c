/* Speed law that learns by angle, with a map or (DELAY) a delay line. */
#include "cogless/space_speed.h"

#include "memories.h"

static cgl_real cell[CGL_SPACE_MEMORY_LENGTH(SPACE_KIND, CHANNELS, CELLS, Q_HALF_WIDTH)];

int main(void)
{
    cgl_space_speed_config config = {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(), ANY_LIMIT, any_bits(), any_space_memory()};
    cgl_space_speed law;
    FILL(cell);
    if (cgl_space_speed_init(&law, &config, any_real(), cell, sizeof cell / sizeof cell[0]) != CGL_OK) {
        return 0;
    }
    //@ widen_hints global:"all", CELLS - 1, CELLS + Q_HALF_WIDTH, CELLS + Q_HALF_WIDTH + 1;
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
