#include "range.h"

CGL_SELDOM bool cgl_is_in_range(const void *config, const cgl_range *range, uint32_t count)
{
    for (uint32_t n = 0; n < count; ++n) {
        const void *field = (const char *)config + range[n].offset;
        if (range[n].kind == (uint16_t)CGL_COUNT) {
            const uint32_t whole = *(const uint32_t *)field;
            if (whole < 1U || whole > 65535U) {
                return false;
            }
        } else {
            const cgl_real x = *(const cgl_real *)field;
            if (!cgl_is_finite(x) || (range[n].kind != (uint16_t)CGL_FINITE && x < CGL_R(0.0))
                || (range[n].kind == (uint16_t)CGL_POSITIVE && !(x > CGL_R(0.0)))) {
                return false;
            }
        }
    }
    return true;
}
