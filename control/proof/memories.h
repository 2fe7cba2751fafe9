/* Configs of the memories whose sizes a run fixes and whose other fields are any, and what is proven of their entries. */
#ifndef MEMORIES_H
#define MEMORIES_H

#include "cogless/space_memory.h"
#include "proof.h"

/* A run without sizes is one of configs that are refused before a size counts. */
#ifndef CELLS
#define CELLS 12
#define Q_HALF_WIDTH 2
#endif

static inline cgl_memory_config any_memory(void)
{
#ifdef DELAY
    const cgl_memory_kind kind = CGL_MEMORY_TIME;
#else
    const cgl_memory_kind kind = CGL_MEMORY_ANGLE;
#endif
    const cgl_memory_config config = {kind, CELLS, any_bits(), Q_HALF_WIDTH, any_bits(), any_real(), ANY_LIMIT};
    return config;
}

#ifndef CHANNELS
#define CHANNELS 3
#endif
#ifdef DELAY
#define SPACE_KIND CGL_SPACE_DELAY
#else
#define SPACE_KIND CGL_SPACE_MAP
#endif

static inline cgl_space_memory_config any_space_memory(void)
{
    const cgl_space_memory_config config = {SPACE_KIND, CHANNELS, CELLS, any_bits(), any_bits(), Q_HALF_WIDTH,
                                            {ANY_LIMIT, ANY_LIMIT, ANY_LIMIT},
                                            any_bool() ? CGL_DELAY_ODE : CGL_DELAY_INVERSION, any_real()};
    return config;
}

/* The entries are finite, and within the limit where a run has one: any of them will do, so one of any place. */
#define PROVE_ENTRIES(cell)                                                                                            \
    do {                                                                                                               \
        const uint32_t place = any_bits();                                                                             \
        if (place < sizeof cell / sizeof cell[0]) {                                                                    \
            PROVE_WITHIN_LIMIT(cell[place]);                                                                              \
        }                                                                                                              \
    } while (false)

/* What init finds in the caller's memory. Loops over long memories are not unrolled, so that Eva would not see them
 * cleared: those start at zero, as static memory does. */
#ifdef ZEROED
#define FILL(cell)
#else
#define FILL(cell) Frama_C_make_unknown((char *)(cell), sizeof(cell))
#endif

#endif
