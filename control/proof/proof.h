/* What the harnesses share: values that nothing is known of, and what has to be proven. */
#ifndef PROOF_H
#define PROOF_H

#include <stddef.h>
#include <stdint.h>

#include "__fc_builtin.h"
#include "cogless/law.h"

/* A volatile may hold anything at each read: any number, NaN and infinity included. */
static volatile cgl_real unknown_real;
static volatile uint32_t unknown_bits;

static inline cgl_real any_real(void) { return unknown_real; }
static inline uint32_t any_bits(void) { return unknown_bits; }
static inline bool any_bool(void) { return Frama_C_nondet(0, 1) != 0; }

static inline void fill_any(cgl_real *x, uint32_t count)
{
    for (uint32_t i = 0; i < count; ++i) {
        x[i] = any_real();
    }
}

/* What has to be proven: that this is never called. */
/*@ requires \false; assigns \nothing; */
void broken(void);
#define PROVE(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            broken();                                                                                                  \
        }                                                                                                              \
    } while (false)

/* Finite. No `x == x` here: of an interval without NaN, Eva knows enough. */
static inline bool is_number(cgl_real x) { return x >= -CGL_REAL_MAX && x <= CGL_REAL_MAX; }

/* LIMIT: the limit of the output, where a run has one; else it is any that init accepts, and the output is finite. */
#ifdef LIMIT
#define ANY_LIMIT ((cgl_real)(LIMIT))
#define PROVE_WITHIN_LIMIT(x) PROVE((x) >= -ANY_LIMIT && (x) <= ANY_LIMIT)
#else
#define ANY_LIMIT any_real()
#define PROVE_WITHIN_LIMIT(x) PROVE(is_number(x))
#endif

/* The runner's table shows what Eva knows of it. */
#define PROVE_OUTPUT(x)                                                                                                \
    do {                                                                                                               \
        Frama_C_show_each_output(x);                                                                                   \
        PROVE_WITHIN_LIMIT(x);                                                                                         \
    } while (false)

static inline cgl_law_input any_input(void)
{
    const cgl_real any = any_real();
    const cgl_real muted = any == any && any >= CGL_R(0.0) && any <= CGL_R(1.0) ? any : CGL_R(0.0); /* the guard's, or the caller's word */
    const cgl_law_input in = {any_real(), any_real(), any_real(), any_real(),
                              any_real(), any_real(), any_bool(), any_bool(), any_bool(), muted, any_bits(), any_bool(), any_real()};
    return in;
}

#endif
