#include "memory.h"

#include "angle.h"
#include "range.h"
#include "turns.h"
#ifndef COGLESS_NO_DELAY_LINE
#include "delay_line.h"
#endif

#define QUARTER 0x40000000U /* a quarter of a period [2^-32 periods] */
#define QUARTER_BACK 0xC0000000U
#define REACH 16U           /* a step over at most this many cells is no jump, if it is within a quarter of the period */
#define PER_TURN CGL_R(2.3283064365386963e-10) /* 2^-32 */
#define MEAN_MOST CGL_R(0.9375) /* largest share of a centred channel's mean that is recalled; an integral takes the rest of the mean */

/* Puts the defaults in place of zeros. */
CGL_SELDOM static void fill_defaults(cgl_memory_config *config)
{
    config->channels = config->channels > 0U ? config->channels : 1U;
    config->turns = config->turns > 0U ? config->turns : 1U;
    config->parts = config->parts > 0U ? config->parts : 1U;
    config->forgetting = cgl_or_default(config->forgetting, CGL_R(1.0));
    config->k_pp = cgl_or_default(config->k_pp, CGL_R(10.0));
}

CGL_SELDOM static const char *bad_kind(const cgl_memory_config *config, cgl_real ts)
{
    (void)ts;
    if (config->kind == CGL_MEMORY_ANGLE) {
        return 0;
    }
#ifndef COGLESS_NO_DELAY_LINE
    if (config->kind == CGL_MEMORY_TIME) {
        return 0;
    }
    if (config->kind == CGL_MEMORY_DELAY) {
        cgl_memory_config full = *config;
        fill_defaults(&full);
        return cgl_delay_is_valid(&full, ts) ? 0 : CGL_FIELD("memory.k_pp, or method");
    }
#endif
    return CGL_FIELD("memory.kind");
}

CGL_SELDOM const char *cgl_memory_bad_field(const cgl_memory_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(memory, turns, CGL_COUNT_OR_DEFAULT),
                                      CGL_RANGE(memory, parts, CGL_COUNT_OR_DEFAULT),
                                      CGL_RANGE(memory, forgetting, CGL_NOT_NEGATIVE)};
    const uint32_t most = config->kind == CGL_MEMORY_ANGLE ? CGL_CELLS_MAX : CGL_SAMPLES_MAX;
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (!cgl_is_positive(ts)) {
        return CGL_FIELD("loop.ts");
    }
    if (config->forgetting > CGL_R(1.0)) {
        return CGL_FIELD("memory.forgetting");
    }
    if (config->channels > (uint32_t)CGL_CHANNELS) {
        return CGL_FIELD("memory.channels");
    }
    if (config->cells < 4U || config->cells > most) {
        return CGL_FIELD("memory.cells");
    }
    if (config->q_half_width >= config->cells / 2U) {
        return CGL_FIELD("memory.q_half_width");
    }
    if (config->lead > config->cells / 4U) {
        return CGL_FIELD("memory.lead");
    }
    for (uint32_t c = 0; c == 0U || c < config->channels; ++c) {
        if (!(cgl_is_positive(config->limit[c])
              && cgl_is_finite((cgl_real)(2U * config->q_half_width + 2U) * config->limit[c]))) {
            return CGL_FIELD("memory.limit");
        }
    }
    return bad_kind(config, ts);
}

CGL_SELDOM void cgl_memory_soften(cgl_memory *memory, cgl_real factor)
{
    memory->gain = factor * memory->config.forgetting / (cgl_real)(2U * memory->config.q_half_width + 1U);
}

CGL_SELDOM static void take(cgl_memory *memory, const cgl_memory_config *wanted)
{
    cgl_memory_config *const config = &memory->config;
    memory->config = *wanted;
    fill_defaults(config);
    const uint32_t within_quarter = 4U * (config->lead > 0U ? config->lead : 1U), wide = config->q_half_width + 1U;
    memory->fewest = config->kind != CGL_MEMORY_ANGLE && within_quarter < wide ? wide : within_quarter;
    memory->map.most = cgl_share_of_turn(1U, memory->fewest);
    cgl_memory_soften(memory, CGL_R(1.0));
    for (uint32_t c = 0; c < (uint32_t)CGL_CHANNELS; ++c) {
        memory->channel[c].limit = config->limit[c];
    }
}

