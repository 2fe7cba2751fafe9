/* The whole controller of a drive, stepped once per current-loop period: it checks the measurements, prepares the law's input when the law
 * is due, and controls the currents. The caller steps the law between the two calls, so a firmware links only the law that it uses:
 *
 *   if (cgl_drive_measure(&drive, &now, &reference)) {
 *       cgl_pi_ilc_step(&law, &drive.in, &drive.command);
 *   }
 *   cgl_drive_actuate(&drive, &out);
 *
 * The law learns only if the reference and the guard allow learning, and three more conditions are true. The monitor trusts the
 * measurements. The speed error is no outlier. In every period since the law's last step the current loop has followed its reference: the
 * voltage was enough, and the reference was within its limit.
 *
 * While the monitor declares the output safe (monitor.h), the voltages are zero, the current loop starts anew, and the law is off. Open the
 * bridge while the status has CGL_STATUS_OFF: zero voltage shorts a motor that turns.
 *
 * While the law's status has CGL_STATUS_BUSY, the law follows a speed that the drive does not know. During this time the drive does not
 * look for a stuck angle, and steps neither the quality measure nor the guard. */
#ifndef COGLESS_DRIVE_H
#define COGLESS_DRIVE_H

#include <stdint.h>

#include "foc.h"
#include "guard.h"
#include "law.h"
#include "monitor.h"
#include "quality.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t pole_pairs;   /* pole pairs of the motor, 1 to 10000 */
    uint32_t divider;      /* current-loop periods in a period of the law, 1 to 65535 */
    bool foreign;          /* true: foreign firmware controls the currents. The drive then uses only current_limit of foc, 0 if it is
                              unknown, and cgl_drive_actuate() returns the law's current reference; default false */
    bool feed_forward;     /* true: foreign firmware controls the speed too. The law returns only what it learns, and the foreign
                              firmware adds that to its current reference; default false */
    bool learn_saturated;  /* true: the law learns even if the current loop has fallen short of its reference. A law that learns from
                              whole trials needs this, as one period without learning would spoil the trial; default false */
    bool unguarded;        /* true: the guard does not watch the learning; default false. With COGLESS_NO_GUARD, which leaves
                              guard.c out, `unguarded` must be true */
    cgl_foc_config foc;
    cgl_monitor_config monitor; /* monitor.phases = 0 stands for foc.phases, or for none if the current loop is foreign. Any other value
                                   must equal foc.phases, unless the current loop is foreign */
    cgl_quality_config quality; /* config of the quality measure, whose error is the speed error [rad/s] */
} cgl_drive_config;

typedef struct {
    cgl_real theta_ref; /* mechanical angle reference [rad] */
    cgl_real omega_ref; /* mechanical speed reference [rad/s] */
    cgl_real alpha_ref; /* derivative of omega_ref [rad/s^2] */
    cgl_real i_d_ref;   /* d-axis current reference [A], usually 0. sqrt(foc.current_limit^2 - i_d_ref^2) is left for the law, so give
                           the law no higher limit. A new value of this or any other field is used from the next period on in which
                           the law is due. But the check for a stuck angle uses omega_ref and torque in every period */
    bool learn;         /* false freezes what is learned */
    bool torque;        /* true: torque mode. The current reference is i_q_ref plus the learned current, and nothing is learned. The
                           references of angle and speed have no effect. Guard, quality and the check for a stuck angle pause */
    cgl_real i_q_ref;   /* q-axis current reference of torque mode [A], within the law's limit */
} cgl_reference;

/* The output of the current loop, with the status bits of all parts. The references for a foreign current loop are not limited. */
typedef cgl_foc_output cgl_drive_output;

typedef struct {
    uint32_t ready;         /* CGL_READY after init */
    bool foreign;           /* copies of the config's flags: this one and the next two */
    bool learn_saturated;
    bool unguarded;
    bool saturated;         /* at least once since the law's last step, the current loop has fallen short of its reference */
    bool off;               /* at least once since the law's last step, the output has been the safe one: no voltage */
    uint32_t divider;       /* current-loop periods in a period of the law, from the config */
    uint32_t countdown;     /* current-loop periods until the law is due */
    unsigned status;        /* CGL_STATUS_ bits of this period's measurements */
    unsigned held;          /* status bit of the guard: CGL_STATUS_GUARDED while cgl_guard_acts(), else 0 */
    cgl_real pole_pairs;    /* number of pole pairs, from the config */
    cgl_real i_q;           /* q-axis current measured in the last period [A]; the law's reference if the current loop is foreign */
    cgl_loop loop;          /* argument of the law's init */
    cgl_law_output command; /* output of the law's last step; it is finite */
    cgl_law_input in;       /* input of the law's next step */
    cgl_foc_input currents; /* input of the current loop in this period */
    cgl_monitor monitor;
    cgl_quality quality;
    cgl_guard guard;        /* not used if unguarded */
    cgl_foc foc;
} cgl_drive;

/* The first field of the drive or of its parts that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_drive_bad_field(const cgl_drive_config *config, cgl_real ts);

/* Copies the config. ts is the period of the current loop [s], > 0. Then pass &drive->loop to the law's init. */
cgl_error cgl_drive_init(cgl_drive *drive, const cgl_drive_config *config, cgl_real ts);

/* Replaces foc, monitor, quality and learn_saturated at run time, as the retune functions of the parts do. The other fields must not
 * change. The law has its own retune. */
cgl_error cgl_drive_retune(cgl_drive *drive, const cgl_drive_config *config);

/* Resets everything but the law. The law is due in the next period. */
void cgl_drive_reset(cgl_drive *drive);

/* Takes the measurements of this period. Returns whether the law is due. If the law is due, step it from drive->in to drive->command.
 * Without a successful init this function does nothing, and cgl_drive_actuate() returns zeros with CGL_STATUS_FAULT and CGL_STATUS_OFF. */
bool cgl_drive_measure(cgl_drive *drive, const cgl_measurement *now,
                       const cgl_reference *reference);

/* Controls the currents in this period, as the law's command says. */
void cgl_drive_actuate(cgl_drive *drive, cgl_drive_output *out);

#ifdef __cplusplus
}
#endif

#endif
