#include "feed.h"

#include <stdio.h>
#include <stdlib.h>

static const uint8_t *byte;
static size_t left;

void feed(const uint8_t *data, size_t size)
{
    byte = data;
    left = size;
}

bool fed(void) { return left > 0U; }

/* What does not hold ends the run; the fuzzer keeps the bytes that led to it. */
void check(bool holds, const char *condition, const char *file, int line)
{
    if (!holds) {
        fprintf(stderr, "%s:%d: %s\n", file, line, condition);
        abort();
    }
}

void hear(cgl_real x) { (void)x; }
void hear_bits(uint32_t bits) { (void)bits; }

void hear_all(const cgl_real *x, uint32_t count)
{
    (void)x;
    (void)count;
}

static uint32_t bits_of(uint32_t bytes)
{
    uint32_t bits = 0U;
    for (; bytes > 0U && left > 0U; --bytes, ++byte, --left) {
        bits = bits << 8 | *byte;
    }
    return bits;
}

uint32_t random_bits(void) { return bits_of(4U); }
uint32_t random_below(uint32_t n) { return bits_of(n > 256U ? 2U : 1U) % n; }

uint32_t random_word(void)
{
    const uint32_t bits = random_bits();
    return bits >> random_below(32U);
}

cgl_real random_real(cgl_real usual)
{
    const cgl_real infinite = CGL_REAL_MAX * CGL_R(2.0), smallest = CGL_R(1.0) / CGL_REAL_MAX / CGL_R(4.0);
    const cgl_real corner[] = {CGL_R(0.0),        infinite,        infinite - infinite, CGL_REAL_MAX, smallest,
                               CGL_R(9.99999e4), CGL_R(1.0e9),    -CGL_REAL_MAX,       -infinite,    -smallest,
                               usual,             CGL_R(6.2831853), -usual,             CGL_R(1.0e19), CGL_R(1.0e-30)};
    const uint32_t kind = bits_of(1U);
    if (kind < 16U) {
        uint64_t bits = random_bits();
        bits = sizeof(cgl_real) > 4U ? bits << 32 | random_bits() : bits;
        cgl_real x;
        memcpy(&x, &bits, sizeof x);
        return x;
    }
    if (kind < 40U) {
        return corner[kind % (sizeof corner / sizeof corner[0])];
    }
    return usual * ((cgl_real)bits_of(2U) / CGL_R(32767.5) - CGL_R(1.0));
}

cgl_real random_gain(cgl_real usual) { return cgl_abs(random_real(usual)); }
