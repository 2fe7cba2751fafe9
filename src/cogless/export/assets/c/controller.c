/* Controller "${controller}" of the study ${study}; see ${stem}.h. Written by cogless ${version}. */
#include "${stem}.h"
${matrix}
const cgl_drive_config ${name}_drive_config = {
${drive_config}
};

const ${law_config} ${name}_law_config = {
${law_values}
};
${part_configs}
cgl_error ${name}_init(${name}_controller *controller)
{
    const cgl_error error = cgl_drive_init(&controller->drive, &${name}_drive_config, ${period});
    if (error != CGL_OK) {
        return error;
    }
${part_inits}    return ${init_call};
}

void ${name}_reset(${name}_controller *controller)
{
    cgl_drive_reset(&controller->drive);
    ${reset_call};
${part_resets}}

void ${name}_step(${name}_controller *controller, const cgl_measurement *now, const cgl_reference *reference,
     ${pad}      cgl_drive_output *out)
{
    cgl_drive *drive = &controller->drive;
    if (cgl_drive_measure(drive, now, reference)) {
        ${law_step}(&controller->law, &drive->in, &drive->command);
${convert}    }
    ${actuate};
${compensate}}
${more_definitions}
/* What `cogless design` finds, for scenario ${scenario}:
 *
${figures}
 */
