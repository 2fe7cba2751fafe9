#include "learner.h"

#include <stddef.h>

const char *learner_start(learner *self, const loop_gains *gains)
{
    const cgl_real limit = CGL_R(0.3) * gains->current_limit; /* most of the current stays the loop's own */
    const cgl_drive_config drive_config = {.pole_pairs = 1, .divider = 1, .foreign = true, .feed_forward = true,
                                           .foc = {.current_limit = gains->current_limit}};
    const cgl_pi_ilc_config law_config = {
        .pi = {.kp = gains->kp, .ki = gains->ki, .limit = limit}, /* of that loop: they bound the learning, and do not act */
        .gain = CGL_R(0.5) * gains->kp,
        .memory = {.cells = LEARNER_CELLS, .q_half_width = LEARNER_Q, .limit = {limit},
                   .lead = (uint32_t)(gains->delay * gains->rate + CGL_R(0.5))}};
    const cgl_real ts = CGL_R(1.0) / gains->rate;
    if (cgl_drive_init(&self->drive, &drive_config, ts) != CGL_OK) {
        return cgl_drive_bad_field(&drive_config, ts);
    }
    if (cgl_pi_ilc_init(&self->law, &law_config, &self->drive.loop, self->map, CGL_ENTRIES(self->map)) != CGL_OK) {
        return cgl_pi_ilc_bad_field(&law_config, &self->drive.loop);
    }
    return NULL;
}

cgl_real learner_current(learner *self, cgl_real theta_m, cgl_real omega_m, cgl_real omega_ref, bool learn)
{
    const cgl_measurement now = {.theta_m = theta_m, .omega_m = omega_m};
    const cgl_reference reference = {.omega_ref = omega_ref, .learn = learn};
    cgl_drive_output out;
    if (cgl_drive_measure(&self->drive, &now, &reference)) {
        cgl_pi_ilc_step(&self->law, &self->drive.in, &self->drive.command);
    }
    cgl_drive_actuate(&self->drive, &out);
    return out.i_q_ref;
}
