/* The number type of the whole library: float, or double with -DCOGLESS_DOUBLE. */
#ifndef COGLESS_REAL_H
#define COGLESS_REAL_H

#include <stdbool.h>

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "compile without -ffast-math and -ffinite-math-only: they remove the tests for NaN and infinity"
#endif

#ifdef COGLESS_DOUBLE
typedef double cgl_real;
#define CGL_R(x) x
#define CGL_REAL_MAX CGL_R(1.7976931348623157e308)
#else
typedef float cgl_real;
#define CGL_R(x) x##f
#define CGL_REAL_MAX CGL_R(3.402823466e38)
#endif

#define CGL_PI CGL_R(3.14159265358979323846)
#define CGL_TWO_PI CGL_R(6.28318530717958647693)

/* Largest angle [rad] that is still an angle: beyond it a float cannot tell neighbouring positions apart. It is a few
 * minutes of running, so wrap the angle to a revolution (mechanical where a map is by mechanical angle). */
#define CGL_ANGLE_MAX CGL_R(1.0e5)

/* False for NaN and both infinities. */
static inline bool cgl_is_finite(cgl_real x)
{
    return x >= -CGL_REAL_MAX && x <= CGL_REAL_MAX;
}

/* False for what no measured angle can be, NaN included. */
static inline bool cgl_is_angle(cgl_real theta)
{
    return theta > -CGL_ANGLE_MAX && theta < CGL_ANGLE_MAX;
}

/* Ranges that config fields have. */
static inline bool cgl_is_positive(cgl_real x)
{
    return x > CGL_R(0.0) && cgl_is_finite(x);
}

static inline bool cgl_is_not_negative(cgl_real x)
{
    return x >= CGL_R(0.0) && cgl_is_finite(x);
}

/* x within [-limit, limit]; 0 for NaN. */
static inline cgl_real cgl_clamp(cgl_real x, cgl_real limit)
{
    if (x >= limit) {
        return limit;
    }
    if (x <= -limit) {
        return -limit;
    }
    return cgl_is_finite(x) ? x : CGL_R(0.0);
}

/* -1, 0 or 1; 0 for NaN. */
static inline cgl_real cgl_sign(cgl_real x)
{
    return x > CGL_R(0.0) ? CGL_R(1.0) : (x < CGL_R(0.0) ? CGL_R(-1.0) : CGL_R(0.0));
}

static inline cgl_real cgl_abs(cgl_real x)
{
    return x < CGL_R(0.0) ? -x : x;
}

#endif
