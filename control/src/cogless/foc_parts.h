/* The parts of cgl_foc_step() that a period without limits needs. They have no branches but those that a motor's kind and the config
 * decide, so several drives can take them together: see choice.h. */
#ifndef COGLESS_FOC_PARTS_H
#define COGLESS_FOC_PARTS_H

#include "choice.h"
#include "duties.h"
#include "foc.h"
#include "real.h"
#include "transform.h"

#define CGL_BUS_MIN CGL_R(1.0e-30) /* lowest bus voltage with a finite reciprocal [V] */

typedef struct {
    cgl_real d, q;
} cgl_vector;

/* Whether x is shorter than this length; false for NaN. */
static inline cgl_truth cgl_is_shorter(cgl_vector x, cgl_real length)
{
    return x.d * x.d + x.q * x.q < length * length;
}

/* The measured currents in the frame of the rotor, whose angle has this sine and cosine [A]. */
static inline cgl_vector cgl_foc_currents(const cgl_foc_input *in, bool two_phases, cgl_real sine, cgl_real cosine)
{
    cgl_real alpha, beta;
    cgl_vector i;
    if (two_phases) {
        alpha = in->i_abc[0];
        beta = in->i_abc[1];
    } else {
        cgl_clarke(in->i_abc, &alpha, &beta);
    }
    cgl_park(alpha, beta, sine, cosine, &i.d, &i.q);
    return i;
}

/* The voltage for the currents i and their errors [V]. */
static inline cgl_vector cgl_foc_voltage(const cgl_foc *foc, cgl_real omega_e, cgl_vector i, cgl_vector error)
{
    const cgl_foc_config *const config = &foc->config;
    cgl_vector u = {config->kp_d * error.d + foc->integral_d, config->kp_q * error.q + foc->integral_q};
    if (config->decoupling) {
        u.d -= omega_e * config->L_q * i.q;
        u.q += omega_e * (config->L_d * i.d + config->psi_f);
    }
    return u;
}

/* The longest voltage as a share of the bus voltage. */
static inline cgl_real cgl_foc_longest(bool two_phases)
{
    return two_phases ? CGL_R(1.0) : CGL_R(0.57735026918962576451);
}

static inline void cgl_foc_integrate(cgl_foc *foc, cgl_vector error, cgl_real u_max)
{
    foc->integral_d = cgl_add(foc->integral_d, foc->rise_d * error.d, u_max, &foc->lost_d);
    foc->integral_q = cgl_add(foc->integral_q, foc->rise_q * error.q, u_max, &foc->lost_q);
}

/* The duty cycles of a voltage, given as a share of the bus voltage, in the frame of the rotor. Sine and cosine are those of the rotor's
 * angle when the voltage acts. */
static inline void cgl_foc_duties(cgl_vector share, bool two_phases, cgl_real sine, cgl_real cosine, cgl_real duty[3])
{
    cgl_real alpha, beta;
    cgl_park_inverse(share.d, share.q, sine, cosine, &alpha, &beta);
    cgl_real part[3] = {CGL_R(0.5) * alpha, CGL_R(0.5) * beta, CGL_R(0.0)}; /* of two H-bridges */
    if (!two_phases) {
        cgl_centred(alpha, beta, part);
    }
    cgl_duties(part, duty);
}

#endif
