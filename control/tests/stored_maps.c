#include "stored_maps.h"

#include <string.h>

#include "check.h"
#include "cogless/crc32.h"
#include "flash.h"

#define ENTRIES 1024U
#define UNTOUCHED CGL_R(0.375)
#define MOTOR 0x1234ABCDU

/* A map over a third of a revolution, in the caller's memory with a row longer than the cells. */
typedef struct {
    cgl_real memory[ENTRIES + 16U];
    cgl_map map;
} owner;

static void make(owner *o, uint32_t channels, uint32_t cells)
{
    const cgl_map map = {o->memory, cells + 3U, cells, channels, 1U, 3U, 1U, CGL_MAP_LAW_SPACE_SPEED,
                         {CGL_MAP_UNIT_CURRENT, CGL_MAP_UNIT_CURRENT_PER_SPEED, CGL_MAP_UNIT_CURRENT_PER_ACCELERATION},
                         {CGL_R(1.0), CGL_R(2.0), CGL_R(4.0)}, NULL, 0U};
    o->map = map;
    for (uint32_t n = 0; n < ENTRIES + 16U; ++n) {
        o->memory[n] = UNTOUCHED;
    }
}

/* Entries that tell of which map they are: multiples of 2^-20, so the same in float and double. */
static cgl_real entry_of(uint32_t which, uint32_t n)
{
    return (cgl_real)((which * 7919U + n * 104729U) % 2000001U) / CGL_R(1048576.0) * CGL_R(0.5) - CGL_R(0.25);
}

static cgl_real *at(const owner *o, uint32_t n)
{
    return o->map.entry + n / o->map.cells * o->map.stride + n % o->map.cells;
}

static void learn(owner *o, uint32_t which)
{
    for (uint32_t n = 0; n < o->map.channels * o->map.cells; ++n) {
        *at(o, n) = entry_of(which, n);
    }
}

static bool knows(const owner *o, uint32_t which)
{
    bool all = true;
    for (uint32_t n = 0; n < o->map.channels * o->map.cells; ++n) {
        const cgl_real wanted = entry_of(which, n);
        all = all && *at(o, n) >= wanted && *at(o, n) <= wanted;
    }
    return all;
}

static bool is_untouched(const owner *o)
{
    bool all = true;
    for (uint32_t n = 0; n < ENTRIES + 16U; ++n) {
        all = all && o->memory[n] >= UNTOUCHED && o->memory[n] <= UNTOUCHED;
    }
    return all;
}

static uint8_t buffer[256];

static cgl_map_store started(const cgl_map_store_config *config)
{
    cgl_map_store store;
    const uint32_t least = config->write_size > CGL_MAP_BUFFER_MIN ? config->write_size : CGL_MAP_BUFFER_MIN;
    CHECK(cgl_map_store_init(&store, config, buffer, least - 1U) == CGL_ERROR_MEMORY);
    CHECK(cgl_map_store_init(&store, config, buffer, sizeof buffer) == CGL_OK);
    return store;
}

static cgl_map_result save(cgl_map_store *store, const owner *o)
{
    cgl_map_result result = cgl_map_store_begin(store, &o->map);
    while (result == CGL_MAP_OK && (result = cgl_map_store_step(store)) == CGL_MAP_BUSY) {
        result = CGL_MAP_OK;
    }
    CHECK(cgl_map_store_step(store) == result);
    return result;
}

/* What a processor that starts anew finds: into a fresh owner of the same shape. */
static cgl_map_result load(const cgl_map_store_config *config, const owner *like, owner *found)
{
    cgl_map_store store = started(config);
    make(found, like->map.channels, like->map.cells);
    return cgl_map_store_load(&store, &found->map);
}

static cgl_map_result load_alike(const cgl_map_store_config *config, const cgl_map *map, owner *found)
{
    cgl_map_store store = started(config);
    make(found, map->channels, map->cells);
    found->map = *map;
    found->map.entry = found->memory;
    return cgl_map_store_load(&store, &found->map);
}

static void save_and_expect(const cgl_map_store_config *config, owner *o, uint32_t which)
{
    owner found;
    cgl_map_store store = started(config);
    learn(o, which);
    CHECK(save(&store, o) == CGL_MAP_OK);
    CHECK(load(config, o, &found) == CGL_MAP_OK && knows(&found, which));
}

/* New flash, in which maps 1 to `which` of a new owner have been saved. */
static cgl_map_store_config after_saves(flash *all, uint32_t write_size, owner *o, uint32_t channels, uint32_t cells, uint32_t which)
{
    flash_clear(all, write_size);
    make(o, channels, cells);
    const cgl_map_store_config config = flash_config(all, MOTOR);
    for (uint32_t n = 1; n <= which; ++n) {
        save_and_expect(&config, o, n);
    }
    return config;
}

