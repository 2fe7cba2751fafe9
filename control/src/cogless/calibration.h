/* What a drive must find out before it runs: the offsets of its current sensors, with the bridge off, and the mechanical angle at
 * which the rotor's d axis stands on phase a, by a current that pulls it there. Both are stepped by the interrupt until they say
 * done or failed.
 *
 *   result = cgl_offsets_step(&offsets, now.i_abc);             bridge off; then subtract offsets.mean from each measurement
 *
 *   result = cgl_align_step(&align, now.theta_m, &wanted);      then the current loop in the frame that it wants:
 *   currents.theta_e = wanted.theta_e; currents.omega_e = wanted.omega_e;
 *   currents.i_d_ref = wanted.i_d_ref; currents.i_q_ref = 0;
 *   cgl_foc_step(&foc, &currents, &out);                        then theta_m less align.zero is the angle of the drive
 *
 * The field goes slowly to and fro over the angle of phase a. Friction holds the rotor back both ways: the mean of both passes
 * is without it. The motor must be free to turn. Cogging stays in the result: take as much current as the motor may have. */
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
    uint32_t samples; /* that are averaged, 1 to 65535 */
    uint32_t phases;  /* measured currents, 2 or 3 */
    cgl_real largest; /* offset that is still plausible [A], > 0 */
    cgl_real spread;  /* largest difference between two samples of a phase [A], > 0: several times the noise */
} cgl_offsets_config;

typedef struct {
    cgl_offsets_config config;
    cgl_real mean[3];           /* the offsets, so far [A] */
    cgl_real low[3], high[3];   /* the smallest and the largest sample [A] */
    uint32_t count;             /* samples so far */
    cgl_calibration result;
} cgl_offsets;

/* Takes the config, which need not stay. */
cgl_error cgl_offsets_init(cgl_offsets *offsets, const cgl_offsets_config *config);

/* Begins anew. */
void cgl_offsets_reset(cgl_offsets *offsets);

/* Takes in a sample. Failed: a current that is not finite, a spread or an offset beyond its bound; until the next reset. */
cgl_calibration cgl_offsets_step(cgl_offsets *offsets, const cgl_real i_abc[3]);

typedef struct {
    uint32_t pole_pairs; /* 1 to 10000 */
    cgl_real current;    /* that pulls the rotor [A], > 0 */
    cgl_real ramp;       /* time in which it rises and falls [s], > 0 */
    cgl_real sweep;      /* the field goes so far to either side, electrical [rad], > 0, up to pi; 0: default pi/2 */
    cgl_real speed;      /* of the field, electrical [rad/s], > 0; a rotor must follow without swinging */
    cgl_real settle;     /* time to come to rest before the angle is read, swings of the pull included [s], > 0 */
    cgl_real tolerance;  /* the rotor's way may differ from the field's by this part of it, > 0, below 1; 0: default 0.25 */
} cgl_align_config;

typedef struct {
    cgl_real theta_e; /* electrical angle of the frame [rad], within +-pi */
    cgl_real omega_e; /* its speed [rad/s] */
    cgl_real i_d_ref; /* current on its d axis [A], 0 to config.current */
} cgl_align_output;

typedef struct {
    cgl_align_config config;
    cgl_real ts;       /* [s] */
    cgl_real theta_e;  /* of the field [rad] */
    cgl_real current;  /* [A] */
    cgl_real theta_m;  /* measured angle without its wraps [rad] */
    cgl_real far[2];   /* theta_m with the field at -sweep and at +sweep [rad] */
    cgl_real near[2];  /* theta_m with the field at 0, on the way forward and back [rad] */
    cgl_real zero;     /* the mechanical angle at which theta_e is 0, when done, within +-pi [rad] */
    cgl_real apart;    /* half of near[1] - near[0], when done: so far does friction hold the rotor back [rad] */
    uint32_t wait;     /* steps until the angle is read */
    uint32_t stage;    /* of the run */
    cgl_calibration result;
} cgl_align;

/* Takes the config, which need not stay; ts: period of the steps [s], > 0. No time is longer than 1e9 ts. */
cgl_error cgl_align_init(cgl_align *align, const cgl_align_config *config, cgl_real ts);

/* Begins anew. */
void cgl_align_reset(cgl_align *align);

/* One period; theta_m: the measured mechanical angle [rad], any revolution below CGL_ANGLE_MAX. Failed: it is not such an angle,
 * or the rotor does not follow the field, or turns against it (two phases changed, or an encoder that counts backward). The
 * current is 0 where done or failed. */
cgl_calibration cgl_align_step(cgl_align *align, cgl_real theta_m, cgl_align_output *out);

#ifdef __cplusplus
}
#endif

#endif
