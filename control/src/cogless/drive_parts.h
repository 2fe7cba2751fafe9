/* Parts of a drive's step that a period without faults needs. */
#ifndef COGLESS_DRIVE_PARTS_H
#define COGLESS_DRIVE_PARTS_H

#include "drive.h"

/* Whether the law follows a speed that the drive does not know. */
static inline bool cgl_drive_is_busy(const cgl_drive *drive)
{
    return (drive->command.status & (unsigned)CGL_STATUS_BUSY) != 0U;
}

/* The reference of the speed by which the monitor looks for a stuck angle [rad/s]. */
static inline cgl_real cgl_drive_omega_ref(const cgl_drive *drive, const cgl_reference *reference)
{
    return cgl_drive_is_busy(drive) || reference->torque ? CGL_R(0.0) : reference->omega_ref;
}

/* Whether the drive's own current loop acts in this period. */
static inline bool cgl_drive_controls(const cgl_drive *drive)
{
    return CGL_OFTEN(drive->ready == CGL_READY) && !drive->monitor.safe && !drive->foreign;
}

/* The status bits of all parts but the current loop. */
static inline unsigned cgl_drive_status(const cgl_drive *drive)
{
    return drive->status | drive->command.status | drive->held;
}

/* Takes over the output of the current loop's step. `status` is cgl_drive_status(). */
static inline void cgl_drive_conclude(cgl_drive *drive, cgl_drive_output *out, unsigned status)
{
    drive->i_q = out->i_q;
    if (out->status != 0U) { /* the current loop has fallen short of its reference */
        drive->saturated = true;
    }
    out->status |= status;
}

#endif
