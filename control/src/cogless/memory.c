#include "memory.h"

#include "angle.h"
#include "range.h"
#ifndef COGLESS_NO_DELAY_LINE
#include "delay_line.h"
#endif

#define QUARTER 0x40000000U /* of a period */
#define REACH 16U           /* cells that a rotor may always pass in a step */

CGL_SELDOM static bool is_valid(const cgl_memory_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(cgl_memory_config, turns, CGL_COUNT),
                                      CGL_RANGE(cgl_memory_config, parts, CGL_COUNT),
                                      CGL_RANGE(cgl_memory_config, forgetting, CGL_POSITIVE)};
    const uint32_t most = config->kind == CGL_MEMORY_ANGLE ? CGL_CELLS_MAX : CGL_SAMPLES_MAX;
    bool valid = CGL_IS_IN_RANGE(config, range) && cgl_is_positive(ts) && config->forgetting <= CGL_R(1.0)
                 && config->channels >= 1U && config->channels <= (uint32_t)CGL_CHANNELS && config->cells >= 4U
                 && config->cells <= most && config->q_half_width < config->cells / 2U
                 && config->lead <= config->cells / 4U;
#ifdef COGLESS_NO_DELAY_LINE
    valid = valid && config->kind == CGL_MEMORY_ANGLE;
#else
    valid = valid && (config->kind == CGL_MEMORY_ANGLE || config->kind == CGL_MEMORY_TIME || cgl_delay_is_valid(config, ts));
#endif
    for (uint32_t c = 0; valid && c < config->channels; ++c) {
        valid = cgl_is_positive(config->limit[c])
                && cgl_is_finite((cgl_real)(2U * config->q_half_width + 2U) * config->limit[c]);
    }
    return valid;
}

CGL_SELDOM static void take(cgl_memory *memory, const cgl_memory_config *config)
{
    memory->config = *config;
    memory->gain = config->forgetting / (cgl_real)(2U * config->q_half_width + 1U);
}

CGL_SELDOM cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, uint32_t ratio,
                                     cgl_real *cell, uint32_t length)
{
    if (!(is_valid(config, ts) && ratio >= 1U && ratio <= 65535U)) {
        return CGL_ERROR_CONFIG;
    }
    if (cell == 0
        || length < CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width)) {
        return CGL_ERROR_MEMORY;
    }
    take(memory, config);
    memory->ts = ts;
    memory->periods = ratio * config->parts;
    memory->cell = cell;
    memory->map.width = (uint32_t)(0x100000000U / config->cells);
    memory->map.per_step = (cgl_real)config->cells / CGL_R(4294967296.0);
    cgl_memory_reset(memory);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_memory_retune(cgl_memory *memory, const cgl_memory_config *config)
{
    const cgl_memory_config *const now = &memory->config;
    if (!(is_valid(config, memory->ts) && config->kind == now->kind && config->channels == now->channels
          && config->cells == now->cells && config->turns == now->turns && config->parts == now->parts
          && config->q_half_width == now->q_half_width)) {
        return CGL_ERROR_CONFIG;
    }
    take(memory, config);
    const uint32_t row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    cgl_real *entry = memory->cell + (config->kind == CGL_MEMORY_DELAY ? row : 0U);
    for (uint32_t c = 0; c < config->channels; ++c, entry += row) {
        for (uint32_t n = 0; n < row; ++n) {
            entry[n] = cgl_clamp(entry[n], config->limit[c]);
        }
        memory->value[c] = cgl_clamp(memory->value[c], config->limit[c]);
    }
    memory->map.started = memory->map.lagging = false;
    return CGL_OK;
}

CGL_SELDOM void cgl_memory_reset(cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t length =
        CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
    for (uint32_t n = 0; n < length; ++n) {
        memory->cell[n] = CGL_R(0.0);
    }
    cgl_angle_map *const map = &memory->map;
    for (uint32_t c = 0; c < (uint32_t)CGL_CHANNELS; ++c) {
        memory->value[c] = map->sum[c] = map->anew[c] = map->correction[c] = CGL_R(0.0);
    }
    memory->learning = false;
    map->angle = map->turn = map->x = map->at = map->passed = map->head = map->half = map->anew_left = map->lag_x = 0U;
    map->part = CGL_R(0.0);
    map->backward = map->started = map->follows = map->lagging = false;
#ifndef COGLESS_NO_DELAY_LINE
    cgl_delay_reset(&memory->line);
#endif
}

