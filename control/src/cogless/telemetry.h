/* One snapshot of a controller that an interrupt writes and a background task reads whole: by wire, to a log, to a display.
 *
 * Two buffers and a count. The writer never waits: it fills the buffer that is not the newest, then says so by the count. A reader
 * copies the newest and looks again: where the writer has begun its second snapshot since, it tries once more. The count is
 * enough for this on one core, where the interrupt runs to its end before the reader goes on: all accesses to
 * count and buffers are volatile, so the compiler keeps their order. With
 * several cores, or a reader that interrupts the writer, it is not: use a lock there, or atomics.
 *
 *   cgl_telemetry_write(&telemetry, &drive, &out);                     in the interrupt
 *   if (cgl_telemetry_read(&telemetry, &snapshot)) send(&snapshot);    in the background */
#ifndef COGLESS_TELEMETRY_H
#define COGLESS_TELEMETRY_H

#include <stdint.h>

#include "drive.h"
#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t count;            /* of the snapshot: grows by one with each; after 2^32 - 1 comes 2 */
    uint32_t status;           /* CGL_STATUS_ bits */
    cgl_real theta_m, omega_m; /* as used: plausible, without jumps [rad], [rad/s] */
    cgl_real omega_ref;        /* where the law was last due [rad/s] */
    cgl_real i_d, i_q;         /* measured [A] */
    cgl_real i_d_ref, i_q_ref; /* [A] */
    cgl_real u_d, u_q;         /* [V] */
    cgl_real u_dc;             /* measured [V]; 0 where somebody else controls the currents */
} cgl_snapshot;

typedef struct {
    cgl_snapshot buffer[2];
    uint32_t count; /* snapshots that are complete; the newest is in buffer[count & 1] */
} cgl_telemetry;

/* Nothing written yet: with the interrupt off. */
void cgl_telemetry_reset(cgl_telemetry *telemetry);

/* In the interrupt, after cgl_drive_actuate. Takes the same time always. */
void cgl_telemetry_write(cgl_telemetry *telemetry, const cgl_drive *drive, const cgl_drive_output *out);

/* In the background. False where nothing was written yet, or the interrupt came twice during each of four tries. */
bool cgl_telemetry_read(const cgl_telemetry *telemetry, cgl_snapshot *snapshot);

#ifdef __cplusplus
}
#endif

#endif
