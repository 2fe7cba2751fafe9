#include "flash.h"

#include <string.h>

#include "check.h"

void flash_clear(flash *all, uint32_t write_size)
{
    memset(all, 0, sizeof *all);
    memset(all->byte, 0xFF, sizeof all->byte);
    all->size = FLASH_SLOT;
    all->write_size = write_size;
    all->power = 0xFFFFFFFFU;
}

static bool powered(flash *all)
{
    if (all->power == 0U) {
        return false;
    }
    --all->power;
    return true;
}

static bool waits(flash *all)
{
    return all->slow && ++all->calls % 2U == 1U;
}

static cgl_flash_result erase(void *context, uint32_t slot)
{
    flash *all = context;
    CHECK(slot < 2U);
    if (waits(all)) {
        return CGL_FLASH_BUSY;
    }
    ++all->erases;
    for (uint32_t n = 0; n < all->size && all->manner != ERASE_NOTHING && !all->locked; ++n) {
        uint8_t *byte = &all->byte[slot][all->manner == ERASE_BACKWARD ? all->size - 1U - n : n];
        if (powered(all)) {
            *byte = 0xFF;
        } else if (all->manner == ERASE_NOISE && *byte != 0xFF) {
            *byte = (uint8_t)(*byte | random_bits());
        }
    }
    return CGL_FLASH_DONE;
}

static cgl_flash_result write(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    flash *all = context;
    CHECK(slot < 2U && count > 0U && offset % all->write_size == 0U && count % all->write_size == 0U);
    CHECK(offset + count <= all->size);
    if (waits(all)) {
        return CGL_FLASH_BUSY;
    }
    ++all->writes;
    for (uint32_t n = 0; n < count && !all->locked && powered(all); ++n) {
        CHECK(all->manner == ERASE_NOTHING || all->byte[slot][offset + n] == 0xFF);
        all->byte[slot][offset + n] = bytes[n];
    }
    return CGL_FLASH_DONE;
}

static cgl_flash_result read(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    flash *all = context;
    CHECK(slot < 2U && offset <= all->size && count <= all->size - offset);
    memcpy(bytes, &all->byte[slot][offset], count);
    const bool wrong = all->reads == 1U;
    all->reads -= all->reads > 0U ? 1U : 0U;
    if (wrong && !all->fails) {
        bytes[0] ^= 1U;
    }
    return all->broken || (wrong && all->fails) ? CGL_FLASH_FAILED : CGL_FLASH_DONE;
}

cgl_map_store_config flash_config(flash *all, uint32_t motor)
{
    const cgl_map_store_config config = {all, erase, write, read, all->size, all->write_size, motor, 0U};
    return config;
}
