/* Checks and random numbers for the C tests. fuzz/feed.c has them, too: there the fuzzer's bytes are the random numbers. */
#ifndef CHECK_H
#define CHECK_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "cogless/real.h"

/* Counts and prints what does not hold, and goes on. The fuzzer ends there. */
#define CHECK(condition) check((condition), #condition, __FILE__, __LINE__)

void check(bool holds, const char *condition, const char *file, int line);
int failures(void);

/* Two states are the same, from byte `first` to the one before `end`. */
static inline void check_bytes(const void *one, const void *other, size_t first, size_t end)
{
    CHECK(memcmp((const char *)one + first, (const char *)other + first, end - first) == 0);
}

/* Within +-limit; no NaN is. */
static inline bool within(cgl_real x, cgl_real limit) { return x >= -limit && x <= limit; }

/* Each from 0 to 1. */
static inline bool are_duties(const cgl_real duty[3])
{
    bool all = true;
    for (int x = 0; x < 3; ++x) {
        all = all && duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0);
    }
    return all;
}

uint32_t random_bits(void);
uint32_t random_below(uint32_t n);
/* Of any size, small numbers as often as large ones. */
uint32_t random_word(void);
/* Any number of the type, in equal shares: any bits at all, a corner (NaN, infinity, denormal, largest, zero), an ordinary
 * number up to `usual` in size. */
cgl_real random_real(cgl_real usual);
/* Not negative and, but for a fuzzer, finite; mostly ordinary, sometimes of any size. */
cgl_real random_gain(cgl_real usual);

/* What a test of random inputs says, into a checksum: numbers, all of them NaN alike; or bits. */
void hear(cgl_real x);
void hear_all(const cgl_real *x, uint32_t count);
void hear_bits(uint32_t bits);

/* A subject of random inputs, and the checksum of what its first configs say in each build. */
#define CHECKED_CONFIGS 60L
typedef struct {
    const char *name;
    void (*one)(void); /* one random config */
    uint32_t in_float, in_double;
} random_subject;

/* Each subject with so many configs, and random numbers of its own. The checksums are the same on every processor and with
 * every compiler that keeps to IEEE 754 and fuses no products; a change of arithmetic changes them, and prints the new ones. */
void try_subjects(const random_subject *subjects, uint32_t count, long configs);

#endif
