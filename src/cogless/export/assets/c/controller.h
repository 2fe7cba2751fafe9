/* Controller "${controller}" of the study ${study}:
${title_comment}
 *
 * Written by cogless ${version}; change the study and export again rather than this file. The configured constants are
 * in ${stem}.c, together with what `cogless design` finds.
 *
 * law              ${law}
${verdict_comment} * study            ${study}, sha256 of its tables:
 *                  ${hash}
 * precision        ${precision}
 * ${name}_step is called ${rate} times a second, the law runs ${law_rate} times a second
 */
#ifndef ${NAME}_CONTROLLER_H
#define ${NAME}_CONTROLLER_H

${part_includes}#include "cogless/drive.h"

${macro_checks}

#include "cogless/${law_header}"

#ifdef __cplusplus
extern "C" {
#endif

#define ${NAME}_PERIOD ${period} /* between two steps [s] */
#define ${NAME}_DIVIDER ${divider}U /* steps in a period of the law */
${memory_define}
/* All that changes, without a heap or pointers to the outside. It points into itself: do not copy or move it. */
typedef struct {
    cgl_drive drive;
    ${law_state} law;
${part_members}${memory_member}} ${name}_controller;

/* The configured constants; they can stay in flash. */
extern const cgl_drive_config ${name}_drive_config;
extern const ${law_config} ${name}_law_config;
${part_declarations}
/* Once, before the first step. Do not run the motor where this is not CGL_OK. */
cgl_error ${name}_init(${name}_controller *controller);

/* ${reset_comment} */
void ${name}_reset(${name}_controller *controller);

/* One period: measurements and references in, ${out_words} and status out. Never fails, whatever comes in. */
void ${name}_step(${name}_controller *controller, const cgl_measurement *now, const cgl_reference *reference,
     ${pad}      cgl_drive_output *out);
${more_declarations}
#ifdef __cplusplus
}
#endif

#endif
