/* Currents for the torque that a law asks for, once per period of the law: most torque per current, and field weakening.
 *
 * With this block a law's i_q_ref, its limit and the measured i_q are equivalent q-axis currents: torque / (1.5 pole_pairs psi_f). With
 * i_d = 0, or L_d = L_q, these are the q-axis currents themselves. The block turns the equivalent current into i_d and i_q:
 *
 *   cgl_current_reference_init(&currents, &config, &drive);    after cgl_drive_init, before the law's init
 *
 *   if (cgl_drive_measure(&drive, &now, &reference)) {
 *       cgl_pi_step(&law, &drive.in, &drive.command);
 *       cgl_current_reference_step(&currents, &drive);
 *   }
 *   cgl_current_reference_actuate(&currents, &drive, &out);    in place of cgl_drive_actuate */
#ifndef COGLESS_CURRENT_REFERENCE_H
#define COGLESS_CURRENT_REFERENCE_H

#include "drive.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_SALIENCY_MAX CGL_R(1.0e3) /* largest |L_q - L_d| current_limit / psi_f: beyond it the magnets make no torque */

typedef struct {
    bool mtpa;              /* true: least current for the torque; false: i_d = 0 up to the voltage limit; default false */
    bool field_weakening;   /* true: i_d keeps the voltage within its limit; default false */
    cgl_real L_d, L_q;      /* inductances [H], >= 0 */
    cgl_real psi_f;         /* magnet flux linkage, peak per phase [V s], > 0 */
    cgl_real R_s;           /* resistance of a phase [ohm], >= 0; only field weakening uses it */
    cgl_real voltage_share; /* part of the largest voltage that field weakening plans with, to 1; 0 for the default 0.95 */
} cgl_current_reference_config;

typedef struct {
    cgl_current_reference_config config;
    cgl_real current_limit; /* of the drive's current loop [A] */
    cgl_real share;         /* largest planned voltage over bus voltage */
    cgl_real saliency;      /* (L_q - L_d) current_limit / psi_f */
    cgl_real reach;         /* largest equivalent current over current_limit, >= 1 */
} cgl_current_reference;

/* The first field that init refuses, as CGL_FIELD; NULL: none. current_limit is that of the current loop. */
const char *cgl_current_reference_bad_field(const cgl_current_reference_config *config, cgl_real current_limit);

/* Copies the config, and raises the drive's loop.current_limit to the largest equivalent current. The drive has had its init or retune,
 * and controls its currents itself: a foreign one is refused. */
cgl_error cgl_current_reference_init(cgl_current_reference *currents, const cgl_current_reference_config *config,
                                     cgl_drive *drive);

/* Turns the law's output into current references within current_limit. An output beyond the torque that current and voltage allow is
 * shortened, which the law gets told like a limit of the current loop. A speed or bus voltage that is not finite or not positive
 * leaves out field weakening. */
void cgl_current_reference_step(const cgl_current_reference *currents, cgl_drive *drive);

/* Controls the currents as cgl_drive_actuate(), and keeps the equivalent of the measured ones for the law. */
void cgl_current_reference_actuate(const cgl_current_reference *currents, cgl_drive *drive, cgl_drive_output *out);

#ifdef __cplusplus
}
#endif

#endif