/* A stored map begins with the header of SPEC.md: numbers with their low byte first. */
static void describe_a_map(void)
{
    static flash all;
    owner o;
    flash_clear(&all, 8U);
    const cgl_map_store_config config = flash_config(&all, MOTOR);
    make(&o, 3U, 8U);
    o.map.ratio = 2U;
    learn(&o, 1U);
    cgl_map_store store = started(&config);
    CHECK(save(&store, &o) == CGL_MAP_OK);
    const uint32_t number[] = {0x4D4C4743U, 1U | 64U << 16, 1U, MOTOR, config.motion, 5U | 1U << 8 | 8U << 16,
                               8U, 1U, 3U, 2U | 3U << 16 | 1U << 24, 2U | 3U << 8, 0x3F800000U, 0x40000000U, 0x40800000U};
    for (uint32_t n = 0; n < 4U * sizeof number / sizeof number[0]; ++n) {
        CHECK(all.byte[store.slot][n] == (uint8_t)(number[n / 4U] >> (8U * (n % 4U))));
    }
}

/* ---- power lost at every byte ---- */

static void lose_power(uint32_t channels, uint32_t cells, uint32_t write_size, erase_manner manner, uint32_t before)
{
    static flash all, start;
    owner o, found;
    make(&o, channels, cells);
    flash_clear(&start, write_size);
    start.manner = manner;
    const uint32_t stored = CGL_MAP_STORED_LENGTH(channels, cells, write_size);
    start.size = stored + 16U;
    if (manner == ERASE_NOISE || manner == ERASE_NOTHING) { /* new from the shop: anything */
        for (uint32_t n = 0; n < FLASH_SLOT; ++n) {
            start.byte[0][n] = (uint8_t)random_bits();
            start.byte[1][n] = (uint8_t)random_bits();
        }
    }
    for (uint32_t which = 1; which <= before; ++which) {
        const cgl_map_store_config config = flash_config(&start, MOTOR);
        save_and_expect(&config, &o, which);
    }
    all = start;
    const cgl_map_store_config config = flash_config(&all, MOTOR);
    const uint32_t mark = CGL_MAP_ROUND_UP(CGL_MAP_MARK, write_size);
    const uint32_t whole = stored + (manner == ERASE_NOTHING ? 0U : start.size);
    uint32_t old = 0U;
    for (uint32_t power = 0; power <= whole; ++power) {
        all = start;
        all.power = power;
        cgl_map_store store = started(&config);
        learn(&o, before + 1U);
        const cgl_map_result result = save(&store, &o);
        all.power = 0xFFFFFFFFU;
        const cgl_map_result loaded = load(&config, &o, &found);
        if (loaded == CGL_MAP_OK && knows(&found, before + 1U)) {
            CHECK(power > whole - mark); /* its last bytes may have been there before */
        } else {
            ++old;
            CHECK(power < whole && result != CGL_MAP_OK);
            CHECK(before > 0U ? loaded == CGL_MAP_OK && knows(&found, before)
                              : (loaded == CGL_MAP_NONE || loaded == CGL_MAP_DAMAGED) && is_untouched(&found));
        }
        save_and_expect(&config, &o, before + 2U); /* and life goes on */
    }
    CHECK(old > whole - mark);
}

static void lose_power_anywhere(void)
{
    static const uint32_t sizes[][2] = {{1, 4}, {1, 5}, {3, 4}, {2, 33}, {3, 100}};
    for (uint32_t n = 0; n < sizeof sizes / sizeof sizes[0]; ++n) {
        for (uint32_t before = 0; before < 3U; ++before) { /* maps in none of the slots, in one, in both */
            lose_power(sizes[n][0], sizes[n][1], 1U << random_below(6), (erase_manner)random_below(4), before);
        }
    }
    for (uint32_t write_size = 1; write_size <= 256U; write_size *= 2U) {
        lose_power(1U, 30U, write_size, (erase_manner)(write_size % 3U), 2U);
        lose_power(2U, 9U, write_size, ERASE_NOTHING, 1U + write_size % 2U);
    }
    lose_power(1U, 1024U, 16U, ERASE_NOISE, 2U);
}

/* ---- a stored map in which anything has changed ---- */

static void flip_every_bit(uint32_t channels, uint32_t cells, uint32_t write_size)
{
    static flash all;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, write_size, &o, channels, cells, 1U);
    for (uint32_t bit = 0; bit < 8U * CGL_MAP_STORED_LENGTH(channels, cells, write_size); ++bit) {
        uint8_t *byte = &all.byte[0][bit / 8U];
        *byte = (uint8_t)(*byte ^ 1U << bit % 8U);
        const cgl_map_result result = load(&config, &o, &found);
        CHECK(result == (bit < 32U ? CGL_MAP_NONE : CGL_MAP_DAMAGED) && is_untouched(&found));
        *byte = (uint8_t)(*byte ^ 1U << bit % 8U);
    }
    CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 1U));
}

