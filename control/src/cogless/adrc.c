#include "adrc.h"

#include "decay.h"

#define FASTEST CGL_R(2.0) /* largest omega_o * ts [-]: with a larger product the observer would hardly smooth */

CGL_SELDOM const char *cgl_adrc_bad_field(const cgl_adrc_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(adrc, b, CGL_POSITIVE), CGL_RANGE(adrc, omega_c, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(adrc, omega_o, CGL_POSITIVE), CGL_RANGE(adrc, limit, CGL_POSITIVE)};
    const char *const field = CGL_OWN_FEEDBACK_BAD_FIELD(config, range, loop);
    if (field != 0) {
        return field;
    }
    if (!(config->omega_o * loop->ts <= FASTEST)) {
        return CGL_FIELD("adrc.omega_o");
    }
    if (!cgl_is_positive(CGL_R(1.0) / config->b)) {
        return CGL_FIELD("adrc.b");
    }
    return cgl_is_positive(config->b * config->limit) ? 0 : CGL_FIELD("adrc.limit");
}

/* Starts the estimates anew, as if `current` [A] had held the speed constant. */
CGL_SELDOM static void start(cgl_adrc *law, cgl_real current)
{
    const cgl_adrc_config *const config = &law->config;
    law->omega = law->proportional = CGL_R(0.0);
    law->before = cgl_clamped(current, config->limit);
    law->f = cgl_clamped(-config->b * law->before, law->most);
    law->rejected = law->before;
    law->started = false;
}

/* Stores a config, and computes the observer's gains. */
static void take(cgl_adrc *law, const cgl_adrc_config *config)
{
    const cgl_real p = cgl_decay(config->omega_o * law->loop.ts), q = CGL_R(1.0) - p;
    law->config = *config;
    law->l1 = CGL_R(1.0) - p * p;
    law->l2 = cgl_clamped(q * q / law->loop.ts, CGL_REAL_MAX);
    law->most = cgl_clamped(config->b * config->limit, CGL_REAL_MAX);
}

CGL_SELDOM cgl_error cgl_adrc_init(cgl_adrc *law, const cgl_adrc_config *config, const cgl_loop *loop)
{
    law->ready = 0U;
    if (cgl_adrc_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    law->loop = *loop;
    take(law, config);
    cgl_adrc_reset(law);
    law->ready = CGL_READY;
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_adrc_retune(cgl_adrc *law, const cgl_adrc_config *config)
{
    if (cgl_adrc_bad_field(config, &law->loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    take(law, config);
    law->f = cgl_clamped(law->f, law->most);
    law->before = cgl_clamped(law->before, config->limit);
    return CGL_OK;
}

CGL_SELDOM void cgl_adrc_reset(cgl_adrc *law)
{
    start(law, CGL_R(0.0));
}

void cgl_adrc_step(cgl_adrc *law, const cgl_law_input *in, cgl_law_output *out)
{
    const cgl_adrc_config *const config = &law->config;
    if (!CGL_OFTEN(law->ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (cgl_law_stands_by(in)) {
        start(law, cgl_law_stand_by(in, CGL_R(0.0), config->limit, out));
        return;
    }
    const bool measured = cgl_is_finite(in->omega_m), wanted = cgl_is_finite(in->omega_ref);
    if (!law->started && measured) {
        law->omega = in->omega_m - law->loop.ts * (law->f + config->b * law->before);
        law->started = true;
    }
    const cgl_real predicted = law->omega + law->loop.ts * (law->f + config->b * law->before);
    const cgl_real e = measured && law->started ? in->omega_m - predicted : CGL_R(0.0);
    law->omega = cgl_clamp(predicted + law->l1 * e, CGL_REAL_MAX);
    law->f = cgl_clamp(law->f + law->l2 * e, law->most);
    const cgl_real error = wanted && law->started ? in->omega_ref - law->omega : CGL_R(0.0);
    law->proportional = cgl_clamp(config->omega_c * error / config->b, CGL_REAL_MAX);
    law->rejected = -law->f / config->b;
    const cgl_real sum = law->proportional + law->rejected;
    out->i_q_ref = law->before = cgl_clamp(sum, config->limit);
    out->status = (unsigned)CGL_STATUS_FROZEN | (cgl_is_below(sum, config->limit) ? 0U : (unsigned)CGL_STATUS_SATURATED)
                  | (measured && wanted ? 0U : (unsigned)CGL_STATUS_FAULT);
}
