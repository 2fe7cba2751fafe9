/* Does the controller compute here what it computed in the simulation? Bit for bit, or it says where it does not.
 *
 * On the target call ${name}_self_test and define COGLESS_NO_MAIN. On a computer compile it with ${stem}.c and all of
 * cogless/, as the README says, and run it: the trials go as they would in your program, with a begin, the steps and an
 * end each.
 *
 * Where it fails, look for -ffast-math, a missing -ffp-contract=off, or a floating-point unit that flushes small
 * numbers to zero. Written by cogless ${version}. */
#include "${stem}.h"
#include "self_test_data.h"

/* 0 where all is equal, else the first sample that differs, counted from 1; UINT32_MAX where init refuses, and
 * UINT32_MAX - 1 where a state that is not a number gives no fault, or an input beyond its limit. The controller is initialised
 * first; initialise it again afterwards. */
uint32_t ${name}_self_test(${name}_controller *controller);

${bit_access}

static cgl_real references[${NAME}_SAMPLES]; /* of the trial that runs */

static void begin(${name}_controller *controller, uint32_t trial)
{
    for (uint32_t p = 0; p < ${NAME}_SAMPLES; ++p) {
        references[p] = real_of(samples[trial * ${NAME}_SAMPLES + p].y_ref);
    }
    ${name}_begin(controller, references);
}

static bool step_is_equal(${name}_controller *controller, const sample *wanted)
{
    cgl_trial_input in = {.learn = true};
    cgl_trial_output out;
    for (uint32_t n = 0; n < ${NAME}_STATES; ++n) {
        in.x[n] = real_of(wanted->x[n]);
    }
    ${name}_step(controller, &in, &out);
    return bits_of(out.u) == wanted->u && out.status == wanted->status;
}

static bool fault_is_safe(${name}_controller *controller)
{
    cgl_trial_input in = {.learn = true};
    cgl_trial_output out;
    in.x[0] = real_of(0x7ff8000000000000U); /* not a number */
    begin(controller, 0);
    ${name}_step(controller, &in, &out);
    return (out.status & (unsigned)CGL_STATUS_FAULT) != 0U && out.u >= -${name}_law_config.limit
           && out.u <= ${name}_law_config.limit;
}

uint32_t ${name}_self_test(${name}_controller *controller)
{
    if (${name}_init(controller) != CGL_OK) {
        return UINT32_MAX;
    }
    for (uint32_t trial = 0; trial < TRIALS; ++trial) {
        begin(controller, trial);
        for (uint32_t p = 0; p < ${NAME}_SAMPLES; ++p) {
            const uint32_t n = trial * ${NAME}_SAMPLES + p;
            if (!step_is_equal(controller, &samples[n])) {
                return n + 1;
            }
        }
        ${name}_end(controller);
    }
    if (${name}_init(controller) != CGL_OK) {
        return UINT32_MAX;
    }
    return fault_is_safe(controller) ? 0 : UINT32_MAX - 1;
}

#ifndef COGLESS_NO_MAIN
#include <stdio.h>

int main(void)
{
    static ${name}_controller controller;
    const uint32_t failed = ${name}_self_test(&controller);
    if (failed == 0) {
        printf("${name}: %d trials of %d samples, all bits equal\n", TRIALS, (int)${NAME}_SAMPLES);
    } else if (failed <= TRIALS * ${NAME}_SAMPLES) {
        printf("${name}: trial %lu differs at sample %lu\n", (unsigned long)((failed - 1) / ${NAME}_SAMPLES + 1),
               (unsigned long)((failed - 1) % ${NAME}_SAMPLES + 1));
    } else {
        printf("${name}: init refuses, or a fault is not safe\n");
    }
    if (failed != 0) {
        printf("Compiled with -ffp-contract=off, and without -ffast-math?\n");
    }
    return failed != 0;
}
#endif