CGL_SELDOM cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, uint32_t ratio,
                                     cgl_real *cell, uint32_t length)
{
    memory->ready = 0U;
    if (cgl_memory_bad_field(config, ts) != 0 || ratio < 1U || ratio > 65535U) {
        return CGL_ERROR_CONFIG;
    }
    if (cgl_check_memory(cell, length, CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width)) != CGL_OK) {
        return CGL_ERROR_MEMORY;
    }
    take(memory, config);
    memory->ts = ts;
    memory->centred = 0U;
    memory->periods = ratio * memory->config.parts;
    memory->cell = cell;
    memory->map.width = cgl_share_of_turn(1U, config->cells);
    memory->map.per_cell = CGL_R(4294967296.0) / (cgl_real)config->cells;
    memory->row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    memory->per_entry = CGL_R(1.0) / (cgl_real)config->cells;
    cgl_memory_reset(memory);
    memory->ready = CGL_READY;
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_memory_retune(cgl_memory *memory, const cgl_memory_config *config)
{
    const cgl_memory_config *const now = &memory->config;
    cgl_memory_config full = *config;
    fill_defaults(&full);
    if (!(cgl_memory_bad_field(config, memory->ts) == 0 && full.kind == now->kind && full.channels == now->channels
          && full.cells == now->cells && full.turns == now->turns && full.parts == now->parts
          && full.q_half_width == now->q_half_width)) {
        return CGL_ERROR_CONFIG;
    }
    bool smaller = false;
    for (uint32_t c = 0; c < full.channels; ++c) {
        smaller = smaller || full.limit[c] < now->limit[c];
    }
    take(memory, config);
    memory->map.lagging = false;
    if (!smaller) {
        return CGL_OK;
    }
    memory->map.started = false; /* the channels' sums still contain unclipped entries, so the next step begins the sums anew */
    cgl_real *entry = memory->cell + (full.kind == CGL_MEMORY_DELAY ? memory->row : 0U);
    for (uint32_t c = 0; c < full.channels; ++c, entry += memory->row) {
        for (uint32_t n = 0; n < memory->row; ++n) {
            entry[n] = cgl_clamp(entry[n], full.limit[c]);
        }
        memory->channel[c].value = cgl_clamp(memory->channel[c].value, full.limit[c]);
    }
    return CGL_OK;
}

/* Begins the sum for the mean anew. No mean is removed until the sum covers a whole period. */
CGL_SELDOM static void forget_mean(cgl_memory *memory)
{
    for (cgl_channel *channel = memory->channel; channel < memory->channel + CGL_CHANNELS; ++channel) {
        channel->partial = channel->drain = channel->transfer = CGL_R(0.0);
    }
    memory->scan_cell = 0U;
    memory->line.span = CGL_R(0.0);
}

CGL_SELDOM void cgl_memory_centre(cgl_memory *memory, uint32_t centred)
{
    const uint32_t channels = centred < memory->config.channels ? centred : memory->config.channels;
    if (channels != memory->centred) {
        memory->centred = channels;
        forget_mean(memory);
    }
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
    for (cgl_channel *channel = memory->channel; channel < memory->channel + CGL_CHANNELS; ++channel) {
        channel->value = channel->sum = channel->anew = channel->correction = CGL_R(0.0);
    }
    forget_mean(memory);
    memory->learning = false;
    map->backward = false;
    map->angle = map->turn = map->x = map->at = map->passed = map->head = map->half = map->anew_left = map->lag_x = 0U;
    map->part = CGL_R(0.0);
    map->started = map->follows = map->lagging = false;
#ifndef COGLESS_NO_DELAY_LINE
    cgl_delay_reset(&memory->line);
#endif
}

/* n modulo `cells`; n is below 2 * cells. */
static inline uint32_t wrapped(uint32_t n, uint32_t cells)
{
    return n < cells ? n : n - cells;
}

/* ---- kind angle: the rotor's place in the map, and the sums of the Q filter ---- */

