/* A snapshot of the controller that an interrupt writes and a background task reads without tearing, for a log or a display.
 *
 * There are two buffers and a count. The writer never waits: it fills the older buffer, then raises the count. A reader copies the newer
 * buffer and reads the count again. If the writer may have begun to overwrite the buffer meanwhile, the reader tries again. On one core
 * this is enough, if the interrupt runs to its end before the reader goes on: all accesses to count and buffers are volatile, so the
 * compiler keeps their order. With several cores, or with a reader that interrupts the writer, use a lock or atomics.
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
    uint32_t count;            /* number of the snapshot, which rises by 1 from 1 on; 2 follows 2^32 - 1 */
    uint32_t status;           /* CGL_STATUS_ bits */
    cgl_real theta_m, omega_m; /* plausible angle and speed, as the monitor gives them [rad], [rad/s] */
    cgl_real omega_ref;        /* mechanical speed reference when the law was last due [rad/s] */
    cgl_real i_d, i_q;         /* measured currents [A] */
    cgl_real i_d_ref, i_q_ref; /* current references [A] */
    cgl_real u_d, u_q;         /* voltages that the duty cycles realise [V] */
    cgl_real u_dc;             /* measured bus voltage [V]; 0 if the current loop is foreign */
} cgl_snapshot;

typedef struct {
    cgl_snapshot buffer[2];
    uint32_t count; /* number of the newest complete snapshot, which is in buffer[count & 1]; 0: there is none yet */
} cgl_telemetry;

/* Clears both buffers. Call this function with the interrupt off. */
void cgl_telemetry_reset(cgl_telemetry *telemetry);

/* Writes a snapshot. Call this function in the interrupt, after cgl_drive_actuate(). Its run time is constant. */
void cgl_telemetry_write(cgl_telemetry *telemetry, const cgl_drive *drive, const cgl_drive_output *out);

/* Copies the newest snapshot. Call this function in the background. Returns false if there is no snapshot yet, or if the interrupt came
 * twice during each of four tries. */
bool cgl_telemetry_read(const cgl_telemetry *telemetry, cgl_snapshot *snapshot);

#ifdef __cplusplus
}
#endif

#endif
