/* Load and save of a map of CHANNELS rows of CELLS entries in flash whose bytes and answers may be anything: what is loaded
 * is within the limits, and the caller's functions get slots, bytes and counts that exist. */
#include "cogless/map_store.h"

#include "memories.h"

#define SLOT CGL_MAP_STORED_LENGTH(CHANNELS, CELLS, 8U)

static cgl_real entry[CHANNELS * CELLS];
static uint8_t buffer[BUFFER];

static cgl_flash_result any_flash(void) { return any_bool() ? CGL_FLASH_DONE : any_bool() ? CGL_FLASH_BUSY : CGL_FLASH_FAILED; }

static cgl_flash_result erase_any(void *context, uint32_t slot)
{
    (void)context;
    PROVE(slot < 2U);
    return any_flash();
}

static cgl_flash_result write_any(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    (void)context;
    (void)offset;
    PROVE(slot < 2U && count <= BUFFER);
    for (uint32_t n = 0; n < count; ++n) {
        PROVE(bytes[n] <= 255U); /* all of them can be read */
    }
    return any_flash();
}

static cgl_flash_result read_any(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    (void)context;
    PROVE(slot < 2U);
    (void)offset;
    PROVE(count <= BUFFER);
    for (uint32_t n = 0; n < count; ++n) {
        bytes[n] = (uint8_t)(any_bits() & 0xFFU);
    }
    return any_flash();
}

int main(void)
{
    cgl_map_store_config config = {0, erase_any, write_any, read_any, SLOT, 8U, any_bits(), any_bits()};
    cgl_map_store store;
    bool learning = any_bool();
    cgl_map map = {entry, CELLS, CELLS, CHANNELS, any_bits(), any_bits(), any_bits(), any_bits(),
                         {any_bits(), any_bits(), any_bits()}, {ANY_LIMIT, ANY_LIMIT, ANY_LIMIT}, &learning};
    if (cgl_map_store_init(&store, &config, buffer, sizeof buffer) != CGL_OK || !cgl_map_is_valid(&map)) {
        return 0;
    }
    //@ dynamic_split store.phase;
    while (any_bool()) {
        learning = any_bool();
        if (any_bool()) {
            (void)cgl_map_store_load(&store, &map);
        } else if (any_bool()) {
            (void)cgl_map_store_begin(&store, &map);
        } else {
            (void)cgl_map_store_step(&store);
        }
        PROVE_ENTRIES(entry);
    }
    return 0;
}
