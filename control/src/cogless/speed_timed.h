/* Speed by the time of an encoder's edges. MT: the counts since the last step over the exact time from the last edge before
 * them to the last edge among them. T: one count over the time between the last two edges. Where no edge comes for longer than
 * that, both give one count over the time since the last edge, the largest speed that is still possible. After two edges in
 * opposite directions and none since, they give 0.
 *
 * The board gives the counter and the timer that it captured at the last edge. Call cgl_edges_pass as often as it reads them, at
 * each edge or once a current-loop period, and the step where the speed is needed:
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

/* The last edges of an encoder. All zero is a start. */
typedef struct {
    uint32_t count;    /* growing forward, wraps at 2^32 */
    uint32_t time;     /* of the last edge [ticks], wraps at 2^32 */
    uint32_t interval; /* between the last two edges [ticks]; the mean, where several came at once */
    bool backward;     /* the last edge was one backward */
    bool reversed;     /* and the one before it was not, or the other way round */
} cgl_edges;

typedef struct {
    uint32_t counts;    /* of the encoder in a revolution: edges, four a line, 1 to 2^32 - 1 */
    cgl_real timer;     /* rate of the timer [Hz], > 0; a step comes at least twice in its 2^32 ticks */
    bool last_interval; /* true: T; default false: MT */
} cgl_speed_timed_config;

typedef struct {
    cgl_speed_timed_config config;
    cgl_real per_tick; /* speed of one count in a tick [rad/s] */
    cgl_real omega_m;  /* of the last step [rad/s] */
    cgl_real time;     /* over which omega_m is the mean [s]; 0 after a start */
    uint32_t count;    /* at the last step */
    uint32_t edge;     /* time of the last edge before the last step [ticks] */
    uint32_t now;      /* time of the last step [ticks] */
    uint32_t since;    /* from that edge to that step, 2^32 - 1 for longer [ticks] */
} cgl_speed_timed;

/* Takes in what the counter shows, and the timer's value at its last edge. */
void cgl_edges_pass(cgl_edges *edges, uint32_t count, uint32_t time);

/* Takes the config, which need not stay. */
cgl_error cgl_speed_timed_init(cgl_speed_timed *speed, const cgl_speed_timed_config *config);

/* The rotor turns at this speed [rad/s], usually 0, with these edges behind it: call it once the sensor is there. */
void cgl_speed_timed_reset(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now, cgl_real omega_m);

/* The mechanical speed [rad/s]. now: the timer at this instant [ticks]. */
cgl_real cgl_speed_timed_step(cgl_speed_timed *speed, const cgl_edges *edges, uint32_t now);

#ifdef __cplusplus
}
#endif

#endif
