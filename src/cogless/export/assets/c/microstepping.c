/* Controller "${controller}" of the study ${study}; see ${stem}.h. Written by cogless ${version}. */
#include "${stem}.h"

const cgl_microstepping_config ${name}_law_config = {
${law_values}
};

cgl_error ${name}_init(${name}_controller *controller)
{
    return cgl_microstepping_init(&controller->law, &${name}_law_config);
}

void ${name}_reset(${name}_controller *controller)
{
    cgl_microstepping_reset(&controller->law);
}

void ${name}_step(${name}_controller *controller, cgl_real theta_ref, cgl_real omega_ref, cgl_microstepping_output *out)
{
    cgl_microstepping_step(&controller->law, theta_ref, omega_ref, out);
}
