/* Flash as the tests play it: two slots, erased to ones, whole write units written once, power that fails at any byte. */
#ifndef FLASH_H
#define FLASH_H

#include "cogless/map_store.h"

#define FLASH_SLOT 4608U

typedef enum {
    ERASE_FORWARD,  /* bytes become ones from the first to the last */
    ERASE_BACKWARD,
    ERASE_NOISE,    /* those on the way read as anything */
    ERASE_NOTHING   /* an EEPROM: what is there stays until it is written over */
} erase_manner;

typedef struct {
    uint8_t byte[2][FLASH_SLOT];
    uint32_t size;        /* of a slot, up to FLASH_SLOT */
    uint32_t write_size;
    uint32_t power;       /* bytes that are still erased or written; beyond them nothing changes any more */
    erase_manner manner;
    bool slow;            /* every second call says CGL_FLASH_BUSY */
    bool broken;          /* reads fail */
    uint32_t reads;       /* the last of so many goes wrong, 0: none; it gives another byte, or fails */
    bool fails;
    bool locked;          /* erases and writes change nothing, and nobody is told */
    uint32_t calls, erases, writes;
} flash;

void flash_clear(flash *all, uint32_t write_size);
cgl_map_store_config flash_config(flash *all, uint32_t motor);

#endif
