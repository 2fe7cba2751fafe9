/* The fuzzer's bytes as the random numbers of check.h, in one call of the target. Where they are used up, the rest is zeros and `fed`
 * says so. */
#ifndef FEED_H
#define FEED_H

#include "check.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

void feed(const uint8_t *data, size_t size);
bool fed(void);

#endif
