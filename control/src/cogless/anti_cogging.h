/* PI speed control with an anti-cogging table, the remedy in common use. A slow calibration run in both directions records the current that
 * the motor needs at each angle. Later the current from the table is added to the PI's output.
 *
 * A table entry is the mean of the currents of both directions, in which Coulomb friction cancels. The mean of all entries is a constant
 * load and is subtracted. Half the difference between the mean currents of both directions is reported as friction. */
#ifndef COGLESS_ANTI_COGGING_H
#define COGLESS_ANTI_COGGING_H

#include <stdint.h>

#include "pi.h"
#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_pi_config pi;       /* kp [A s/rad], ki [A/rad], bound of the sum of PI and table [A] */
    uint32_t cells;         /* table entries per mechanical revolution; 4 to 65535 */
    cgl_real speed;         /* mechanical speed of the calibration run [rad/s], > 0 */
    uint32_t revolutions;   /* number of revolutions recorded in each direction, 1 to 100 */
    cgl_real position_gain; /* gain on the position error of the calibration run [1/s], >= 0 */
    cgl_real lead;          /* delay of the current loop [s], >= 0; default 0. The table is read at the angle that the rotor will have
                               after this time */
} cgl_anti_cogging_config;

typedef enum {
    CGL_ANTI_COGGING_RUN,     /* no calibration: the table acts */
    CGL_ANTI_COGGING_FORWARD, /* calibration, first direction */
    CGL_ANTI_COGGING_BACKWARD /* calibration, second direction */
} cgl_anti_cogging_stage;

typedef struct {
    cgl_anti_cogging_config config;
    cgl_pi pi;
    cgl_real *table; /* caller's memory: `cells` entries [A], within +-pi.limit, entry n at angle 2 pi n / cells */
    cgl_anti_cogging_stage stage;
    cgl_real looked_up;         /* current from the table in the last step [A] */
    cgl_real friction;          /* friction in the last calibration [A]: Coulomb friction plus viscous friction at config.speed */
    cgl_real place;             /* measured angle of the last step [cells], in [0, cells) */
    int32_t turns;              /* revolutions since this direction began, forward positive, without those to be repeated */
    cgl_real behind;            /* angle that the calibration's speed asks for, less the rotor's angle [rad] */
    int32_t cell;               /* number of the table entry being recorded, which rises in either direction of the run */
    int32_t end_cell;           /* value of `cell` at which this direction ends */
    cgl_real sum;               /* sum of the currents measured within this entry [A] */
    uint32_t samples;           /* number of samples in `sum` */
    cgl_real means[2];          /* mean current over all recorded entries, [0] forward and [1] backward [A] */
    bool started;               /* place is valid */
} cgl_anti_cogging;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_anti_cogging_bad_field(const cgl_anti_cogging_config *config, const cgl_loop *loop);

/* `loop` is drive.loop. `table` has `cells` entries. Init clears the table, and the law uses it from then on. */
cgl_error cgl_anti_cogging_init(cgl_anti_cogging *law, const cgl_anti_cogging_config *config, const cgl_loop *loop, cgl_real *table,
                                uint32_t length);

/* Replaces gains and limits at run time, as cgl_pi_retune() does. The table stays, within the new limit. `cells` must not change.
 * `revolutions` must not change during a calibration. */
cgl_error cgl_anti_cogging_retune(cgl_anti_cogging *law, const cgl_anti_cogging_config *config);

/* Restarts the PI and ends a calibration; a table that is complete stays. */
void cgl_anti_cogging_reset(cgl_anti_cogging *law);

/* Begins a calibration run. The following steps make the run, and ignore omega_ref. The rotor turns forward by an eighth of a revolution to
 * settle, and by `revolutions` to record. Then the rotor does the same backward. Until the run ends, the status has CGL_STATUS_BUSY, so
 * cgl_drive does not look for a stuck angle.
 *
 * While in->learn is false, nothing is recorded, and the status has CGL_STATUS_FROZEN. The motor goes on turning, and a missing entry is
 * recorded the next time that the rotor passes it. So a finished table is always complete. While in->learn stays false, the run does not
 * end, unless cgl_anti_cogging_reset() ends it. Calibrate anew after cgl_monitor_trust(), because the old table belongs to the old angle.
 *
 * With loop.feed_forward this function does nothing: the foreign feedback would have to make the run. */
void cgl_anti_cogging_calibrate(cgl_anti_cogging *law);

/* Sets the output to the sum of PI and table. A calibration records in->i_q, and pauses while an input is not finite. While in->off, the
 * output and the PI's integral are 0. A calibration that in->off or torque mode interrupts begins anew afterwards. */
void cgl_anti_cogging_step(cgl_anti_cogging *law, const cgl_law_input *in,
                           cgl_law_output *out);

#ifdef __cplusplus
}
#endif

#endif
