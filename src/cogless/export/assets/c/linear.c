/* Controller "${controller}" of the study ${study}; see ${stem}.h. Written by cogless ${version}. */
#include "${stem}.h"
${matrix}
const cgl_trial_config ${name}_law_config = {
${law_values}
};

cgl_error ${name}_init(${name}_controller *controller)
{
    return cgl_trial_init(&controller->law, &${name}_law_config, controller->memory, ${NAME}_MEMORY_LENGTH);
}

void ${name}_begin(${name}_controller *controller, const cgl_real *y_ref)
{
    cgl_trial_begin(&controller->law, y_ref);
}

void ${name}_step(${name}_controller *controller, const cgl_trial_input *in, cgl_trial_output *out)
{
    cgl_trial_step(&controller->law, in, out);
}

bool ${name}_end(${name}_controller *controller)
{
    return cgl_trial_end(&controller->law);
}

/* What `cogless design` finds, for scenario ${scenario}:
 *
${figures}
 */
