/* Learned maps in flash: two slots, of which the one that a save writes is never the one that a load would take. Power may
 * be lost at any byte of an erase or a write; a load then finds the old map or the new one. The format is in SPEC.md.
 *
 * Flash is whatever your three functions reach: flash inside the chip or outside, an EEPROM, two files.
 *
 *   cgl_map_store_init(&store, &config, buffer, sizeof buffer);   once; must return CGL_OK
 *   cgl_map_of_pi_ilc(&law, &map);                   once, after the law's init; must return CGL_MAP_OK
 *   cgl_map_store_load(&store, &map);                    before the law's first step
 *
 *   to save, in the background:
 *     learn = false in the law's input, for one step of the law or more
 *     cgl_map_store_begin(&store, &map);                 must return CGL_MAP_OK
 *     cgl_map_store_step(&store);                        again and again while it returns CGL_MAP_BUSY
 *     learn = true
 *
 * Learning rests while a map is saved, so that its entries are of one moment; no copy is needed. If it does not rest, the
 * save ends with CGL_MAP_CHANGED and the old map stays. */
#ifndef COGLESS_MAP_STORE_H
#define COGLESS_MAP_STORE_H

#include <stdint.h>

#include "map.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CGL_MAP_HEADER 64U
#define CGL_MAP_MARK 8U
#define CGL_MAP_WRITE_MAX 256U
#define CGL_MAP_BUFFER_MIN 8U

typedef enum {
    CGL_FLASH_DONE = 0,
    CGL_FLASH_BUSY = 1,  /* erase, write: not yet; it is called again with the same arguments */
    CGL_FLASH_FAILED = 2
} cgl_flash_result;

typedef struct {
    void *context; /* handed to the functions; may be NULL */
    /* Erases slot 0 or 1, for new writes. Where bytes can be written over (EEPROM, file) it may do nothing. */
    cgl_flash_result (*erase)(void *context, uint32_t slot);
    /* Writes bytes; offset and count are multiples of write_size, and each place is written once after an erase. */
    cgl_flash_result (*write)(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count);
    /* Reads any bytes of the slot; CGL_FLASH_DONE or CGL_FLASH_FAILED. An interrupted write can leave words that flash with
     * error correction refuses to read: give any bytes for those, and the map is found damaged. CGL_FLASH_FAILED is for
     * flash that can't be reached: a save ends then, rather than write over a map that it could not see. */
    cgl_flash_result (*read)(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count);
    uint32_t slot_size;  /* of each [bytes], at least CGL_MAP_STORED_LENGTH */
    uint32_t write_size; /* smallest write of the flash [bytes], a power of two from 1 to CGL_MAP_WRITE_MAX */
    uint32_t motor;      /* identity of this very motor with its encoder, from you; SPEC.md has a way to make one */
    uint32_t motion;     /* trial: identity of the reference, from you; otherwise 0 */
} cgl_map_store_config;

typedef enum {
    CGL_STORE_IDLE,   /* no save goes on */
    CGL_STORE_LOOK,   /* reads both slots, to write the one that is of less use */
    CGL_STORE_SUM,    /* of the map's entries: what is to be stored */
    CGL_STORE_ERASE,
    CGL_STORE_WRITE,  /* header and entries */
    CGL_STORE_VERIFY, /* reads them back */
    CGL_STORE_MARK    /* makes them valid */
} cgl_store_phase;

typedef struct {
    cgl_map_store_config config;
    uint8_t *buffer;        /* caller's memory */
    uint32_t chunk;         /* bytes in one go: as many as the buffer holds, a multiple of write_size and 8 */
    const cgl_map *map;     /* being saved or loaded */
    cgl_store_phase phase;
    cgl_map_result result;  /* of the last save */
    uint32_t slot;          /* being read or written */
    uint32_t position;      /* in it [bytes] */
    uint32_t end;           /* of header, entries and padding: where the mark is [bytes] */
    uint32_t align;         /* of the map in this slot [bytes] */
    uint32_t crc;           /* of the entries so far */
    uint32_t entries_crc;   /* as it should be */
    uint32_t header_crc;
    uint32_t wanted;        /* CRC of the new header */
    uint32_t sequence;      /* in the header */
    bool bad_value;         /* an entry so far was */
    bool other_order;       /* an order so far was not the law's */
    bool fits[2];           /* a load would take this slot, if the other one were empty */
    uint32_t sequences[2];  /* of headers that are right, whether the slot fits or not; else 0 */
    uint32_t crcs[2];       /* of the entries of slots that fit */
} cgl_map_store;

/* Bytes of a slot that a map takes. */
#define CGL_MAP_STORED_LENGTH(channels, cells, write_size)                                                             \
    (CGL_MAP_ROUND_UP(CGL_MAP_HEADER + 4U * (channels) * (cells), write_size)                                          \
     + CGL_MAP_ROUND_UP(CGL_MAP_MARK, write_size))
#define CGL_MAP_ROUND_UP(bytes, write_size) (((bytes) + (write_size) - 1U) / (write_size) * (write_size))

/* Takes the caller's buffer of `length` bytes, at least CGL_MAP_BUFFER_MIN and write_size. A larger one makes fewer and
 * longer steps. */
cgl_error cgl_map_store_init(cgl_map_store *store, const cgl_map_store_config *config, uint8_t *buffer,
                             uint32_t length);

/* Takes the newer one of the stored maps that fit: CGL_MAP_OK, or why there is none. Every byte is checked before the
 * first entry of `map` is touched. The first `centred` channels lose their mean, which belongs to an integral. Reads both slots from
 * end to end, and one twice. For a start, or for a law that was stepped with learn false and is not stepped with learn true
 * meanwhile. Not while a save goes on: a load ends the save. */
cgl_map_result cgl_map_store_load(cgl_map_store *store, const cgl_map *map);

/* Begins a save of `map`, which is to stay until it has ended; one that goes on is given up. CGL_MAP_OK, or why not. */
cgl_map_result cgl_map_store_begin(cgl_map_store *store, const cgl_map *map);

/* A piece of the save: one call of your functions, or a few short ones. CGL_MAP_BUSY until it ends; then CGL_MAP_OK, or
 * why it failed, again and again. A map that is stored already is not written once more. */
cgl_map_result cgl_map_store_step(cgl_map_store *store);

#ifdef __cplusplus
}
#endif

#endif
