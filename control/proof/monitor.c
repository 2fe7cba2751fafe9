/* Plausibility: what goes on to the law and the current loop is finite, the angle within a turn. */
#include "cogless/monitor.h"

#include "proof.h"

int main(void)
{
    cgl_monitor_config config = {any_real(), any_real(), any_real(), any_real(), any_real(),
                                 any_real(), any_real(), any_real(), any_real(), any_bits()};
    cgl_monitor monitor;
    if (cgl_monitor_init(&monitor, &config, any_real()) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_measurement now = {{any_real(), any_real(), any_real()}, any_real(), any_real(), any_real()};
        if (any_bool()) {
            cgl_monitor_reset(&monitor);
        } else if (any_bool()) {
            cgl_monitor_trust(&monitor);
        } else {
            cgl_monitor_step(&monitor, &now, any_real(), any_bool());
        }
        Frama_C_show_each_output(monitor.theta_m);
        PROVE(monitor.theta_m >= CGL_R(0.0) && monitor.theta_m <= CGL_TWO_PI);
    }
    return 0;
}
