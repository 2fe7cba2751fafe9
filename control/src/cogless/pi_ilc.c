#include "pi_ilc.h"

cgl_error cgl_pi_ilc_init(const cgl_pi_ilc_config *config, cgl_pi_ilc *law, cgl_real *cell, uint32_t length)
{
    if (!cgl_is_not_negative(config->gain)) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_pi_init(&config->pi, &law->pi);
    law->learned = CGL_R(0.0);
    return error != CGL_OK ? error : cgl_memory_init(&config->memory, &law->memory, cell, length);
}

void cgl_pi_ilc_reset(const cgl_pi_ilc_config *config, cgl_pi_ilc *law)
{
    cgl_pi_reset(&law->pi);
    cgl_memory_reset(&config->memory, &law->memory);
    law->learned = CGL_R(0.0);
}

void cgl_pi_ilc_step(const cgl_pi_ilc_config *config, cgl_pi_ilc *law, const cgl_speed_input *in,
                     cgl_speed_output *out)
{
    const cgl_real error = in->omega_ref - in->omega_m;
    const bool plausible = cgl_is_finite(error) && cgl_is_angle(in->theta_m);
    cgl_real filtered, held;
    const bool known = cgl_memory_recall(&config->memory, &law->memory, in->theta_m, in->omega_ref, &filtered, &held);
    const bool learn = in->learn && plausible && known && !law->pi.saturated;

    law->learned =
        cgl_memory_update(&config->memory, &law->memory, learn ? filtered : held, config->gain * error, learn);
    out->i_q_ref = cgl_pi_step(&config->pi, &law->pi, error, law->learned);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}
