#include "telemetry.h"

#define TRIES 4

CGL_SELDOM void cgl_telemetry_reset(cgl_telemetry *telemetry)
{
    telemetry->buffer[0].count = telemetry->buffer[1].count = 0U;
    telemetry->count = 0U;
}

void cgl_telemetry_write(cgl_telemetry *telemetry, const cgl_drive *drive, const cgl_drive_output *out)
{
    volatile uint32_t *const complete = &telemetry->count;
    const uint32_t before = *complete, count = before < UINT32_MAX ? before + 1U : 2U; /* 0 means that there is no snapshot yet */
    volatile cgl_snapshot *const next = &telemetry->buffer[count & 1U];
    next->count = count;
    next->status = out->status;
    next->theta_m = drive->monitor.theta_m;
    next->omega_m = drive->monitor.omega_m;
    next->omega_ref = drive->in.omega_ref;
    next->i_d = out->i_d;
    next->i_q = out->i_q;
    next->i_d_ref = out->i_d_ref;
    next->i_q_ref = out->i_q_ref;
    next->u_d = out->u_d;
    next->u_q = out->u_q;
    next->u_dc = drive->currents.u_dc;
    *complete = count;
}

bool cgl_telemetry_read(const cgl_telemetry *telemetry, cgl_snapshot *snapshot)
{
    const volatile uint32_t *const complete = &telemetry->count;
    for (int n = 0; n < TRIES; ++n) {
        const uint32_t before = *complete;
        const volatile cgl_snapshot *const newest = &telemetry->buffer[before & 1U];
        const cgl_snapshot copy = {newest->count,   newest->status, newest->theta_m, newest->omega_m,
                                   newest->omega_ref, newest->i_d,    newest->i_q,     newest->i_d_ref,
                                   newest->i_q_ref, newest->u_d,    newest->u_q,     newest->u_dc};
        /* the next snapshot goes into the other buffer, and the one after next into the buffer just copied */
        const uint32_t after = *complete;
        /* cppcheck-suppress knownConditionTrueFalse ; an interrupt writes it meanwhile */
        if ((after == before || after == before + 1U) && copy.count == before) {
            *snapshot = copy;
            return before != 0U;
        }
    }
    return false;
}
