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
    cgl_real limit; /* the output stays within +-limit [output], > 0, at most loop.current_limit */
} cgl_pi_config; /* loop.feed_forward: kp and ki tell the gains of somebody else's loop, and do not act */

typedef struct {
    uint32_t ready;        /* CGL_READY after init */
    bool saturated;        /* the last output was at its limit, or would have been */
    cgl_real kp, ki;       /* the gains that act: 0 in a loop with somebody else's feedback */
    cgl_real integral;     /* within +-limit [output] */
    cgl_real lost;         /* what rounding kept from the integral [output] */
    cgl_real proportional; /* the share of the last step [output] */
    cgl_pi_config config;
    cgl_loop loop;
} cgl_pi;

/* The first field of config or loop that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_pi_bad_field(const cgl_pi_config *config, const cgl_loop *loop);

/* Takes config and loop, which need not stay. */
cgl_error cgl_pi_init(cgl_pi *pi, const cgl_pi_config *config, const cgl_loop *loop);

/* Takes other gains while it runs, without a jump of the output: the integral takes up what the proportional part leaves. As
 * every retune it checks as init does, refuses with the state untouched, and is not called while a step runs. */
cgl_error cgl_pi_retune(cgl_pi *pi, const cgl_pi_config *config);

/* Forgets everything; the next output starts from zero integral. */
void cgl_pi_reset(cgl_pi *pi);

/* The same from another integral [output], which is taken within the limit. */
void cgl_pi_start(cgl_pi *pi, cgl_real integral);

/* Adds to the integral an output that acted beside it until now; `output` is finite. Somebody else's integral takes it over of
 * itself. */
static inline void cgl_pi_take_over(cgl_pi *pi, cgl_real output)
{
    if (!pi->loop.feed_forward) {
        pi->integral = cgl_add(pi->integral, output, pi->config.limit, &pi->lost);
    }
}

/* cgl_pi_step where nothing is at its limit and all is finite, in few instructions; else false, and nothing has changed. */
static inline bool cgl_pi_step_free(cgl_pi *pi, cgl_real error, cgl_real feedforward,
                                    cgl_real *output)
{
    const cgl_pi_config *const config = &pi->config;
    const cgl_real proportional = pi->kp * error, term = pi->ki * pi->loop.ts * error + pi->lost;
    const cgl_real integral = pi->integral + term, wanted = proportional + integral + feedforward;
    if (!(cgl_is_within(integral, config->limit) && cgl_is_below(wanted, config->limit))) {
        return false;
    }
    pi->lost = term - (integral - pi->integral); /* as in cgl_add */
    pi->proportional = proportional;
    pi->integral = integral;
    pi->saturated = false;
    *output = wanted;
    return true;
}

/* Returns kp error + integral + feedforward within the limit. The integral holds while the output is at its limit and
 * the error would push it further. An error or feedforward that is not finite counts as zero. */
cgl_real cgl_pi_step(cgl_pi *pi, cgl_real error, cgl_real feedforward);

#ifdef __cplusplus
}
#endif

#endif
