/* Ranges of config fields, as a table that init reads: a row takes 4 bytes, a comparison in code three times that. */
#ifndef COGLESS_RANGE_H
#define COGLESS_RANGE_H

#include <stddef.h>
#include <stdint.h>

#include "real.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    CGL_FINITE,       /* a cgl_real: any number */
    CGL_NOT_NEGATIVE, /* a cgl_real: a number, >= 0 */
    CGL_POSITIVE,     /* a cgl_real: a number, > 0 */
    CGL_COUNT         /* a uint32_t: 1 to 65535 */
};

typedef struct {
    uint16_t offset; /* of the field in its config [bytes] */
    uint16_t kind;   /* CGL_FINITE and so on */
} cgl_range;

#define CGL_RANGE(config, field, kind) {(uint16_t)offsetof(config, field), (uint16_t)(kind)}

/* Whether the fields of `count` rows are in their ranges. */
bool cgl_is_in_range(const void *config, const cgl_range *range, uint32_t count);

/* The same for all rows of an array. */
#define CGL_IS_IN_RANGE(config, range) cgl_is_in_range((config), (range), (uint32_t)(sizeof(range) / sizeof((range)[0])))

#ifdef __cplusplus
}
#endif

#endif
