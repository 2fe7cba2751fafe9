/* Encoders: the register of a quadrature counter or the word of an absolute encoder, to the mechanical angle.
 *
 * The register runs round at any number, so the difference of two readings is taken the short way: read it before it has moved
 * half of its range. An incremental encoder does not know where it is until its index pulse, or cgl_encoder_place:
 *
 *   cgl_encoder_step(&encoder, board_counter());
 *   now.theta_m = cgl_radians(encoder.turns); */
#ifndef COGLESS_ENCODER_H
#define COGLESS_ENCODER_H

#include <stdint.h>

#include "real.h"
#include "status.h"
#include "turns.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t counts; /* in a revolution, four a line of a quadrature encoder, 2 to 2^32 - 1 */
    uint32_t range;  /* the register runs from 0 to range - 1, 65536 for 16 bits; 0: 2^32; at least 4. Absolute: of one
                        revolution, so equal to counts */
    uint32_t zero;   /* the position at the index pulse, or the word of an absolute one at angle zero, below counts, default 0 */
    bool absolute;   /* the register is the position; default false */
    bool backward;   /* the register falls where the angle grows; default false */
} cgl_encoder_config;

typedef struct {
    cgl_encoder_config config;
    uint64_t per_count; /* 2^64 / counts */
    uint32_t reading;   /* the register's last value */
    uint32_t count;     /* counts moved, forward less backward; wraps at 2^32: for the speed */
    uint32_t position;  /* counts from angle zero, below config.counts */
    uint32_t turns;     /* the mechanical angle, 2^32 a revolution */
    bool placed;        /* the angle is that of the rotor: absolute, or the index has passed */
} cgl_encoder;

/* Takes the config, which need not stay; reading: what the register shows. */
cgl_error cgl_encoder_init(cgl_encoder *encoder, const cgl_encoder_config *config, uint32_t reading);

/* As after init. */
void cgl_encoder_reset(cgl_encoder *encoder, uint32_t reading);

/* Takes in the register. A value that it cannot have changes nothing. */
void cgl_encoder_step(cgl_encoder *encoder, uint32_t reading);

/* The index pulse: the register showed `reading` at it, before or after the last step. */
void cgl_encoder_index(cgl_encoder *encoder, uint32_t reading);

/* The rotor is at this position [counts from angle zero], after homing or a calibration. */
void cgl_encoder_place(cgl_encoder *encoder, uint32_t position);

#ifdef __cplusplus
}
#endif

#endif
