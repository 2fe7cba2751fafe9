#include "map.h"

#define FLOAT_MAX CGL_R(3.402823466e38)
#define ROUNDING CGL_R(1.0e-6) /* largest mean that is only a rounding error, as a share of the limit */

CGL_SELDOM bool cgl_map_is_valid(const cgl_map *map)
{
    if (!(map->entry != 0 && map->cells >= 1U && map->cells <= CGL_MAP_CELLS_MAX && map->stride >= map->cells
          && map->channels >= 1U && map->channels <= CGL_MAP_CHANNELS && map->ratio >= 1U && map->ratio <= 65535U
          && (map->turns == 0U) == (map->parts == 0U) && map->law <= 255U)) {
        return false;
    }
    for (uint32_t c = 0; c < map->channels; ++c) {
        /* the first comparison makes sure that a float can hold the limit */
        if (!(map->limit[c] <= FLOAT_MAX && map->limit[c] > CGL_R(0.0) && (float)map->limit[c] > 0.0f
              && map->unit[c] <= 255U)) {
            return false;
        }
    }
    return true;
}

CGL_SELDOM void cgl_map_centre(const cgl_map *map)
{
    for (uint32_t c = 0; c < map->centred && c < map->channels; ++c) {
        cgl_real *const entry = map->entry + c * map->stride;
        cgl_real mean = CGL_R(0.0);
        for (uint32_t n = 0; n < map->cells; ++n) {
            mean += entry[n] / (cgl_real)map->cells;
        }
        if (cgl_is_within(mean, ROUNDING * map->limit[c])) {
            continue; /* The mean is only a rounding error, so the entries stay as they are. */
        }
        for (uint32_t n = 0; n < map->cells; ++n) {
            entry[n] = cgl_clamp(entry[n] - mean, map->limit[c]);
        }
    }
}

/* Fills in a map of one channel. The caller adds further channels. */
CGL_SELDOM static void fill(cgl_map *map, uint32_t law, cgl_real *entry, uint32_t cells, uint32_t unit, cgl_real limit)
{
    map->entry = entry;
    map->stride = map->cells = cells;
    map->channels = 1U;
    map->turns = map->parts = 1U;
    map->ratio = 1U;
    map->law = law;
    for (uint32_t c = 0; c < CGL_MAP_CHANNELS; ++c) {
        map->unit[c] = c == 0U ? unit : (uint32_t)CGL_MAP_UNIT_NONE;
        map->limit[c] = c == 0U ? limit : CGL_R(0.0);
    }
    map->learning = 0;
    map->centred = 0U;
}

static cgl_map_result checked(const cgl_map *map)
{
    return cgl_map_is_valid(map) ? CGL_MAP_OK : CGL_MAP_INVALID;
}

/* Fills in the map of a memory. `ratio` is the field of cgl_map: 1 rad in the entries' units is 1 rad of ratio * theta_m. */
CGL_SELDOM static cgl_map_result of_memory(const cgl_memory *memory, uint32_t law, uint32_t first_unit, uint32_t ratio,
                                           cgl_map *map)
{
    static const uint32_t unit[CGL_MAP_CHANNELS] = {CGL_MAP_UNIT_NONE, CGL_MAP_UNIT_CURRENT_PER_SPEED,
                                                    CGL_MAP_UNIT_CURRENT_PER_ACCELERATION};
    const cgl_memory_config *const config = &memory->config;
    fill(map, law, memory->cell, config->cells, first_unit, config->limit[0]);
    map->stride = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    map->channels = config->channels;
    map->turns = config->turns;
    map->parts = memory->periods;
    map->ratio = ratio;
    for (uint32_t c = 1; c < (uint32_t)CGL_MAP_CHANNELS && c < config->channels; ++c) {
        map->unit[c] = unit[c];
        map->limit[c] = config->limit[c];
    }
    map->learning = &memory->learning;
    map->centred = memory->centred;
    return config->kind == CGL_MEMORY_ANGLE ? checked(map) : CGL_MAP_BY_TIME;
}

CGL_SELDOM cgl_map_result cgl_map_of_pi_ilc(const cgl_pi_ilc *law, cgl_map *map)
{
    return of_memory(&law->memory, CGL_MAP_LAW_PI_ILC, CGL_MAP_UNIT_CURRENT, 1U, map);
}

CGL_SELDOM cgl_map_result cgl_map_of_robust_ilc(const cgl_robust_ilc *law, cgl_map *map)
{
    return of_memory(&law->memory, CGL_MAP_LAW_ROBUST_ILC, CGL_MAP_UNIT_ACCELERATION, 1U, map);
}

CGL_SELDOM cgl_map_result cgl_map_of_anti_cogging(const cgl_anti_cogging *law,
                                       cgl_map *map)
{
    fill(map, CGL_MAP_LAW_ANTI_COGGING, law->table, law->config.cells, CGL_MAP_UNIT_CURRENT, law->config.pi.limit);
    map->centred = 1U; /* a calibrated table has no mean */
    return checked(map);
}

CGL_SELDOM cgl_map_result cgl_map_of_space_position(const cgl_space_position *law,
                                         cgl_map *map)
{
    return of_memory(&law->memory, CGL_MAP_LAW_SPACE_POSITION, CGL_MAP_UNIT_CURRENT, law->config.ratio, map);
}

CGL_SELDOM cgl_map_result cgl_map_of_space_speed(const cgl_space_speed *law, cgl_map *map)
{
    return of_memory(&law->memory, CGL_MAP_LAW_SPACE_SPEED, CGL_MAP_UNIT_CURRENT, 1U, map);
}

CGL_SELDOM cgl_map_result cgl_map_of_trial(const cgl_trial *law, cgl_map *map)
{
    fill(map, CGL_MAP_LAW_TRIAL, law->learned, law->config.samples, CGL_MAP_UNIT_OF_THE_TRIAL, law->config.learned_limit);
    map->turns = map->parts = 0U;
    return checked(map);
}

/* Fills in a map of orders: their cosines, their sines, and the orders themselves. */
static cgl_map_result of_orders(uint32_t law, cgl_real *entry, uint32_t orders, cgl_real limit, cgl_real highest,
                                const bool *learning, cgl_map *map)
{
    fill(map, law, entry, orders, CGL_MAP_UNIT_COSINE_CURRENT, limit);
    map->channels = 3U;
    map->unit[1] = CGL_MAP_UNIT_SINE_CURRENT;
    map->limit[1] = limit;
    map->unit[2] = CGL_MAP_UNIT_ORDER;
    map->limit[2] = highest;
    map->learning = learning;
    return checked(map);
}

CGL_SELDOM cgl_map_result cgl_map_of_pi_afc(const cgl_pi_afc *law, cgl_map *map)
{
    return of_orders(CGL_MAP_LAW_PI_AFC, law->coefficient, law->config.orders, law->config.limit,
                     (cgl_real)CGL_PI_AFC_ORDER_MAX, &law->learning, map);
}

CGL_SELDOM cgl_map_result cgl_map_of_harmonic(const cgl_harmonic *law, cgl_map *map)
{
    return of_orders(CGL_MAP_LAW_HARMONIC, law->cosine, law->config.orders, law->config.limit,
                     (cgl_real)CGL_HARMONIC_ORDER_MAX, &law->learning, map);
}