/* n, below two times the cells, within them. */
static inline uint32_t wrapped(uint32_t n, uint32_t cells)
{
    return n < cells ? n : n - cells;
}

/* ---- where the rotor is ---- */

/* The place of an angle in the period; with more turns than one, of the turn that the rotor is in. */
CGL_SELDOM static uint32_t place_in_turns(cgl_memory *memory, uint32_t angle)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t turns = memory->config.turns;
    if ((int32_t)(angle - map->angle) >= 0) { /* the shorter way round */
        map->turn = angle < map->angle ? wrapped(map->turn + 1U, turns) : map->turn;
    } else {
        map->turn = angle > map->angle ? wrapped(map->turn + turns - 1U, turns) : map->turn;
    }
    map->angle = angle;
    /* periods / turns of a revolution; the remainder of a turn first, which must not be lost */
    const uint32_t turn = (uint32_t)((((uint64_t)map->turn * memory->periods % turns) << 32) / turns);
    const uint32_t whole = angle / turns, rest = angle % turns;
    return turn + whole * memory->periods + (uint32_t)((uint64_t)rest * memory->periods / turns);
}

/* Starts anew at a place: the sum is that of one cell. */
CGL_SELDOM static void seat(cgl_memory *memory, uint32_t x, uint32_t n, cgl_real part, bool backward)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, length = CGL_MEMORY_ROW(cells, memory->config.q_half_width);
    cgl_real *row = memory->cell;
    map->x = x;
    map->at = n;
    map->part = part;
    map->backward = backward;
    map->started = true;
    map->follows = map->lagging = false;
    map->passed = map->head = map->half = 0U;
    map->anew_left = 1U;
    for (uint32_t c = 0; c < memory->config.channels; ++c, row += length) {
        map->sum[c] = row[n];
        map->anew[c] = CGL_R(0.0);
        row[cells] = row[backward ? wrapped(n + 1U, cells) : n];
    }
}

/* Place in the ring of the entry that was passed `age` cells ago. */
static inline uint32_t ring_place(const cgl_memory *memory, uint32_t age)
{
    const uint32_t head = memory->map.head, cells = memory->config.cells;
    return cells + (head >= age ? head - age : head + memory->config.q_half_width + 1U - age);
}

/* The sum takes in a cell more on each side. */
CGL_SELDOM static void widen(cgl_memory *memory)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, half = map->half + 1U;
    const uint32_t length = CGL_MEMORY_ROW(cells, memory->config.q_half_width);
    const uint32_t above = wrapped(map->at + half, cells), below = wrapped(map->at + cells - half, cells);
    const uint32_t last = ring_place(memory, half - 1U), oldest = ring_place(memory, half);
    cgl_real *row = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, row += length) {
        if (map->backward) {
            map->sum[c] += row[last] + row[below];
            row[oldest] = row[wrapped(above + 1U, cells)];
        } else {
            row[oldest] = row[below];
            map->sum[c] += row[above] + row[below];
        }
        map->anew[c] = CGL_R(0.0);
    }
    map->half = half;
    map->anew_left = 2U * half + 1U;
}

/* The rotor comes to the next cell, whose entry goes into the ring as it is. */
static inline void pass(cgl_memory *memory)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, m = memory->config.q_half_width, half = map->half;
    const uint32_t length = CGL_MEMORY_ROW(cells, m), at = map->at;
    const bool backward = map->backward, whole = --map->anew_left == 0U;
    const uint32_t next = backward ? (at > 0U ? at : cells) - 1U : wrapped(at + 1U, cells);
    const uint32_t passed = backward ? at : next, entering = wrapped(backward ? next + cells - half : next + half, cells);
    /* on the way back the entry that is passed is in the window, and may be what leaves it */
    const uint32_t behind = ring_place(memory, backward ? half - 1U : half);
    const uint32_t leaving = backward && half == 0U ? at : behind;
    map->head = map->head < m ? map->head + 1U : 0U;
    const uint32_t newest = cells + map->head;
    cgl_real *row = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, row += length) {
        const cgl_real new_one = row[entering];
        map->sum[c] += new_one - row[leaving];
        map->anew[c] += new_one;
        row[newest] = row[passed];
        if (whole) {
            map->sum[c] = map->anew[c];
            map->anew[c] = CGL_R(0.0);
        }
    }
    map->anew_left = whole ? 2U * half + 1U : map->anew_left;
    map->at = next;
}

