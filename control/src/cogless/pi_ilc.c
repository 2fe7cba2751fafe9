#include "pi_ilc.h"

CGL_SELDOM cgl_error cgl_pi_ilc_init(cgl_pi_ilc *law, const cgl_pi_ilc_config *config, cgl_real ts, cgl_real *cell, uint32_t length)
{
    if (!cgl_is_not_negative(config->gain)) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_pi_init(&law->pi, &config->pi, ts);
    law->gain = law->acting = config->gain;
    law->gentle = 0U;
    law->learned = CGL_R(0.0);
    return error != CGL_OK ? error : cgl_memory_init(&law->memory, &config->memory, ts, cell, length);
}

CGL_SELDOM void cgl_pi_ilc_reset(cgl_pi_ilc *law)
{
    cgl_pi_reset(&law->pi);
    cgl_memory_reset(&law->memory);
    law->learned = CGL_R(0.0);
}

/* A step in which something is at its limit, not plausible, or not learning; the memory is done. */
CGL_SELDOM static void step_otherwise(cgl_pi_ilc *law, const cgl_law_input *in,
                                      cgl_real error, bool learn, cgl_law_output *out)
{
    if (in->off) {
        cgl_pi_reset(&law->pi);
        law->learned = CGL_R(0.0);
        cgl_law_off(out);
        return;
    }
    const bool plausible = cgl_is_finite(error) && cgl_is_angle(in->theta_m);
    out->i_q_ref = cgl_pi_step(&law->pi, error, law->learned);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}

/* What the guard has just changed, or clears. */
CGL_SELDOM static void follow_guard(cgl_pi_ilc *law, const cgl_law_input *in)
{
    law->gentle = in->gentle;
    law->acting = law->gain * cgl_gentle_gain(in->gentle, law->gain, law->pi.config.kp);
    cgl_memory_soften(&law->memory, cgl_gentle_forgetting(in->gentle));
    if (in->forget) {
        cgl_memory_forget(&law->memory, in->theta_m);
    }
}

void cgl_pi_ilc_step(cgl_pi_ilc *law, const cgl_law_input *in,
                     cgl_law_output *out)
{
    const cgl_real error = in->omega_ref - in->omega_m;
    bool learn = in->learn && !in->off && !law->pi.saturated; /* and only if the memory can learn now: the error is finite, the angle known */
    if (in->gentle != law->gentle || in->forget) {
        follow_guard(law, in);
    }
    law->learned = in->share * cgl_memory_step(&law->memory, in->theta_m, in->omega_ref, law->acting * error, &learn);
    if (learn && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, learn, out);
    }
}
