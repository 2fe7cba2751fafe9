/* PI speed control with an anti-cogging table, the remedy in common use: a slow run in both directions records the
 * current that holds the motor at each angle, later the table is looked up and added.
 *
 * The mean of both directions removes Coulomb friction, the mean over the revolution removes a constant load. Half the
 * difference of the directions is reported as friction. */
#ifndef COGLESS_ANTI_COGGING_H
#define COGLESS_ANTI_COGGING_H

#include <stdint.h>

#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_pi_config pi;       /* kp [A s/rad], ki [A/rad], limit of the sum [A] */
    uint32_t cells;         /* table entries per mechanical revolution; 4 to 65535 */
    cgl_real speed;         /* of the calibration run, mechanical [rad/s], > 0 */
    uint32_t revolutions;   /* recorded in each direction, 1 to 100 */
    cgl_real position_gain; /* holds the run to its path [1/s], >= 0 */
    cgl_real lead;          /* the table is looked up where the rotor will be after this time, in which the current loop
                               answers [s], >= 0; default 0 */
} cgl_anti_cogging_config;

typedef enum {
    CGL_ANTI_COGGING_RUN,     /* the table is looked up */
    CGL_ANTI_COGGING_FORWARD, /* calibration, first direction */
    CGL_ANTI_COGGING_BACKWARD /* calibration, second direction */
} cgl_anti_cogging_stage;

typedef struct {
    cgl_anti_cogging_config config;
    cgl_pi pi;
    cgl_real *table; /* caller's memory: `cells` entries [A], within +-pi.limit, entry n at angle 2 pi n / cells */
    cgl_anti_cogging_stage stage;
    cgl_real looked_up;         /* the table's part of the last step [A] */
    cgl_real friction;          /* found by the last calibration: Coulomb part, and viscous at its speed [A] */
    cgl_real place;             /* measured angle of the last step [cells], in [0, cells) */
    int32_t turns;              /* revolutions in this direction; the first ones, while the speed settles, do not count */
    cgl_real behind;            /* how far the rotor is behind the calibration's path [rad] */
    int32_t cell;               /* table entry being recorded, counted in the run's direction */
    int32_t end_cell;           /* first one that is not recorded any more */
    cgl_real sum;               /* of the current within the cell [A] */
    uint32_t samples;           /* within the cell */
    cgl_real means[2];          /* over all recorded cells, by direction [A] */
    bool started;               /* place is valid */
} cgl_anti_cogging;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_anti_cogging_bad_field(const cgl_anti_cogging_config *config, const cgl_loop *loop);

/* loop: drive.loop. `table`: `cells` entries, which the state keeps using; they are cleared. */
cgl_error cgl_anti_cogging_init(cgl_anti_cogging *law, const cgl_anti_cogging_config *config, const cgl_loop *loop, cgl_real *table,
                                uint32_t length);

/* Takes other gains and limits while it runs, as cgl_pi_retune. The table stays, within the limit; the number of cells must
 * stay, and during a calibration that of revolutions. */
cgl_error cgl_anti_cogging_retune(cgl_anti_cogging *law, const cgl_anti_cogging_config *config);

/* Restarts the PI and ends a calibration; a table that is complete stays. */
void cgl_anti_cogging_reset(cgl_anti_cogging *law);

/* The following steps ignore omega_ref and make the calibration run: an eighth of a revolution to settle and
 * `revolutions` to record, forward, then the same backward. CGL_STATUS_BUSY is set until it is done: with it in
 * drive->command, cgl_drive does not look for a stuck angle. Where in->learn is false nothing is recorded, and the status has
 * CGL_STATUS_FROZEN; the motor turns on, and what is missing is recorded when the rotor passes there the next time. So a table
 * is whole or not there, and with in->learn false for good the run does not end: end it by a reset. After
 * cgl_monitor_trust() calibrate anew: what was recorded belongs to the angle before. With loop.feed_forward nothing happens: somebody
 * else's feedback would have to make the run. */
void cgl_anti_cogging_calibrate(cgl_anti_cogging *law);

/* PI plus table. In a calibration in->i_q is recorded; it waits while an input is not finite. While in->off the output and
 * the PI's integral are 0; a calibration begins anew after it. */
void cgl_anti_cogging_step(cgl_anti_cogging *law, const cgl_law_input *in,
                           cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
