/* A low-pass of first order, as drives have it behind their measured speed:
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
    cgl_real ts;    /* [s] */
    cgl_real share; /* of the difference that a step takes in */
    cgl_real y;     /* of the last step */
} cgl_low_pass;

/* Takes the config, which need not stay; ts: period of the steps [s], > 0. It begins at 0. */
cgl_error cgl_low_pass_init(cgl_low_pass *filter, const cgl_low_pass_config *config, cgl_real ts);

/* Another bandwidth while it runs: the state stays. Checked as by init. */
cgl_error cgl_low_pass_retune(cgl_low_pass *filter, const cgl_low_pass_config *config);

/* As if x had been there for long. */
void cgl_low_pass_reset(cgl_low_pass *filter, cgl_real x);

/* The filtered value. An x that is not finite comes out as it is, and changes nothing. */
cgl_real cgl_low_pass_step(cgl_low_pass *filter, cgl_real x);

#ifdef __cplusplus
}
#endif

#endif
