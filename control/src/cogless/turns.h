/* Angles and counters that wrap at 2^32. An angle in turns is a uint32_t, of which 2^32 is a revolution. */
#ifndef COGLESS_TURNS_H
#define COGLESS_TURNS_H

#include <stdint.h>

#include "real.h"

#define CGL_TURN_BITS CGL_R(4294967296.0) /* 2^32 */

/* Returns an angle in turns as radians in [0, 2 pi), rounded down to the precision of cgl_real. */
static inline cgl_real cgl_radians(uint32_t turns)
{
#ifdef COGLESS_DOUBLE
    return (cgl_real)turns * (CGL_TWO_PI / CGL_TURN_BITS);
#else
    return (cgl_real)(turns >> 9) * (CGL_TWO_PI / 8388608.0f); /* 23 bits: the product stays below 2 pi */
#endif
}

/* Returns 2^32 * part / parts, rounded down, where part < parts and part * parts < 2^32. A 64-bit division would take 700 bytes of
 * flash. */
static inline uint32_t cgl_share_of_turn(uint32_t part, uint32_t parts)
{
    return part * (UINT32_MAX / parts) + part * (UINT32_MAX % parts + 1U) / parts;
}

/* Returns the way from `from` to `to`, the shorter way round, in [-2^31, 2^31). Compilers turn the expression into a single conversion. */
static inline cgl_real cgl_steps(uint32_t from, uint32_t to)
{
    const uint32_t ahead = to - from;
    return (cgl_real)(ahead < 0x80000000U ? (int32_t)ahead : -1 - (int32_t)(UINT32_MAX - ahead));
}

/* Returns the angle [2^-32 turns] that is `by` revolutions ahead of `turns`. `by` is clipped to +-0.4999. */
static inline uint32_t cgl_turned(uint32_t turns, cgl_real by)
{
    const cgl_real steps = cgl_clamp(by, CGL_R(0.4999)) * CGL_TURN_BITS;
    return turns + (uint32_t)(int32_t)steps;
}

#endif
