/* The first ${ticks} periods of scenario ${scenario} as simulated, with controller ${controller}; then an electrical turn in
 * ${turn_steps} steps each way, and references that are not plausible. Bit patterns of references, and of the currents and the
 * status that they must give. Written by cogless ${version}. */
#ifndef ${NAME}_SELF_TEST_DATA_H
#define ${NAME}_SELF_TEST_DATA_H

#include <stdint.h>

typedef struct {
    ${bits} theta_ref, omega_ref, i_a, i_b;
    uint32_t status;
} period;

static const period periods[] = {
${rows}
};

#endif
