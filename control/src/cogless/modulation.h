/* Space-vector modulation: duty cycles of a three-phase two-level inverter. */
#ifndef COGLESS_MODULATION_H
#define COGLESS_MODULATION_H

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Computes the duty cycles in [0, 1] that realise the voltage (u_alpha, u_beta) [V] from the bus voltage u_dc [V]. A common-mode voltage
 * centres the three phases (the min-max form of space-vector modulation). The duty cycles are exact for a voltage vector of at most u_dc /
 * sqrt(3). If u_dc is not positive, or a voltage is not finite, all duty cycles are 0.5, which is zero voltage. */
void cgl_modulate(cgl_real u_alpha, cgl_real u_beta, cgl_real u_dc, cgl_real duty[3]);

#ifdef __cplusplus
}
#endif

#endif
