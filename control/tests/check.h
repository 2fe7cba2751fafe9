/* Checks and random numbers for the C tests. */
#ifndef CHECK_H
#define CHECK_H

#include <stdint.h>

#include "cogless/real.h"

/* Counts and prints what does not hold, and goes on. */
#define CHECK(condition) check((condition), #condition, __FILE__, __LINE__)

void check(bool holds, const char *condition, const char *file, int line);
int failures(void);

uint32_t random_bits(void);
uint32_t random_below(uint32_t n);
/* Any number of the type, in equal shares: any bits at all, a corner (NaN, infinity, denormal, largest, zero), an ordinary
 * number up to `usual` in size. */
cgl_real random_real(cgl_real usual);
/* Not negative and finite; mostly ordinary, sometimes of any size. */
cgl_real random_gain(cgl_real usual);

#endif
