/* A law as the whole controller's fuzzer sees it; one of the law_*.c is linked. */
#ifndef LAW_H
#define LAW_H

#include "cogless/law.h"
#include "feed.h"

#define CELLS_MAX 40U

/* A config from the bytes; false where init refuses it. */
bool law_begin(feed *from);
void law_step(const cgl_law_input *in, cgl_law_output *out);
void law_reset(void);
/* What else a firmware may call: calibrations, begin and end of trials. */
void law_other(feed *from);
/* Ends the law; what it learned and what it keeps must be within its limits. */
void law_end(void);
cgl_real law_limit(void);
/* What has to stay while learning is frozen; none: 0. */
const cgl_real *law_learned(uint32_t *length);

/* A loop that leaves a law every config: any current, and no guard. */
static inline const cgl_loop *fuzzed_loop(cgl_real ts)
{
    static cgl_loop loop;
    loop.ts = ts;
    loop.current_limit = CGL_REAL_MAX;
    return &loop;
}

/* The caller's memory, exactly as long as it must be: the address sanitizer sees what is beyond. */
static inline cgl_real *borrow(uint32_t length)
{
    cgl_real *memory = malloc(length * sizeof *memory);
    memset(memory, 0xFF, length * sizeof *memory); /* NaN: init has to clear it */
    return memory;
}

static inline void check_entries(const cgl_real *entry, uint32_t length, cgl_real limit)
{
    for (uint32_t n = 0; n < length; ++n) {
        HOLDS(within(entry[n], limit));
    }
}

#endif
