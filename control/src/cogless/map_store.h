/* Stores learned maps in flash, in two slots. A save never writes to the slot that a load would take. So if power fails during an erase or
 * a write, the next load still gets the old map or the new one. SPEC.md has the format.
 *
 * You supply three functions that erase, write and read. Flash may be inside or outside of the chip, an EEPROM, or two files.
 *
 *   cgl_map_store_init(&store, &config, buffer, sizeof buffer);   once; must return CGL_OK
 *   cgl_map_of_pi_ilc(&law, &map);                   once, after the law's init; must return CGL_MAP_OK
 *   cgl_map_store_load(&store, &map);                    before the law's first step
 *
 *   to save, in the background:
 *     learn = false in the law's input, for one step of the law or more
 *     cgl_map_store_begin(&store, &map);                 must return CGL_MAP_OK
 *     cgl_map_store_step(&store);                        repeat while it returns CGL_MAP_BUSY
 *     learn = true
 *
 * Learning must rest during a save, so that all entries belong to the same moment. No copy is needed. If the law learns meanwhile, the
 * save ends with CGL_MAP_CHANGED, and the old map stays. */
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
    CGL_FLASH_BUSY = 1,  /* an erase or write is under way; the function is called again with the same arguments */
    CGL_FLASH_FAILED = 2
} cgl_flash_result;

typedef struct {
    void *context; /* first argument of the functions; may be NULL */
    /* Erases slot 0 or 1. The function may do nothing if bytes can be overwritten, as in an EEPROM or a file. */
    cgl_flash_result (*erase)(void *context, uint32_t slot);
    /* Writes bytes. offset and count are multiples of write_size. Each byte is written once after an erase. */
    cgl_flash_result (*write)(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count);
    /* Reads bytes of the slot. After an interrupted write, flash with error correction may refuse to read a word: return any bytes for
     * that word, and the map counts as damaged. Return CGL_FLASH_FAILED only if the flash cannot be reached. A save then ends, and does not
     * overwrite a map that it could not read. */
    cgl_flash_result (*read)(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count);
    uint32_t slot_size;  /* size of each slot [bytes], at least CGL_MAP_STORED_LENGTH */
    uint32_t write_size; /* smallest write of the flash [bytes], a power of two from 1 to CGL_MAP_WRITE_MAX */
    uint32_t motor;      /* your number for this individual motor with its encoder; SPEC.md has a way to make one */
    uint32_t motion;     /* for trials: your number for the reference; else 0 */
} cgl_map_store_config;

typedef enum {
    CGL_STORE_IDLE,   /* no save is under way */
    CGL_STORE_LOOK,   /* reads both slots, to find the one to overwrite */
    CGL_STORE_SUM,    /* computes the CRC of the entries */
    CGL_STORE_ERASE,
    CGL_STORE_WRITE,  /* writes header and entries */
    CGL_STORE_VERIFY, /* reads header and entries back */
    CGL_STORE_MARK    /* writes the mark that makes header and entries valid */
} cgl_store_phase;

typedef struct {
    cgl_map_store_config config;
    uint8_t *buffer;        /* caller's memory */
    uint32_t chunk;         /* bytes in one piece: as many as the buffer holds, a multiple of write_size and of 8 */
    const cgl_map *map;     /* map that is saved or loaded */
    cgl_store_phase phase;
    cgl_map_result result;  /* result of the last save */
    uint32_t slot;          /* slot that is read or written */
    uint32_t position;      /* place in the slot [bytes] */
    uint32_t end;           /* end of header, entries and padding, where the mark begins [bytes] */
    uint32_t align;         /* write_size with which the map in this slot was stored [bytes] */
    uint32_t crc;           /* CRC of the entries that have been processed so far */
    uint32_t entries_crc;   /* CRC of the entries, as the header states it */
    uint32_t header_crc;    /* CRC of the header, as the header states it */
    uint32_t wanted;        /* CRC of the new header; the header in flash must have it */
    uint32_t sequence;      /* sequence number in the header */
    bool bad_value;         /* an entry that has been read is not finite or beyond its limit */
    bool other_order;       /* a harmonic order that has been read is not the law's */
    bool fits[2];           /* the map of this slot could be loaded */
    uint32_t sequences[2];  /* sequence number of each slot with a valid header, else 0 */
    uint32_t crcs[2];       /* CRC of the entries of each slot that could be loaded */
} cgl_map_store;

/* Number of bytes that a map takes in a slot. */
#define CGL_MAP_STORED_LENGTH(channels, cells, write_size)                                                             \
    (CGL_MAP_ROUND_UP(CGL_MAP_HEADER + 4U * (channels) * (cells), write_size)                                          \
     + CGL_MAP_ROUND_UP(CGL_MAP_MARK, write_size))
#define CGL_MAP_ROUND_UP(bytes, write_size) (((bytes) + (write_size) - 1U) / (write_size) * (write_size))

/* Copies the config. The caller's buffer of `length` bytes, at least CGL_MAP_BUFFER_MIN and write_size, is used from then on. With a larger
 * buffer there are fewer and longer steps. */
cgl_error cgl_map_store_init(cgl_map_store *store, const cgl_map_store_config *config, uint8_t *buffer,
                             uint32_t length);

/* Loads the newer one of the stored maps that fit. Returns CGL_MAP_OK, or the reason why there is none. Every byte is checked before the
 * first entry of `map` changes. The first `centred` channels lose their means, which belong to an integral. A load reads both slots
 * completely, and one of them twice. Call this function before the law's first step, or while the law is stepped with learn false. A load
 * ends a save that is under way. */
cgl_map_result cgl_map_store_load(cgl_map_store *store, const cgl_map *map);

/* Begins a save of `map`, which must stay valid until the save ends. A save that is under way is abandoned. Returns CGL_MAP_OK, or the
 * reason why the save cannot begin. */
cgl_map_result cgl_map_store_begin(cgl_map_store *store, const cgl_map *map);

/* Does a piece of the save: one call of your flash functions, or a few short ones. Returns CGL_MAP_BUSY until the save ends. From then on
 * it returns CGL_MAP_OK, or the reason why the save failed. A map that is already stored is not written again. */
cgl_map_result cgl_map_store_step(cgl_map_store *store);

#ifdef __cplusplus
}
#endif

#endif
