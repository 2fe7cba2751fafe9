/* Does the controller compute here what it computed in the simulation? Bit for bit, or it says where it does not.
 *
 * On the target call ${name}_self_test and define COGLESS_NO_MAIN. On a computer compile it with ${stem}.c and all of
 * cogless/, as the README says, and run it.
 *
 * Where it fails, look for -ffast-math, a missing -ffp-contract=off, or a floating-point unit that flushes small
 * numbers to zero. Written by cogless ${version}. */
#include "${stem}.h"
#include "self_test_data.h"

#define PERIODS ((uint32_t)(sizeof periods / sizeof periods[0]))

/* 0 where all is equal, else the first period that differs, counted from 1; UINT32_MAX where init refuses. The controller is
 * initialised first; initialise it again afterwards. */
uint32_t ${name}_self_test(${name}_controller *controller);

${bit_access}

static bool step_is_equal(${name}_controller *controller, const period *wanted)
{
    cgl_microstepping_output out;
    ${name}_step(controller, real_of(wanted->theta_ref), real_of(wanted->omega_ref), &out);
    return bits_of(out.i_a) == wanted->i_a && bits_of(out.i_b) == wanted->i_b && out.status == wanted->status;
}

uint32_t ${name}_self_test(${name}_controller *controller)
{
    if (${name}_init(controller) != CGL_OK) {
        return UINT32_MAX;
    }
    for (uint32_t n = 0; n < PERIODS; ++n) {
        if (!step_is_equal(controller, &periods[n])) {
            return n + 1;
        }
    }
    return 0;
}

#ifndef COGLESS_NO_MAIN
#include <stdio.h>

int main(void)
{
    static ${name}_controller controller;
    const uint32_t failed = ${name}_self_test(&controller);
    if (failed == 0) {
        printf("${name}: %lu periods, all bits equal\n", (unsigned long)PERIODS);
    } else if (failed <= PERIODS) {
        printf("${name}: period %lu differs\n", (unsigned long)failed);
    } else {
        printf("${name}: init refuses\n");
    }
    if (failed != 0) {
        printf("Compiled with -ffp-contract=off, and without -ffast-math?\n");
    }
    return failed != 0;
}
#endif
