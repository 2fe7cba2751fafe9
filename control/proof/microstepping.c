/* Microstepping: the coils' currents within their amplitude, whatever the reference. */
#include "cogless/microstepping.h"

#include "proof.h"

static void any_waves(cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES])
{
    for (uint32_t k = 0U; k < (uint32_t)CGL_MICROSTEPPING_WAVES; ++k) {
        wave[k].order = any_bits();
        wave[k].magnitude = any_real();
        wave[k].phase = any_real();
    }
}

int main(void)
{
    cgl_microstepping_config config;
    cgl_microstepping motor;
    config.teeth = any_bits();
    config.current = ANY_LIMIT;
    config.microsteps = any_bits();
    any_waves(config.forward);
    any_waves(config.backward);
    if (cgl_microstepping_init(&motor, &config) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        cgl_microstepping_output out;
        if (any_bool()) {
            cgl_microstepping_reset(&motor);
        } else {
            cgl_microstepping_step(&motor, any_real(), any_real(), &out);
            PROVE_OUTPUT(out.i_a);
            PROVE_OUTPUT(out.i_b);
        }
    }
    return 0;
}