/* Returns the place of an angle in a period of several turns. Updates map->turn, the turn that the rotor is in. */
CGL_SELDOM static uint32_t place_in_turns(cgl_memory *memory, uint32_t angle)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t turns = memory->config.turns;
    if (angle - map->angle < 0x80000000U) { /* the shorter way is forward */
        map->turn = angle < map->angle ? wrapped(map->turn + 1U, turns) : map->turn;
    } else {
        map->turn = angle > map->angle ? wrapped(map->turn + turns - 1U, turns) : map->turn;
    }
    map->angle = angle;
    /* the fractional part of (turn + angle) * periods / turns: 32-bit products are enough, as whole periods wrap away */
    const uint32_t whole = memory->periods / turns, over = memory->periods % turns;
    const uint32_t from = map->turn * over % turns, rest = angle % turns;
    return cgl_share_of_turn(from, turns)
           + angle / turns * memory->periods + rest * whole + rest * over / turns;
}

/* Returns the index of the entry of cell n. Cells are counted in the direction of motion. */
static inline uint32_t entry_of(const cgl_memory *memory, uint32_t n)
{
    return memory->map.backward ? memory->config.cells - 1U - n : n;
}

/* Returns the index of the ring's entry for the cell that was passed `age` cells ago. */
static inline uint32_t ring_place(const cgl_memory *memory, uint32_t age)
{
    const uint32_t length = memory->config.q_half_width + 1U;
    return memory->config.cells + wrapped(memory->map.head + length - age, length);
}

/* Restarts the map at the place x [2^-32 periods]. The Q filter's sum then covers one cell. */
CGL_SELDOM static void seat(cgl_memory *memory, uint32_t x)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, row = memory->row;
    const uint64_t place = (uint64_t)x * cells;
    map->x = x;
    map->at = (uint32_t)(place >> 32);
    map->part = (cgl_real)(uint32_t)place * PER_TURN;
    map->started = true;
    map->follows = map->lagging = false;
    map->passed = map->head = map->half = 0U;
    map->anew_left = 1U;
    cgl_real *entry = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, entry += row) {
        memory->channel[c].sum = entry[cells] = entry[entry_of(memory, map->at)];
        memory->channel[c].anew = CGL_R(0.0);
    }
}

/* Widens the Q filter's sum by one cell on each side. */
CGL_SELDOM static void widen(cgl_memory *memory)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, half = map->half + 1U, oldest = ring_place(memory, half);
    const uint32_t ahead = entry_of(memory, wrapped(map->at + half, cells));
    const uint32_t behind = entry_of(memory, wrapped(map->at + cells - half, cells));
    cgl_real *entry = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, entry += memory->row) {
        entry[oldest] = entry[behind];
        memory->channel[c].sum += entry[ahead] + entry[behind];
        memory->channel[c].anew = CGL_R(0.0);
    }
    map->half = half;
    map->anew_left = 2U * half + 1U;
}

/* Moves the map's place and the Q filter's sums on by `count` cells. The old entries of these cells go into the ring. */
CGL_APART static void pass(cgl_memory *memory, uint32_t count)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, m = memory->config.q_half_width, half = map->half;
    const uint32_t first = ring_place(memory, half) - cells, front = wrapped(map->at + half, cells);
    cgl_real *entry = memory->cell;
    for (cgl_channel *channel = memory->channel;;) {
        cgl_real *const ring = entry + cells;
        cgl_real sum = channel->sum, anew = channel->anew;
        uint32_t at = map->at, ahead = front, head = map->head, leaving = first, anew_left = map->anew_left, left = count;
        do {
            at = wrapped(at + 1U, cells);
            ahead = wrapped(ahead + 1U, cells);
            head = head < m ? head + 1U : 0U;
            const cgl_real entering = entry[entry_of(memory, ahead)];
            sum += entering - ring[leaving];
            anew += entering;
            ring[head] = entry[entry_of(memory, at)];
            leaving = leaving < m ? leaving + 1U : 0U;
            if (--anew_left == 0U) {
                sum = anew;
                anew = CGL_R(0.0);
                anew_left = 2U * half + 1U;
            }
        } while (--left > 0U);
        channel->sum = sum;
        channel->anew = anew;
        entry += memory->row;
        if (++channel >= memory->channel + memory->config.channels) {
            map->at = at;
            map->head = head;
            map->anew_left = anew_left;
            return;
        }
    }
}

