#include "space_memory.h"

static uint32_t row_length(const cgl_space_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
}

CGL_SELDOM static bool is_valid(const cgl_space_memory_config *config, cgl_real ts)
{
    const uint32_t most = config->kind == CGL_SPACE_DELAY ? CGL_SAMPLES_MAX : CGL_CELLS_MAX;
    if (!((config->kind == CGL_SPACE_MAP || config->kind == CGL_SPACE_DELAY) && config->channels >= 1U
          && config->channels <= CGL_SPACE_CHANNELS && config->cells >= 4U && config->cells <= most
          && config->turns >= 1U && config->turns <= 65535U && config->parts >= 1U && config->parts <= 65535U
          && config->q_half_width < most && 2U * config->q_half_width + 1U <= config->cells
          && cgl_is_positive(ts))) {
        return false;
    }
    for (uint32_t c = 0; c < config->channels; ++c) {
        if (!(cgl_is_positive(config->limit[c])
              && cgl_is_finite((cgl_real)(2U * config->q_half_width + 2U) * config->limit[c]))) {
            return false;
        }
    }
    return config->kind == CGL_SPACE_MAP || config->method == CGL_DELAY_INVERSION
           || (config->method == CGL_DELAY_ODE && cgl_is_positive(config->k_pp)
               && config->k_pp * ts < CGL_R(1.0));
}

CGL_SELDOM cgl_error cgl_space_memory_init(cgl_space_memory *memory, const cgl_space_memory_config *config, cgl_real ts, cgl_real *cell,
                                uint32_t length)
{
    if (!is_valid(config, ts)) {
        return CGL_ERROR_CONFIG;
    }
    if (cell == 0
        || length < CGL_SPACE_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width)) {
        return CGL_ERROR_MEMORY;
    }
    memory->config = *config;
    memory->ts = ts;
    memory->cell = cell;
    memory->periods_per_rad = (cgl_real)config->parts / ((cgl_real)config->turns * CGL_TWO_PI);
    memory->length = (cgl_real)config->cells;
    cgl_space_memory_soften(memory, CGL_R(1.0));
    cgl_space_memory_reset(memory);
    return CGL_OK;
}

CGL_SELDOM void cgl_space_memory_soften(cgl_space_memory *memory, cgl_real factor)
{
    memory->kept = factor;
    memory->per_width = factor / (cgl_real)(2U * memory->config.q_half_width + 1U);
}

CGL_SELDOM void cgl_space_memory_reset(cgl_space_memory *memory)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t length =
        CGL_SPACE_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
    for (uint32_t n = 0; n < length; ++n) {
        memory->cell[n] = CGL_R(0.0);
    }
    for (uint32_t c = 0; c < CGL_SPACE_CHANNELS; ++c) {
        memory->value[c] = memory->sum[c] = memory->change[c] = CGL_R(0.0);
    }
    memory->x = memory->position = memory->next_position = memory->p_t = memory->distance = memory->part = CGL_R(0.0);
    memory->newest = memory->known = memory->head = memory->at = memory->next = memory->then = 0U;
    memory->direction = 0;
    memory->placed = memory->started = memory->steady = memory->tracking = false;
}

/* n in [-length, 2 length) */
static uint32_t wrap(int32_t n, uint32_t length)
{
    return (uint32_t)(n < 0 ? n + (int32_t)length : (n >= (int32_t)length ? n - (int32_t)length : n));
}

/* Fractional part, for |x| < 2^31. */
static cgl_real fraction(cgl_real x)
{
    const cgl_real rest = cgl_rest(x);
    if (rest < CGL_R(0.0)) {
        const cgl_real positive = rest + CGL_R(1.0);
        return positive < CGL_R(1.0) ? positive : CGL_R(0.0); /* a tiny negative rest rounds up to 1 */
    }
    return rest;
}

/* The distance between places in a period of length 1 or cells, the shorter way round. */
static cgl_real shorter_way(cgl_real distance, cgl_real period)
{
    return distance > CGL_R(0.5) * period ? distance - period
                                          : (distance <= CGL_R(-0.5) * period ? distance + period : distance);
}

/* For each row the mean of 2 m + 1 entries from `start` on, interpolated by `part` (0 to 1) towards the same mean taken one
 * entry later. The entries of a mean are `step` apart; their places wrap around at the length. */