/* A damaged newer map gives way to the older one. */
static void fall_back(void)
{
    static flash all;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, 8U, &o, 1U, 50U, 2U);
    all.byte[1][100] ^= 4U;
    CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 1U));
    save_and_expect(&config, &o, 3U);
    CHECK(all.byte[0][8] == 1U && all.byte[1][8] == 2U); /* in the place of the damaged one */
}

/* ---- reasons ---- */

static void set_header(flash *all, uint32_t slot, uint32_t place, uint32_t count, uint32_t value)
{
    uint8_t *header = all->byte[slot];
    const uint32_t end = FLASH_SLOT; /* the mark follows the header's CRC: found by its second half */
    for (uint32_t n = 0; n < count; ++n) {
        header[place + n] = (uint8_t)(value >> 8U * n);
    }
    const uint32_t crc = cgl_crc32(0U, header, CGL_MAP_HEADER - 4U);
    uint32_t mark = CGL_MAP_HEADER;
    while (mark + 8U < end && memcmp(header + mark + 4U, "DONE", 4U) != 0) {
        ++mark;
    }
    for (uint32_t n = 0; n < 4U; ++n) {
        header[60U + n] = (uint8_t)(crc >> 8U * n);
        header[mark + n] = (uint8_t)(~crc >> 8U * n);
    }
}

static void refuse_with_reason(void)
{
    static flash all, good;
    owner o, found;
    flash_clear(&all, 4U);
    cgl_map_store_config config = flash_config(&all, MOTOR);
    make(&o, 2U, 20U);
    CHECK(load(&config, &o, &found) == CGL_MAP_NONE);
    save_and_expect(&config, &o, 1U);
    good = all;

    config.motor = MOTOR + 1U;
    CHECK(load(&config, &o, &found) == CGL_MAP_OTHER_MOTOR && is_untouched(&found));
    config.motor = MOTOR;
    config.motion = 1U;
    CHECK(load(&config, &o, &found) == CGL_MAP_OTHER_MOTION && is_untouched(&found));
    config.motion = 0U;
    set_header(&all, 0U, 4U, 2U, 2U);
    CHECK(load(&config, &o, &found) == CGL_MAP_OTHER_VERSION && is_untouched(&found));
    all = good;
    all.broken = true;
    CHECK(load(&config, &o, &found) == CGL_MAP_FLASH_FAILED && is_untouched(&found));
    all = good;

    cgl_map other = o.map;
    other.cells = 19U;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.channels = 1U;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.parts = 4U;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.turns = other.parts = 0U;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.ratio = 2U;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.unit[1] = CGL_MAP_UNIT_ACCELERATION;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OTHER_LAYOUT && is_untouched(&found));
    other = o.map;
    other.limit[0] = CGL_R(0.1);
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_BAD_VALUE && is_untouched(&found));
    other = o.map;
    other.turns = 2U; /* the same period, in other words */
    other.parts = 6U;
    other.law = CGL_MAP_LAW_PI_ILC; /* and who learned it is of no matter */
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_OK && knows(&found, 1U));
    other.limit[1] = CGL_R(0.0);
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_INVALID && is_untouched(&found));

    const bool learning = true;
    other = o.map;
    other.learning = &learning;
    CHECK(load_alike(&config, &other, &found) == CGL_MAP_LEARNING && is_untouched(&found));
    cgl_map_store store = started(&config);
    CHECK(cgl_map_store_begin(&store, &other) == CGL_MAP_LEARNING);
    CHECK(cgl_map_store_step(&store) == CGL_MAP_LEARNING);
    config.slot_size = CGL_MAP_STORED_LENGTH(2U, 20U, 4U);
    store = started(&config);
    CHECK(cgl_map_store_begin(&store, &o.map) == CGL_MAP_OK);
    config.slot_size -= 4U;
    store = started(&config);
    CHECK(cgl_map_store_begin(&store, &o.map) == CGL_MAP_NO_ROOM);
    CHECK(load(&config, &o, &found) == CGL_MAP_DAMAGED); /* cut short */
}

static void refuse_numbers(void)
{
    static const uint32_t bad[] = {0x7F800000U, 0xFF800000U, 0x7FC00000U, 0xFFFFFFFFU, 0x7F800001U, 0x3F800001U, 0xBF800001U};
    static flash all;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, 4U, &o, 1U, 10U, 1U);
    for (uint32_t n = 0; n < sizeof bad / sizeof bad[0]; ++n) {
        for (uint32_t byte = 0; byte < 4U; ++byte) {
            all.byte[0][CGL_MAP_HEADER + 36U + byte] = (uint8_t)(bad[n] >> 8U * byte);
        }
        CHECK(load(&config, &o, &found) == CGL_MAP_DAMAGED);
        set_header(&all, 0U, 56U, 4U, cgl_crc32(0U, all.byte[0] + CGL_MAP_HEADER, 40U));
        CHECK(load(&config, &o, &found) == CGL_MAP_BAD_VALUE && is_untouched(&found));
    }
}

