/* Does the controller compute here what it computed in the simulation? Bit for bit, or it says where it does not.
 *
 * On the target call ${name}_self_test and define COGLESS_NO_MAIN. On a computer compile it with ${stem}.c and all of
 * cogless/, as the README says, and run it.
 *
 * Where it fails, look for -ffast-math, a missing -ffp-contract=off, or a floating-point unit that flushes small
 * numbers to zero. Written by cogless ${version}. */
#include "${stem}.h"
#include "self_test_data.h"

#define FNV_START ${fnv_start}U

/* 0 where all is equal, else the first period that differs, counted from 1, or the first stretch, counted from TICKS + 1;
 * UINT32_MAX where init refuses, and UINT32_MAX - 1 where all recorded outputs are equal but not what was learned. The
 * controller is initialised first; initialise it again afterwards. */
uint32_t ${name}_self_test(${name}_controller *controller);

${bit_access}

static bool step_is_equal(${name}_controller *controller, const ${bits} *in, const ${bits} *wanted)
{
    cgl_measurement now;
    cgl_reference reference;
    cgl_drive_output out;
${read_inputs}
    ${name}_step(controller, &now, &reference, &out);
    return ${compare_outputs};
}

/* A word more of an FNV-1a sum. */
static uint32_t add(uint32_t sum, ${bits} next)
{
    return (sum ^ ${folded}) * ${fnv_prime}U;
}

static bool stretch_is_equal(${name}_controller *controller, const stretch *s)
{
    uint32_t sum = FNV_START;
    for (uint32_t n = 0; n < s->periods; ++n) {
        cgl_measurement now;
        cgl_reference reference;
        cgl_drive_output out;
        const uint32_t place = (s->counts + n * s->step) % COUNTS;
${read_stretch}
        now.theta_m += (cgl_real)place * (CGL_TWO_PI / (cgl_real)COUNTS);
        ${name}_step(controller, &now, &reference, &out);
${sum_outputs}
    }
    return sum == s->sum;
}
${memory_function}
uint32_t ${name}_self_test(${name}_controller *controller)
{
    if (${name}_init(controller) != CGL_OK) {
        return UINT32_MAX;
    }
${start}    for (uint32_t tick = 0; tick < TICKS; ++tick) {
        if (!step_is_equal(controller, inputs[tick], outputs[tick])) {
            return tick + 1;
        }
    }
${end}    if (${name}_init(controller) != CGL_OK) {
        return UINT32_MAX;
    }
${begin}    for (uint32_t n = 0; n < STRETCHES; ++n) {
        if (!stretch_is_equal(controller, &stretches[n])) {
            return TICKS + n + 1;
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
        printf("${name}: %d periods and %d stretches, all bits equal\n", TICKS, STRETCHES);
    } else if (failed <= TICKS) {
        printf("${name}: period %lu differs\n", (unsigned long)failed);
    } else if (failed <= TICKS + STRETCHES) {
        printf("${name}: stretch %lu differs, see self_test_data.h\n", (unsigned long)(failed - TICKS));
    } else {
        printf("${name}: init or the learned memory differs\n");
    }
    if (failed != 0) {
        printf("Compiled with -ffp-contract=off, and without -ffast-math?\n");
    }
    return failed != 0;
}
#endif