/* Restarts the map where the rotor does not continue its motion: at a start, a jump or a reversal. Returns the way since the last step
 * [2^-32 periods] if this is a jump by more than a quarter of the period, else 0. */
CGL_SELDOM static uint32_t start_there(cgl_memory *memory, uint32_t x, uint32_t moved, uint32_t count)
{
    cgl_angle_map *const map = &memory->map;
    const bool back = map->started && moved >= QUARTER_BACK - map->width;
    const uint32_t leap = map->started && moved > QUARTER && !back ? moved : 0U;
    if (back) { /* the rotor has turned back by a cell or more */
        map->backward = !map->backward;
        x = 0U - map->width - x;
    }
    seat(memory, x);
    map->passed = moved <= QUARTER ? count : 0U; /* a next step of the same length is no jump */
    return leap;
}

/* Follows the rotor to a place in the period. Returns the way since the last step [2^-32 periods]. If this function restarts the map, it
 * returns what start_there() returns. */
static inline uint32_t follow(cgl_memory *memory, uint32_t place)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, x = map->backward ? 0U - map->width - place : place, moved = x - map->x;
    const uint64_t wide = (uint64_t)x * cells;
    const uint32_t n = (uint32_t)(wide >> 32), apart = n - map->at, count = apart < cells ? apart : apart + cells;
    if (!(map->started && moved <= QUARTER && count <= REACH + 2U * map->passed)) {
        if (map->started && moved > 0U - map->width) { /* a way back of less than a cell counts as standstill */
            map->passed = 0U;
            return 0U;
        }
        return start_there(memory, x, moved, count);
    }
    map->x = x;
    map->part = (cgl_real)(uint32_t)wide * PER_TURN;
    map->passed = count;
    if (count > 0U && memory->config.q_half_width > 0U) {
        pass(memory, count);
    } else if (count > 0U) { /* without a Q filter the sum is the entry of the cell that the rotor has reached */
        cgl_real *entry = memory->cell;
        for (uint32_t c = 0; c < memory->config.channels; ++c, entry += memory->row) {
            memory->channel[c].sum = entry[cells] = entry[entry_of(memory, n)];
        }
        map->at = n;
    }
    return moved;
}

/* ---- learning: the mean of a centred channel, and the entries of a map ---- */

/* Ends a period of `entries` entries. Sets each channel's `drain`, the part of the mean that the next period removes from the memory.
 * Clears the sum for the mean. */
CGL_SELDOM static void take_mean(cgl_memory *memory, cgl_real entries)
{
    const cgl_real share = (cgl_real)memory->config.cells / entries;
    const cgl_real forgetting = memory->config.forgetting, beyond = CGL_R(1.0) - MEAN_MOST / forgetting;
    const cgl_real per_mean = (beyond > CGL_R(0.0) ? beyond : CGL_R(0.0)) * (cgl_real)(2U * memory->config.q_half_width + 1U);
    for (cgl_channel *channel = memory->channel; channel < memory->channel + memory->centred; ++channel) {
        channel->drain = per_mean * cgl_clamp(share * channel->partial, channel->limit);
        channel->partial = CGL_R(0.0);
    }
}

/* Adds the next cells to the sum for the mean: as many as the rotor passes in this step, and at least one. The place of this scan in the
 * map is not the rotor's place. While the rotor turns, the mean is at most one period old. While the rotor rocks within a few cells, the
 * scan still reads the whole map. */
CGL_APART static void scan(cgl_memory *memory, uint32_t moved)
{
    const uint32_t cells = memory->config.cells, first = memory->scan_cell, passed = memory->map.passed;
    const uint32_t reach = first + (passed > 1U ? passed : 1U), after = reach < cells ? reach : cells;
    const cgl_real way = memory->gain * (cgl_real)moved * PER_TURN, per_entry = memory->per_entry;
    const cgl_channel *const end = memory->channel + memory->centred;
    const cgl_real *row = memory->cell;
    for (cgl_channel *channel = memory->channel; channel < end; ++channel, row += memory->row) {
        cgl_real partial = channel->partial;
        for (const cgl_real *entry = row + first; entry < row + after; ++entry) {
            partial += per_entry * *entry;
        }
        channel->partial = partial;
        channel->transfer = way * channel->drain;
    }
    memory->scan_cell = after;
    if (after == cells) {
        take_mean(memory, (cgl_real)cells);
        memory->scan_cell = 0U;
    }
}

