#include "microstepping.h"

#include "range.h"
#include "sine.h"

#define FULL_STEP 0x40000000U                            /* a quarter of an electrical turn [2^-32 turns] */
#define TURNS_PER_RAD (CGL_R(4294967296.0) / CGL_TWO_PI) /* [2^-32 turns / rad] */

/* Whether the waves are in range, and the command always rises with the angle, because the slope of the waves' sum is above -1. */
CGL_SELDOM static bool is_correction(const cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES])
{
    cgl_real slope = CGL_R(0.0);
    for (uint32_t k = 0U; k < (uint32_t)CGL_MICROSTEPPING_WAVES; ++k) {
        if (wave[k].order != 0U) {
            if (!(wave[k].order <= 65535U && cgl_is_not_negative(wave[k].magnitude) && cgl_is_angle(wave[k].phase))) {
                return false;
            }
            slope += (cgl_real)wave[k].order * wave[k].magnitude;
        }
    }
    return slope < CGL_R(1.0);
}

CGL_SELDOM static uint32_t microsteps_of(const cgl_microstepping_config *config)
{
    return config->microsteps == 0U ? (uint32_t)CGL_MICROSTEPS_DEFAULT : config->microsteps;
}

CGL_SELDOM static void to_turns(const cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES], uint32_t phase[CGL_MICROSTEPPING_WAVES])
{
    for (uint32_t k = 0U; k < (uint32_t)CGL_MICROSTEPPING_WAVES; ++k) {
        phase[k] = wave[k].order != 0U && cgl_is_angle(wave[k].phase) ? cgl_turns(wave[k].phase) : 0U;
    }
}

CGL_SELDOM const char *cgl_microstepping_bad_field(const cgl_microstepping_config *config)
{
    static const cgl_range range[] = {
        CGL_RANGE(microstepping, teeth, CGL_COUNT), CGL_RANGE(microstepping, current, CGL_POSITIVE)};
    const char *const field = cgl_out_of_range(config, range, CGL_ROWS(range));
    const uint32_t microsteps = microsteps_of(config);
    if (field != 0) {
        return field;
    }
    if (microsteps > (uint32_t)CGL_MICROSTEPS_MAX || (microsteps & (microsteps - 1U)) != 0U) {
        return CGL_FIELD("microstepping.microsteps");
    }
    if (!is_correction(config->forward)) {
        return CGL_FIELD("microstepping.forward");
    }
    return is_correction(config->backward) ? 0 : CGL_FIELD("microstepping.backward");
}

CGL_SELDOM cgl_error cgl_microstepping_init(cgl_microstepping *motor, const cgl_microstepping_config *config)
{
    motor->ready = 0U;
    cgl_microstepping_reset(motor);
    return cgl_microstepping_retune(motor, config);
}

CGL_SELDOM void cgl_microstepping_reset(cgl_microstepping *motor)
{
    motor->command = 0U;
    motor->backward = false;
}

CGL_SELDOM cgl_error cgl_microstepping_retune(cgl_microstepping *motor, const cgl_microstepping_config *config)
{
    if (cgl_microstepping_bad_field(config) != 0) {
        return CGL_ERROR_CONFIG;
    }
    motor->config = *config;
    to_turns(config->forward, motor->phase_forward);
    to_turns(config->backward, motor->phase_backward);
    motor->microstep = FULL_STEP / microsteps_of(config);
    motor->ready = CGL_READY;
    return CGL_OK;
}

/* Returns the correction of the command at the electrical angle u, both in [2^-32 turns]. */
static uint32_t correction(const cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES],
                           const uint32_t phase[CGL_MICROSTEPPING_WAVES], uint32_t u)
{
    cgl_real sum = CGL_R(0.0);
    for (uint32_t k = 0U; k < (uint32_t)CGL_MICROSTEPPING_WAVES; ++k) {
        if (wave[k].order != 0U) {
            cgl_real sine, cosine;
            cgl_sincos_of_turns(wave[k].order * u + phase[k], &sine, &cosine);
            sum += wave[k].magnitude * sine;
        }
    }
    return (uint32_t)(int32_t)(cgl_clamp(sum, CGL_R(1.0)) * TURNS_PER_RAD);
}

void cgl_microstepping_step(cgl_microstepping *motor, cgl_real theta_ref, cgl_real omega_ref, cgl_microstepping_output *out)
{
    const cgl_microstepping_config *const config = &motor->config;
    cgl_real sine, cosine;
    out->status = 0U;
    if (motor->ready != CGL_READY) {
        out->i_a = out->i_b = CGL_R(0.0);
        out->status = (unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_OFF;
        return;
    }
    if (CGL_OFTEN(cgl_is_angle(theta_ref) && cgl_is_finite(omega_ref))) {
        const uint32_t u = config->teeth * cgl_turns(theta_ref);
        if (omega_ref != CGL_R(0.0)) {
            motor->backward = omega_ref < CGL_R(0.0);
        }
        const uint32_t off = motor->backward ? correction(config->backward, motor->phase_backward, u)
                                             : correction(config->forward, motor->phase_forward, u);
        motor->command = (u + off + motor->microstep / 2U) & ~(motor->microstep - 1U);
    } else {
        out->status = (unsigned)CGL_STATUS_FAULT;
    }
    cgl_sincos_of_turns(motor->command, &sine, &cosine);
    out->i_a = cgl_clamp(config->current * cosine, config->current);
    out->i_b = cgl_clamp(config->current * sine, config->current);
}
