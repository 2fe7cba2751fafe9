#ifndef RANDOM_INPUTS_H
#define RANDOM_INPUTS_H

/* Each law with so many random configs, 300 steps or more each. */
void random_inputs(long configs);

#endif