/* Amplitudes belong to orders: of others they mean nothing. */
static void refuse_other_orders(void)
{
    static flash all;
    owner o, found;
    flash_clear(&all, 4U);
    const cgl_map_store_config config = flash_config(&all, MOTOR);
    make(&o, 2U, 3U);
    learn(&o, 1U);
    o.map.unit[0] = CGL_MAP_UNIT_ORDER;
    o.map.limit[0] = CGL_R(100.0);
    for (uint32_t n = 0; n < 3U; ++n) {
        *at(&o, n) = (cgl_real)(6U + 12U * n);
    }
    cgl_map_store store = started(&config);
    CHECK(save(&store, &o) == CGL_MAP_OK);
    for (uint32_t other = 0; other < 4U; ++other) {
        make(&found, 2U, 3U);
        found.map = o.map;
        found.map.entry = found.memory;
        for (uint32_t n = 0; n < 3U; ++n) {
            *at(&found, n) = *at(&o, n) + (n == other ? CGL_R(1.0) : CGL_R(0.0));
        }
        const cgl_real before = *at(&found, 4U);
        store = started(&config);
        CHECK(cgl_map_store_load(&store, &found.map) == (other < 3U ? CGL_MAP_OTHER_LAYOUT : CGL_MAP_OK));
        const cgl_real wanted = other < 3U ? before : *at(&o, 4U);
        CHECK(*at(&found, 4U) >= wanted && *at(&found, 4U) <= wanted);
    }
}

static void refuse_configs(void)
{
    static flash all;
    flash_clear(&all, 4U);
    const cgl_map_store_config good = flash_config(&all, MOTOR);
    cgl_map_store store;
    CHECK(cgl_map_store_init(&store, &good, NULL, 64U) == CGL_ERROR_MEMORY);
    for (uint32_t field = 0; field < 7U; ++field) {
        cgl_map_store_config config = good;
        config.erase = field == 0U ? NULL : config.erase;
        config.write = field == 1U ? NULL : config.write;
        config.read = field == 2U ? NULL : config.read;
        config.write_size = field == 3U ? 0U : (field == 4U ? 24U : (field == 5U ? 512U : config.write_size));
        config.slot_size = field == 6U ? CGL_MAP_HEADER : config.slot_size;
        CHECK(cgl_map_store_init(&store, &config, buffer, sizeof buffer) == CGL_ERROR_CONFIG);
    }
    cgl_map_store_config least = good; /* room for a map of one number */
    least.slot_size = CGL_MAP_STORED_LENGTH(1U, 1U, least.write_size);
    CHECK(cgl_map_store_init(&store, &least, buffer, sizeof buffer) == CGL_OK);
    --least.slot_size;
    CHECK(cgl_map_store_init(&store, &least, buffer, sizeof buffer) == CGL_ERROR_CONFIG);
}

/* ---- saving ---- */

/* Number n in the slots, then the next: the newer one is found, over the end of the numbers too. */
static void number_saves(void)
{
    static const uint32_t numbers[] = {1U, 0x7FFFFFFEU, 0x7FFFFFFFU, 0x80000000U, 0xFFFFFFFEU, 0xFFFFFFFFU};
    static flash all;
    owner o, found;
    for (uint32_t n = 0; n < sizeof numbers / sizeof numbers[0]; ++n) {
        const cgl_map_store_config config = after_saves(&all, 8U, &o, 1U, 12U, 1U);
        set_header(&all, 0U, 8U, 4U, numbers[n]);
        for (uint32_t which = 2; which < 6U; ++which) {
            save_and_expect(&config, &o, which);
        }
        CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 5U));
        set_header(&all, 0U, 8U, 4U, numbers[n]); /* map 5 */
        for (uint32_t other = 0; other < sizeof numbers / sizeof numbers[0]; ++other) {
            set_header(&all, 1U, 8U, 4U, numbers[other]); /* map 4 */
            const uint32_t newer = (int32_t)(numbers[other] - numbers[n]) > 0 ? 4U : 5U;
            CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, newer));
        }
    }
}

/* A map that does not fit for now, for its limit or its motor, is older than one saved meanwhile when it fits again:
 * wherever its number is, and with power lost at any byte of that save before. */
