/* Space-vector modulation: duty cycles of a three-phase two-level inverter. */
#ifndef COGLESS_MODULATION_H
#define COGLESS_MODULATION_H

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Duty cycles in [0, 1] that realise the voltage (alpha, beta) [V] from the bus u_dc [V], with the common mode that
 * centres the three phases (the min-max form of space-vector modulation). Exact for |u| <= u_dc / sqrt(3).
 * A bus that is not positive, or a voltage that is not finite, gives 0.5 everywhere: zero voltage. */
void cgl_modulate(cgl_real u_alpha, cgl_real u_beta, cgl_real u_dc, cgl_real duty[3]);

#ifdef __cplusplus
}
#endif

#endif
