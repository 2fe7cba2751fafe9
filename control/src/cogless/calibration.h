/* Two calibrations that a drive needs before it runs. The first finds the offsets of the current sensors while the bridge is off. The
 * second, the alignment, pulls the rotor with a current, and finds the mechanical angle at which the d axis stands on phase a. Call the
 * step of the first in each interrupt until the step returns CGL_CALIBRATION_DONE or CGL_CALIBRATION_FAILED. Then do the same with the
 * second.
 *
 *   result = cgl_offsets_step(&offsets, now.i_abc);             bridge off; then subtract offsets.mean from each measurement
 *
 *   result = cgl_align_step(&align, now.theta_m, &wanted);      then step the current loop in the frame `wanted`:
 *   currents.theta_e = wanted.theta_e; currents.omega_e = wanted.omega_e;
 *   currents.i_d_ref = wanted.i_d_ref; currents.i_q_ref = 0;
 *   cgl_foc_step(&foc, &currents, &out);                        when done, the angle of the drive is theta_m - align.zero
 *
 * In the alignment the field passes the angle of phase a slowly, forward and then back. Friction holds the rotor back on both passes, and
 * cancels in the mean of the rotor's angles on both passes. The motor must be free to turn. Cogging shifts the result, less so with more
 * current: use as much current as the motor may have. */
#ifndef COGLESS_CALIBRATION_H
#define COGLESS_CALIBRATION_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
    CGL_CALIBRATION_BUSY = 0,
    CGL_CALIBRATION_DONE = 1,
    CGL_CALIBRATION_FAILED = 2
} cgl_calibration;

typedef struct {
    uint32_t samples; /* number of samples in the mean, 1 to 65535 */
    uint32_t phases;  /* number of measured phase currents, 2 or 3 */
    cgl_real largest; /* largest plausible offset [A], > 0 */
    cgl_real spread;  /* largest difference between two samples of a phase [A], > 0: several times the noise */
} cgl_offsets_config;

typedef struct {
    cgl_offsets_config config;
    cgl_real mean[3];           /* mean of the samples so far [A]; when done, this is the offset */
    cgl_real low[3], high[3];   /* the smallest and the largest sample [A] */
    uint32_t count;             /* samples so far */
    cgl_calibration result;
} cgl_offsets;

/* Copies the config. */
cgl_error cgl_offsets_init(cgl_offsets *offsets, const cgl_offsets_config *config);

/* Begins anew. */
void cgl_offsets_reset(cgl_offsets *offsets);

/* Takes one sample. Fails if a current is not finite, if two samples of a phase differ by more than `spread`, or if the mean of a phase is
 * beyond +-`largest`. After a failure the step returns CGL_CALIBRATION_FAILED until a reset. */
cgl_calibration cgl_offsets_step(cgl_offsets *offsets, const cgl_real i_abc[3]);

typedef struct {
    uint32_t pole_pairs; /* 1 to 10000 */
    cgl_real current;    /* current that pulls the rotor [A], > 0 */
    cgl_real ramp;       /* time in which the current rises, and in which it falls [s], > 0 */
    cgl_real sweep;      /* electrical angle of the field to either side of phase a [rad], > 0, up to pi; 0: default pi/2 */
    cgl_real speed;      /* electrical speed of the field, which the rotor must follow without swinging [rad/s], > 0 */
    cgl_real settle;     /* time for which the rotor may swing before its angle is read [s], > 0 */
    cgl_real tolerance;  /* largest difference between the rotor's way and the field's way, as a share of the field's way, > 0, below 1;
                            0: default 0.25 */
} cgl_align_config;

typedef struct {
    cgl_real theta_e; /* electrical angle of the frame [rad], within +-pi */
    cgl_real omega_e; /* derivative of theta_e [rad/s] */
    cgl_real i_d_ref; /* current on the d axis of that frame [A], 0 to config.current */
} cgl_align_output;

typedef struct {
    cgl_align_config config;
    cgl_real ts;       /* period of the steps [s] */
    cgl_real theta_e;  /* electrical angle of the field [rad] */
    cgl_real current;  /* present current [A] */
    cgl_real theta_m;  /* measured angle without its wraps [rad] */
    cgl_real far[2];   /* theta_m with the field at -sweep and at +sweep [rad] */
    cgl_real near[2];  /* theta_m with the field at 0, on the way forward and back [rad] */
    cgl_real zero;     /* when done: the mechanical angle at which theta_e is 0, within +-pi [rad] */
    cgl_real apart;    /* when done: half of near[1] - near[0], the angle by which friction holds the rotor back [rad] */
    uint32_t wait;     /* steps until the rotor's angle is read, plus 1; 0: no wait has begun */
    uint32_t stage;    /* stage of the alignment, 0 to 4 */
    cgl_calibration result;
} cgl_align;

/* Copies the config. ts is the period of the steps [s], > 0. The times ramp, settle and sweep / speed are at most 1e9 ts. */
cgl_error cgl_align_init(cgl_align *align, const cgl_align_config *config, cgl_real ts);

/* Begins anew. */
void cgl_align_reset(cgl_align *align);

/* Steps one period. theta_m is the measured mechanical angle [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX. The
 * alignment fails at once if theta_m is not valid. It fails at its end if the rotor has not followed the field, or has turned against the
 * field, or if friction has held the rotor back by more than `sweep`. A rotor turns against the field if two phases are swapped, or if the
 * encoder counts backward. Once the alignment is done or has failed, the current is 0. */
cgl_calibration cgl_align_step(cgl_align *align, cgl_real theta_m, cgl_align_output *out);

#ifdef __cplusplus
}
#endif

#endif