#ifndef COGLESS_NO_DELAY_LINE
/* Adds the present sample of a delay line to the sum for the mean. A period may end within a sample. The rest of the sample then counts
 * for the next period. */
CGL_APART static void gather_samples(cgl_memory *memory)
{
    cgl_delay_line *const line = &memory->line;
    const uint32_t newest = line->newest < line->then ? line->newest + memory->row : line->newest;
    const cgl_real period = (cgl_real)(newest - line->then) + line->part, missing = period - line->span;
    const cgl_real share = missing < CGL_R(1.0) ? (missing > CGL_R(0.0) ? missing : CGL_R(0.0)) : CGL_R(1.0);
    for (uint32_t c = 0; c < memory->centred; ++c) {
        cgl_channel *const channel = memory->channel + c;
        channel->transfer = memory->gain * channel->drain / period;
        channel->partial += share * memory->per_entry * channel->value;
    }
    line->span += share;
    if (share < CGL_R(1.0)) {
        take_mean(memory, line->span);
        line->span = CGL_R(1.0) - share;
        for (uint32_t c = 0; c < memory->centred; ++c) {
            memory->channel[c].partial = line->span * memory->per_entry * memory->channel[c].value;
        }
    }
}
#endif

/* Adds the corrections to the map at the rotor's place `lead` samples ago. This place is computed from the rotor's way in this step. */
CGL_SELDOM static void correct(cgl_memory *memory, uint32_t moved, const cgl_real *correction)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, lead = memory->config.lead;
    const uint32_t x = map->x - moved * lead, passed = x - map->lag_x;
    if (map->lagging && (passed == 0U || passed > 0x80000000U)) {
        return; /* strong acceleration moves that place backward: nothing is corrected until the place moves ahead again */
    }
    const uint64_t wide = (uint64_t)x * cells;
    const uint32_t n = (uint32_t)(wide >> 32), apart = n - (uint32_t)(((uint64_t)map->lag_x * cells) >> 32);
    const uint32_t count = apart < cells ? apart : apart + cells;
    const bool writes = map->lagging && passed <= QUARTER && count > 0U && count <= REACH + 2U * map->passed;
    const cgl_real part = (cgl_real)(uint32_t)wide * PER_TURN, per_cell = map->per_cell / (cgl_real)passed;
    cgl_real *entry = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, entry += memory->row) {
        cgl_channel *const channel = memory->channel + c;
        const cgl_real slope = (correction[c] - channel->correction) * per_cell, limit = channel->limit;
        cgl_real on_line = correction[c] - part * slope;
        uint32_t cell = n;
        for (uint32_t left = writes ? count : 0U; left > 0U; --left) {
            cgl_real *const corrected = entry + entry_of(memory, cell);
            *corrected = cgl_clamp(*corrected + on_line, limit);
            on_line -= slope;
            cell = (cell > 0U ? cell : cells) - 1U;
        }
        channel->correction = correction[c];
    }
    map->lag_x = x;
    map->lagging = true;
}

/* Fills `value` with the map's value at the rotor's place, interpolated between two cells. Nothing is learned. */
CGL_SELDOM static void repeat(cgl_memory *memory, cgl_real *value)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t here = entry_of(memory, map->at), next = entry_of(memory, wrapped(map->at + 1U, memory->config.cells));
    const cgl_real *entry = memory->cell;
    for (uint32_t c = 0; c < memory->config.channels; ++c, entry += memory->row) {
        value[c] = entry[here] + map->part * (entry[next] - entry[here]);
        memory->channel[c].value = cgl_clamp(value[c], memory->channel[c].limit);
    }
    map->follows = map->lagging = false;
}

/* Learns at the rotor's place of the map: recalls, corrects and stores. The cells passed get values on the line from the last value to
 * the present one. */
