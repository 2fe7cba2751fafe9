/* An example of the interrupt, ${rate} times a second. The functions that begin with board_ are yours. */
#include "${stem}.h"
${motion_includes}
void board_measure(cgl_measurement *now); /* zero and signs: README.md */
${motion_declarations}${board_act_declaration}
bool motor_start(void);
void current_loop_interrupt(void);
${example_declarations}
static ${name}_controller controller;
${motion_definitions}
/* ${reference_comment}
 * Code outside the interrupt that changes it must shut the interrupt out meanwhile. */
static cgl_reference reference = {.learn = true};

/* Once, before the interrupt is enabled. Where it returns false do not run the motor. */
bool motor_start(void)
{
    return ${name}_init(&controller) == CGL_OK${motion_start};
}

void current_loop_interrupt(void)
{
    cgl_measurement now;
    cgl_drive_output out; /* out.status: CGL_STATUS_ bits */
    board_measure(&now);
${motion_call}    ${name}_step(&controller, &now, &reference, &out);
    ${board_act}
}
${example_definitions}