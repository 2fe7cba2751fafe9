/* Three speed and position loops as others ship them, each on the same rotor, with and without what the learner adds. Written from
 * their documentation, in their units; no line of theirs is in here. */
#ifndef LOOPS_H
#define LOOPS_H

#include <stdbool.h>

typedef struct {
    double before, after; /* deviation of the rotor's true speed from its mean over the last turns: without the learner, with it [rad/s] */
    double mean;          /* of that speed, with it [rad/s] */
    const char *refused;  /* NULL, or the field that the learner's init refuses */
} loop_result;

/* As SimpleFOC: velocity PI with limited output slope, speed through a low-pass of 5 ms, current mode; feed_forward_current.q. kp: what the learner
 * is told of it [A s/rad], 0: the loop's own. */
loop_result simplefoc_like(double kp);
/* What a user tells as kp who cannot know it: a sine is added to the current, and the largest amplitude of the measured speed per
 * ampere is 1 / kp [A s/rad]. */
double simplefoc_measured_kp(void);
/* As ODrive: P of the position over PI of the velocity, torque out, an angle observer at 8 kHz; input_torque. */
loop_result odrive_like(void);
/* As moteus: PID of the position with a rate, torque out, at 15 kHz; feedforward_torque. */
loop_result moteus_like(void);

#endif
