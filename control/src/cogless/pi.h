/* Proportional-integral control of a scalar, with a limit and conditional anti-windup. */
#ifndef COGLESS_PI_H
#define COGLESS_PI_H

#include "law.h"
#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    cgl_real kp;    /* proportional gain [output/error], >= 0 */
    cgl_real ki;    /* integral gain [output/error/s], >= 0 */
    cgl_real limit; /* bound of the output's magnitude [output], > 0, at most loop.current_limit */
} cgl_pi_config; /* with loop.feed_forward, kp and ki are the gains of the foreign feedback, and do not act here */

typedef struct {
    uint32_t ready;        /* CGL_READY after init */
    bool saturated;        /* the last output was at its limit */
    cgl_real kp, ki;       /* gains that act: those of the config, or 0 with loop.feed_forward */
    cgl_real integral;     /* integral part of the output, within +-limit [output] */
    cgl_real lost;         /* rounding error of the integral, to be added in the next step [output] */
    cgl_real proportional; /* proportional part of the last output [output] */
    cgl_pi_config config;
    cgl_loop loop;
} cgl_pi;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_pi_bad_field(const cgl_pi_config *config, const cgl_loop *loop);

/* Copies config and loop. */
cgl_error cgl_pi_init(cgl_pi *pi, const cgl_pi_config *config, const cgl_loop *loop);

/* Replaces the gains at run time. The output does not jump: the integral takes the difference of the proportional parts. Every retune
 * checks the config as init does, and leaves the state untouched if it refuses. Do not call a retune while a step runs. */
cgl_error cgl_pi_retune(cgl_pi *pi, const cgl_pi_config *config);

/* Starts anew with an integral of 0. */
void cgl_pi_reset(cgl_pi *pi);

/* Starts anew with this integral [output], clipped to +-limit. If ki is 0, or with loop.feed_forward, the integral starts with 0 instead,
 * because nothing would ever change it. */
void cgl_pi_start(cgl_pi *pi, cgl_real integral);

/* Adds `output` [output], which acted beside the integral until now, to the integral. `output` must be finite. With loop.feed_forward this
 * function does nothing: the foreign integral makes up for the output by itself. */
static inline void cgl_pi_take_over(cgl_pi *pi, cgl_real output)
{
    if (!pi->loop.feed_forward) {
        pi->integral = cgl_add(pi->integral, output, pi->config.limit, &pi->lost);
    }
}

/* Does the same as cgl_pi_step(), in few instructions, if integral and output are within the limit and the inputs are finite. Otherwise
 * this function returns false and leaves the state untouched. */
static inline bool cgl_pi_step_free(cgl_pi *pi, cgl_real error, cgl_real feedforward,
                                    cgl_real *output)
{
    const cgl_pi_config *const config = &pi->config;
    const cgl_real proportional = pi->kp * error, term = pi->ki * pi->loop.ts * error + pi->lost;
    const cgl_real integral = pi->integral + term, wanted = proportional + integral + feedforward;
    if (!(cgl_is_within(integral, config->limit) && cgl_is_below(wanted, config->limit))) {
        return false;
    }
    pi->lost = term - (integral - pi->integral); /* the rounding error of the addition, as in cgl_add() */
    pi->proportional = proportional;
    pi->integral = integral;
    pi->saturated = false;
    *output = wanted;
    return true;
}

/* Returns kp error + integral + feedforward, clipped to +-limit. The integral holds while the output is at its limit and the error would
 * push the output further. An error or feedforward that is not finite counts as 0. */
cgl_real cgl_pi_step(cgl_pi *pi, cgl_real error, cgl_real feedforward);

#ifdef __cplusplus
}
#endif

#endif
