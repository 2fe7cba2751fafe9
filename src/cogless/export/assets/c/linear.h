/* Controller "${controller}" of the study ${study}:
${title_comment}
 *
 * Written by cogless ${version}; change the study and export again rather than this file. The configured constants are
 * in ${stem}.c.
 *
 * law              ${law}, for a plant whose ${states} states are all measured
${verdict_comment} * study            ${study}, sha256 of its tables:
 *                  ${hash}
 * precision        double: define COGLESS_DOUBLE for every file
 * ${name}_step is called every ${period} s, ${samples} times in a trial; units are those of the study's matrices
 */
#ifndef ${NAME}_CONTROLLER_H
#define ${NAME}_CONTROLLER_H

#ifndef COGLESS_DOUBLE
#error "the study computes in double precision: compile every file with COGLESS_DOUBLE"
#endif

#include "cogless/trial.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ${NAME}_STATES ${states}U /* entries of x */
#define ${NAME}_SAMPLES ${samples}U /* steps in a trial */
#define ${NAME}_MEMORY_LENGTH ${entries} /* numbers */

/* All that changes, without a heap or pointers to the outside. It points into itself: do not copy or move it. */
typedef struct {
    cgl_trial law;
    cgl_real memory[${NAME}_MEMORY_LENGTH]; /* what is learned */
} ${name}_controller;

/* The configured constants; they can stay in flash. */
extern const cgl_trial_config ${name}_law_config;

/* Once, before the first trial. Do not run the plant where this is not CGL_OK. */
cgl_error ${name}_init(${name}_controller *controller);

/* Before each trial. y_ref: the ${samples} references of the trial, to be left alone until the next begin. */
void ${name}_begin(${name}_controller *controller, const cgl_real *y_ref);

/* One sample: the measured states in, the input of the plant and the status out. Never fails, whatever comes in. */
void ${name}_step(${name}_controller *controller, const cgl_trial_input *in, cgl_trial_output *out);

/* After each trial, in the background: learns from it. False: nothing was learned (cogless/trial.h says when). */
bool ${name}_end(${name}_controller *controller);

#ifdef __cplusplus
}
#endif

#endif
