#include "current_reference.h"

#include "range.h"
#include "square_root.h"

#define USUAL_SHARE CGL_R(0.95)
#define LARGEST_DROP CGL_R(1.0e6) /* bound of a voltage drop, as a multiple of the planned voltage (see `plane`); field weakening
                                     cannot make up for a larger drop */
#define NEWTON_STEPS 7
#define SEARCH_STEPS 26      /* number of golden-section steps; they narrow the range of i_d to 4e-6 of its first width */
#define BISECTION_STEPS 20
#define GOLDEN CGL_R(0.61803398874989484820)

CGL_SELDOM const char *cgl_current_reference_bad_field(const cgl_current_reference_config *config,
                                                       cgl_real current_limit)
{
    static const cgl_range range[] = {CGL_RANGE(current_reference, L_d, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(current_reference, L_q, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(current_reference, psi_f, CGL_POSITIVE),
                                      CGL_RANGE(current_reference, R_s, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(current_reference, voltage_share, CGL_NOT_NEGATIVE)};
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (config->voltage_share > CGL_R(1.0)) {
        return CGL_FIELD("current_reference.voltage_share");
    }
    const cgl_real saliency = (config->L_q - config->L_d) / config->psi_f * current_limit;
    return cgl_is_within(saliency, CGL_SALIENCY_MAX) ? 0 : CGL_FIELD("current_reference.psi_f");
}

/* Returns the d-axis current of most torque at the current limit, as a share of the limit. The condition of most torque is x (x - 1) = y^2,
 * with x = saliency d and y = saliency q. */
CGL_SELDOM static cgl_real d_at_limit(cgl_real saliency)
{
    return CGL_R(-2.0) * saliency / (CGL_R(1.0) + cgl_square_root(CGL_R(1.0) + CGL_R(8.0) * saliency * saliency));
}

/* Returns the largest q-axis current that the limit leaves beside the d-axis current d. Both are shares of the limit. */
static cgl_real q_at_limit(cgl_real d)
{
    return cgl_square_root(CGL_R(1.0) - d * d);
}

CGL_SELDOM cgl_error cgl_current_reference_init(cgl_current_reference *currents,
                                                const cgl_current_reference_config *config, cgl_drive *drive)
{
    if (drive->ready != CGL_READY || drive->foreign) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_foc_config *const foc = &drive->foc.config;
    if (cgl_current_reference_bad_field(config, foc->current_limit) != 0) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_real longest = foc->phases == 2U ? CGL_R(1.0) : CGL_R(0.57735026918962576451);
    currents->config = *config;
    currents->current_limit = foc->current_limit;
    currents->share = longest * cgl_or_default(config->voltage_share, USUAL_SHARE);
    currents->saliency = (config->L_q - config->L_d) / config->psi_f * foc->current_limit;
    currents->reach = CGL_R(1.0);
    if (config->mtpa) {
        const cgl_real d = d_at_limit(currents->saliency);
        currents->reach = q_at_limit(d) * (CGL_R(1.0) - currents->saliency * d);
    }
    drive->loop.current_limit = currents->reach * foc->current_limit;
    return CGL_OK;
}

/* Returns the d-axis current with which a torque takes the least current; both are shares of the limit. With x = -saliency d, the
 * condition of least current is (saliency q)^2 = x (1 + x). So x (1 + x)^3 = (saliency torque)^2. Newton's iteration falls towards x
 * from above. */
CGL_SELDOM static cgl_real d_of_least_current(cgl_real saliency, cgl_real torque)
{
    const cgl_real size = cgl_abs(saliency) * torque, square = size * size;
    cgl_real x = size < CGL_R(1.0) ? square : cgl_square_root(size);
    if (!(x > CGL_R(0.0))) {
        return CGL_R(0.0);
    }
    for (int n = 0; n < NEWTON_STEPS; ++n) {
        const cgl_real w = CGL_R(1.0) + x, ww = w * w;
        x -= (x * w * ww - square) / (ww * (CGL_R(1.0) + CGL_R(4.0) * x));
    }
    return -x / saliency;
}

/* Voltage drops at the current limit and the present speed, as multiples of the planned voltage. The planned voltage is the largest that
 * field weakening uses. d and q are currents as shares of the current limit, and q is not negative. The square of the voltage is
 *
 *   (r d - side x_q q)^2 + (side r q + flux + x_d d)^2 */
typedef struct {
    cgl_real r, x_d, x_q, flux; /* by resistance, inductances and magnets; all >= 0 */
    cgl_real side;              /* 1: the motor drives; -1: it brakes */
    cgl_real saliency;
} plane;

/* The square of the voltage less the square of the planned voltage, which is 1. The result is at most 0 if the voltage is low enough. */
static cgl_real excess(const plane *at, cgl_real d, cgl_real q)
{
    const cgl_real u_d = at->r * d - at->side * at->x_q * q;
    const cgl_real u_q = at->side * at->r * q + at->flux + at->x_d * d;
    return u_d * u_d + u_q * u_q - CGL_R(1.0);
}

/* Returns the largest torque with the d-axis current d within the limits of current and voltage. If no torque is possible, the result is
 * minus the least excess of the voltage. So the result has only one maximum over d: the logarithm of the torque is concave, and the excess
 * is convex. */
CGL_SELDOM static cgl_real largest_torque(const plane *at, cgl_real d)
{
    const cgl_real q_max = q_at_limit(d);
    const cgl_real a = at->r * at->r + at->x_q * at->x_q;
    const cgl_real b = at->side * at->r * (at->flux + (at->x_d - at->x_q) * d);
    cgl_real q = q_max;
    if (excess(at, d, q_max) > CGL_R(0.0)) {
        const cgl_real deepest = a > CGL_R(0.0) && b < CGL_R(0.0) ? -b / a : CGL_R(0.0);
        const cgl_real q_least = deepest < q_max ? deepest : q_max;
        const cgl_real least = excess(at, d, q_least);
        if (!(least <= CGL_R(0.0))) {
            return -least;
        }
        /* the excess is a q^2 + 2 b q + c: q is its larger root */
        const cgl_real c = excess(at, d, CGL_R(0.0));
        q = (cgl_square_root(b * b - a * c) - b) / a;
        q = q < q_least ? q_least : (q < q_max ? q : q_max);
    }
    return q * (CGL_R(1.0) - at->saliency * d);
}

/* Returns the d-axis current of the largest torque, by golden section. */
CGL_SELDOM static cgl_real d_of_largest_torque(const plane *at, cgl_real *torque)
{
    cgl_real low = CGL_R(-1.0), high = CGL_R(1.0);
    if (at->saliency < CGL_R(-1.0)) { /* the factor 1 - saliency d of the torque must not be negative */
        low = CGL_R(1.0) / at->saliency;
    } else if (at->saliency > CGL_R(1.0)) {
        high = CGL_R(1.0) / at->saliency;
    } else { /* no bound is needed */
    }
    cgl_real left = high - GOLDEN * (high - low), right = low + GOLDEN * (high - low);
    cgl_real at_left = largest_torque(at, left), at_right = largest_torque(at, right);
    for (int n = 0; n < SEARCH_STEPS; ++n) {
        if (at_left > at_right) {
            high = right;
            right = left;
            at_right = at_left;
            left = high - GOLDEN * (high - low);
            at_left = largest_torque(at, left);
        } else {
            low = left;
            left = right;
            at_left = at_right;
            right = low + GOLDEN * (high - low);
            at_right = largest_torque(at, right);
        }
    }
    *torque = at_left > at_right ? at_left : at_right;
    return at_left > at_right ? left : right;
}

/* Whether the limits of current and voltage allow a torque with the d-axis current d. */
static bool is_possible(const plane *at, cgl_real d, cgl_real torque)
{
    const cgl_real q = torque / (CGL_R(1.0) - at->saliency * d);
    return d * d + q * q <= CGL_R(1.0) && excess(at, d, q) <= CGL_R(0.0);
}

/* Returns the d-axis current nearest to `wanted` that allows the torque. A torque above the largest possible one is reduced to that one. */
CGL_SELDOM static cgl_real weakened(const plane *at, cgl_real wanted, cgl_real *torque)
{
    cgl_real largest, outside = wanted;
    cgl_real inside = d_of_largest_torque(at, &largest);
    if (!(*torque < largest)) {
        *torque = largest > CGL_R(0.0) ? largest : CGL_R(0.0);
        return inside;
    }
    for (int n = 0; n < BISECTION_STEPS; ++n) {
        const cgl_real middle = CGL_R(0.5) * (inside + outside);
        if (is_possible(at, middle, *torque)) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    return inside;
}

/* Returns a voltage drop as a multiple of the planned voltage, limited to LARGEST_DROP. */
static cgl_real drop(cgl_real voltage, cgl_real planned)
{
    const cgl_real ratio = voltage / planned;
    return ratio < LARGEST_DROP ? ratio : LARGEST_DROP;
}

void cgl_current_reference_step(const cgl_current_reference *currents, cgl_drive *drive)
{
    const cgl_current_reference_config *const config = &currents->config;
    const cgl_real limit = currents->current_limit, saliency = currents->saliency;
    const cgl_real wanted = cgl_finite_or_zero(drive->command.i_q_ref) / limit;
    const cgl_real side = wanted < CGL_R(0.0) ? CGL_R(-1.0) : CGL_R(1.0);
    const cgl_real planned = currents->share * drive->currents.u_dc, omega_e = drive->currents.omega_e;
    cgl_real torque = cgl_clamp(cgl_abs(wanted), currents->reach);
    cgl_real d = config->mtpa ? d_of_least_current(saliency, torque) : CGL_R(0.0);
    if (config->field_weakening && cgl_is_positive(planned) && cgl_is_finite(omega_e)) {
        const cgl_real speed = cgl_abs(omega_e);
        const plane at = {drop(config->R_s * limit, planned),
                          drop(speed * config->L_d * limit, planned),
                          drop(speed * config->L_q * limit, planned),
                          drop(speed * config->psi_f, planned),
                          omega_e * side < CGL_R(0.0) ? CGL_R(-1.0) : CGL_R(1.0),
                          saliency};
        if (excess(&at, d, torque / (CGL_R(1.0) - saliency * d)) > CGL_R(0.0)) {
            d = weakened(&at, d, &torque);
        }
    }
    const cgl_real q = torque > CGL_R(0.0) ? torque / (CGL_R(1.0) - saliency * d) : CGL_R(0.0);
    if (torque < cgl_abs(wanted)) {
        drive->saturated = true;
        drive->command.status |= (unsigned)CGL_STATUS_SATURATED;
    }
    drive->currents.i_d_ref = cgl_clamp(d, CGL_R(1.0)) * limit;
    drive->command.i_q_ref = cgl_clamp(q, CGL_R(1.0)) * side * limit;
}

void cgl_current_reference_actuate(const cgl_current_reference *currents, cgl_drive *drive, cgl_drive_output *out)
{
    cgl_drive_actuate(drive, out);
    drive->i_q = cgl_finite_or_zero(out->i_q * (CGL_R(1.0) - currents->saliency * (out->i_d / currents->current_limit)));
}
