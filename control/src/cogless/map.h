/* A learned map: its numbers and their meaning. map_store saves and loads it.
 *
 * Entry n of a channel belongs to the mechanical angle 2 pi n turns / (parts cells), a map over `turns / parts` of a revolution. In a
 * trial, entry n belongs to sample n. In a map of orders, entry n belongs to the order that stands in entry n of the channel with the
 * unit CGL_MAP_UNIT_ORDER. */
#ifndef COGLESS_MAP_H
#define COGLESS_MAP_H

#include <stdint.h>

#include "anti_cogging.h"
#include "harmonic.h"
#include "pi_afc.h"
#include "pi_ilc.h"
#include "real.h"
#include "robust_ilc.h"
#include "space_position.h"
#include "space_speed.h"
#include "trial.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_MAP_CHANNELS 3
#define CGL_MAP_CELLS_MAX 16777216U

/* Codes in the stored format, as in SPEC.md. */
enum {
    CGL_MAP_LAW_OTHER = 0,
    CGL_MAP_LAW_PI_ILC = 1,
    CGL_MAP_LAW_ROBUST_ILC = 2,
    CGL_MAP_LAW_ANTI_COGGING = 3,
    CGL_MAP_LAW_SPACE_POSITION = 4,
    CGL_MAP_LAW_SPACE_SPEED = 5,
    CGL_MAP_LAW_TRIAL = 6,
    CGL_MAP_LAW_PI_AFC = 7,
    CGL_MAP_LAW_HARMONIC = 8
};

enum {
    CGL_MAP_UNIT_NONE = 0,
    CGL_MAP_UNIT_CURRENT = 1,                  /* A */
    CGL_MAP_UNIT_CURRENT_PER_SPEED = 2,        /* A s/rad */
    CGL_MAP_UNIT_CURRENT_PER_ACCELERATION = 3, /* A s^2/rad */
    CGL_MAP_UNIT_ACCELERATION = 4,             /* rad/s^2 */
    CGL_MAP_UNIT_OF_THE_TRIAL = 5,             /* unit of the learned signal v of trial.h, which the plant decides */
    CGL_MAP_UNIT_COSINE_CURRENT = 6,           /* A: amplitude of the cosine of an order */
    CGL_MAP_UNIT_SINE_CURRENT = 7,             /* A: amplitude of the sine of an order */
    CGL_MAP_UNIT_ORDER = 8                     /* the orders themselves; a load requires the same orders */
};

/* Results of saving and loading. */
typedef enum {
    CGL_MAP_OK = 0,
    CGL_MAP_BUSY = 1,          /* the save is under way: call step again */
    CGL_MAP_NONE = 2,          /* there is no stored map */
    CGL_MAP_DAMAGED = 3,       /* the stored map is incomplete or corrupt: a save was interrupted, or bits have changed */
    CGL_MAP_OTHER_VERSION = 4, /* the stored map has another version of the format */
    CGL_MAP_OTHER_MOTOR = 5,   /* the stored map belongs to another motor */
    CGL_MAP_OTHER_MOTION = 6,  /* the stored map belongs to a trial with another reference */
    CGL_MAP_OTHER_LAYOUT = 7,  /* cells, channels, period, ratio, unit or orders differ */
    CGL_MAP_BAD_VALUE = 8,     /* an entry is not finite, or is beyond its present limit */
    CGL_MAP_FLASH_FAILED = 9,  /* one of the caller's functions failed, or the flash does not read back what was written */
    CGL_MAP_CHANGED = 10,      /* the law has learned during the save */
    CGL_MAP_LEARNING = 11,     /* the law has learned in its last step: step it once with learn false */
    CGL_MAP_NO_ROOM = 12,      /* the map is larger than a slot */
    CGL_MAP_BY_TIME = 13,      /* the memory is a delay line, which has no fixed angles */
    CGL_MAP_INVALID = 14       /* the cgl_map has no entries, or a field outside its range */
} cgl_map_result;

typedef struct {
    cgl_real *entry;                    /* caller's memory: the first channel's first entry */
    uint32_t stride;                    /* distance between the first entries of two successive channels [entries], >= cells */
    uint32_t cells;                     /* number of entries in each channel, 1 to CGL_MAP_CELLS_MAX */
    uint32_t channels;                  /* number of channels, 1 to CGL_MAP_CHANNELS */
    uint32_t turns, parts;              /* the period is turns / parts of a mechanical revolution; both are 0 for a trial */
    uint32_t ratio;                     /* 1 rad in the units is 1 rad of ratio * theta_m, 1 to 65535; 1: mechanical rad */
    uint32_t law;                       /* law that learned the map, CGL_MAP_LAW_...; 128 to 255 are free for the application */
    uint32_t unit[CGL_MAP_CHANNELS];    /* CGL_MAP_UNIT_...; 128 to 255 are free for the application */
    cgl_real limit[CGL_MAP_CHANNELS];   /* bound of the magnitude of each channel's entries [unit], > 0 and within the range of float */
    const bool *learning;               /* NULL, or a flag of the law that is true if its last step has learned */
    uint32_t centred;                   /* number of the first channels whose means belong to an integral; a load removes these means;
                                           default 0 */
} cgl_map;

/* Each function fills in the map of a law that has been initialised. The map is valid until the next init or retune of the law. If the
 * result is not CGL_MAP_OK, do not use the map. Use the table of `anti_cogging` only while no calibration runs, and the signal of a
 * trial only outside of cgl_trial_end(). States that belong to no angle are not in the map, such as the integrals, and
 * the adapted constant r of robust_ilc. */
cgl_map_result cgl_map_of_pi_ilc(const cgl_pi_ilc *law, cgl_map *map);
cgl_map_result cgl_map_of_robust_ilc(const cgl_robust_ilc *law, cgl_map *map);
cgl_map_result cgl_map_of_anti_cogging(const cgl_anti_cogging *law,
                                       cgl_map *map);
cgl_map_result cgl_map_of_space_position(const cgl_space_position *law,
                                         cgl_map *map);
cgl_map_result cgl_map_of_space_speed(const cgl_space_speed *law, cgl_map *map);
cgl_map_result cgl_map_of_trial(const cgl_trial *law, cgl_map *map);
cgl_map_result cgl_map_of_pi_afc(const cgl_pi_afc *law, cgl_map *map);
cgl_map_result cgl_map_of_harmonic(const cgl_harmonic *law, cgl_map *map);

/* Removes the means of the first `centred` channels. Call this function after writing the entries and before the law's next step. The run
 * time grows with the number of cells. */
void cgl_map_centre(const cgl_map *map);

/* Whether every field is within its range. */
bool cgl_map_is_valid(const cgl_map *map);

#ifdef __cplusplus
}
#endif

#endif
