/* Turns the torque that a law asks for into current references, once per period of the law. The block does two things: most torque per
 * current (MTPA), and field weakening.
 *
 * With this block the law's i_q_ref, its limit and its measured i_q are equivalent q-axis currents. An equivalent current is torque / (1.5
 * pole_pairs psi_f). If i_d = 0 or L_d = L_q, the equivalent current is the q-axis current itself. The block turns the equivalent current
 * into i_d and i_q:
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

#define CGL_SALIENCY_MAX CGL_R(1.0e3) /* largest |L_q - L_d| current_limit / psi_f [-]: beyond it the magnets' torque is negligible */

typedef struct {
    bool mtpa;              /* true: least current for the torque; false: i_d = 0 up to the voltage limit; default false */
    bool field_weakening;   /* true: i_d keeps the voltage within its limit; default false */
    cgl_real L_d, L_q;      /* inductances [H], >= 0 */
    cgl_real psi_f;         /* magnet flux linkage, peak per phase [V s], > 0 */
    cgl_real R_s;           /* resistance of a phase [ohm], >= 0; only field weakening uses it */
    cgl_real voltage_share; /* share of the inverter's largest voltage that field weakening uses [-], > 0, at most 1; 0: default 0.95 */
} cgl_current_reference_config;

typedef struct {
    cgl_current_reference_config config;
    cgl_real current_limit; /* limit of the drive's current loop [A] */
    cgl_real share;         /* largest voltage that field weakening uses, as a share of the bus voltage [-] */
    cgl_real saliency;      /* (L_q - L_d) current_limit / psi_f [-] */
    cgl_real reach;         /* largest equivalent current, as a multiple of current_limit, >= 1 */
} cgl_current_reference;

/* The first field that init refuses, as CGL_FIELD; NULL: none. `current_limit` is the limit of the current loop [A]. */
const char *cgl_current_reference_bad_field(const cgl_current_reference_config *config, cgl_real current_limit);

/* Copies the config, and raises the drive's loop.current_limit to the largest equivalent current. Call this function after the init and
 * each retune of the drive. A drive with a foreign current loop is refused. */
cgl_error cgl_current_reference_init(cgl_current_reference *currents, const cgl_current_reference_config *config,
                                     cgl_drive *drive);

/* Turns the law's output into current references within current_limit. If current and voltage do not allow the torque, the torque is
 * reduced. The drive then counts the current loop as saturated. Field weakening is left out if the speed is not finite, or if the bus
 * voltage is not finite or not positive. */
void cgl_current_reference_step(const cgl_current_reference *currents, cgl_drive *drive);

/* Controls the currents as cgl_drive_actuate() does. Then sets the i_q of the law's next input to the equivalent of the measured
 * currents. */
void cgl_current_reference_actuate(const cgl_current_reference *currents, cgl_drive *drive, cgl_drive_output *out);

#ifdef __cplusplus
}
#endif

#endif
