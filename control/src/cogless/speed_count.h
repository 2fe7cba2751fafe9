/* Speed by counting (M): the counts that an encoder or a converter moved in a window, over the window's time. The mean over the
 * window, in steps of a count over its time. */
#ifndef COGLESS_SPEED_COUNT_H
#define COGLESS_SPEED_COUNT_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t counts; /* of the sensor in a revolution, four a line of an encoder, 1 to 2^32 - 1 */
    uint32_t window; /* steps that are looked back over, 1 to 2^20 */
} cgl_speed_count_config;

typedef struct {
    cgl_speed_count_config config;
    cgl_real step;      /* angle of a count [rad] */
    cgl_real time;      /* of the window [s] */
    uint32_t *before;   /* the caller's: counts of the last `window` steps */
    uint32_t oldest;    /* of them */
} cgl_speed_count;

/* Takes the config, which need not stay, and `window` entries at `before`, which it keeps using; ts: period of the steps [s],
 * > 0. The rotor counts as standing at count 0. */
cgl_error cgl_speed_count_init(cgl_speed_count *speed, const cgl_speed_count_config *config, cgl_real ts, uint32_t *before,
                               uint32_t length);

/* The rotor stands at this count: call it once the sensor is there. Takes the time of a whole window. */
void cgl_speed_count_reset(cgl_speed_count *speed, uint32_t count);

/* The mechanical speed [rad/s]. count: any, growing forward, wraps at 2^32; right below 2^31 counts in a window. */
cgl_real cgl_speed_count_step(cgl_speed_count *speed, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