CGL_SELDOM static void read_rows(const cgl_space_memory_config *config, const cgl_real *row, uint32_t length,
                                 uint32_t start, uint32_t step, uint32_t m, cgl_real part, cgl_real *value)
{
    const cgl_real per_width = m > 0U ? CGL_R(1.0) / (cgl_real)(2U * m + 1U) : CGL_R(1.0);
    for (uint32_t c = 0; c < config->channels; ++c, row += row_length(config)) {
        uint32_t n = start;
        cgl_real sum = CGL_R(0.0);
        for (uint32_t count = 0; count < 2U * m + 1U; ++count) {
            sum += row[n];
            n += step;
            if (n >= length) {
                n -= length;
            }
        }
        value[c] = (sum + part * (row[n] - row[start])) * per_width;
    }
}

/* ---- map. The cells passed last, as many as the Q filter looks back on, wait in a ring behind it, so that it holds
 * what is one period old wherever the filter looks ---- */

CGL_SELDOM static void write_waiting(cgl_space_memory *memory)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t ring = config->q_half_width + 1U;
    for (; memory->known > 0U; --memory->known) {
        cgl_real *row = memory->cell;
        for (uint32_t c = 0; c < config->channels; ++c, row += row_length(config)) {
            row[memory->newest] = row[config->cells + memory->head];
        }
        memory->newest = wrap((int32_t)memory->newest - memory->direction, config->cells);
        memory->head = memory->head > 0U ? memory->head - 1U : ring - 1U;
    }
    memory->direction = 0;
}

/* Cell n gets the value at `share` of the way from the last values to these; the cell that has waited longest goes
 * into the map. */
CGL_SELDOM static void pass_cell(cgl_space_memory *memory, int32_t n, int direction,
                      const cgl_real *value, cgl_real share)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t cell = wrap(n, config->cells), ring = config->q_half_width + 1U;
    if (direction != memory->direction || wrap((int32_t)memory->newest + direction, config->cells) != cell) {
        write_waiting(memory);
        memory->direction = direction;
    }
    memory->head = memory->head + 1U < ring ? memory->head + 1U : 0U;
    const bool full = memory->known == ring;
    memory->known += full ? 0U : 1U;
    memory->newest = cell;
    const uint32_t length = row_length(config);
    cgl_real *waiting = memory->cell + config->cells + memory->head;
    cgl_real *oldest = full ? memory->cell + wrap((int32_t)cell - direction * (int32_t)ring, config->cells) : waiting;
    for (uint32_t c = 0; c < config->channels; ++c, waiting += length, oldest += length) {
        *oldest = *waiting;
        *waiting = memory->value[c] + share * (value[c] - memory->value[c]);
    }
}

CGL_SELDOM static void recall_from_map(cgl_space_memory *memory, bool learn,
                                       cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t cells = config->cells;
    const cgl_real position = memory->x * memory->length;
    const uint32_t n = (uint32_t)(int32_t)position;
    memory->next_position = position;
    memory->next = n < cells ? n : 0U;
    const uint32_t m = learn ? config->q_half_width : 0U;
    read_rows(config, memory->cell, cells, wrap((int32_t)memory->next - (int32_t)m, cells), 1U, m,
              position - (cgl_real)(int32_t)n, value);
}

/* The sums around cell n, anew. What waits is not among these cells. */
CGL_SELDOM static void sum_rows(cgl_space_memory *memory, uint32_t n)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t m = config->q_half_width, cells = config->cells;
    const cgl_real *row = memory->cell;
    for (uint32_t c = 0; c < config->channels; ++c, row += row_length(config)) {
        uint32_t k = wrap((int32_t)n - (int32_t)m, cells);
        const cgl_real first = row[k];
        cgl_real sum = CGL_R(0.0);
        for (uint32_t count = 0; count < 2U * m + 1U; ++count) {
            sum += row[k];
            k = k + 1U < cells ? k + 1U : 0U;
        }
        memory->sum[c] = sum;
        memory->change[c] = row[k] - first;
    }
}

/* Passes the cells on the way from the last position, `moved` further. */
CGL_SELDOM static void pass_cells(cgl_space_memory *memory, cgl_real moved,
                       const cgl_real *value)
{
    const cgl_real from = memory->position, to = from + moved, per_way = CGL_R(1.0) / moved;
    const int direction = moved < CGL_R(0.0) ? -1 : 1;
    const int32_t start = (int32_t)from;
    int32_t n = direction > 0 || (cgl_real)start >= from ? start + direction : start;
    for (; direction > 0 ? (cgl_real)n <= to : (cgl_real)n >= to; n += direction) {
        const cgl_real share = ((cgl_real)n - from) * per_way;
        pass_cell(memory, n, direction, value, share < CGL_R(1.0) ? share : CGL_R(1.0));
    }
}

