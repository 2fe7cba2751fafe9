/* The fuzzer's bytes as numbers. Where they are used up, the rest is zeros and `fed` says so. */
#ifndef FEED_H
#define FEED_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cogless/real.h"

/* What does not hold ends the run; the fuzzer keeps the bytes that led to it. */
#define HOLDS(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                            \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

typedef struct {
    const uint8_t *byte;
    size_t left;
} feed;

static inline bool fed(const feed *from) { return from->left > 0U; }

static inline uint32_t feed_bits(feed *from, uint32_t bytes)
{
    uint32_t bits = 0U;
    for (; bytes > 0U && from->left > 0U; --bytes, ++from->byte, --from->left) {
        bits = bits << 8 | *from->byte;
    }
    return bits;
}

static inline bool feed_bool(feed *from) { return (feed_bits(from, 1U) & 1U) != 0U; }
static inline uint32_t feed_below(feed *from, uint32_t n) { return feed_bits(from, n > 256U ? 2U : 1U) % n; }

/* Any bits, a corner, or an ordinary number up to `usual` in size. */
static inline cgl_real feed_real(feed *from, cgl_real usual)
{
    const cgl_real infinite = CGL_REAL_MAX * CGL_R(2.0), smallest = CGL_R(1.0) / CGL_REAL_MAX / CGL_R(4.0);
    const cgl_real corner[] = {CGL_R(0.0),        infinite,        infinite - infinite, CGL_REAL_MAX, smallest,
                               CGL_R(9.99999e4), CGL_R(1.0e9),    -CGL_REAL_MAX,       -infinite,    -smallest,
                               usual,             CGL_R(6.2831853), -usual,             CGL_R(1.0e19), CGL_R(1.0e-30)};
    const uint32_t kind = feed_bits(from, 1U);
    if (kind < 16U) {
        uint64_t bits = feed_bits(from, 4U);
        bits = sizeof(cgl_real) > 4U ? bits << 32 | feed_bits(from, 4U) : bits;
        cgl_real x;
        memcpy(&x, &bits, sizeof x);
        return x;
    }
    if (kind < 40U) {
        return corner[kind % (sizeof corner / sizeof corner[0])];
    }
    return usual * ((cgl_real)feed_bits(from, 2U) / CGL_R(32767.5) - CGL_R(1.0));
}

/* Not negative and, but for a few, finite. */
static inline cgl_real feed_gain(feed *from, cgl_real usual) { return cgl_abs(feed_real(from, usual)); }

static inline bool within(cgl_real x, cgl_real limit) { return x >= -limit && x <= limit; } /* false for NaN */

#endif
