/* Words for conditions and choices. Text that uses them in place of `bool` and `?:` also compiles for several numbers at once: the
 * simulator includes transform.h, duties.h, foc_parts.h, monitor_parts.h and harmonic_parts.h once more, with vectors as cgl_real and its
 * own choice.h. */
#ifndef COGLESS_CHOICE_H
#define COGLESS_CHOICE_H

#include <stdbool.h>

typedef bool cgl_truth; /* result of a comparison */

#define CGL_CHOICE(condition, yes, no) ((condition) ? (yes) : (no))

#endif
