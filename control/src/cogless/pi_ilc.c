#include "pi_ilc.h"

/* Returns the number of channels whose mean belongs to the PI's integral. */
static uint32_t centred(const cgl_pi_ilc_config *config)
{
    return config->pi.ki > CGL_R(0.0) ? 1U : 0U;
}

CGL_SELDOM const char *cgl_pi_ilc_bad_field(const cgl_pi_ilc_config *config, const cgl_loop *loop)
{
    const char *field = cgl_pi_bad_field(&config->pi, loop);
    field = field != 0 ? field : cgl_memory_bad_field(&config->memory, loop->ts);
    if (field != 0) {
        return field;
    }
    if (config->memory.channels > 1U) {
        return CGL_FIELD("memory.channels");
    }
    if (config->memory.limit[0] > loop->current_limit) {
        return CGL_FIELD("memory.limit");
    }
    if (!cgl_is_not_negative(config->gain)) {
        return CGL_FIELD("pi_ilc.gain");
    }
    return cgl_loop_can_learn(loop, config->gain, config->pi.kp) ? 0 : CGL_FIELD("pi.kp");
}

/* Applies the guard's step of gentle learning, an index of cgl_gentle_steps. */
CGL_SELDOM static void follow_guard(cgl_pi_ilc *law, uint32_t gentle)
{
    const cgl_real forgetting = cgl_gentle_forgetting(gentle);
    law->gentle = gentle;
    cgl_memory_soften(&law->memory, forgetting);
    law->acting = law->gain * cgl_gentle_gain(gentle, law->gain, law->pi.config.kp);
    law->idle = !(law->acting > CGL_R(0.0)) && forgetting > CGL_R(0.0);
}

CGL_SELDOM cgl_error cgl_pi_ilc_init(cgl_pi_ilc *law, const cgl_pi_ilc_config *config, const cgl_loop *loop, cgl_real *cell,
                                     uint32_t length)
{
    law->pi.ready = 0U;
    if (cgl_pi_ilc_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_error error = cgl_memory_init(&law->memory, &config->memory, loop->ts, 1U, cell, length);
    if (error != CGL_OK) {
        return error;
    }
    cgl_memory_centre(&law->memory, centred(config));
    law->gain = config->gain;
    law->learned = CGL_R(0.0);
    (void)cgl_pi_init(&law->pi, &config->pi, loop);
    follow_guard(law, 0U);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_pi_ilc_retune(cgl_pi_ilc *law, const cgl_pi_ilc_config *config)
{
    if (cgl_pi_ilc_bad_field(config, &law->pi.loop) != 0 || cgl_memory_retune(&law->memory, &config->memory) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    (void)cgl_pi_retune(&law->pi, &config->pi);
    law->gain = config->gain;
    cgl_memory_centre(&law->memory, centred(config));
    law->gentle = UINT32_MAX; /* no valid index, so the next step applies the guard's step again */
    return CGL_OK;
}

CGL_SELDOM void cgl_pi_ilc_reset(cgl_pi_ilc *law)
{
    cgl_pi_reset(&law->pi);
    cgl_memory_reset(&law->memory);
    law->learned = CGL_R(0.0);
}

/* Sets the output after the step of the memory, if the output is at its limit, an input is not plausible, or nothing is learned. */
CGL_SELDOM static void step_otherwise(cgl_pi_ilc *law, const cgl_law_input *in,
                                      cgl_real error, bool learn, cgl_law_output *out)
{
    if (cgl_law_stands_by(in)) {
        law->learned = in->off ? CGL_R(0.0) : law->learned;
        cgl_pi_start(&law->pi, cgl_law_stand_by(in, law->learned, law->pi.config.limit, out));
        return;
    }
    const bool plausible = cgl_is_finite(error) && cgl_is_angle(in->theta_m);
    out->i_q_ref = cgl_pi_step(&law->pi, error, law->learned);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U) | (learn ? 0U : (unsigned)CGL_STATUS_FROZEN)
                  | (plausible ? 0U : (unsigned)CGL_STATUS_FAULT);
}

void cgl_pi_ilc_step(cgl_pi_ilc *law, const cgl_law_input *in,
                     cgl_law_output *out)
{
    const cgl_real error = in->omega_ref - in->omega_m;
    const uint32_t gentle = cgl_law_gentle(in);
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (gentle != law->gentle) {
        follow_guard(law, gentle);
    }
    const cgl_real correction = law->acting * error;
    cgl_real value;
    const bool learn = cgl_memory_step(&law->memory, in->theta_m, in->omega_ref,
                                       ((in->learn && !law->idle && !law->pi.saturated) || in->forget) && !cgl_law_stands_by(in), &correction, &value);
    const cgl_real share = cgl_law_share(in);
    law->learned = share * cgl_clamp(value, law->memory.config.limit[0]);
    if (learn) {
        cgl_pi_take_over(&law->pi, share * law->memory.channel[0].transfer);
    }
    if (learn && cgl_pi_step_free(&law->pi, error, law->learned, &out->i_q_ref)) {
        out->status = 0U;
    } else {
        step_otherwise(law, in, error, learn, out);
    }
}
