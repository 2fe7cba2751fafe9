/* Hall sensors: six sectors per electrical revolution, to the mechanical angle and speed.
 *
 * The angle is interpolated from the last edge on by the speed, and never leaves the sector. The speed is that of the last
 * intervals between edges; over six of them, an electrical revolution, the errors of the sensors' placement cancel. Where no edge
 * comes for longer than one and a half of them, the speed falls with the time since the last one. After an edge backward it is 0
 * until the next.
 *
 * The board gives the sector, 0 to 5 in the order of the forward electrical angle, from its own wiring's table; anything else is
 * a wrong code and is not believed. It gives the timer as captured at the last edge:
 *
 *   cgl_hall_step(&hall, sector_of[board_hall()], captured, board_timer());
 *   now.theta_m = cgl_radians(hall.turns);   now.omega_m = hall.omega_m; */
#ifndef COGLESS_HALL_H
#define COGLESS_HALL_H

#include <stdint.h>

#include "real.h"
#include "status.h"
#include "turns.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_HALL_EDGES 6

typedef struct {
    uint32_t pole_pairs; /* 1 to 10000 */
    uint32_t edges;      /* intervals that the speed is taken over, 1 to CGL_HALL_EDGES */
    cgl_real timer;      /* rate of the timer [Hz], > 0; a step comes at least twice in its 2^32 ticks */
} cgl_hall_config;

typedef struct {
    cgl_hall_config config;
    cgl_real per_tick; /* speed of one sector in a tick [rad/s] */
    uint32_t sectors;  /* in a mechanical revolution */
    uint32_t position; /* of them, from angle zero */
    uint32_t interval[CGL_HALL_EDGES]; /* between edges, the last at `last` [ticks] */
    uint32_t last;
    uint32_t known; /* of the intervals */
    uint32_t now;   /* time of the last step [ticks] */
    uint32_t since; /* from the last edge to that step, 2^32 - 1 for longer [ticks] */
    bool timed;     /* an edge has come */
    bool backward;  /* the last one */
    uint32_t turns; /* mechanical angle, 2^32 a revolution */
    cgl_real omega_m; /* mechanical speed [rad/s] */
} cgl_hall;

/* Takes the config, which need not stay. The rotor counts as standing in sector 0. */
cgl_error cgl_hall_init(cgl_hall *hall, const cgl_hall_config *config);

/* The rotor stands in this sector: of the mechanical revolution, or, if that is not known, of the electrical one. */
void cgl_hall_reset(cgl_hall *hall, uint32_t position);

/* Takes in the sector, 0 to 5, and the timer at the last edge and now [ticks]. */
void cgl_hall_step(cgl_hall *hall, uint32_t sector, uint32_t edge, uint32_t now);

#ifdef __cplusplus
}
#endif

#endif