static void outrank_what_does_not_fit(uint32_t before, uint32_t number, bool motor)
{
    static flash all, start;
    owner o, low, found;
    flash_clear(&start, 8U);
    start.size = 256U;
    make(&o, 1U, 12U);
    make(&low, 1U, 12U);
    low.map.limit[0] = motor ? CGL_R(1.0) : CGL_R(0.1);
    for (uint32_t which = 1; which <= before; ++which) {
        const cgl_map_store_config config = flash_config(&start, MOTOR);
        save_and_expect(&config, &o, which);
        if (which == 1U) {
            set_header(&start, 0U, 8U, 4U, number);
        }
    }
    for (uint32_t power = 0; power <= 500U; power += number == 1U ? 1U : 19U) {
        all = start;
        const cgl_map_store_config own = flash_config(&all, MOTOR);
        const cgl_map_store_config other = flash_config(&all, motor ? 99U : MOTOR);
        for (uint32_t n = 0; n < 12U; ++n) {
            *at(&low, n) = CGL_R(0.0625);
        }
        all.power = power;
        cgl_map_store store = started(&other);
        save(&store, &low);
        all.power = 0xFFFFFFFFU;
        const cgl_map_result result = load(&own, &o, &found);
        CHECK(result == CGL_MAP_OK || before == 1U);
        CHECK(result != CGL_MAP_OK || knows(&found, before) || knows(&found, before - 1U) || !motor);
        CHECK(save(&store, &low) == CGL_MAP_OK);
        CHECK(load_alike(&other, &low.map, &found) == CGL_MAP_OK && found.memory[0] >= CGL_R(0.0625));
        if (!motor) { /* the limit is as it was */
            CHECK(load(&own, &o, &found) == CGL_MAP_OK && found.memory[0] >= CGL_R(0.0625)
                  && found.memory[0] <= CGL_R(0.0625));
        }
        save_and_expect(&own, &o, 77U);
        save_and_expect(&own, &o, 78U);
    }
}

static void outrank_all(void)
{
    static const uint32_t numbers[] = {1U, 4U, 0x7FFFFFFFU, 0x80000000U, 0xFFFFFFFCU, 0xFFFFFFFEU, 0xFFFFFFFFU};
    for (uint32_t n = 0; n < sizeof numbers / sizeof numbers[0]; ++n) {
        for (uint32_t before = 1; before < 6U; ++before) {
            outrank_what_does_not_fit(before, numbers[n], false);
            outrank_what_does_not_fit(before, numbers[n], true);
        }
    }
}

/* A map of another motor is written over before the last one of this. */
static void spare_the_own(void)
{
    static flash all;
    owner o, found;
    flash_clear(&all, 8U);
    const cgl_map_store_config own = flash_config(&all, MOTOR), other = flash_config(&all, 99U);
    make(&o, 1U, 12U);
    save_and_expect(&own, &o, 1U);
    save_and_expect(&own, &o, 2U);
    save_and_expect(&other, &o, 3U); /* into slot 0: neither fits */
    CHECK(load(&own, &o, &found) == CGL_MAP_OK && knows(&found, 2U));
    all.power = 100U;
    cgl_map_store store = started(&own);
    learn(&o, 4U);
    CHECK(save(&store, &o) == CGL_MAP_FLASH_FAILED);
    all.power = 0xFFFFFFFFU;
    CHECK(load(&own, &o, &found) == CGL_MAP_OK && knows(&found, 2U));
}

/* The same entries are not written again; flash that waits is waited for; a failure is told. */
static void spare_the_flash(void)
{
    static flash all, before;
    owner o, found;
    flash_clear(&all, 8U);
    all.slow = true;
    const cgl_map_store_config config = flash_config(&all, MOTOR);
    make(&o, 3U, 40U);
    save_and_expect(&config, &o, 1U);
    save_and_expect(&config, &o, 2U);
    CHECK(all.erases == 2U);
    before = all;
    save_and_expect(&config, &o, 2U);
    CHECK(memcmp(&before.byte, &all.byte, sizeof all.byte) == 0 && all.erases == 2U && all.writes == before.writes);

    all.broken = true;
    cgl_map_store store = started(&config);
    learn(&o, 3U);
    CHECK(save(&store, &o) == CGL_MAP_FLASH_FAILED);
    CHECK(all.erases == 2U); /* nothing is written where nothing can be seen */
    all.broken = false;
    CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 2U));
}

/* Flash that is locked has a whole map in the slot already, perhaps with the very entries: still it is not the new one. */
static void notice_locked_flash(void)
{
    static flash all;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, 8U, &o, 1U, 12U, 2U);
    all.locked = true;
    for (uint32_t which = 1; which < 4U; which += 2U) {
        cgl_map_store store = started(&config);
        learn(&o, which);
        CHECK(save(&store, &o) == CGL_MAP_FLASH_FAILED);
        CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 2U));
    }
}

/* The newer slot loses a bit between two saves: the next one goes there, and spares the map that is left. */
static void look_again(void)
{
    static flash all, before;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, 8U, &o, 1U, 12U, 0U);
    cgl_map_store store = started(&config);
    for (uint32_t which = 1; which < 5U; ++which) {
        learn(&o, which);
        CHECK(save(&store, &o) == CGL_MAP_OK);
        const uint32_t slot = (which + 1U) % 2U;
        CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, which));
        before = all;
        all.byte[slot][CGL_MAP_HEADER] ^= 1U;
        learn(&o, 10U + which);
        CHECK(save(&store, &o) == CGL_MAP_OK);
        CHECK(memcmp(all.byte[1U - slot], before.byte[1U - slot], FLASH_SLOT) == 0);
        CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 10U + which));
    }
}