CGL_APART static void learn_on(cgl_memory *memory, uint32_t moved, const cgl_real *correction, cgl_real *value)
{
    cgl_angle_map *const map = &memory->map;
    const uint32_t cells = memory->config.cells, m = memory->config.q_half_width, at = map->at;
    const uint32_t ahead = entry_of(memory, wrapped(at + m + 1U, cells));
    const uint32_t oldest = cells + (map->head < m ? map->head + 1U : 0U);
    const uint32_t count = moved > 0U && map->follows ? map->passed : 0U;
    const bool acts = memory->config.lead == 0U;
    const cgl_real gain = memory->gain, part = map->part;
    const cgl_channel *const end = memory->channel + memory->config.channels;
    cgl_real *entry = memory->cell;
    const cgl_real *change = correction;
    for (cgl_channel *channel = memory->channel; channel < end; ++channel, entry += memory->row) {
        const cgl_real recalled = gain * (channel->sum + part * (entry[ahead] - entry[oldest])) - gain * channel->drain;
        const cgl_real wanted = acts ? recalled + *change : recalled;
        const cgl_real stored = cgl_clamp_here(wanted, channel->limit);
        *value++ = wanted;
        ++change;
        if (count > 0U) {
            const cgl_real slope = (stored - channel->value) * (map->per_cell / (cgl_real)moved);
            cgl_real on_line = stored - part * slope;
            uint32_t cell = at;
            for (uint32_t left = count;;) {
                entry[entry_of(memory, cell)] = cgl_clamp_here(on_line, channel->limit);
                if (--left == 0U) {
                    break;
                }
                on_line -= slope;
                cell = (cell > 0U ? cell : cells) - 1U;
            }
        }
        channel->value = stored;
    }
    map->follows = true;
    if (!acts && moved > 0U) {
        correct(memory, moved, correction);
    }
}

static inline bool are_finite(const cgl_real *x, uint32_t count)
{
    bool finite = cgl_is_finite(x[0]);
    for (uint32_t c = 1U; c < count; ++c) {
        finite = finite && cgl_is_finite(x[c]);
    }
    return finite;
}

/* Fills `value` with the last values, because the rotor's place is unknown. */
CGL_SELDOM static void lose(cgl_memory *memory, cgl_real *value)
{
    for (uint32_t c = 0; c < memory->config.channels; ++c) {
        value[c] = memory->channel[c].value;
    }
    memory->map.started = memory->map.follows = memory->map.lagging = false;
}

bool cgl_memory_step(cgl_memory *memory, cgl_real theta, cgl_real speed, bool learn, const cgl_real *correction,
                     cgl_real *value)
{
    learn = learn && are_finite(correction, memory->config.channels);
    if (!cgl_is_angle(theta)) {
        lose(memory, value);
        memory->learning = false;
        return false;
    }
    const uint32_t angle = cgl_turns(theta);
    const uint32_t place = CGL_OFTEN(memory->config.turns == 1U) ? angle * memory->periods /* the product wraps, so whole periods drop
                                                                                              out */
                                                                 : place_in_turns(memory, angle);
    if (CGL_OFTEN(memory->config.kind == CGL_MEMORY_ANGLE)) {
        const uint32_t moved = follow(memory, place);
        if (CGL_OFTEN(learn && memory->map.half == memory->config.q_half_width && moved <= memory->map.most)) {
            learn_on(memory, moved, correction, value);
            if (memory->centred > 0U) {
                scan(memory, moved);
            }
        } else {
            learn = false;
            if (memory->map.half < memory->config.q_half_width) {
                widen(memory);
            }
            repeat(memory, value);
        }
    } else {
#ifndef COGLESS_NO_DELAY_LINE
        learn = cgl_delay_step(memory, place, speed, learn, correction, value);
        if (learn && memory->centred > 0U && (memory->config.kind == CGL_MEMORY_TIME || memory->line.tracking)) {
            gather_samples(memory);
        }
#endif
    }
    (void)speed;
    memory->learning = learn;
    return learn;
}

CGL_SELDOM cgl_real cgl_memory_fastest(const cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real period = CGL_TWO_PI * (cgl_real)config->turns / (cgl_real)memory->periods; /* the memory's period as an angle theta
                                                                                                 [rad] */
    return period / ((cgl_real)memory->fewest * memory->ts);
}
