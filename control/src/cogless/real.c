#include "real.h"

bool cgl_is_positive(cgl_real x)
{
    return x > CGL_R(0.0) && x <= CGL_REAL_MAX;
}

bool cgl_is_not_negative(cgl_real x)
{
    return x >= CGL_R(0.0) && x <= CGL_REAL_MAX;
}

CGL_SELDOM cgl_real cgl_finite_or_zero(cgl_real x)
{
    return cgl_is_finite(x) ? x : CGL_R(0.0);
}

CGL_SELDOM cgl_real cgl_added(cgl_real sum, cgl_real x, cgl_real limit, cgl_real *lost)
{
    return cgl_add(sum, x, limit, lost);
}

CGL_SELDOM cgl_real cgl_clamped(cgl_real x, cgl_real limit)
{
    return cgl_clamp_here(x, limit);
}
