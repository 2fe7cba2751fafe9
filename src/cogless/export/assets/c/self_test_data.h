/* The first ${ticks} periods of scenario ${scenario} as simulated, with controller ${controller}: bit patterns of
 * measurements and references, and of the outputs that they must give. Written by cogless ${version}. */
#ifndef ${NAME}_SELF_TEST_DATA_H
#define ${NAME}_SELF_TEST_DATA_H

#include <stdint.h>

enum {
    TICKS = ${ticks},
    INPUTS = ${input_count},
    OUTPUTS = ${output_count},
    STRETCHES = ${stretch_count},
    COUNTS = ${counts} /* of the angle in a revolution */
};
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
/* Inputs that a simulation without events never meets. After a fresh start, stretches of periods in which only the angle moves:
 * it begins at `counts` and goes on by `step`. in: as bit patterns, but theta_m, to which the counts are added,
 * ${stretch_names}.
 * sum: FNV-1a of all outputs, word by word. */
typedef struct {
    uint32_t periods, counts, step;
    ${bits} in[${stretch_inputs}];
    uint32_t sum;
} stretch;

static const stretch stretches[STRETCHES] = {
${stretches}
};

#endif
