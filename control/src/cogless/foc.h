/* Field-oriented current control: from measured phase currents to duty cycles, once per current-loop period. */
#ifndef COGLESS_FOC_H
#define COGLESS_FOC_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_CURRENT_MAX CGL_R(1.0e5) /* largest current limit [A]: a larger value is probably in a wrong unit */

typedef struct {
    cgl_real kp_d, ki_d;    /* d-axis gains [V/A], [V/A/s], >= 0 */
    cgl_real kp_q, ki_q;    /* q-axis gains [V/A], [V/A/s], >= 0 */
    cgl_real current_limit; /* largest length of the current reference [A], > 0, to CGL_CURRENT_MAX */
    cgl_real advance;       /* the voltage acts this many periods after sampling: 1.5 with one period of computation
                               delay, 0.5 without [periods], >= 0 */
    bool decoupling;        /* true: the speed voltages are fed forward, by the three values below; usually true */
    cgl_real L_d, L_q;      /* inductances [H], >= 0 */
    cgl_real psi_f;         /* magnet flux linkage, peak per phase [V s], >= 0 */
    uint32_t phases;        /* 3 (or 0): star connection and half bridges; 2: two H-bridges; default 3 */
} cgl_foc_config;

typedef struct {
    cgl_foc_config config;
    cgl_real ts;                     /* sampling period [s] */
    cgl_real ahead;                  /* time from sampling until the voltage acts [s] */
    cgl_real rise_d, rise_q;         /* growth of an integral in a period per error, ki ts [V/A] */
    cgl_real integral_d, integral_q; /* integral parts of the voltage [V] */
    cgl_real lost_d, lost_q;         /* rounding errors of the integrals, which the next step adds [V] */
} cgl_foc;

typedef struct {
    cgl_real i_abc[3];         /* measured phase currents [A]; the first two in a two-phase motor */
    cgl_real theta_e;          /* measured electrical angle [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX */
    cgl_real omega_e;          /* electrical speed [rad/s] */
    cgl_real u_dc;             /* bus voltage [V] */
    cgl_real i_d_ref, i_q_ref; /* current references in the rotor's frame [A] */
} cgl_foc_input;

typedef struct {
    cgl_real duty[3];          /* duty cycles in [0, 1]; two phases use the first two, with mean voltage u_dc (2 duty - 1) */
    cgl_real i_d, i_q;         /* measured currents in the rotor's frame [A] */
    cgl_real u_d, u_q;         /* voltage that the duty cycles realise [V] */
    cgl_real i_d_ref, i_q_ref; /* references after limiting: a vector of at most current_limit [A] */
    unsigned status;           /* CGL_STATUS_SATURATED: voltage or reference was limited; CGL_STATUS_FAULT */
} cgl_foc_output;

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_foc_bad_field(const cgl_foc_config *config, cgl_real ts);

cgl_error cgl_foc_init(cgl_foc *foc, const cgl_foc_config *config, cgl_real ts);

/* Replaces the config at run time. The integrals stay. The number of phases must not change. */
cgl_error cgl_foc_retune(cgl_foc *foc, const cgl_foc_config *config);

void cgl_foc_reset(cgl_foc *foc);

/* PI control of i_d and i_q with speed voltages fed forward. Vectors that are too long are shortened, and keep their angle. The limit of
 * the reference is current_limit. The limit of the voltage is u_dc / sqrt(3), or u_dc with two phases. The integrals follow the
 * shortened voltage (back calculation). A reference that is not finite counts as zero. A fault gives zero voltage, holds the integrals
 * and sets CGL_STATUS_FAULT. Faults are: a current, angle, speed or bus voltage that is not finite; a bus voltage below 1e-30 V; an
 * angle beyond CGL_ANGLE_MAX, now or when the voltage will act. */
void cgl_foc_step(cgl_foc *foc, const cgl_foc_input *in, cgl_foc_output *out);

#ifdef __cplusplus
}
#endif

#endif
