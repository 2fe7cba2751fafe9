/* The first trials of scenario ${scenario} as simulated, with controller ${controller}: bit patterns of reference and
 * measured states at each sample, and of the input and the status that they must give. Written by cogless ${version}. */
#ifndef ${NAME}_SELF_TEST_DATA_H
#define ${NAME}_SELF_TEST_DATA_H

#include <stdint.h>

enum { TRIALS = ${trials} };

typedef struct {
    uint64_t y_ref, x[${states}], u;
    uint32_t status;
} sample;

static const sample samples[] = {
${rows}
};

#endif
