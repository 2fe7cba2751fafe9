/* Speed by counting (method M): the counts by which an encoder or a converter has moved in a window, divided by the window's time. The
 * result is the mean speed over the window. The resolution of this speed is one count per window. */
#ifndef COGLESS_SPEED_COUNT_H
#define COGLESS_SPEED_COUNT_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t counts; /* counts of the sensor in a revolution, four per line of an encoder, 1 to 2^32 - 1 */
    uint32_t window; /* length of the window [steps], 1 to 2^20 */
} cgl_speed_count_config;

typedef struct {
    cgl_speed_count_config config;
    cgl_real step;      /* angle of a count [rad] */
    cgl_real time;      /* length of the window [s] */
    uint32_t *before;   /* caller's memory: a ring with the sensor's count at each of the last `window` steps */
    uint32_t oldest;    /* index of the oldest entry of the ring */
} cgl_speed_count;

/* Copies the config. The caller's memory at `before`, of `window` entries or more, is used from then on. ts is the period of the steps [s],
 * > 0. The rotor counts as standing at count 0. */
cgl_error cgl_speed_count_init(cgl_speed_count *speed, const cgl_speed_count_config *config, cgl_real ts, uint32_t *before,
                               uint32_t length);

/* Starts with a rotor that stands at this count. The run time of this function grows with the window. */
void cgl_speed_count_reset(cgl_speed_count *speed, uint32_t count);

/* Returns the mechanical speed [rad/s]. The count grows forward and wraps at 2^32. The speed must be below 2^31 counts in a window. */
cgl_real cgl_speed_count_step(cgl_speed_count *speed, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
