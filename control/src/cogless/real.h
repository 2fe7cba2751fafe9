/* The number type of the whole library: float, or double with -DCOGLESS_DOUBLE. */
#ifndef COGLESS_REAL_H
#define COGLESS_REAL_H

#include <stdbool.h>
#include <stdint.h>

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "compile without -ffast-math and -ffinite-math-only: they remove the tests for NaN and infinity"
#endif
#if defined(__ASSOCIATIVE_MATH__) /* gcc defines it since version 12 */
#error "compile without -funsafe-math-optimizations and -fassociative-math: sums in another order make the sine wrong"
#endif
#if defined(__clang__) && __clang_major__ >= 12 /* clang defines no such macro; the pragma holds for the whole file */
#pragma clang fp reassociate(off)
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

/* Bound of a valid angle's magnitude [rad]. A float beyond it cannot tell neighbouring positions apart. A motor turns so far in a few
 * minutes, so wrap every angle to a revolution. For a map over the mechanical angle, wrap to a mechanical revolution. */
#define CGL_ANGLE_MAX CGL_R(1.0e5)

/* cgl_abs() is |x|. cgl_is_within() says whether |x| is at most `limit`; it is false for NaN. The builtin is one instruction. */
#if defined(__GNUC__) && !defined(__FRAMAC__)
#ifdef COGLESS_DOUBLE
#define CGL_BUILTIN_ABS __builtin_fabs
#else
#define CGL_BUILTIN_ABS __builtin_fabsf
#endif
static inline cgl_real cgl_abs(cgl_real x)
{
    return CGL_BUILTIN_ABS(x);
}

static inline bool cgl_is_within(cgl_real x, cgl_real limit)
{
    return cgl_abs(x) <= limit;
}
#else
static inline cgl_real cgl_abs(cgl_real x)
{
    return x < CGL_R(0.0) ? -x : x;
}

static inline bool cgl_is_within(cgl_real x, cgl_real limit)
{
    return x >= -limit && x <= limit;
}
#endif

/* CGL_SELDOM marks a function that is seldom called: the compiler makes it small, and keeps it apart from the others. (For Frama-C 25 the
 * macro is empty: with it, Frama-C loses the values of a struct that such a function returns.) */
#if defined(__GNUC__) && !defined(__FRAMAC__)
#define CGL_SELDOM __attribute__((noinline, cold))
#define CGL_APART __attribute__((noinline)) /* marks a function that is often called, and is faster with registers of its own */
#define CGL_OFTEN(condition) __builtin_expect((condition), 1)
#else
#define CGL_SELDOM
#define CGL_APART
#define CGL_OFTEN(condition) (condition)
#endif

/* Whether x is finite: false for NaN and both infinities. */
static inline bool cgl_is_finite(cgl_real x)
{
    return cgl_is_within(x, CGL_REAL_MAX);
}

/* Whether |x| is below the limit; false for NaN. */
static inline bool cgl_is_below(cgl_real x, cgl_real limit)
{
    return cgl_abs(x) < limit;
}

/* Whether theta is a valid angle; false for NaN. */
static inline bool cgl_is_angle(cgl_real theta)
{
    return cgl_is_below(theta, CGL_ANGLE_MAX);
}

/* Whether theta is within the first turn; false for NaN. */
static inline bool cgl_is_in_turn(cgl_real theta)
{
    return theta >= CGL_R(0.0) && theta < CGL_TWO_PI;
}

/* The exact fractional part of x, |x| < 2^31, with the sign of x: in (-1, 1). */
static inline cgl_real cgl_rest(cgl_real x)
{
    return x - (cgl_real)(int32_t)x;
}

#ifdef __cplusplus
extern "C" {
#endif

/* cgl_is_positive(): whether x is finite and > 0. cgl_is_not_negative(): whether x is finite and >= 0. */
bool cgl_is_positive(cgl_real x);
bool cgl_is_not_negative(cgl_real x);

/* x limited to [-limit, limit]; 0 for NaN. This is a function call. */
cgl_real cgl_clamped(cgl_real x, cgl_real limit);

/* x, or 0 if x is not finite. */
cgl_real cgl_finite_or_zero(cgl_real x);

/* The same as cgl_add(), as a function call, for code that seldom runs. */
cgl_real cgl_added(cgl_real sum, cgl_real x, cgl_real limit, cgl_real *lost);

#ifdef __cplusplus
}
#endif

/* The same as cgl_clamped(), with a call only if |x| is above the limit. */
static inline cgl_real cgl_clamp(cgl_real x, cgl_real limit)
{
    return CGL_OFTEN(cgl_is_within(x, limit)) ? x : cgl_clamped(x, limit);
}

/* The same as cgl_clamped(), without any call. This function is for the few places that run most often: a call would cost them
 * registers. */
static inline cgl_real cgl_clamp_here(cgl_real x, cgl_real limit)
{
    if (CGL_OFTEN(cgl_is_within(x, limit))) {
        return x;
    }
    return x > CGL_R(0.0) ? limit : (x < CGL_R(0.0) ? -limit : CGL_R(0.0));
}

/* Returns sum + x + *lost, limited to [-limit, limit], or 0 for NaN. Stores the rounding error of this addition in *lost, for the next
 * call. So small terms add up beside a large sum. */
static inline cgl_real cgl_add(cgl_real sum, cgl_real x, cgl_real limit, cgl_real *lost)
{
    const cgl_real term = x + *lost, result = sum + term;
    const bool within = CGL_OFTEN(cgl_is_within(result, limit));
    *lost = within ? term - (result - sum) : CGL_R(0.0);
    return within ? result : cgl_clamped(result, limit);
}

/* The sign of x: -1, 0 or 1; 0 for NaN. */
static inline cgl_real cgl_sign(cgl_real x)
{
    return x > CGL_R(0.0) ? CGL_R(1.0) : (x < CGL_R(0.0) ? CGL_R(-1.0) : CGL_R(0.0));
}

#endif
