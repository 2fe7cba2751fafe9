/* Does the controller compute here what it computed in the simulation? Bit for bit, or it says where it does not.
 *
 * On the target call ${name}_self_test and define COGLESS_NO_MAIN. On a computer compile it with ${stem}.c and all of
 * cogless/, as the README says, and run it.
 *
 * Where it fails, look for -ffast-math, a missing -ffp-contract=off, or a floating-point unit that flushes small
 * numbers to zero. Written by cogless ${version}. */
#include "${stem}.h"
#include "self_test_data.h"

/* 0 where all is equal, else the first period that differs, counted from 1; UINT32_MAX where init refuses, and
 * UINT32_MAX - 1 where all outputs are equal but not what was learned. The controller is initialised first; initialise it
 * again afterwards. */
uint32_t ${name}_self_test(${name}_controller *controller);

typedef union {
    cgl_real real;
    ${bits} bits;
} word;

static cgl_real real_of(${bits} bits)
{
    word w;
    w.bits = bits;
    return w.real;
}

static ${bits} bits_of(cgl_real x)
{
    word w;
    w.real = x;
    return w.bits;
}

static bool step_is_equal(${name}_controller *controller, const ${bits} *in, const ${bits} *wanted)
{
    cgl_measurement now;
    cgl_reference reference;
    cgl_drive_output out;
${read_inputs}
    ${name}_step(controller, &now, &reference, &out);
    return ${compare_outputs};
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
    return ${end};
}

#ifndef COGLESS_NO_MAIN
#include <stdio.h>

int main(void)
{
    static ${name}_controller controller;
    const uint32_t failed = ${name}_self_test(&controller);
    if (failed == 0) {
        printf("${name}: %d periods, all bits equal\n", TICKS);
        return 0;
    }
    printf(failed > TICKS ? "${name}: init or the learned memory differs\n" : "${name}: period %lu differs\n",
           (unsigned long)failed);
    return 1;
}
#endif
