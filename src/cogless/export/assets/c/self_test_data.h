/* The first ${ticks} periods of scenario ${scenario} as simulated, with controller ${controller}: bit patterns of
 * measurements and references, and of the outputs that they must give. Written by cogless ${version}. */
#ifndef ${NAME}_SELF_TEST_DATA_H
#define ${NAME}_SELF_TEST_DATA_H

#include <stdint.h>

enum { TICKS = ${ticks}, INPUTS = ${input_count}, OUTPUTS = ${output_count} };
${start_data}
/* ${input_names} */
static const ${bits} inputs[TICKS][INPUTS] = {
${inputs}
};

/* ${output_names} */
static const ${bits} outputs[TICKS][OUTPUTS] = {
${outputs}
};
${end_data}
#endif
