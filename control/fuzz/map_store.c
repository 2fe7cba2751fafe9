/* The map loader: two slots of any bytes, or of a saved map in which any bytes are changed, and power that fails at any
 * write. A load gives every entry within its limit or leaves the map as it was. */
#include "cogless/map_store.h"

#include <stdlib.h>

#include "feed.h"

#define SLOT 256U
#define CELLS 24U

static uint8_t slots[2][SLOT];
static uint32_t power; /* bytes that are still written */

static cgl_flash_result erase(void *context, uint32_t slot)
{
    (void)context;
    CHECK(slot < 2U);
    if (power == 0U) {
        return CGL_FLASH_FAILED;
    }
    memset(slots[slot], 0xFF, SLOT);
    return CGL_FLASH_DONE;
}

static cgl_flash_result write(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    (void)context;
    CHECK(slot < 2U && offset <= SLOT && count <= SLOT - offset);
    const uint32_t done = count < power ? count : power;
    memcpy(slots[slot] + offset, bytes, done);
    power -= done;
    return done == count ? CGL_FLASH_DONE : CGL_FLASH_FAILED;
}

static cgl_flash_result read(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    (void)context;
    CHECK(slot < 2U && offset <= SLOT && count <= SLOT - offset);
    memcpy(bytes, slots[slot] + offset, count);
    return CGL_FLASH_DONE;
}

static cgl_map random_map(cgl_real *entry)
{
    cgl_map map;
    memset(&map, 0, sizeof map);
    map.entry = entry;
    map.channels = 1U + random_below(4U);
    map.cells = 1U + random_below(CELLS / (map.channels < 3U ? map.channels : 3U));
    map.stride = map.cells;
    map.turns = map.parts = random_below(4U);
    map.ratio = 1U + random_below(3U);
    map.law = random_below(256U);
    for (uint32_t c = 0; c < CGL_MAP_CHANNELS; ++c) {
        map.unit[c] = random_below(8U);
        map.limit[c] = random_gain(CGL_R(5.0));
    }
    return map;
}

static void fill(const cgl_map *map)
{
    for (uint32_t n = 0; n < map->channels * map->cells; ++n) {
        map->entry[n] = n % 4U == 0U ? random_real(CGL_R(5.0)) : CGL_R(0.5);
    }
}

static void save(cgl_map_store *store, const cgl_map *map)
{
    if (cgl_map_store_begin(store, map) == CGL_MAP_OK) {
        for (uint32_t step = 0; cgl_map_store_step(store) == CGL_MAP_BUSY; ++step) {
            CHECK(step < 10000U);
        }
    }
}

/* Whatever the slots hold: the map is within its limits, or as it was. */
static cgl_map_result load(cgl_map_store *store, const cgl_map *map)
{
    cgl_real before[CELLS];
    memcpy(before, map->entry, CELLS * sizeof before[0]);
    const cgl_map_result result = cgl_map_store_load(store, map);
    if (result == CGL_MAP_OK) {
        for (uint32_t n = 0; n < map->channels * map->cells; ++n) {
            CHECK(within(map->entry[n], map->limit[n / map->cells]));
        }
    } else {
        CHECK(memcmp(before, map->entry, CELLS * sizeof before[0]) == 0);
    }
    return result;
}

static void spoil(void)
{
    while (fed() && random_below(256U) < 200U) {
        slots[random_below(2U)][random_below(SLOT)] ^= (uint8_t)random_below(256U);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    feed(data, size);
    uint8_t buffer[64];
    cgl_real entry[CELLS];
    cgl_map_store store;
    memset(entry, 0, sizeof entry);
    cgl_map_store_config config = {0, erase, write, read, SLOT, 1U << random_below(10U), random_below(3U), random_below(2U)};
    const uint32_t length = random_below(sizeof buffer + 1U);
    uint8_t *lent = malloc(length + 1U); /* of just this length, for the address sanitizer */
    const cgl_map map = random_map(entry);
    memset(slots, 0xFF, sizeof slots);
    if (cgl_map_store_init(&store, &config, lent + 1U, length) == CGL_OK) {
        if (random_below(2U) != 0U && cgl_map_is_valid(&map)) {
            for (uint32_t saves = random_below(3U) + 1U; saves > 0U; --saves) {
                fill(&map);
                power = random_below(2U) ? 0xFFFFFFFFU : random_below(600U);
                save(&store, &map);
            }
        } else {
            for (uint32_t n = 0; n < SLOT; ++n) {
                slots[0][n] = (uint8_t)random_below(256U);
            }
        }
        spoil();
        store.config.motor += random_below(16U) ? 0U : 1U;
        load(&store, &map);
    }
    free(lent);
    return 0;
}
