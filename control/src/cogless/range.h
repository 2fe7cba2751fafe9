/* Checks that every init makes: of the caller's memory, and of the ranges of config fields. The ranges are tables. A row takes 4 bytes,
 * or 8 with the field's name. A comparison in code would take three times as much. */
#ifndef COGLESS_RANGE_H
#define COGLESS_RANGE_H

#include <stddef.h>
#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    CGL_FINITE,       /* a cgl_real that is finite */
    CGL_NOT_NEGATIVE, /* a cgl_real that is finite and >= 0 */
    CGL_POSITIVE,     /* a cgl_real that is finite and > 0 */
    CGL_COUNT,        /* a uint32_t from 1 to 65535 */
    CGL_COUNT_OR_DEFAULT /* a uint32_t from 0 to 65535; 0 stands for the default */
};

#ifdef COGLESS_NO_TEXTS
typedef struct {
    uint16_t offset; /* place of the field in its config [bytes] */
    uint16_t kind;   /* CGL_FINITE or another of the kinds above */
} cgl_range;
#define CGL_RANGE_OF(type, name, field, kind) {(uint16_t)offsetof(type, field), (uint16_t)(kind)}
#else
typedef struct {
    const char *name; /* name of the field, as "pi.kp" */
    uint16_t offset;  /* place of the field in its config [bytes] */
    uint16_t kind;    /* CGL_FINITE or another of the kinds above */
} cgl_range;
#define CGL_RANGE_OF(type, name, field, kind) {(name), (uint16_t)offsetof(type, field), (uint16_t)(kind)}
#endif

/* CGL_RANGE is the row of a field of cgl_PART_config. CGL_RANGE_OF is the row of a field of any struct. */
#define CGL_RANGE(part, field, kind) CGL_RANGE_OF(cgl_##part##_config, #part "." #field, field, kind)

/* The name of a row's field. With COGLESS_NO_TEXTS this name is empty, like every name that CGL_FIELD gives. */
#ifdef COGLESS_NO_TEXTS
#define CGL_RANGE_NAME(row) CGL_FIELD("")
#else
#define CGL_RANGE_NAME(row) ((row)->name)
#endif

/* Checks the fields of a config against `count` rows. Returns the first field that is outside its range, as CGL_FIELD, or NULL. */
const char *cgl_out_of_range(const void *config, const cgl_range *range, uint32_t count);

/* CGL_ROWS is the number of rows of an array. CGL_OUT_OF_RANGE is cgl_out_of_range() for all rows of an array. CGL_IS_IN_RANGE says whether
 * that check finds no field. */
#define CGL_ROWS(range) ((uint32_t)(sizeof(range) / sizeof((range)[0])))
#define CGL_OUT_OF_RANGE(config, range) cgl_out_of_range((config), (range), CGL_ROWS(range))
#define CGL_IS_IN_RANGE(config, range) (CGL_OUT_OF_RANGE(config, range) == 0)

/* x, or the default if x is 0. */
cgl_real cgl_or_default(cgl_real x, cgl_real usual);

/* Returns CGL_OK if the caller's memory is not NULL, is aligned, and has exactly `needed` entries. So a sizeof in place of a number of
 * entries is refused. */
cgl_error cgl_check_memory(const cgl_real *cell, uint32_t length, uint32_t needed);

#ifdef __cplusplus
}
#endif

#endif
