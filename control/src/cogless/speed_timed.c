#include "speed_timed.h"

#include "turns.h"

CGL_SELDOM cgl_error cgl_speed_timed_init(cgl_speed_timed *speed, const cgl_speed_timed_config *config)
{
    static const cgl_edges none = {0U, 0U, 0U, false, false};
    if (!(config->counts >= 1U && cgl_is_positive(config->timer))) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real per_tick = CGL_TWO_PI / (cgl_real)config->counts * config->timer;
    if (!(per_tick * CGL_R(2147483648.0) <= CGL_REAL_MAX)) {
        return CGL_ERROR_CONFIG;
    }
    speed->config = *config;
    speed->per_tick = per_tick;
    cgl_speed_timed_reset(speed, &none, 0U, CGL_R(0.0));
    return CGL_OK;
}

CGL_SELDOM void cgl_speed_timed_reset(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now, cgl_real omega_m)
{
    speed->omega_m = cgl_is_finite(omega_m) ? omega_m : CGL_R(0.0);
    speed->time = CGL_R(0.0);
    speed->count = edges->count;
    speed->edge = edges->time;
    speed->now = now;
    speed->since = now - edges->time;
}

void cgl_edges_pass(cgl_edges *edges, uint32_t count, uint32_t time)
{
    const uint32_t ahead = count - edges->count;
    if (ahead == 0U) {
        return;
    }
    const bool backward = ahead >= 0x80000000U;
    const uint32_t passed = backward ? 0U - ahead : ahead;
    edges->interval = passed == 1U ? time - edges->time : (time - edges->time) / passed;
    edges->reversed = passed == 1U && backward != edges->backward;
    edges->backward = backward;
    edges->count = count;
    edges->time = time;
}

/* a + b, limited to 2^32 - 1. */
static uint32_t sum(uint32_t a, uint32_t b)
{
    return b > UINT32_MAX - a ? UINT32_MAX : a + b;
}

cgl_real cgl_speed_timed_step(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now)
{
    const bool passed = edges->time != speed->edge;
    /* `elapsed` is the time from the edge before the last step to the newest edge. It is summed from the times before and after the last
     * step: the timer may have wrapped between the two edges, so their difference could be wrong. */
    const uint32_t elapsed = sum(speed->since, edges->time - speed->now);
    const uint32_t since = passed ? now - edges->time : sum(speed->since, now - speed->now);
    const cgl_real moved = cgl_steps(speed->count, edges->count);
    cgl_real ticks = (cgl_real)elapsed, counts = moved;
    if (speed->config.last_interval || edges->count == speed->count) {
        counts = edges->reversed ? CGL_R(0.0) : (edges->backward ? CGL_R(-1.0) : CGL_R(1.0));
        ticks = (cgl_real)(edges->interval > since ? edges->interval : since);
    }
    if (ticks > CGL_R(0.0)) {
        speed->omega_m = counts * speed->per_tick / ticks;
        speed->time = ticks / speed->config.timer;
    }
    speed->count = edges->count;
    speed->edge = edges->time;
    speed->now = now;
    speed->since = since;
    return speed->omega_m;
}
