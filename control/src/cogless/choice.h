/* Words for conditions and choices. Text that uses them in place of `?:` and `bool` also compiles for several numbers at once: the
 * simulator includes transform.h, phasor.h, duties.h and foc_parts.h once more, with vectors as cgl_real and its own choice.h. */
#ifndef COGLESS_CHOICE_H
#define COGLESS_CHOICE_H

#include <stdbool.h>
#include <stdint.h>

#include "real.h"

typedef bool cgl_truth;     /* result of a comparison */
typedef uint32_t cgl_whole; /* whole number, modulo 2^32 */

#define CGL_CHOICE(condition, yes, no) ((condition) ? (yes) : (no))

/* n, a whole number with |n| < 2^31. */
static inline cgl_whole cgl_whole_of(cgl_real n)
{
    return (uint32_t)(int32_t)n;
}

static inline cgl_truth cgl_has_bit(cgl_whole n, uint32_t bit)
{
    return (n & bit) != 0U;
}

#endif
