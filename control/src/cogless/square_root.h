/* Square roots, with the same bits on every machine. */
#ifndef COGLESS_SQUARE_ROOT_H
#define COGLESS_SQUARE_ROOT_H

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Returns the square root of x in [1, 4], in the same time for every x. */
cgl_real cgl_root_of_1_to_4(cgl_real x);

/* Returns the square root of x in [1e-30, 1e38], and 0 for every other x. */
cgl_real cgl_square_root(cgl_real x);

#ifdef __cplusplus
}
#endif

#endif
