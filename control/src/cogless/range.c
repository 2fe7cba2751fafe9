#include "range.h"

static bool is_in_range(const void *field, uint32_t kind)
{
    if (kind >= (uint32_t)CGL_COUNT) {
        const uint32_t whole = *(const uint32_t *)field;
        return whole <= 65535U && (whole >= 1U || kind == (uint32_t)CGL_COUNT_OR_DEFAULT);
    }
    const cgl_real x = *(const cgl_real *)field;
    return cgl_is_finite(x) && (kind == (uint32_t)CGL_FINITE || x >= CGL_R(0.0))
           && (kind != (uint32_t)CGL_POSITIVE || x > CGL_R(0.0));
}

CGL_SELDOM const char *cgl_out_of_range(const void *config, const cgl_range *range, uint32_t count)
{
    for (uint32_t n = 0; n < count; ++n) {
        if (!is_in_range((const char *)config + range[n].offset, range[n].kind)) {
            return CGL_RANGE_NAME(range + n);
        }
    }
    return 0;
}

CGL_SELDOM cgl_real cgl_or_default(cgl_real x, cgl_real usual)
{
    return x > CGL_R(0.0) || x < CGL_R(0.0) || !cgl_is_finite(x) ? x : usual;
}

/* The offset of the second member is the alignment of cgl_real. */
typedef struct {
    /* cppcheck-suppress unusedStructMember ; only offsetof reads it */
    char first;
    /* cppcheck-suppress unusedStructMember ; likewise */
    cgl_real aligned;
} alignment;

CGL_SELDOM cgl_error cgl_check_memory(const cgl_real *cell, uint32_t length, uint32_t needed)
{
    const bool usable = cell != 0 && (uintptr_t)cell % offsetof(alignment, aligned) == 0U && length == needed;
    return usable ? CGL_OK : CGL_ERROR_MEMORY;
}