/* Whether the sums that are kept from step to step stay right. A step that passes k cells writes the k cells behind the
 * 2 q_half_width + 1 of the Q filter, and the sum's change looks one cell ahead of those: round the period the two do not
 * meet while there are more cells than 2 q_half_width + 1 + k. A short step passes a quarter of them at most, rounded up. */
static bool has_room(const cgl_space_memory_config *config)
{
    return 2U * config->q_half_width + 1U + (config->cells + 3U) / 4U < config->cells;
}

CGL_SELDOM static void store_in_map(cgl_space_memory *memory,
                                    const cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    const cgl_real moved = shorter_way(memory->next_position - memory->position, memory->length);
    if (memory->started && cgl_is_within(moved, CGL_R(0.25) * memory->length)) {
        pass_cells(memory, moved, value);
    }
    memory->position = memory->next_position;
    memory->at = memory->next;
    memory->started = true;
    memory->steady = memory->direction > 0 && memory->known > config->q_half_width && memory->newest == memory->at
                     && has_room(config);
    if (memory->steady) {
        sum_rows(memory, memory->at);
    }
}

/* The sums around cell n, `count` cells further than those known. */
static inline void sum_on(cgl_space_memory *memory, uint32_t n, uint32_t count)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t m = config->q_half_width, cells = config->cells, length = row_length(config);
    if (CGL_OFTEN(count == 1U && n > 0U)) { /* at the start anew, as changes round */
        const uint32_t next = n + m + 1U;
        const cgl_real *first = memory->cell + (n >= m ? n - m : n + cells - m);
        const cgl_real *ahead = memory->cell + (next < cells ? next : next - cells);
        for (uint32_t c = 0; c < config->channels; ++c, first += length, ahead += length) {
            memory->sum[c] = m > 0U ? memory->sum[c] + memory->change[c] : *first;
            memory->change[c] = *ahead - *first;
        }
    } else {
        sum_rows(memory, n);
    }
}

/* Stores the values of the cells passed, and what waited for longest. */
static inline void pass_on(cgl_space_memory *memory, uint32_t count,
                           cgl_real moved, const cgl_real *stored)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t m = config->q_half_width, cells = config->cells, length = row_length(config);
    const uint32_t channels = config->channels;
    const cgl_real per_way = CGL_R(1.0) / moved;
    cgl_real way = (cgl_real)(int32_t)memory->at - memory->position;
    uint32_t at = memory->at, head = memory->head;
    do {
        way += CGL_R(1.0);
        at = at + 1U < cells ? at + 1U : 0U;
        head = head < m ? head + 1U : 0U;
        const cgl_real share = way * per_way < CGL_R(1.0) ? way * per_way : CGL_R(1.0);
        cgl_real *waiting = memory->cell + cells + head;
        cgl_real *oldest = memory->cell + (at > m ? at - m - 1U : at + cells - m - 1U);
        for (uint32_t c = 0; c < channels; ++c, waiting += length, oldest += length) {
            *oldest = *waiting;
            *waiting = memory->value[c] + share * (stored[c] - memory->value[c]);
        }
    } while (--count > 0U);
    memory->head = head;
    memory->at = memory->newest = at;
}

static inline cgl_real recalled(const cgl_space_memory *memory, uint32_t c, cgl_real part)
{
    return (memory->sum[c] + part * memory->change[c]) * memory->per_width;
}

/* Recalls, corrects and stores where a rotor goes on forward by less than a quarter; else changes nothing. */
static inline bool step_on(cgl_space_memory *memory, cgl_real theta,
                           const cgl_real *gain, cgl_real step, cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    if (!cgl_is_angle(theta)) {
        return false;
    }
    const cgl_real position = fraction(theta * memory->periods_per_rad) * memory->length;
    const uint32_t n = (uint32_t)(int32_t)position, cells = config->cells, channels = config->channels;
    uint32_t count = n - memory->at;
    cgl_real moved = position - memory->position;
    if (n < memory->at) {
        count += cells;
        moved += memory->length;
    }
    if (!(moved >= CGL_R(0.0) && moved < CGL_R(0.25) * memory->length && n < cells)) {
        return false;
    }
    const cgl_real part = position - (cgl_real)(int32_t)n;
    if (count == 0U) {
        for (uint32_t c = 0; c < channels; ++c) {
            value[c] = recalled(memory, c, part) - gain[c] * step;
            memory->value[c] = cgl_clamp(value[c], config->limit[c]);
        }
    } else {
        cgl_real stored[CGL_SPACE_CHANNELS];
        sum_on(memory, n, count);
        for (uint32_t c = 0; c < channels; ++c) {
            value[c] = recalled(memory, c, part) - gain[c] * step;
            stored[c] = cgl_clamp(value[c], config->limit[c]);
        }
        pass_on(memory, count, moved, stored);
        for (uint32_t c = 0; c < channels; ++c) {
            memory->value[c] = stored[c];
        }
    }
    memory->position = position;
    return true;
}

