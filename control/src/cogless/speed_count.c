#include "speed_count.h"

#include <stddef.h>

#include "turns.h"

#define WINDOW_MAX 1048576U

CGL_SELDOM cgl_error cgl_speed_count_init(cgl_speed_count *speed, const cgl_speed_count_config *config, cgl_real ts,
                                          uint32_t *before, uint32_t length)
{
    if (!(config->counts >= 1U && config->window >= 1U && config->window <= WINDOW_MAX && cgl_is_positive(ts))) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real step = CGL_TWO_PI / (cgl_real)config->counts, time = (cgl_real)config->window * ts;
    if (!(step * CGL_R(2147483648.0) / time <= CGL_REAL_MAX && cgl_is_finite(time))) {
        return CGL_ERROR_CONFIG;
    }
    if (before == NULL || length < config->window) {
        return CGL_ERROR_MEMORY;
    }
    speed->config = *config;
    speed->step = step;
    speed->time = time;
    speed->before = before;
    cgl_speed_count_reset(speed, 0U);
    return CGL_OK;
}

CGL_SELDOM void cgl_speed_count_reset(cgl_speed_count *speed, uint32_t count)
{
    for (uint32_t n = 0; n < speed->config.window; ++n) {
        speed->before[n] = count;
    }
    speed->oldest = 0U;
}

cgl_real cgl_speed_count_step(cgl_speed_count *speed, uint32_t count)
{
    uint32_t *const then = &speed->before[speed->oldest];
    const cgl_real moved = cgl_steps(*then, count);
    *then = count;
    speed->oldest = speed->oldest + 1U < speed->config.window ? speed->oldest + 1U : 0U;
    return moved * speed->step / speed->time;
}
