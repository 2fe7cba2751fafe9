/* A learned map: numbers with their meaning, which map_store saves and loads.
 *
 * Entry n of a channel belongs to the mechanical angle 2 pi n turns / (parts cells), a map over `turns / parts` of a
 * revolution; to sample n of a trial; or, where a channel has orders, to order n of them in that period. */
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

/* The codes of the stored format; SPEC.md. */
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
    CGL_MAP_UNIT_OF_THE_TRIAL = 5,             /* as the trial law's config has it */
    CGL_MAP_UNIT_COSINE_CURRENT = 6,           /* A: amplitude of the cosine of an order */
    CGL_MAP_UNIT_SINE_CURRENT = 7,             /* A: of its sine */
    CGL_MAP_UNIT_ORDER = 8                     /* the orders that the entries belong to; a load asks for the same */
};

/* Results of saving and loading: why something is not saved or not loaded. */
typedef enum {
    CGL_MAP_OK = 0,
    CGL_MAP_BUSY = 1,          /* the save goes on: call step again */
    CGL_MAP_NONE = 2,          /* there is no map */
    CGL_MAP_DAMAGED = 3,       /* a map that is not whole: an interrupted save, or bits have changed */
    CGL_MAP_OTHER_VERSION = 4, /* of the format */
    CGL_MAP_OTHER_MOTOR = 5,
    CGL_MAP_OTHER_MOTION = 6,  /* a trial of another reference */
    CGL_MAP_OTHER_LAYOUT = 7,  /* cells, channels, period, ratio, unit or orders differ */
    CGL_MAP_BAD_VALUE = 8,     /* an entry is not finite or beyond the limit that it has now */
    CGL_MAP_FLASH_FAILED = 9,  /* one of the caller's functions failed, or what was written reads otherwise */
    CGL_MAP_CHANGED = 10,      /* the law went on learning while the map was saved */
    CGL_MAP_LEARNING = 11,     /* the law learned in its last step: step it once with learn false */
    CGL_MAP_NO_ROOM = 12,      /* the map is larger than a slot */
    CGL_MAP_BY_TIME = 13,      /* a delay line is not tied to an angle: it is of no use another day */
    CGL_MAP_INVALID = 14       /* no entries, or a field of cgl_map is outside its range */
} cgl_map_result;

typedef struct {
    cgl_real *entry;                    /* caller's memory: the first channel's first entry */
    uint32_t stride;                    /* from a channel's first entry to the next one's, >= cells */
    uint32_t cells;                     /* entries of each channel, 1 to CGL_MAP_CELLS_MAX */
    uint32_t channels;                  /* 1 to CGL_MAP_CHANNELS */
    uint32_t turns, parts;              /* period of a map: turns / parts of a mechanical revolution; of a trial 0, 0 */
    uint32_t ratio;                     /* the units' rad is of ratio theta_m; 1: mechanical; 1 to 65535 */
    uint32_t law;                       /* CGL_MAP_LAW_: who learned it; from 128 to 255 the application's own */
    uint32_t unit[CGL_MAP_CHANNELS];    /* CGL_MAP_UNIT_; from 128 to 255 the application's own */
    cgl_real limit[CGL_MAP_CHANNELS];   /* entries stay within +-limit [unit], > 0 and within the range of float */
    const bool *learning;               /* NULL, or true where the law's last step learned */
    uint32_t centred;                   /* number of first channels whose mean is an integral's; a load removes it; default 0 */
} cgl_map;

/* The map of a law that has been initialised. It stays valid until the law's next init or retune. Not CGL_MAP_OK: there is none,
 * and `map` can't be used. A table of `anti_cogging` is one while no calibration runs; a trial's signal outside of
 * cgl_trial_end. What isn't tied to the place, such as integrals and r of robust_ilc, is no part of it. */
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

/* Removes the mean of the first `centred` channels. Call it after the entries were written and before the law's next step. Its time
 * grows with the cells. */
void cgl_map_centre(const cgl_map *map);

/* Whether every field is within its range. */
bool cgl_map_is_valid(const cgl_map *map);

#ifdef __cplusplus
}
#endif

#endif