/* ---- delay: a ring of x and one of each channel, in which newer samples come later ---- */

static uint32_t newer(const cgl_space_memory_config *config, uint32_t at)
{
    return at + 1U < row_length(config) ? at + 1U : 0U;
}

static uint32_t older(const cgl_space_memory_config *config, uint32_t at)
{
    return at > 0U ? at - 1U : row_length(config) - 1U;
}

static bool is_oldest(const cgl_space_memory *memory)
{
    const cgl_space_memory_config *const config = &memory->config;
    return memory->then == (memory->known < row_length(config) ? 0U : newer(config, memory->newest));
}

/* Rise of the angle to this sample. */
static cgl_real rise(const cgl_space_memory *memory, uint32_t at)
{
    const cgl_space_memory_config *const config = &memory->config;
    return shorter_way(memory->cell[at] - memory->cell[older(config, at)], CGL_R(1.0));
}

static void go_newer(cgl_space_memory *memory)
{
    const cgl_space_memory_config *const config = &memory->config;
    memory->then = newer(config, memory->then);
    memory->distance -= rise(memory, memory->then);
}

static void go_older(cgl_space_memory *memory)
{
    const cgl_space_memory_config *const config = &memory->config;
    memory->distance += rise(memory, memory->then);
    memory->then = older(config, memory->then);
}

/* Moves to the oldest sample less than a period ago, on with the angle: each sample is passed once a period. */
static void invert(cgl_space_memory *memory)
{
    while (memory->then != memory->newest && memory->distance > CGL_R(1.0)) {
        go_newer(memory);
    }
    while (!is_oldest(memory) && memory->distance + rise(memory, memory->then) <= CGL_R(1.0)) {
        go_older(memory);
    }
    memory->tracking = !is_oldest(memory);
    memory->part = memory->tracking
                       ? cgl_clamp((CGL_R(1.0) - memory->distance) / rise(memory, memory->then), CGL_R(1.0))
                       : CGL_R(0.0);
}

/* A step of the differential equation, counted in samples. */
static void follow(cgl_space_memory *memory, cgl_real moved)
{
    const cgl_space_memory_config *const config = &memory->config;
    const cgl_real slope = rise(memory, memory->then);
    const cgl_real error = memory->distance - moved + memory->part * slope - CGL_R(1.0);
    memory->part -= (moved + config->k_pp * memory->ts * error) / slope; /* P_t grows by a sample as the samples age */
    while (memory->part < CGL_R(0.0) && memory->then != memory->newest) {
        go_newer(memory);
        memory->part += CGL_R(1.0);
    }
    while (memory->part >= CGL_R(1.0) && !is_oldest(memory)) {
        go_older(memory);
        memory->part -= CGL_R(1.0);
    }
    memory->tracking = !is_oldest(memory) && memory->part >= CGL_R(0.0) && memory->part < CGL_R(1.0);
}

/* Finds P_t for an angle that has risen by `moved` since the last sample; the distance counts to now meanwhile. */
static void find_period(cgl_space_memory *memory, cgl_real moved)
{
    const cgl_space_memory_config *const config = &memory->config;
    memory->distance += moved;
    memory->tracking = memory->tracking && !is_oldest(memory); /* the period may have outgrown the line */
    if (memory->tracking && config->method == CGL_DELAY_ODE) {
        follow(memory, moved);
    }
    if (!memory->tracking || config->method == CGL_DELAY_INVERSION) {
        invert(memory);
    }
    memory->distance -= moved;
}

CGL_SELDOM static bool recall_from_line(cgl_space_memory *memory, bool moving, bool learn,
                             cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    const cgl_real moved =
        memory->known > 0U ? shorter_way(memory->x - memory->cell[memory->newest], CGL_R(1.0)) : CGL_R(1.0);
    memory->placed = moving && moved > CGL_R(0.0);
    if (!memory->placed) {
        return false;
    }
    if (memory->known > 0U) {
        find_period(memory, moved);
    }
    const uint32_t length = row_length(config);
    const uint32_t age = wrap((int32_t)memory->newest - (int32_t)memory->then, length) + 1U;
    memory->p_t = memory->tracking ? ((cgl_real)age + memory->part) * memory->ts : CGL_R(0.0);
    const bool fits = age > config->q_half_width && age + config->q_half_width < length;
    if (!memory->tracking || !fits) {
        for (uint32_t c = 0; c < config->channels; ++c) {
            value[c] = CGL_R(0.0);
        }
        return learn && memory->known < length && !memory->tracking; /* nothing is known yet from there, or any more */
    }
    const uint32_t m = learn ? config->q_half_width : 0U;
    read_rows(config, memory->cell + length, length, wrap((int32_t)memory->then + (int32_t)m, length), length - 1U,
              m, memory->part, value);
    return learn;
}

