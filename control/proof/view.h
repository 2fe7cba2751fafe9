/* What the prover sees in place of some functions of cogless/real.h; included before every file. Eva 25 does not conclude
 * from `x < limit` that x is a number; from `x == x` it does. Nor does it know how x and its whole part belong together.
 * view_check.c proves that nothing else is different. */
#ifndef VIEW_H
#define VIEW_H

#define cgl_is_within cgl_is_within_as_written
#define cgl_is_finite cgl_is_finite_as_written
#define cgl_is_angle cgl_is_angle_as_written
#define cgl_clamp cgl_clamp_as_written
#define cgl_clamp_here cgl_clamp_here_as_written
#define cgl_is_below cgl_is_below_as_written
#define cgl_rest cgl_rest_as_written
#define cgl_is_in_turn cgl_is_in_turn_as_written
#define cgl_clamped cgl_clamped_as_written
#define cgl_is_positive cgl_is_positive_as_written
#define cgl_is_not_negative cgl_is_not_negative_as_written
#define cgl_add cgl_add_as_written
#define cgl_added cgl_added_as_written
#define cgl_finite_or_zero cgl_finite_or_zero_as_written
#include "cogless/real.h"
#undef cgl_is_within
#undef cgl_add
#undef cgl_added
#undef cgl_finite_or_zero
#undef cgl_is_finite
#undef cgl_is_angle
#undef cgl_clamp
#undef cgl_clamp_here
#undef cgl_is_below
#undef cgl_rest
#undef cgl_is_in_turn
#undef cgl_clamped
#undef cgl_is_positive
#undef cgl_is_not_negative

/* As macros, so that a condition of several is one for Eva, whose branches know what each part says. */
#define cgl_is_within(x, limit) ((x) == (x) && (x) >= -(limit) && (x) <= (limit))
#define cgl_is_below(x, limit) ((x) == (x) && (x) > -(limit) && (x) < (limit))
#define cgl_is_finite(x) cgl_is_within(x, CGL_REAL_MAX)
#define cgl_is_angle(x) cgl_is_below(x, CGL_ANGLE_MAX)
#define cgl_is_in_turn(x) ((x) == (x) && (x) >= CGL_R(0.0) && (x) < CGL_TWO_PI)

static inline bool cgl_is_positive(cgl_real x) { return x == x && x > CGL_R(0.0) && x <= CGL_REAL_MAX; }
static inline bool cgl_is_not_negative(cgl_real x) { return x == x && x >= CGL_R(0.0) && x <= CGL_REAL_MAX; }

static inline cgl_real cgl_clamp(cgl_real x, cgl_real limit)
{
    return x == x ? (x >= limit ? limit : (x <= -limit ? -limit : x)) : CGL_R(0.0);
}

static inline cgl_real cgl_clamp_here(cgl_real x, cgl_real limit) { return cgl_clamp(x, limit); }
static inline cgl_real cgl_clamped(cgl_real x, cgl_real limit) { return cgl_clamp(x, limit); }

static inline cgl_real cgl_rest(cgl_real x)
{
    const cgl_real rest = cgl_rest_as_written(x);
    return rest > CGL_R(-1.0) && rest < CGL_R(1.0) ? rest : CGL_R(0.0);
}

/* The same with a branch in place of a bool, which Eva does not keep together with the number. */
static inline cgl_real cgl_add(cgl_real sum, cgl_real x, cgl_real limit, cgl_real *lost)
{
    const cgl_real term = x + *lost, result = sum + term;
    if (cgl_is_within(result, limit)) {
        *lost = term - (result - sum);
        return result;
    }
    *lost = CGL_R(0.0);
    return cgl_clamp(result, limit);
}

static inline cgl_real cgl_added(cgl_real sum, cgl_real x, cgl_real limit, cgl_real *lost)
{
    return cgl_add(sum, x, limit, lost);
}

static inline cgl_real cgl_finite_or_zero(cgl_real x) { return cgl_is_finite(x) ? x : CGL_R(0.0); }

#endif
