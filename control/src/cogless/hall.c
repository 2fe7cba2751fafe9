#include "hall.h"

#define SECTORS 6U
#define POLE_PAIRS_MAX 10000U
#define LATE CGL_R(1.5) /* number of mean intervals after which an edge is overdue. An edge comes this late if it is 15 electrical degrees
                          late and the edge before was as much early */

CGL_SELDOM cgl_error cgl_hall_init(cgl_hall *hall, const cgl_hall_config *config)
{
    if (!(config->pole_pairs >= 1U && config->pole_pairs <= POLE_PAIRS_MAX && config->edges >= 1U
          && config->edges <= CGL_HALL_EDGES && cgl_is_positive(config->timer))) {
        return CGL_ERROR_CONFIG;
    }
    const uint32_t sectors = SECTORS * config->pole_pairs;
    const cgl_real per_tick = CGL_TWO_PI / (cgl_real)sectors * config->timer;
    if (!(per_tick * CGL_R(16.0) <= CGL_REAL_MAX)) {
        return CGL_ERROR_CONFIG;
    }
    hall->config = *config;
    hall->per_tick = per_tick;
    hall->sectors = sectors;
    cgl_hall_reset(hall, 0U);
    return CGL_OK;
}

/* a + b, limited to 2^32 - 1. */
static uint32_t sum(uint32_t a, uint32_t b)
{
    return b > UINT32_MAX - a ? UINT32_MAX : a + b;
}

/* Puts the angle at this share of the present sector. A share of 0 is the begin of the sector, where its angle is least. */
static void put(cgl_hall *hall, cgl_real share)
{
    const uint32_t sector = UINT32_MAX / hall->sectors;
    hall->turns = cgl_share_of_turn(hall->position, hall->sectors) + (uint32_t)(cgl_clamp(share, CGL_R(0.9999)) * (cgl_real)sector);
}

CGL_SELDOM void cgl_hall_reset(cgl_hall *hall, uint32_t position)
{
    hall->position = position % hall->sectors;
    hall->last = hall->known = hall->now = hall->since = 0U;
    hall->timed = hall->backward = false;
    hall->omega_m = CGL_R(0.0);
    put(hall, CGL_R(0.5));
}

/* Takes an edge that comes `elapsed` [ticks] after the edge before, and that passes this many sectors. */
static void pass(cgl_hall *hall, uint32_t sectors, bool backward, uint32_t elapsed)
{
    if (!hall->timed || backward != hall->backward) {
        hall->known = 0U; /* no interval is measured: a reversal passes the same edge twice, and before a first edge there is no edge */
    } else {
        for (uint32_t n = 0; n < sectors; ++n) {
            hall->last = hall->last + 1U < CGL_HALL_EDGES ? hall->last + 1U : 0U;
            hall->interval[hall->last] = elapsed / sectors;
            hall->known += hall->known < CGL_HALL_EDGES ? 1U : 0U;
        }
    }
    hall->timed = true;
    hall->backward = backward;
    hall->position = (hall->position + (backward ? hall->sectors - sectors : sectors)) % hall->sectors;
}

/* Returns the magnitude of the speed [rad/s], from the mean of the last intervals, or from the time since the last edge if the next edge
 * is overdue. */
static cgl_real speed(const cgl_hall *hall)
{
    const uint32_t count = hall->known < hall->config.edges ? hall->known : hall->config.edges;
    cgl_real ticks = CGL_R(0.0);
    for (uint32_t n = 0, at = hall->last; n < count; ++n) {
        ticks += (cgl_real)hall->interval[at];
        at = at > 0U ? at - 1U : CGL_HALL_EDGES - 1U;
    }
    if (count == 0U) {
        return CGL_R(0.0);
    }
    const cgl_real mean = ticks / (cgl_real)count, waited = (cgl_real)hall->since / LATE;
    const cgl_real longest = waited > mean ? waited : mean;
    return hall->per_tick / (longest > CGL_R(1.0) ? longest : CGL_R(1.0));
}

void cgl_hall_step(cgl_hall *hall, uint32_t sector, uint32_t edge, uint32_t now)
{
    const uint32_t before = hall->position % SECTORS;
    const uint32_t ahead = sector < SECTORS ? (sector + SECTORS - before) % SECTORS : 0U;
    if (ahead == 0U) {
        hall->since = sum(hall->since, now - hall->now);
    } else {
        const bool backward = ahead > 3U || (ahead == 3U && hall->backward); /* three sectors may be passed either way, so the
                                                                                direction stays */
        pass(hall, backward ? SECTORS - ahead : ahead, backward, sum(hall->since, edge - hall->now));
        hall->since = now - edge;
    }
    hall->now = now;
    const cgl_real omega = speed(hall);
    hall->omega_m = hall->backward ? -omega : omega;
    if (hall->timed) {
        const cgl_real share = cgl_clamp(omega / hall->per_tick * (cgl_real)hall->since, CGL_R(1.0));
        put(hall, hall->backward ? CGL_R(1.0) - share : share);
    }
}
