/* Dead-time compensation: duty cycles in [0, 1], the delayed reference finite. */
#include "cogless/dead_time.h"

#include "proof.h"

int main(void)
{
    cgl_dead_time_config config = {any_real(), any_real(), any_real(), any_real(), any_real(), any_bits()};
    cgl_dead_time dead_time;
    if (cgl_dead_time_init(&dead_time, &config, any_real()) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_foc_input in = {{any_real(), any_real(), any_real()}, any_real(), any_real(), any_real(), any_real(), any_real()};
        cgl_real duty[3];
        for (int x = 0; x < 3; ++x) {
            duty[x] = any_real();
            if (!(duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0))) {
                return 0;
            }
        }
        if (any_bool()) {
            cgl_dead_time_reset(&dead_time);
        } else {
            cgl_dead_time_step(&dead_time, &in, duty);
            for (int x = 0; x < 3; ++x) {
                Frama_C_show_each_output(duty[x]);
                PROVE(duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0));
            }
        }
    }
    return 0;
}