CGL_SELDOM static void store_in_line(cgl_space_memory *memory, const cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t length = row_length(config);
    const uint32_t next = memory->known > 0U ? newer(config, memory->newest) : 0U;
    if (memory->known == length && next == memory->then) {
        go_newer(memory);
    }
    memory->newest = next;
    memory->cell[next] = memory->x;
    for (uint32_t c = 0; c < config->channels; ++c) {
        memory->cell[(c + 1U) * length + next] = value[c];
    }
    /* sums of rises drift; the angles themselves do not, and the sum still tells the whole periods */
    const cgl_real apart = memory->x - memory->cell[memory->then];
    const cgl_real sum = memory->known > 0U ? memory->distance + rise(memory, next) : CGL_R(0.0);
    const cgl_real most = (cgl_real)CGL_SAMPLES_MAX; /* periods: the angle rises by less than one a sample */
    memory->distance = apart + (cgl_real)(int32_t)cgl_clamp(sum - apart + CGL_R(0.5), most);
    memory->known += memory->known < length ? 1U : 0U;
}

/* ---- both ---- */

CGL_SELDOM bool cgl_space_memory_recall(cgl_space_memory *memory, cgl_real theta,
                             bool moving, bool learn, cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    memory->placed = cgl_is_angle(theta);
    if (memory->placed) {
        memory->x = fraction(theta * memory->periods_per_rad);
        if (config->kind == CGL_SPACE_MAP) {
            recall_from_map(memory, learn, value);
            return learn;
        }
    }
    for (uint32_t c = 0; c < config->channels; ++c) {
        value[c] = memory->value[c];
    }
    return memory->placed && recall_from_line(memory, moving, learn, value);
}

CGL_SELDOM void cgl_space_memory_update(cgl_space_memory *memory, const cgl_real *value,
                             bool learn)
{
    const cgl_space_memory_config *const config = &memory->config;
    const uint32_t channels = config->channels;
    cgl_real stored[CGL_SPACE_CHANNELS] = {CGL_R(0.0)}; /* gcc does not know that there is a channel */
    for (uint32_t c = 0; c < channels; ++c) {
        stored[c] = cgl_clamped(value[c], config->limit[c]);
    }
    if (config->kind == CGL_SPACE_DELAY) {
        if (memory->placed) {
            store_in_line(memory, stored);
        }
    } else if (learn && memory->placed) {
        store_in_map(memory, stored);
    } else {
        if (memory->known > 0U) {
            write_waiting(memory);
        }
        memory->started = memory->steady = false; /* the next value has no line back to this one */
    }
    for (uint32_t c = 0; c < channels; ++c) {
        memory->value[c] = stored[c];
    }
}

CGL_SELDOM static bool step_anywhere(cgl_space_memory *memory, cgl_real theta,
                                     bool moving, bool learn, const cgl_real *gain, cgl_real step, cgl_real *value)
{
    const cgl_space_memory_config *const config = &memory->config;
    learn = cgl_space_memory_recall(memory, theta, moving, learn, value);
    for (uint32_t c = 0; learn && c < config->channels; ++c) {
        value[c] = memory->kept * value[c] - gain[c] * step;
    }
    cgl_space_memory_update(memory, value, learn);
    return learn;
}

CGL_SELDOM void cgl_space_memory_forget(cgl_space_memory *memory, cgl_real theta, bool moving)
{
    static const cgl_real nothing[CGL_SPACE_CHANNELS] = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};
    cgl_real value[CGL_SPACE_CHANNELS];
    cgl_space_memory_update(memory, nothing, cgl_space_memory_recall(memory, theta, moving, true, value));
}

bool cgl_space_memory_step(cgl_space_memory *memory, cgl_real theta, bool moving,
                           bool learn, const cgl_real *gain, cgl_real step, cgl_real *value)
{
    if (learn && memory->steady && step_on(memory, theta, gain, step, value)) {
        return true;
    }
    return step_anywhere(memory, theta, moving, learn, gain, step, value);
}
