#include "map_store.h"

#include "crc32.h"
#include "version.h"

#define NUMBER_TYPE 1U        /* IEEE 754 binary32 */
#define MAGIC 0x4D4C4743U     /* "CGLM" */
#define DONE 0x454E4F44U      /* "DONE" */
#define PADDING 0xFFFFFFFFU   /* erased flash */
#define WORDS (CGL_MAP_HEADER / 4U)

/* Index of each word in the header; SPEC.md describes them. */
enum { AT_MAGIC, AT_VERSION, AT_SEQUENCE, AT_MOTOR, AT_MOTION, AT_LAW, AT_CELLS, AT_TURNS, AT_PARTS, AT_RATIO, AT_UNITS,
       AT_LIMITS, AT_ENTRIES_CRC = 14, AT_HEADER_CRC };

/* ---- numbers as bytes, in little-endian order on every machine ---- */

typedef union {
    float number;
    uint32_t bits;
} binary32;

CGL_SELDOM static void put(uint8_t *byte, uint32_t value)
{
    for (uint32_t n = 0; n < 4U; ++n) {
        byte[n] = (uint8_t)(value >> (8U * n) & 0xFFU);
    }
}

static uint32_t get(const uint8_t *byte)
{
    return byte[0] | (uint32_t)byte[1] << 8 | (uint32_t)byte[2] << 16 | (uint32_t)byte[3] << 24;
}

static uint32_t bits_of(float number)
{
    binary32 both;
    both.number = number;
    return both.bits;
}

static float number_of(uint32_t bits)
{
    binary32 both;
    both.bits = bits;
    return both.number;
}