/* Flash that fades, or fails once, during a load: the result is the whole newest map, the older one, or none. */
static void fade(bool fails)
{
    static flash all;
    owner o, found;
    const cgl_map_store_config config = after_saves(&all, 8U, &o, 2U, 40U, 2U);
    all.fails = fails;
    uint32_t whole = 0U, older = 0U, cleared = 0U, untouched = 0U;
    for (uint32_t reads = 1; reads < 100U; ++reads) {
        all.reads = reads;
        const cgl_map_result result = load(&config, &o, &found);
        all.reads = 0U;
        bool zero = true;
        for (uint32_t n = 0; n < o.map.channels * o.map.cells; ++n) {
            zero = zero && within(*at(&found, n), CGL_R(0.0));
        }
        CHECK(result == CGL_MAP_OK ? knows(&found, 1U) || knows(&found, 2U) : zero || is_untouched(&found));
        whole += result == CGL_MAP_OK && knows(&found, 2U);
        older += result == CGL_MAP_OK && knows(&found, 1U);
        cleared += result != CGL_MAP_OK && zero;
        untouched += result != CGL_MAP_OK && is_untouched(&found);
    }
    CHECK(whole > 20U && older > 20U && cleared > 3U && untouched > 10U); /* the header is read word by word, thrice */
}

/* A law that learns while its map is saved: the old map stays, whenever the entry changed. */
static void change_meanwhile(void)
{
    static flash all, start;
    owner o, found;
    flash_clear(&start, 8U);
    make(&o, 2U, 15U);
    cgl_map_store_config config = flash_config(&start, MOTOR);
    save_and_expect(&config, &o, 1U);
    config.context = &all;
    bool ended = false;
    for (uint32_t change = 0; !ended; ++change) {
        all = start;
        cgl_map_store store;
        CHECK(cgl_map_store_init(&store, &config, buffer, 8U) == CGL_OK);
        learn(&o, 2U);
        CHECK(cgl_map_store_begin(&store, &o.map) == CGL_MAP_OK);
        cgl_map_result result = CGL_MAP_BUSY;
        ended = true;
        for (uint32_t step = 0; result == CGL_MAP_BUSY; ++step) {
            if (step == change) {
                learn(&o, 3U);
                ended = false;
            }
            result = cgl_map_store_step(&store);
        }
        CHECK(result == CGL_MAP_OK || result == CGL_MAP_CHANGED);
        CHECK(load(&config, &o, &found) == CGL_MAP_OK);
        CHECK(result == CGL_MAP_CHANGED ? knows(&found, 1U) : knows(&found, 2U) || knows(&found, 3U));
    }
}

/* ---- anything at all ---- */

static void random_slot(flash *all, uint32_t slot)
{
    for (uint32_t n = 0; n < 400U; ++n) {
        all->byte[slot][n] = (uint8_t)random_bits();
    }
    if (random_below(4) != 0U) { /* what a reader looks at next */
        memcpy(all->byte[slot], "CGLM\1\0\100\0", 8U);
        set_header(all, slot, 8U, 0U, 0U);
    }
}

void random_flash(long tries)
{
    static flash all;
    owner o, found;
    for (long n = 0; n < tries; ++n) {
        flash_clear(&all, 1U << random_below(9));
        const cgl_map_store_config config = flash_config(&all, MOTOR);
        make(&o, 1U + random_below(3), 1U + random_below(40));
        o.map.turns = random_below(2) ? random_bits() : 1U;
        o.map.parts = o.map.turns != 0U ? 1U + random_below(7) : 0U;
        cgl_map_store store = started(&config);
        learn(&o, (uint32_t)n);
        CHECK(save(&store, &o) == CGL_MAP_OK);
        CHECK(load_alike(&config, &o.map, &found) == CGL_MAP_OK && knows(&found, (uint32_t)n));
        if (random_below(2) != 0U) {
            random_slot(&all, random_below(2));
        }
        for (uint32_t count = random_below(4); count > 0U; --count) { /* fields of any kind under a CRC that is right */
            set_header(&all, random_below(2), 4U + random_below(53), 1U + random_below(4), random_word());
        }
        for (uint32_t count = random_below(3); count > 0U; --count) {
            all.byte[0][64U + random_below(160)] = (uint8_t)random_bits();
        }
        const cgl_map_result result = load_alike(&config, &o.map, &found);
        CHECK(result == CGL_MAP_OK ? knows(&found, (uint32_t)n) : is_untouched(&found));
        learn(&o, (uint32_t)n + 1U);
        CHECK(save(&store, &o) == CGL_MAP_OK); /* whatever was there before */
        CHECK(load_alike(&config, &o.map, &found) == CGL_MAP_OK && knows(&found, (uint32_t)n + 1U));
    }
}

/* ---- what a law says of its map ---- */

static cgl_real entries[16];

