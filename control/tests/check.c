#include "check.h"

#include <stdio.h>
#include <string.h>

#include "cogless/crc32.h"

static int failed;
static uint64_t seed = 88172645463325252u;
static uint32_t heard;

void check(bool holds, const char *condition, const char *file, int line)
{
    if (!holds && ++failed <= 20) {
        printf("%s:%d: %s\n", file, line, condition);
    }
}

int failures(void)
{
    return failed;
}

uint32_t random_bits(void)
{
    seed ^= seed << 13; /* xorshift64 */
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (uint32_t)(seed >> 32);
}

uint32_t random_below(uint32_t n)
{
    return random_bits() % n;
}

uint32_t random_word(void)
{
    const uint32_t bits = random_bits();
    return bits >> random_below(32);
}

static cgl_real any_bits(void)
{
    const uint64_t high = random_bits(), bits = (high << 32) | random_bits();
    cgl_real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static cgl_real corner(void)
{
    const cgl_real largest = CGL_REAL_MAX;
    const cgl_real infinite = largest * CGL_R(2.0);
    const cgl_real smallest = CGL_R(1.0) / largest / CGL_R(4.0);
    const cgl_real corners[] = {CGL_R(0.0),  infinite,       infinite - infinite, largest, smallest,
                                CGL_R(1e-9), CGL_R(9.9999e4), CGL_R(1.0e5),        CGL_R(1.0e9)};
    const cgl_real x = corners[random_below(sizeof corners / sizeof corners[0])];
    return random_below(2) ? x : -x;
}

static cgl_real ordinary(cgl_real usual)
{
    return usual * ((cgl_real)(random_bits() >> 8) / CGL_R(8388608.0) - CGL_R(1.0));
}

cgl_real random_real(cgl_real usual)
{
    const uint32_t kind = random_below(3);
    return kind == 0U ? any_bits() : (kind == 1U ? corner() : ordinary(usual));
}

cgl_real random_gain(cgl_real usual)
{
    for (;;) {
        const cgl_real x = random_below(8) ? ordinary(usual) : random_real(usual);
        if (cgl_is_finite(x)) {
            return cgl_abs(x);
        }
    }
}

void hear_bits(uint32_t bits)
{
    const uint8_t bytes[4] = {(uint8_t)bits, (uint8_t)(bits >> 8), (uint8_t)(bits >> 16), (uint8_t)(bits >> 24)};
    heard = cgl_crc32(heard, bytes, 4U);
}

void hear(cgl_real x)
{
#ifdef COGLESS_DOUBLE
    uint64_t bits = 0U;
#else
    uint32_t bits = 0U;
#endif
    if (x >= x) {
        memcpy(&bits, &x, sizeof bits);
    }
    for (uint32_t n = 0; n < sizeof bits / sizeof(uint32_t); ++n) {
        hear_bits((uint32_t)(bits >> (32U * n)));
    }
}

void hear_all(const cgl_real *x, uint32_t count)
{
    for (uint32_t n = 0; n < count; ++n) {
        hear(x[n]);
    }
}

void try_subjects(const random_subject *subjects, uint32_t count, long configs)
{
    for (uint32_t k = 0; k < count; ++k) {
        seed = 88172645463325252u + ((uint64_t)k << 40);
        heard = 0U;
        for (long n = 0; n < configs; ++n) {
            subjects[k].one();
            if (n + 1L == CHECKED_CONFIGS) {
                const uint32_t expected = sizeof(cgl_real) == sizeof(float) ? subjects[k].in_float : subjects[k].in_double;
                CHECK(heard == expected);
                if (heard != expected) {
                    printf("  %s: 0x%08lxU\n", subjects[k].name, (unsigned long)heard);
                }
            }
        }
    }
}