/* Follows the rotor to a place; how far it moved [2^-32 periods], 0 where it starts anew. */
static inline uint32_t follow(cgl_memory *memory, uint32_t x)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells;
    uint32_t moved = map->backward ? map->x - x : x - map->x;
    if (map->started && moved > 0U - map->width) { /* back by less than a cell: it stands */
        x = map->x;
        moved = 0U;
    }
    const uint64_t place = (uint64_t)x * cells;
    const uint32_t n = (uint32_t)(place >> 32);
    const cgl_real part = (cgl_real)(uint32_t)place * CGL_R(2.3283064365386963e-10);
    uint32_t count = map->backward ? map->at - n : n - map->at;
    count += count < cells ? 0U : cells;
    if (!(map->started && moved <= QUARTER && count <= REACH + 2U * map->passed)) {
        const bool turned = map->started && moved >= 0U - QUARTER;
        seat(memory, x, n, part, map->backward != turned);
        map->passed = moved <= QUARTER ? count : 0U; /* where it goes on like this, it is no jump */
        return 0U;
    }
    map->passed = count;
    for (; count > 0U; --count) {
        pass(memory);
    }
    map->x = x;
    map->part = part;
    return moved;
}

/* ---- what is learned there ---- */

/* `count` cells back from n, against the way the rotor goes, get values of a line that ends `rest` cells after n with
 * `value`, by `slope` a cell; or, to correct them, they get it added. */
static inline void write_line(cgl_real *row, uint32_t cells, bool backward, uint32_t n, uint32_t count, cgl_real value,
                              cgl_real rest, cgl_real slope, cgl_real limit, bool add)
{
    cgl_real on_line = value - rest * slope;
    for (; count > 0U; --count) {
        row[n] = cgl_clamp(add ? row[n] + on_line : on_line, limit);
        on_line -= slope;
        n = backward ? wrapped(n + 1U, cells) : (n > 0U ? n : cells) - 1U;
    }
}

/* Adds the corrections where the rotor was `lead` samples ago, had it always moved as it does now. */
static inline void correct(cgl_memory *memory, uint32_t moved, const cgl_real *correction)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, lead = memory->config.lead;
    const uint32_t length = CGL_MEMORY_ROW(cells, memory->config.q_half_width);
    const bool backward = map->backward;
    if ((uint64_t)moved * lead > QUARTER) {
        map->lagging = false;
        return;
    }
    const uint32_t behind = moved * lead, x = backward ? map->x + behind : map->x - behind;
    const uint32_t passed = backward ? map->lag_x - x : x - map->lag_x;
    if (map->lagging && (passed == 0U || passed > 0x80000000U)) {
        return; /* the rotor gains speed faster than it moves: wait until the place comes by again */
    }
    const uint64_t from = (uint64_t)map->lag_x * cells, to = (uint64_t)x * cells;
    const uint32_t n = (uint32_t)(to >> 32), last = (uint32_t)(from >> 32);
    uint32_t count = backward ? last - n : n - last;
    count += count < cells ? 0U : cells;
    if (map->lagging && passed <= QUARTER && count <= REACH + 2U * map->passed) {
        const cgl_real part = (cgl_real)(uint32_t)to * CGL_R(2.3283064365386963e-10);
        const cgl_real rest = backward ? CGL_R(1.0) - part : part;
        const cgl_real per_cell = CGL_R(1.0) / ((cgl_real)passed * map->per_step);
        cgl_real *row = memory->cell;
        for (uint32_t c = 0; count > 0U && c < memory->config.channels; ++c, row += length) {
            write_line(row, cells, backward, backward ? wrapped(n + 1U, cells) : n, count, correction[c], rest,
                       (correction[c] - map->correction[c]) * per_cell, memory->config.limit[c], true);
        }
    }
    map->lag_x = x;
    map->lagging = true;
    for (uint32_t c = 0; c < memory->config.channels; ++c) {
        map->correction[c] = correction[c];
    }
}