static void check_map(const cgl_map *map, cgl_map_result result, uint32_t law, uint32_t stride, uint32_t channels, const uint32_t period[3],
                      const uint32_t unit[3], const cgl_real limit[3])
{
    CHECK(result == CGL_MAP_OK && map->law == law && map->entry == entries && map->cells == 5U);
    CHECK(map->stride == stride && map->channels == channels);
    CHECK(map->turns == period[0] && map->parts == period[1] && map->ratio == period[2]);
    for (uint32_t c = 0; c < CGL_MAP_CHANNELS; ++c) {
        CHECK(map->unit[c] == unit[c] && within(map->limit[c] - limit[c], CGL_R(0.0)));
    }
}

/* Of `channels` functions of 2/3 of a revolution, in a row of 5 cells and 2 more. */
static cgl_memory learned(uint32_t channels)
{
    const cgl_memory memory = {.config = {.kind = CGL_MEMORY_ANGLE, .channels = channels, .cells = 5U, .turns = 2U, .parts = 3U,
                                          .q_half_width = 1U, .limit = {CGL_R(1.0), CGL_R(2.0), CGL_R(3.0)}},
                               .periods = 3U, .cell = entries};
    return memory;
}

static void maps_of_laws(void)
{
    const cgl_real one[3] = {CGL_R(1.0), CGL_R(0.0), CGL_R(0.0)}, three[3] = {CGL_R(1.0), CGL_R(2.0), CGL_R(3.0)};
    const uint32_t part[3] = {2U, 3U, 1U}, turn[3] = {1U, 1U, 1U}, trial[3] = {0U, 0U, 1U}, geared[3] = {2U, 3U, 7U};
    const uint32_t current[3] = {CGL_MAP_UNIT_CURRENT, CGL_MAP_UNIT_NONE, CGL_MAP_UNIT_NONE};
    const uint32_t acceleration[3] = {CGL_MAP_UNIT_ACCELERATION, CGL_MAP_UNIT_NONE, CGL_MAP_UNIT_NONE};
    const uint32_t of_trial[3] = {CGL_MAP_UNIT_OF_THE_TRIAL, CGL_MAP_UNIT_NONE, CGL_MAP_UNIT_NONE};
    const uint32_t space[3] = {CGL_MAP_UNIT_CURRENT, CGL_MAP_UNIT_CURRENT_PER_SPEED, CGL_MAP_UNIT_CURRENT_PER_ACCELERATION};
    const uint32_t orders[3] = {CGL_MAP_UNIT_COSINE_CURRENT, CGL_MAP_UNIT_SINE_CURRENT, CGL_MAP_UNIT_ORDER};
    const cgl_real of_afc[3] = {CGL_R(1.0), CGL_R(1.0), (cgl_real)CGL_PI_AFC_ORDER_MAX};
    const cgl_real of_harmonic[3] = {CGL_R(1.0), CGL_R(1.0), (cgl_real)CGL_HARMONIC_ORDER_MAX};
    const cgl_pi_ilc pi_ilc = {.memory = learned(1U)};
    const cgl_robust_ilc robust_ilc = {.memory = learned(1U)};
    const cgl_space_position position = {.config = {.ratio = 7U}, .memory = learned(3U)};
    const cgl_space_speed speed = {.memory = learned(3U)};
    const cgl_anti_cogging table = {.config = {.pi = {.limit = CGL_R(1.0)}, .cells = 5U}, .table = entries};
    const cgl_trial run = {.config = {.samples = 5U, .learned_limit = CGL_R(1.0)}, .learned = entries};
    const cgl_pi_afc afc = {.config = {.orders = 5U, .limit = CGL_R(1.0)}, .coefficient = entries};
    const cgl_harmonic harmonic = {.config = {.orders = 5U, .limit = CGL_R(1.0)}, .cosine = entries};
    cgl_map map;
    memset(&map, 0xA5, sizeof map);
    check_map(&map, cgl_map_of_pi_ilc(&pi_ilc, &map), CGL_MAP_LAW_PI_ILC, 7U, 1U, part, current, one);
    CHECK(map.learning == &pi_ilc.memory.learning);
    check_map(&map, cgl_map_of_robust_ilc(&robust_ilc, &map), CGL_MAP_LAW_ROBUST_ILC, 7U, 1U, part, acceleration, one);
    CHECK(map.learning == &robust_ilc.memory.learning);
    check_map(&map, cgl_map_of_space_position(&position, &map), CGL_MAP_LAW_SPACE_POSITION, 7U, 3U, geared, space, three);
    check_map(&map, cgl_map_of_space_speed(&speed, &map), CGL_MAP_LAW_SPACE_SPEED, 7U, 3U, part, space, three);
    check_map(&map, cgl_map_of_anti_cogging(&table, &map), CGL_MAP_LAW_ANTI_COGGING, 5U, 1U, turn, current, one);
    CHECK(map.learning == NULL);
    check_map(&map, cgl_map_of_trial(&run, &map), CGL_MAP_LAW_TRIAL, 5U, 1U, trial, of_trial, one);
    check_map(&map, cgl_map_of_pi_afc(&afc, &map), CGL_MAP_LAW_PI_AFC, 5U, 3U, turn, orders, of_afc);
    CHECK(map.learning == &afc.learning);
    check_map(&map, cgl_map_of_harmonic(&harmonic, &map), CGL_MAP_LAW_HARMONIC, 5U, 3U, turn, orders, of_harmonic);
    CHECK(map.learning == &harmonic.learning);
    cgl_pi_ilc by_time = pi_ilc;
    by_time.memory.config.kind = CGL_MEMORY_TIME;
    CHECK(cgl_map_of_pi_ilc(&by_time, &map) == CGL_MAP_BY_TIME);
}

