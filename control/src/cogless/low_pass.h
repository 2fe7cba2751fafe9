/* First-order low-pass filter, as drives use it for their measured speed:
 *
 *   y = y + (1 - exp(-bandwidth ts)) (x - y)
 *
 *   now.omega_m = cgl_low_pass_step(&filter, now.omega_m); */
#ifndef COGLESS_LOW_PASS_H
#define COGLESS_LOW_PASS_H

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real bandwidth; /* 2 pi times the frequency of -3 dB [rad/s], above 0, at most 2 / ts */
} cgl_low_pass_config;

typedef struct {
    cgl_low_pass_config config;
    cgl_real ts;    /* period of the steps [s] */
    cgl_real share; /* weight of a new input x in the output [-] */
    cgl_real y;     /* output of the last step */
} cgl_low_pass;

/* Copies the config. ts is the period of the steps [s], > 0. The output starts at 0. */
cgl_error cgl_low_pass_init(cgl_low_pass *filter, const cgl_low_pass_config *config, cgl_real ts);

/* Changes the bandwidth at run time, within the range that init accepts. The state stays. */
cgl_error cgl_low_pass_retune(cgl_low_pass *filter, const cgl_low_pass_config *config);

/* Starts in the steady state of the input x. An x that is not finite counts as 0. */
void cgl_low_pass_reset(cgl_low_pass *filter, cgl_real x);

/* Returns the filtered value. An x that is not finite is returned as it is, and has no other effect. */
cgl_real cgl_low_pass_step(cgl_low_pass *filter, cgl_real x);

#ifdef __cplusplus
}
#endif

#endif
