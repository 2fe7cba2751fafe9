/* Mechanical angle from the register of a quadrature counter, or from the word of an absolute encoder.
 *
 * The register may wrap at any number. The difference of two readings is taken as the shorter of the two ways round. So read the register
 * again before it has moved by half of its range. The angle of an incremental encoder is right once the index pulse has come, or once
 * cgl_encoder_place() has been called. Each period:
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
    uint32_t counts; /* counts in a revolution, four per line of a quadrature encoder, 2 to 2^32 - 1 */
    uint32_t range;  /* the register runs from 0 to range - 1. range is 65536 for 16 bits, and 0 stands for 2^32; any other value is at
                        least 4. An absolute encoder needs the value of `counts` here */
    uint32_t zero;   /* position at the index pulse, or the word of an absolute encoder at angle zero [counts], below `counts`, default 0 */
    bool absolute;   /* true: the register is the word of an absolute encoder, which shows the position; default false */
    bool backward;   /* true: the register falls as the angle grows; default false */
} cgl_encoder_config;

typedef struct {
    cgl_encoder_config config;
    uint64_t per_count; /* (2^64 - 1) / counts, rounded down */
    uint32_t reading;   /* the register's last value */
    uint32_t count;     /* counts moved forward minus counts moved backward, for a speed estimate; wraps at 2^32 */
    uint32_t position;  /* position of the rotor from angle zero [counts], below config.counts */
    uint32_t turns;     /* mechanical angle; 2^32 is a revolution */
    bool placed;        /* the angle is right: the encoder is absolute, or the index pulse has come, or cgl_encoder_place() was called */
} cgl_encoder;

/* Copies the config. `reading` is the present value of the register. */
cgl_error cgl_encoder_init(cgl_encoder *encoder, const cgl_encoder_config *config, uint32_t reading);

/* Starts anew, as init does. */
void cgl_encoder_reset(cgl_encoder *encoder, uint32_t reading);

/* Takes a reading of the register. A reading that is not below config.range has no effect. */
void cgl_encoder_step(cgl_encoder *encoder, uint32_t reading);

/* Takes the index pulse. `reading` is what the register showed at the pulse, which may come before or after the last step. */
void cgl_encoder_index(cgl_encoder *encoder, uint32_t reading);

/* Sets the position of the rotor, from angle zero [counts], as after homing or a calibration. */
void cgl_encoder_place(cgl_encoder *encoder, uint32_t position);

#ifdef __cplusplus
}
#endif

#endif
