/* Speed from the times of an encoder's edges, by one of two methods. Method MT divides the counts since the last step by the exact time
 * that these counts took, from the last edge before them to the last edge among them. Method T divides one count by the time between the
 * last two edges. If the next edge takes longer than the last interval between edges, both methods divide one count by the time since the
 * last edge. This quotient is the largest speed that is still possible. After an edge in the opposite direction, both methods
 * give 0 until the next edge comes. But MT still counts the opposite edge in the first step after it.
 *
 * The board passes its counter of edges, and the value of a timer that the board captured at the last edge. Call cgl_edges_pass() whenever
 * the board reads these two, at each edge or once a current-loop period. Call cgl_speed_timed_step() where the speed is needed:
 *
 *   cgl_edges_pass(&edges, count, captured);
 *   omega_m = cgl_speed_timed_step(&speed, &edges, now); */
#ifndef COGLESS_SPEED_TIMED_H
#define COGLESS_SPEED_TIMED_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The last edges of an encoder. Set all fields to zero at the start. */
typedef struct {
    uint32_t count;    /* counter, which grows forward and wraps at 2^32 */
    uint32_t time;     /* timer at the last edge [ticks], wraps at 2^32 */
    uint32_t interval; /* time between the last two edges [ticks], or the mean time if several edges came between two calls */
    bool backward;     /* the last edge was backward */
    bool reversed;     /* the last two edges were in opposite directions */
} cgl_edges;

typedef struct {
    uint32_t counts;    /* edges of the encoder in a revolution, four per line, 1 to 2^32 - 1 */
    cgl_real timer;     /* rate of the timer [Hz], > 0; call the step at least twice in the timer's 2^32 ticks */
    bool last_interval; /* true: method T; false: method MT; default false */
} cgl_speed_timed_config;

typedef struct {
    cgl_speed_timed_config config;
    cgl_real per_tick; /* speed at which one count passes in a tick [rad/s] */
    cgl_real omega_m;  /* speed at the last step [rad/s] */
    cgl_real time;     /* time over which omega_m is the mean [s]; 0 after a start */
    uint32_t count;    /* counter at the last step */
    uint32_t edge;     /* time of the last edge before the last step [ticks] */
    uint32_t now;      /* time of the last step [ticks] */
    uint32_t since;    /* time from the edge at `edge` to the step at `now`, at most 2^32 - 1 [ticks] */
} cgl_speed_timed;

/* Takes the counter of edges, and the value that the timer had at the last counted edge [ticks]. */
void cgl_edges_pass(cgl_edges *edges, uint32_t count, uint32_t time);

/* Copies the config. */
cgl_error cgl_speed_timed_init(cgl_speed_timed *speed, const cgl_speed_timed_config *config);

/* Starts at this speed [rad/s], usually 0. `edges` are the last edges of the sensor, and `now` is the present value of the timer
 * [ticks]. */
void cgl_speed_timed_reset(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now, cgl_real omega_m);

/* Returns the mechanical speed [rad/s]. `now` is the timer at this instant [ticks]. */
cgl_real cgl_speed_timed_step(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now);

#ifdef __cplusplus
}
#endif

#endif
