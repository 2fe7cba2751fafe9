/* The whole controller of a drive, once per current-loop period: plausible measurements, the law where it is due, the
 * current loop. The law is stepped by the caller in between, so that a firmware holds only its own:
 *
 *   if (cgl_drive_measure(&drive, &now, &reference)) {
 *       cgl_pi_ilc_step(&law, &drive.in, &drive.command);
 *   }
 *   cgl_drive_actuate(&drive, &out);
 *
 * The law learns only where measurements are trusted, the current loop did what it was asked for since its last step (had
 * voltage enough, and no reference beyond its limit), and the error is no outlier. Where the output is safe, voltages are
 * zero, the current loop starts anew, and the law is off; open the bridge then (status CGL_STATUS_OFF), since no voltage
 * shorts a motor that turns. While the law says CGL_STATUS_BUSY, it follows a speed that is
 * not known here: a stuck angle is not looked for, and errors count for nothing. */
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
    uint32_t pole_pairs;   /* 1 to 10000 */
    uint32_t divider;      /* current-loop periods in a period of the law, 1 to 65535 */
    bool foreign;          /* somebody else controls the currents: of foc only current_limit is used, 0 where none is known;
                              actuate gives the law's reference */
    bool feed_forward;     /* somebody else controls the speed too: the law gives only what it learns, for a foreign loop to add;
                              default false */
    bool learn_saturated;  /* learn although the current loop falls short: for a law that learns from whole trials, of
                              which one such period would spoil all; default false */
    bool unguarded;        /* learning is not watched by the guard; default false. With COGLESS_NO_GUARD, which leaves guard.c
                              out, it must be true */
    cgl_foc_config foc;
    /* init refuses parts that do not agree */
    cgl_monitor_config monitor; /* phases: 0 stands for foc.phases; if the current loop is foreign, for none */
    cgl_quality_config quality; /* of the speed error [rad/s] */
} cgl_drive_config;

typedef struct {
    cgl_real theta_ref; /* mechanical angle reference [rad] */
    cgl_real omega_ref; /* mechanical speed reference [rad/s] */
    cgl_real alpha_ref; /* its derivative [rad/s^2] */
    cgl_real i_d_ref;   /* d-axis current reference [A], usually 0; it leaves the law sqrt(foc.current_limit^2 - i_d_ref^2), so
                           give the law no higher limit. Taken, as all of these but omega_ref, where the law is due */
    bool learn;         /* false freezes what is learned */
    bool torque;        /* torque mode: i_q_ref acts, and what is learned beside it, frozen; references of angle and speed
                           are not followed, and the guard, the quality and the watch for a stuck angle stand still */
    cgl_real i_q_ref;   /* q-axis current reference of torque mode [A], within the law's limit */
} cgl_reference;

/* The current loop's output; here the status has the bits of all parts, and the references of a foreign current loop are
 * not limited. */
typedef cgl_foc_output cgl_drive_output;

typedef struct {
    uint32_t ready;         /* CGL_READY after init */
    bool foreign;
    bool learn_saturated;
    bool unguarded;
    bool saturated;         /* the current loop fell short of its reference since the law's last step */
    bool off;               /* the output was safe since then */
    uint32_t divider;
    uint32_t countdown;     /* periods until the law is due */
    unsigned status;        /* of this period's measurements */
    unsigned held;          /* CGL_STATUS_GUARDED, or 0 */
    cgl_real pole_pairs;    /* these from the config */
    cgl_real i_q;           /* measured in the last period [A] */
    cgl_loop loop;          /* for the law's init */
    cgl_law_output command; /* of the law's last step; finite, as every law's is */
    cgl_law_input in;       /* for the law that is due */
    cgl_foc_input currents; /* of this period, for foc */
    cgl_monitor monitor;
    cgl_quality quality;
    cgl_guard guard;        /* not used if unguarded */
    cgl_foc foc;
} cgl_drive;

/* The first field of the drive or of its parts that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_drive_bad_field(const cgl_drive_config *config, cgl_real ts);

/* Takes the config, which need not stay; ts: period of the current loop [s], > 0. A law's init then takes
 * &drive->loop. */
cgl_error cgl_drive_init(cgl_drive *drive, const cgl_drive_config *config, cgl_real ts);

/* Takes other values of foc, monitor and quality while it runs, as their retunes, and learn_saturated; the rest must stay. The
 * law has its own retune. */
cgl_error cgl_drive_retune(cgl_drive *drive, const cgl_drive_config *config);

/* Everything but the law starts anew; the law is due at once. */
void cgl_drive_reset(cgl_drive *drive);

/* Takes the measurements of this period. True where the law is due: step it then, from drive->in to drive->command. A state that no
 * init made does nothing, and its outputs are 0 with CGL_STATUS_FAULT and CGL_STATUS_OFF. */
bool cgl_drive_measure(cgl_drive *drive, const cgl_measurement *now,
                       const cgl_reference *reference);

/* The current loop's part of the period, with the law's command. */
void cgl_drive_actuate(cgl_drive *drive, cgl_drive_output *out);

#ifdef __cplusplus
}
#endif

#endif
