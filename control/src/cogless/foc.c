#include "foc.h"

#include "angle.h"
#include "foc_parts.h"
#include "range.h"
#include "sine.h"
#include "square_root.h"

CGL_SELDOM const char *cgl_foc_bad_field(const cgl_foc_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(foc, kp_d, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, ki_d, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, kp_q, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, ki_q, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, current_limit, CGL_POSITIVE),
                                      CGL_RANGE(foc, advance, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, L_d, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, L_q, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(foc, psi_f, CGL_NOT_NEGATIVE)};
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (config->current_limit > CGL_CURRENT_MAX) {
        return CGL_FIELD("foc.current_limit");
    }
    if (!(config->phases == 0U || config->phases == 2U || config->phases == 3U)) {
        return CGL_FIELD("foc.phases");
    }
    return cgl_is_positive(ts) ? 0 : CGL_FIELD("ts");
}

/* Stores a valid config and the values that follow from it. */
CGL_SELDOM static void take(cgl_foc *foc, const cgl_foc_config *config)
{
    foc->config = *config;
    foc->ahead = config->advance * foc->ts;
    foc->rise_d = config->ki_d * foc->ts;
    foc->rise_q = config->ki_q * foc->ts;
}

CGL_SELDOM cgl_error cgl_foc_init(cgl_foc *foc, const cgl_foc_config *config, cgl_real ts)
{
    if (cgl_foc_bad_field(config, ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    foc->ts = ts;
    take(foc, config);
    cgl_foc_reset(foc);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_foc_retune(cgl_foc *foc, const cgl_foc_config *config)
{
    if (cgl_foc_bad_field(config, foc->ts) != 0 || (config->phases == 2U) != (foc->config.phases == 2U)) {
        return CGL_ERROR_CONFIG;
    }
    take(foc, config);
    return CGL_OK;
}

CGL_SELDOM void cgl_foc_reset(cgl_foc *foc)
{
    foc->integral_d = CGL_R(0.0);
    foc->integral_q = CGL_R(0.0);
    foc->lost_d = foc->lost_q = CGL_R(0.0);
}

/* Returns a component with its old sign and a new magnitude, `size` >= 0. Rounding cannot make the magnitude larger than it was. */
CGL_SELDOM static cgl_real with_size(cgl_real component, cgl_real size)
{
    return cgl_clamped(size, cgl_abs(component)) * cgl_sign(component);
}

/* Returns x, shortened to this length if it is longer. A component that is not finite counts as zero. */
CGL_SELDOM static cgl_vector shortened(cgl_vector x, cgl_real length)
{
    x.d = cgl_finite_or_zero(x.d);
    x.q = cgl_finite_or_zero(x.q);
    const cgl_real u = x.d / length;
    const cgl_real v = x.q / length;
    if (!(u * u + v * v > CGL_R(1.0))) {
        return x;
    }
    /* the squares of the components could overflow; the ratio of the components cannot */
    const bool steep = cgl_abs(x.q) > cgl_abs(x.d);
    const cgl_real ratio = steep ? x.d / x.q : x.q / x.d;
    const cgl_real longer = length / cgl_root_of_1_to_4(CGL_R(1.0) + ratio * ratio);
    const cgl_real shorter = longer * cgl_abs(ratio);
    x.d = with_size(x.d, steep ? shorter : longer);
    x.q = with_size(x.q, steep ? longer : shorter);
    return x;
}

/* Whether a component of x is smaller than the same component of `than`. So a vector that is exactly as long as its limit does not count as
 * shortened. */
static bool is_shorter(cgl_vector x, cgl_vector than)
{
    return cgl_abs(x.d) < cgl_abs(than.d) || cgl_abs(x.q) < cgl_abs(than.q);
}

/* Returns the error that the integral takes: the error less the part whose proportional voltage was cut off. `missing` is the voltage after
 * the cut less the voltage before the cut [V]. */
static cgl_real taken_back(cgl_real error, cgl_real kp, cgl_real missing)
{
    return kp > CGL_R(0.0) ? error + missing / kp : error;
}

/* Sets the output at a fault: zero voltage. */
CGL_SELDOM static void safe(const cgl_foc *foc, const cgl_foc_input *in, cgl_foc_output *out)
{
    const cgl_vector wanted = {in->i_d_ref, in->i_q_ref};
    const cgl_vector ref = shortened(wanted, foc->config.current_limit);
    out->i_d_ref = ref.d;
    out->i_q_ref = ref.q;
    out->duty[0] = out->duty[1] = out->duty[2] = CGL_R(0.5);
    out->i_d = out->i_q = out->u_d = out->u_q = CGL_R(0.0);
    out->status = CGL_STATUS_FAULT;
}

void cgl_foc_step(cgl_foc *foc, const cgl_foc_input *in, cgl_foc_output *out)
{
    const cgl_foc_config *const config = &foc->config;
    const bool two_phases = config->phases == 2U;
    const cgl_real omega_e = in->omega_e, u_dc = in->u_dc;
    /* the angle by which the rotor turns until the voltage acts */
    const cgl_real ahead = foc->ahead * omega_e;
    if (!(cgl_is_angle(in->theta_e) && cgl_is_angle(in->theta_e + ahead) && u_dc >= CGL_BUS_MIN
          && cgl_is_finite(u_dc))) {
        safe(foc, in, out);
        return;
    }
    cgl_phasor rotor;
    cgl_sincos_of_angle(in->theta_e, &rotor.sine, &rotor.cosine);
    const cgl_vector i = cgl_foc_currents(in, two_phases, rotor.sine, rotor.cosine);

    cgl_vector ref = {in->i_d_ref, in->i_q_ref};
    out->status = 0U;
    if (!cgl_is_shorter(ref, config->current_limit)) {
        const cgl_vector wanted = ref;
        ref = shortened(wanted, config->current_limit);
        out->status = is_shorter(ref, wanted) ? (unsigned)CGL_STATUS_SATURATED : 0U;
    }
    cgl_vector error = {ref.d - i.d, ref.q - i.q};
    cgl_vector u = cgl_foc_voltage(foc, omega_e, i, error);

    /* a current that is not finite makes both voltages not finite, with any gains */
    const cgl_real per_bus = CGL_R(1.0) / u_dc, longest = cgl_foc_longest(two_phases), u_max = u_dc * longest;
    cgl_vector part = {u.d * per_bus, u.q * per_bus};
    if (!cgl_is_shorter(part, longest)) {
        if (!(cgl_is_finite(u.d) && cgl_is_finite(u.q))) {
            safe(foc, in, out);
            return;
        }
        const cgl_vector wanted = u;
        u = shortened(wanted, u_max);
        part.d = u.d * per_bus;
        part.q = u.q * per_bus;
        error.d = taken_back(error.d, config->kp_d, u.d - wanted.d);
        error.q = taken_back(error.q, config->kp_q, u.q - wanted.q);
        out->status = CGL_STATUS_SATURATED;
    }
    cgl_foc_integrate(foc, error, u_max);
    out->i_d = i.d;
    out->i_q = i.q;
    out->u_d = u.d;
    out->u_q = u.q;
    out->i_d_ref = ref.d;
    out->i_q_ref = ref.q;
    const cgl_phasor acting = cgl_product(rotor, cgl_phasor_ahead(ahead));
    cgl_foc_duties(part, two_phases, acting.sine, acting.cosine, out->duty);
}