static uint32_t smaller(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/* ---- form of a stored map: header, entries and padding, then a mark ---- */

static uint32_t entry_bytes(const cgl_map *map)
{
    return 4U * map->channels * map->cells;
}

static uint32_t end_of(const cgl_map *map, uint32_t align)
{
    return CGL_MAP_ROUND_UP(CGL_MAP_HEADER + entry_bytes(map), align);
}

/* Fills in the header words that describe the map, AT_CELLS to AT_UNITS. */
static void describe(const cgl_map *map, uint32_t *word)
{
    word[AT_CELLS] = map->cells;
    word[AT_TURNS] = map->turns;
    word[AT_PARTS] = map->parts;
    word[AT_RATIO] = map->ratio | map->channels << 16 | map->unit[0] << 24;
    word[AT_UNITS] = (map->channels > 1U ? map->unit[1] : 0U) | (map->channels > 2U ? map->unit[2] << 8 : 0U);
}

static void make_header(const cgl_map_store *store, uint32_t *word)
{
    const cgl_map_store_config *const config = &store->config;
    const cgl_map *map = store->map;
    word[AT_MAGIC] = MAGIC;
    word[AT_VERSION] = CGL_MAP_VERSION | CGL_MAP_HEADER << 16;
    word[AT_SEQUENCE] = store->sequence;
    word[AT_MOTOR] = config->motor;
    word[AT_MOTION] = config->motion;
    word[AT_LAW] = map->law | NUMBER_TYPE << 8 | store->align << 16;
    describe(map, word);
    for (uint32_t c = 0; c < CGL_MAP_CHANNELS; ++c) {
        word[AT_LIMITS + c] = c < map->channels ? bits_of((float)map->limit[c]) : 0U;
    }
    word[AT_ENTRIES_CRC] = store->entries_crc;
    word[AT_HEADER_CRC] = store->header_crc;
}

static uint32_t header_crc(const uint32_t *word)
{
    uint32_t crc = 0U;
    for (uint32_t n = 0; n < AT_HEADER_CRC; ++n) {
        uint8_t bytes[4];
        put(bytes, word[n]);
        crc = cgl_crc32(crc, bytes, 4U);
    }
    return crc;
}

/* Returns entry k, counted through one channel after the other. Sets *channel to the channel of this entry. */
static cgl_real *entry_at(const cgl_map *map, uint32_t k, uint32_t *channel)
{
    *channel = k / map->cells;
    return map->entry + *channel * map->stride + k % map->cells;
}

/* Fills the buffer with the bytes to be stored from `position` on. Position and count are multiples of 4. */
static void fill(const cgl_map_store *store, uint32_t position, uint32_t count)
{
    const cgl_map *map = store->map;
    uint32_t header[WORDS];
    make_header(store, header);
    for (uint32_t n = 0; n < count; n += 4U) {
        const uint32_t place = position + n;
        uint32_t word = PADDING, c;
        if (place < CGL_MAP_HEADER) {
            word = header[place / 4U];
        } else if (place - CGL_MAP_HEADER < entry_bytes(map)) {
            const cgl_real *entry = entry_at(map, (place - CGL_MAP_HEADER) / 4U, &c);
            word = bits_of((float)cgl_clamp(*entry, map->limit[c]));
        }
        put(store->buffer + n, word);
    }
}

/* Returns byte `place` of the mark. The mark contains the header's CRC, so it is valid with this header only. */
static uint8_t mark_byte(const cgl_map_store *store, uint32_t place)
{
    const uint32_t word = place < 4U ? ~store->header_crc : (place < CGL_MAP_MARK ? DONE : PADDING);
    return (uint8_t)(word >> (8U * (place % 4U)) & 0xFFU);
}

/* ---- reading and checking a slot, one piece at a time ---- */

CGL_SELDOM static bool read_bytes(const cgl_map_store *store, uint32_t offset, uint8_t *bytes,
                 uint32_t count)
{
    const cgl_map_store_config *const config = &store->config;
    return config->read(config->context, store->slot, offset, bytes, count) == CGL_FLASH_DONE;
}

/* Whether the header describes a map of the same layout. Two fractions turns / parts of the same value are the same period. */
static bool has_layout(const cgl_map *map, const uint32_t *word)
{
    uint32_t own[WORDS];
    describe(map, own);
    return (word[AT_LAW] >> 8 & 0xFFU) == NUMBER_TYPE && word[AT_CELLS] == own[AT_CELLS]
           && word[AT_RATIO] == own[AT_RATIO] && word[AT_UNITS] == own[AT_UNITS]
           && (word[AT_TURNS] == 0U) == (own[AT_TURNS] == 0U) && (word[AT_PARTS] == 0U) == (own[AT_PARTS] == 0U)
           && (uint64_t)word[AT_TURNS] * own[AT_PARTS] == (uint64_t)own[AT_TURNS] * word[AT_PARTS];
}

static bool is_write_size(uint32_t size)
{
    return size >= 1U && size <= CGL_MAP_WRITE_MAX && (size & (size - 1U)) == 0U;
}

static cgl_map_result check_header(cgl_map_store *store)
{
    const cgl_map_store_config *const config = &store->config;
    uint32_t word[WORDS];
    for (uint32_t n = 0; n < WORDS; ++n) {
        if (!read_bytes(store, 4U * n, store->buffer, 4U)) {
            return CGL_MAP_FLASH_FAILED;
        }
        word[n] = get(store->buffer);
    }
    if (word[AT_MAGIC] != MAGIC) {
        return CGL_MAP_NONE;
    }
    store->header_crc = word[AT_HEADER_CRC];
    if (header_crc(word) != store->header_crc) {
        return CGL_MAP_DAMAGED; /* the CRC covers the same words in every version, so it is checked before the version */
    }
    if ((word[AT_VERSION] & 0xFFFFU) != CGL_MAP_VERSION) {
        return CGL_MAP_OTHER_VERSION;
    }
    store->sequence = word[AT_SEQUENCE];
    const uint32_t align = word[AT_LAW] >> 16;
    if (word[AT_VERSION] >> 16 != CGL_MAP_HEADER || !is_write_size(align)) {
        return CGL_MAP_DAMAGED;
    }
    if (word[AT_MOTOR] != config->motor) {
        return CGL_MAP_OTHER_MOTOR;
    }
    if (word[AT_MOTION] != config->motion) {
        return CGL_MAP_OTHER_MOTION;
    }
    if (!has_layout(store->map, word)) {
        return CGL_MAP_OTHER_LAYOUT;
    }
    const uint32_t end = end_of(store->map, align);
    if (end + CGL_MAP_ROUND_UP(CGL_MAP_MARK, align) > config->slot_size) {
        return CGL_MAP_DAMAGED;
    }
    store->align = align;
    store->end = end;
    store->entries_crc = word[AT_ENTRIES_CRC];
    return CGL_MAP_OK;
}

/* Checks that the entries in the buffer are within their limits, and that stored orders are those of the law. If `into` is true, it also
 * copies the entries into the map. */
static void take_entries(cgl_map_store *store, uint32_t count, bool into)
{
    const cgl_map *map = store->map;
    for (uint32_t n = 0; n < count; n += 4U) {
        const uint32_t place = store->position + n - CGL_MAP_HEADER;
        if (place >= entry_bytes(map)) {
            return;
        }
        uint32_t c;
        cgl_real *entry = entry_at(map, place / 4U, &c);
        const float number = number_of(get(store->buffer + n));
        const float limit = (float)map->limit[c], own = (float)*entry;
        if (!(number >= -limit && number <= limit)) { /* NaN comes here too */
            store->bad_value = true;
        } else if (map->unit[c] == (uint32_t)CGL_MAP_UNIT_ORDER) {
            store->other_order = store->other_order || number < own || number > own;
        } else if (into) {
            *entry = cgl_clamp((cgl_real)number, map->limit[c]);
        }
    }
}

static cgl_map_result check_mark(const cgl_map_store *store)
{
    const uint32_t length = CGL_MAP_ROUND_UP(CGL_MAP_MARK, store->align);
    for (uint32_t place = 0; place < length; ++place) {
        if (!read_bytes(store, store->end + place, store->buffer, 1U)) {
            return CGL_MAP_FLASH_FAILED;
        }
        if (store->buffer[0] != mark_byte(store, place)) {
            return CGL_MAP_DAMAGED;
        }
    }
    return CGL_MAP_OK;
}

static void begin_check(cgl_map_store *store, uint32_t slot)
{
    store->slot = slot;
    store->position = 0U;
    store->crc = 0U;
    store->sequence = 0U;
    store->bad_value = store->other_order = false;
}

/* Checks the next piece of the slot. Returns CGL_MAP_BUSY until the whole slot is checked. */
static cgl_map_result check_step(cgl_map_store *store, bool marked, bool into)
{
    if (store->position == 0U) {
        const cgl_map_result result = check_header(store);
        store->position = CGL_MAP_HEADER;
        return result == CGL_MAP_OK ? CGL_MAP_BUSY : result;
    }
    if (store->position < store->end) {
        const uint32_t count = smaller(store->chunk, store->end - store->position);
        if (!read_bytes(store, store->position, store->buffer, count)) {
            return CGL_MAP_FLASH_FAILED;
        }
        store->crc = cgl_crc32(store->crc, store->buffer, count);
        take_entries(store, count, into);
        store->position += count;
        return CGL_MAP_BUSY;
    }
    if (store->crc != store->entries_crc) {
        return CGL_MAP_DAMAGED;
    }
    const cgl_map_result mark = marked ? check_mark(store) : CGL_MAP_OK;
    return mark != CGL_MAP_OK    ? mark
           : store->other_order ? CGL_MAP_OTHER_LAYOUT
           : store->bad_value   ? CGL_MAP_BAD_VALUE
                                : CGL_MAP_OK;
}

static void note(cgl_map_store *store, cgl_map_result result)
{
    store->fits[store->slot] = result == CGL_MAP_OK;
    store->sequences[store->slot] = store->sequence;
    store->crcs[store->slot] = store->entries_crc;
}

/* The slot that a load takes, or 2 if there is none. Sequence numbers wrap. */
CGL_SELDOM static uint32_t newest(const cgl_map_store *store)
{
    if (store->fits[0] && store->fits[1]) {
        const uint32_t ahead = store->sequences[1] - store->sequences[0];
        return ahead >= 1U && ahead < 0x80000000U ? 1U : 0U;
    }
    return store->fits[0] ? 0U : (store->fits[1] ? 1U : 2U);
}

/* ---- loading a stored map ---- */

CGL_SELDOM static cgl_map_result check(cgl_map_store *store, uint32_t slot, bool into)
{
    cgl_map_result result;
    begin_check(store, slot);
    do {
        result = check_step(store, true, into);
    } while (result == CGL_MAP_BUSY);
    return result;
}

/* Clears a map that was loaded only in part: the flash read differently from the check before. No map is better than half a map. */
static void forget(const cgl_map *map)
{
    for (uint32_t c = 0; c < map->channels; ++c) {
        for (uint32_t n = 0; n < map->cells && map->unit[c] != (uint32_t)CGL_MAP_UNIT_ORDER; ++n) {
            map->entry[c * map->stride + n] = CGL_R(0.0);
        }
    }
}

cgl_map_result cgl_map_store_load(cgl_map_store *store, const cgl_map *map)
{
    store->phase = CGL_STORE_IDLE;
    store->result = CGL_MAP_NONE;
    if (!cgl_map_is_valid(map)) {
        return CGL_MAP_INVALID;
    }
    if (map->learning != 0 && *map->learning) {
        return CGL_MAP_LEARNING;
    }
    store->map = map;
    cgl_map_result worst = CGL_MAP_NONE;
    for (uint32_t slot = 0; slot < 2U; ++slot) {
        const cgl_map_result result = check(store, slot, false);
        note(store, result);
        worst = result > worst ? result : worst;
    }
    const uint32_t slot = newest(store);
    if (slot > 1U) {
        return worst;
    }
    const cgl_map_result result = check(store, slot, true);
    if (result != CGL_MAP_OK && store->position > CGL_MAP_HEADER) {
        forget(map);
    } else if (result == CGL_MAP_OK) {
        cgl_map_centre(map);
    } else {
        /* no entry has changed, so there is no mean to remove */
    }
    return result;
}

/* ---- init, and saving a map ---- */

CGL_SELDOM cgl_error cgl_map_store_init(cgl_map_store *store, const cgl_map_store_config *config, uint8_t *buffer,
                             uint32_t length)
{
    if (!(config->erase != 0 && config->write != 0 && config->read != 0 && is_write_size(config->write_size)
          && config->slot_size >= CGL_MAP_STORED_LENGTH(1U, 1U, config->write_size))) {
        return CGL_ERROR_CONFIG;
    }
    const uint32_t unit = config->write_size > CGL_MAP_BUFFER_MIN ? config->write_size : CGL_MAP_BUFFER_MIN;
    if (buffer == 0 || length < unit) {
        return CGL_ERROR_MEMORY;
    }
    store->config = *config;
    store->buffer = buffer;
    store->chunk = length - length % unit;
    store->map = 0;
    store->phase = CGL_STORE_IDLE;
    store->result = CGL_MAP_NONE;
    store->fits[0] = store->fits[1] = false;
    store->align = config->write_size;
    store->end = store->crc = store->entries_crc = store->header_crc = store->wanted = store->sequence = 0U;
    store->sequences[0] = store->sequences[1] = store->crcs[0] = store->crcs[1] = 0U;
    begin_check(store, 0U);
    return CGL_OK;
}

CGL_SELDOM cgl_map_result cgl_map_store_begin(cgl_map_store *store, const cgl_map *map)
{
    const cgl_map_store_config *const config = &store->config;
    store->phase = CGL_STORE_IDLE;
    store->result = CGL_MAP_INVALID;
    if (cgl_map_is_valid(map)) {
        const uint32_t end = end_of(map, config->write_size);
        const uint32_t mark = CGL_MAP_ROUND_UP(CGL_MAP_MARK, config->write_size);
        store->result = map->learning != 0 && *map->learning ? CGL_MAP_LEARNING
                        : end + mark > config->slot_size     ? CGL_MAP_NO_ROOM
                                                             : CGL_MAP_OK;
    }
    if (store->result == CGL_MAP_OK) {
        store->map = map;
        store->phase = CGL_STORE_LOOK;
        begin_check(store, 0U);
    }
    return store->result;
}

static cgl_map_result finish(cgl_map_store *store, cgl_map_result result)
{
    store->phase = CGL_STORE_IDLE;
    store->result = result;
    return result;
}

static cgl_map_result go_on(cgl_map_store *store, cgl_store_phase phase, uint32_t position)
{
    store->phase = phase;
    store->position = position;
    store->crc = 0U;
    return CGL_MAP_BUSY;
}

CGL_SELDOM static cgl_map_result look(cgl_map_store *store)
{
    const cgl_map_store_config *const config = &store->config;
    const cgl_map_result result = check_step(store, true, false);
    if (result == CGL_MAP_BUSY) {
        return CGL_MAP_BUSY;
    }
    if (result == CGL_MAP_FLASH_FAILED) {
        return finish(store, CGL_MAP_FLASH_FAILED);
    }
    note(store, result);
    if (store->slot == 0U) {
        begin_check(store, 1U);
        return CGL_MAP_BUSY;
    }
    store->align = config->write_size;
    store->end = end_of(store->map, store->align);
    return go_on(store, CGL_STORE_SUM, CGL_MAP_HEADER);
}

/* Computes the CRC of the present entries and the padding. At the end of the padding, chooses the slot and computes the header. */
CGL_SELDOM static cgl_map_result sum(cgl_map_store *store)
{
    const uint32_t count = smaller(store->chunk, store->end - store->position);
    fill(store, store->position, count);
    store->crc = cgl_crc32(store->crc, store->buffer, count);
    store->position += count;
    if (store->position < store->end) {
        return CGL_MAP_BUSY;
    }
    const uint32_t now = newest(store);
    if (now < 2U && store->crcs[now] == store->crc) {
        return finish(store, CGL_MAP_OK);
    }
    store->slot = now == 0U ? 1U : 0U;
    store->entries_crc = store->crc;
    /* newer than the map in the other slot, even if that one does not fit now: it may fit again with another motor or limit */
    store->sequence = store->sequences[1U - store->slot] + 1U;
    uint32_t word[WORDS];
    make_header(store, word);
    store->header_crc = store->wanted = header_crc(word);
    return go_on(store, CGL_STORE_ERASE, 0U);
}

CGL_SELDOM static cgl_map_result erase_slot(cgl_map_store *store)
{
    const cgl_map_store_config *const config = &store->config;
    const cgl_flash_result result = config->erase(config->context, store->slot);
    if (result == CGL_FLASH_BUSY) {
        return CGL_MAP_BUSY;
    }
    return result == CGL_FLASH_DONE ? go_on(store, CGL_STORE_WRITE, 0U) : finish(store, CGL_MAP_FLASH_FAILED);
}

CGL_SELDOM static cgl_map_result write_bytes(cgl_map_store *store)
{
    const cgl_map_store_config *const config = &store->config;
    const uint32_t count = smaller(store->chunk, store->end - store->position);
    fill(store, store->position, count);
    const cgl_flash_result result =
        config->write(config->context, store->slot, store->position, store->buffer, count);
    if (result != CGL_FLASH_DONE) {
        return result == CGL_FLASH_BUSY ? CGL_MAP_BUSY : finish(store, CGL_MAP_FLASH_FAILED);
    }
    for (uint32_t n = 0; n < count; n += 4U) {
        if (store->position + n >= CGL_MAP_HEADER) {
            store->crc = cgl_crc32(store->crc, store->buffer + n, 4U);
        }
    }
    store->position += count;
    if (store->position < store->end) {
        return CGL_MAP_BUSY;
    }
    if (store->crc != store->entries_crc) {
        return finish(store, CGL_MAP_CHANGED);
    }
    begin_check(store, store->slot);
    return go_on(store, CGL_STORE_VERIFY, 0U);
}

/* Reads the slot back. Its header must be the new one: if a write had no effect, the slot still has the old map. */
CGL_SELDOM static cgl_map_result verify(cgl_map_store *store)
{
    const cgl_map_result result = check_step(store, false, false);
    if (result == CGL_MAP_BUSY) {
        return CGL_MAP_BUSY;
    }
    return result == CGL_MAP_OK && store->header_crc == store->wanted
               ? go_on(store, CGL_STORE_MARK, store->end)
               : finish(store, CGL_MAP_FLASH_FAILED);
}

CGL_SELDOM static cgl_map_result write_mark(cgl_map_store *store)
{
    const cgl_map_store_config *const config = &store->config;
    const uint32_t length = CGL_MAP_ROUND_UP(CGL_MAP_MARK, config->write_size);
    for (uint32_t place = 0; place < length; ++place) {
        store->buffer[place] = mark_byte(store, place);
    }
    const cgl_flash_result result =
        config->write(config->context, store->slot, store->end, store->buffer, length);
    if (result == CGL_FLASH_BUSY) {
        return CGL_MAP_BUSY;
    }
    const bool good = result == CGL_FLASH_DONE && check_mark(store) == CGL_MAP_OK;
    return finish(store, good ? CGL_MAP_OK : CGL_MAP_FLASH_FAILED);
}

CGL_SELDOM cgl_map_result cgl_map_store_step(cgl_map_store *store)
{
    if (store->map == 0) {
        return store->result;
    }
    switch (store->phase) {
    case CGL_STORE_LOOK:
        return look(store);
    case CGL_STORE_SUM:
        return sum(store);
    case CGL_STORE_ERASE:
        return erase_slot(store);
    case CGL_STORE_WRITE:
        return write_bytes(store);
    case CGL_STORE_VERIFY:
        return verify(store);
    case CGL_STORE_MARK:
        return write_mark(store);
    case CGL_STORE_IDLE:
    default:
        return store->result;
    }
}