/* A state that no init has made has no map: its limit is 0. */
static void maps_of_no_law(void)
{
    static const cgl_pi_ilc pi_ilc;
    static const cgl_robust_ilc robust_ilc;
    static const cgl_space_position position;
    static const cgl_space_speed speed;
    static const cgl_anti_cogging table;
    static const cgl_trial run;
    static const cgl_pi_afc afc;
    static const cgl_harmonic harmonic;
    cgl_map map;
    CHECK(cgl_map_of_pi_ilc(&pi_ilc, &map) == CGL_MAP_INVALID && cgl_map_of_robust_ilc(&robust_ilc, &map) == CGL_MAP_INVALID);
    CHECK(cgl_map_of_space_position(&position, &map) == CGL_MAP_INVALID && cgl_map_of_space_speed(&speed, &map) == CGL_MAP_INVALID);
    CHECK(cgl_map_of_anti_cogging(&table, &map) == CGL_MAP_INVALID && cgl_map_of_trial(&run, &map) == CGL_MAP_INVALID);
    CHECK(cgl_map_of_pi_afc(&afc, &map) == CGL_MAP_INVALID && cgl_map_of_harmonic(&harmonic, &map) == CGL_MAP_INVALID);
}

/* Whether a mean is a rounding error depends on the limit of the entries, not on their unit. */
static void centre_by_the_limit(void)
{
    const cgl_real limits[] = {CGL_R(1.0e-3), CGL_R(1.0), CGL_R(1.0e3)};
    for (uint32_t n = 0U; n < sizeof limits / sizeof limits[0]; ++n) {
        const cgl_real limit = limits[n], rounding = CGL_R(1.0e-7) * limit, mean = CGL_R(1.0e-5) * limit;
        cgl_real entry[2] = {rounding, rounding};
        const cgl_map map = {.entry = entry, .stride = 2U, .cells = 2U, .channels = 1U, .limit = {limit}, .centred = 1U};
        cgl_map_centre(&map);
        CHECK(cgl_is_within(entry[0] - rounding, CGL_R(0.0)) && cgl_is_within(entry[1] - rounding, CGL_R(0.0)));
        entry[0] = CGL_R(2.0) * mean;
        entry[1] = CGL_R(0.0);
        cgl_map_centre(&map);
        CHECK(cgl_is_within(entry[0] - mean, rounding) && cgl_is_within(entry[1] + mean, rounding));
    }
}

/* Of a buffer that holds no whole number of writes the rest stays as it is. */
static void use_any_buffer(void)
{
    static flash all;
    for (uint32_t write_size = 1U; write_size <= 64U; write_size *= 4U) {
        for (uint32_t length = write_size > 8U ? write_size : 8U; length < 200U; length += 13U) {
            owner o, found;
            flash_clear(&all, write_size);
            const cgl_map_store_config config = flash_config(&all, MOTOR);
            cgl_map_store store;
            memset(buffer, 0xA5, sizeof buffer);
            CHECK(cgl_map_store_init(&store, &config, buffer, length) == CGL_OK);
            make(&o, 2U, 50U);
            learn(&o, 1U);
            CHECK(save(&store, &o) == CGL_MAP_OK);
            for (uint32_t n = length - length % write_size; n < sizeof buffer; ++n) {
                CHECK(buffer[n] == 0xA5U);
            }
            CHECK(load(&config, &o, &found) == CGL_MAP_OK && knows(&found, 1U));
        }
    }
}

void stored_maps(void)
{
    use_any_buffer();
    describe_a_map();
    maps_of_laws();
    maps_of_no_law();
    centre_by_the_limit();
    CHECK(cgl_crc32(0U, (const uint8_t *)"123456789", 9U) == 0xCBF43926U);
    refuse_configs();
    refuse_with_reason();
    refuse_numbers();
    refuse_other_orders();
    number_saves();
    outrank_all();
    spare_the_own();
    spare_the_flash();
    notice_locked_flash();
    look_again();
    fade(false);
    fade(true);
    change_meanwhile();
    fall_back();
    flip_every_bit(1U, 4U, 1U);
    flip_every_bit(3U, 25U, 16U);
    flip_every_bit(2U, 7U, 256U);
    flip_every_bit(1U, 300U, 8U);
    lose_power_anywhere();
}
