#include "square_root.h"

#include <stdint.h>

#define LEAST CGL_R(1.0e-30)
#define LARGEST CGL_R(1.0e38)
#define NEWTON_STEPS 4U      /* Newton's iteration starts within 4 % of the root; each step leaves half the square of the relative error */
#define POWERS_OF_4_MOST 64U /* powers of 4 between LARGEST and 1 */

CGL_SELDOM cgl_real cgl_root_of_1_to_4(cgl_real x)
{
    cgl_real root = CGL_R(0.7) + CGL_R(0.34) * x;
    for (uint32_t n = 0U; n < NEWTON_STEPS; ++n) {
        root = CGL_R(0.5) * (root + x / root);
    }
    return root;
}

CGL_SELDOM cgl_real cgl_square_root(cgl_real x)
{
    cgl_real rest = x, scale = CGL_R(1.0);
    if (!(x >= LEAST && x <= LARGEST)) {
        return CGL_R(0.0);
    }
    for (uint32_t n = 0U; n < POWERS_OF_4_MOST && rest > CGL_R(4.0); ++n) {
        rest *= CGL_R(0.25);
        scale *= CGL_R(2.0);
    }
    for (uint32_t n = 0U; n < POWERS_OF_4_MOST && rest < CGL_R(1.0); ++n) {
        rest *= CGL_R(4.0);
        scale *= CGL_R(0.5);
    }
    /* After the loops `rest` is at most 4. The proof needs to read that bound here. */
    return scale * cgl_root_of_1_to_4(rest < CGL_R(4.0) ? rest : CGL_R(4.0));
}
