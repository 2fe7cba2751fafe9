#include "foc.h"

#include "angle.h"
#include "modulation.h"
#include "transform.h"

/* Square root of x in [1, 2]: Newton from the best straight line takes the same time for every x. */
static cgl_real square_root(cgl_real x)
{
    cgl_real root = CGL_R(0.59) + CGL_R(0.4142) * x;
    for (int n = 0; n < 3; ++n) {
        root = CGL_R(0.5) * (root + x / root);
    }
    return root;
}

cgl_error cgl_foc_init(const cgl_foc_config *config, cgl_foc *foc)
{
    if (!(cgl_is_not_negative(config->kp_d) && cgl_is_not_negative(config->ki_d) && cgl_is_not_negative(config->kp_q)
          && cgl_is_not_negative(config->ki_q) && cgl_is_not_negative(config->advance) && cgl_is_not_negative(config->L_d)
          && cgl_is_not_negative(config->L_q) && cgl_is_not_negative(config->psi_f) && cgl_is_not_negative(config->ts)
          && config->ts > CGL_R(0.0) && cgl_is_not_negative(config->current_limit)
          && config->current_limit > CGL_R(0.0)
          && (config->phases == 0U || config->phases == 2U || config->phases == 3U))) {
        return CGL_ERROR_CONFIG;
    }
    cgl_foc_reset(foc);
    return CGL_OK;
}

void cgl_foc_reset(cgl_foc *foc)
{
    foc->integral_d = CGL_R(0.0);
    foc->integral_q = CGL_R(0.0);
}

/* Shortens (x, y) to the given length where it is longer; true where it was. */
static bool limit_length(cgl_real *x, cgl_real *y, cgl_real length)
{
    const cgl_real u = *x / length;
    const cgl_real v = *y / length;
    if (!(u * u + v * v > CGL_R(1.0))) {
        return false;
    }
    /* by the ratio of the components, which cannot overflow */
    const bool steep = cgl_abs(*y) > cgl_abs(*x);
    const cgl_real ratio = steep ? *x / *y : *y / *x;
    const cgl_real longer = length / square_root(CGL_R(1.0) + ratio * ratio);
    const cgl_real shorter = longer * cgl_abs(ratio);
    *x = (steep ? shorter : longer) * cgl_sign(*x);
    *y = (steep ? longer : shorter) * cgl_sign(*y);
    return true;
}

/* Duty cycles of two H-bridges; the voltage is within the bus. */
static void modulate_two_phases(cgl_real u_a, cgl_real u_b, cgl_real u_dc, cgl_real duty[3])
{
    duty[0] = CGL_R(0.5) + cgl_clamp(CGL_R(0.5) * u_a / u_dc, CGL_R(0.5));
    duty[1] = CGL_R(0.5) + cgl_clamp(CGL_R(0.5) * u_b / u_dc, CGL_R(0.5));
    duty[2] = CGL_R(0.5);
}

static void safe(cgl_foc_output *out)
{
    out->duty[0] = out->duty[1] = out->duty[2] = CGL_R(0.5);
    out->i_d = out->i_q = out->u_d = out->u_q = CGL_R(0.0);
    out->status = CGL_STATUS_FAULT;
}

void cgl_foc_step(const cgl_foc_config *config, cgl_foc *foc, const cgl_foc_input *in, cgl_foc_output *out)
{
    /* the rotor turns on until the voltage acts */
    const cgl_real theta_acting = in->theta_e + config->advance * config->ts * in->omega_e;
    const bool two_phases = config->phases == 2U;
    if (!(cgl_is_finite(in->i_abc[0]) && cgl_is_finite(in->i_abc[1]) && (two_phases || cgl_is_finite(in->i_abc[2]))
          && cgl_is_angle(in->theta_e) && cgl_is_finite(in->omega_e) && cgl_is_angle(theta_acting)
          && in->u_dc > CGL_R(0.0) && cgl_is_finite(in->u_dc))) {
        safe(out);
        return;
    }
    cgl_real sine, cosine, alpha, beta, i_d, i_q;
    cgl_sincos(in->theta_e, &sine, &cosine);
    if (two_phases) {
        alpha = in->i_abc[0];
        beta = in->i_abc[1];
    } else {
        cgl_clarke(in->i_abc, &alpha, &beta);
    }
    cgl_park(alpha, beta, sine, cosine, &i_d, &i_q);

    cgl_real i_d_ref = cgl_is_finite(in->i_d_ref) ? in->i_d_ref : CGL_R(0.0);
    cgl_real i_q_ref = cgl_is_finite(in->i_q_ref) ? in->i_q_ref : CGL_R(0.0);
    limit_length(&i_d_ref, &i_q_ref, config->current_limit);

    const cgl_real e_d = i_d_ref - i_d;
    const cgl_real e_q = i_q_ref - i_q;
    cgl_real u_d = config->kp_d * e_d + foc->integral_d;
    cgl_real u_q = config->kp_q * e_q + foc->integral_q;
    if (config->decoupling) {
        u_d -= in->omega_e * config->L_q * i_q;
        u_q += in->omega_e * (config->L_d * i_d + config->psi_f);
    }
    if (!(cgl_is_finite(u_d) && cgl_is_finite(u_q))) { /* finite inputs whose products are not */
        safe(out);
        return;
    }
    const cgl_real u_max = two_phases ? in->u_dc : in->u_dc * CGL_R(0.57735026918962576451);
    const cgl_real wanted_d = u_d, wanted_q = u_q;
    const bool saturated = limit_length(&u_d, &u_q, u_max);

    /* what could not be realised is taken back from the error that the integrals see */
    const cgl_real back_d = config->kp_d > CGL_R(0.0) ? (u_d - wanted_d) / config->kp_d : CGL_R(0.0);
    const cgl_real back_q = config->kp_q > CGL_R(0.0) ? (u_q - wanted_q) / config->kp_q : CGL_R(0.0);
    foc->integral_d = cgl_clamp(foc->integral_d + config->ki_d * config->ts * (e_d + back_d), u_max);
    foc->integral_q = cgl_clamp(foc->integral_q + config->ki_q * config->ts * (e_q + back_q), u_max);

    cgl_sincos(theta_acting, &sine, &cosine);
    cgl_park_inverse(u_d, u_q, sine, cosine, &alpha, &beta);
    if (two_phases) {
        modulate_two_phases(alpha, beta, in->u_dc, out->duty);
    } else {
        cgl_modulate(alpha, beta, in->u_dc, out->duty);
    }

    out->i_d = i_d;
    out->i_q = i_q;
    out->u_d = u_d;
    out->u_q = u_q;
    out->status = saturated ? CGL_STATUS_SATURATED : 0U;
}
