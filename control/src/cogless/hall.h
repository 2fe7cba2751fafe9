/* Mechanical angle and speed from Hall sensors, which tell six sectors per electrical revolution.
 *
 * Between two edges the angle moves on with the speed, but never leaves the sector. The speed is the mean over the last intervals between
 * edges. Over six intervals, an electrical revolution, the errors of the sensors' placement cancel. If no edge comes for longer than one
 * and a half mean intervals, the speed falls with the time since the last edge. After a reversal the speed is 0 until the next edge.
 *
 * The board passes the sector, 0 to 5 in the order of the forward electrical angle. The board gets the sector from a table of its wiring.
 * Any other value is a wrong code of the sensors and counts as no edge. The board also passes the value of a timer that it captured at the
 * last edge:
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
    uint32_t edges;      /* number of intervals over which the speed is the mean, 1 to CGL_HALL_EDGES */
    cgl_real timer;      /* rate of the timer [Hz], > 0; call the step at least twice in the timer's 2^32 ticks */
} cgl_hall_config;

typedef struct {
    cgl_hall_config config;
    cgl_real per_tick; /* speed at which one sector passes in a tick [rad/s] */
    uint32_t sectors;  /* number of sectors in a mechanical revolution */
    uint32_t position; /* sector in which the rotor is, counted from angle zero, below `sectors` */
    uint32_t interval[CGL_HALL_EDGES]; /* times between edges, in a ring [ticks] */
    uint32_t last;  /* index of the newest interval */
    uint32_t known; /* number of intervals measured since the first edge or the last reversal, at most CGL_HALL_EDGES */
    uint32_t now;   /* time of the last step [ticks] */
    uint32_t since; /* time from the last edge to the last step, at most 2^32 - 1 [ticks] */
    bool timed;     /* an edge has come */
    bool backward;  /* the last edge was backward */
    uint32_t turns; /* mechanical angle; 2^32 is a revolution */
    cgl_real omega_m; /* mechanical speed [rad/s] */
} cgl_hall;

/* Copies the config. The rotor counts as standing in sector 0. */
cgl_error cgl_hall_init(cgl_hall *hall, const cgl_hall_config *config);

/* Starts anew with a rotor that stands in sector `position` of the mechanical revolution. If only the sector of the electrical revolution
 * is known, pass that one. */
void cgl_hall_reset(cgl_hall *hall, uint32_t position);

/* Takes the sector, 0 to 5. `edge` is the timer at the last edge, and `now` the timer at present [ticks]. */
void cgl_hall_step(cgl_hall *hall, uint32_t sector, uint32_t edge, uint32_t now);

#ifdef __cplusplus
}
#endif

#endif