/* What is held at the place, as it is. */
CGL_SELDOM static void repeat(cgl_memory *memory, cgl_real *value)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, length = CGL_MEMORY_ROW(cells, memory->config.q_half_width);
    const cgl_real *row = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, row += length) {
        const cgl_real here = row[map->at];
        value[c] = here + map->part * (row[wrapped(map->at + 1U, cells)] - here);
        memory->value[c] = cgl_clamp(value[c], memory->config.limit[c]);
    }
    map->follows = map->lagging = false;
}

static inline void learn_on(cgl_memory *memory, uint32_t moved, const cgl_real *correction, cgl_real *value)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, m = memory->config.q_half_width, length = CGL_MEMORY_ROW(cells, m);
    const uint32_t at = map->at, count = map->follows && moved > 0U ? map->passed : 0U;
    const bool backward = map->backward, acts = memory->config.lead == 0U;
    const uint32_t behind = ring_place(memory, m), ahead = wrapped(backward ? at + cells - m : at + m + 1U, cells);
    const cgl_real rest = backward ? CGL_R(1.0) - map->part : map->part;
    const cgl_real per_cell = count > 0U ? CGL_R(1.0) / ((cgl_real)moved * map->per_step) : CGL_R(0.0);
    cgl_real *row = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, row += length) {
        const cgl_real change = backward ? row[behind] - row[ahead] : row[ahead] - row[behind];
        const cgl_real recalled = memory->gain * (map->sum[c] + map->part * change), limit = memory->config.limit[c];
        value[c] = acts ? recalled + correction[c] : recalled;
        const cgl_real stored = cgl_clamp(value[c], limit);
        if (count > 0U) {
            write_line(row, cells, backward, backward ? wrapped(at + 1U, cells) : at, count, stored, rest,
                       (stored - memory->value[c]) * per_cell, limit, false);
        }
        memory->value[c] = stored;
    }
    map->follows = true;
    if (!acts && moved > 0U) {
        correct(memory, moved, correction);
    }
}

static inline bool is_finite_all(const cgl_memory *memory, const cgl_real *x)
{
    cgl_real sum = CGL_R(0.0);
    for (uint32_t c = 0; c < memory->config.channels; ++c) {
        sum += x[c] - x[c]; /* 0, or NaN */
    }
    return sum == CGL_R(0.0);
}

/* No place is known: what acts is what acted last. */
CGL_SELDOM static void lose(cgl_memory *memory, cgl_real *value)
{
    for (uint32_t c = 0; c < memory->config.channels; ++c) {
        value[c] = memory->value[c];
    }
    memory->map.started = memory->map.follows = memory->map.lagging = false;
}

bool cgl_memory_step(cgl_memory *memory, cgl_real theta, cgl_real speed, bool learn, const cgl_real *correction,
                     cgl_real *value)
{
    learn = learn && is_finite_all(memory, correction);
    if (!cgl_is_angle(theta)) {
        lose(memory, value);
        learn = false;
    } else if (CGL_OFTEN(memory->config.kind == CGL_MEMORY_ANGLE)) {
        const uint32_t angle = cgl_turns(theta);
        const uint32_t moved = follow(memory, CGL_OFTEN(memory->config.turns == 1U)
                                                  ? angle * memory->periods /* whole periods fall off */
                                                  : place_in_turns(memory, angle));
        if (CGL_OFTEN(learn && memory->map.half == memory->config.q_half_width)) {
            learn_on(memory, moved, correction, value);
        } else {
            learn = false;
            if (memory->map.half < memory->config.q_half_width) {
                widen(memory);
            }
            repeat(memory, value);
        }
    } else {
#ifndef COGLESS_NO_DELAY_LINE
        learn = cgl_delay_step(memory, theta, speed, learn, correction, value);
#endif
    }
    (void)speed;
    memory->learning = learn;
    return learn;
}

CGL_SELDOM cgl_real cgl_memory_fastest(const cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real period = CGL_TWO_PI * (cgl_real)config->turns / (cgl_real)memory->periods; /* of theta [rad] */
    uint32_t samples = 4U * (config->lead > 0U ? config->lead : 1U); /* in a period, at least */
    if (config->kind != CGL_MEMORY_ANGLE && samples < config->q_half_width + 1U) {
        samples = config->q_half_width + 1U;
    }
    return period / ((cgl_real)samples * memory->ts);
}
