#include "memory.h"

#include "angle.h"

#define CELLS_MAX 65535U

cgl_error cgl_memory_init(const cgl_memory_config *config, cgl_memory *memory, cgl_real *cell, uint32_t length)
{
    if (!(config->cells >= 4U && config->cells <= CELLS_MAX && config->periods_per_rev >= 1U
          && config->periods_per_rev <= CELLS_MAX && config->q_half_width < CELLS_MAX
          && 2U * config->q_half_width + 1U <= config->cells && config->lead <= config->cells / 4U
          && config->forgetting > CGL_R(0.0) && config->forgetting <= CGL_R(1.0)
          && cgl_is_positive(config->limit) && cgl_is_positive(config->ts)
          && (config->kind == CGL_MEMORY_ANGLE || config->kind == CGL_MEMORY_TIME))) {
        return CGL_ERROR_CONFIG;
    }
    if (cell == 0 || length < CGL_MEMORY_LENGTH(config->cells, config->q_half_width)) {
        return CGL_ERROR_MEMORY;
    }
    memory->cell = cell;
    cgl_memory_reset(config, memory);
    return CGL_OK;
}

void cgl_memory_reset(const cgl_memory_config *config, cgl_memory *memory)
{
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    for (uint32_t n = 0; n < length; ++n) {
        memory->cell[n] = CGL_R(0.0);
    }
    memory->position = memory->value = memory->next_position = CGL_R(0.0);
    memory->lag_position = memory->correction = CGL_R(0.0);
    memory->newest = memory->known = memory->head = 0U;
    memory->direction = 0;
    memory->started = memory->lagging = false;
}

/* ---- by angle: a map, and behind it a ring of the entries overwritten last, which the Q filter still needs ---- */

static uint32_t ring_length(const cgl_memory_config *config)
{
    return config->q_half_width + 1U;
}

static uint32_t wrap_cell(const cgl_memory_config *config, int32_t n)
{
    const int32_t cells = (int32_t)config->cells;
    const int32_t wrapped = n < 0 ? n + cells : (n >= cells ? n - cells : n);
    return (uint32_t)wrapped;
}

/* The entry of one period ago at cell k in [-cells, 2 cells), for a rotor between the cells n and n + 1. */
static cgl_real old_entry(const cgl_memory_config *config, const cgl_memory *memory, int32_t n, int32_t k)
{
    const uint32_t cell = wrap_cell(config, k);
    if (memory->direction < 0 ? k <= n : k > n) {
        return memory->cell[cell]; /* the rotor has yet to pass it */
    }
    const int32_t ahead = (int32_t)memory->newest - (int32_t)cell;
    const uint32_t age = wrap_cell(config, memory->direction < 0 ? -ahead : ahead);
    if (age >= memory->known) {
        return memory->cell[cell];
    }
    const uint32_t length = ring_length(config);
    return memory->cell[config->cells + (memory->head >= age ? memory->head - age : memory->head + length - age)];
}

static bool recall_by_angle(const cgl_memory_config *config, cgl_memory *memory, cgl_real theta_m, cgl_real *filtered,
                            cgl_real *held)
{
    if (!cgl_is_angle(theta_m)) {
        memory->started = false;
        return false;
    }
    const cgl_real turns = theta_m * (CGL_R(1.0) / CGL_TWO_PI) * (cgl_real)config->periods_per_rev;
    const cgl_real x = cgl_fraction(turns) * (cgl_real)config->cells;
    const int32_t n = (int32_t)x;
    const int32_t m = (int32_t)config->q_half_width;
    const cgl_real part = x - (cgl_real)n;

    cgl_real sum = CGL_R(0.0);
    for (int32_t k = n - m; k <= n + m; ++k) {
        sum += old_entry(config, memory, n, k);
    }
    /* the window moved on by one cell, for the straight line in between */
    const cgl_real moved = old_entry(config, memory, n, n + m + 1) - old_entry(config, memory, n, n - m);
    *filtered = config->forgetting * (sum + part * moved) / (cgl_real)(2 * m + 1);
    const cgl_real here = old_entry(config, memory, n, n);
    *held = here + part * (old_entry(config, memory, n, n + 1) - here);
    memory->next_position = x;
    return true;
}

static void write_cell(const cgl_memory_config *config, cgl_memory *memory, int32_t n, int direction, cgl_real value)
{
    const uint32_t cell = wrap_cell(config, n);
    if (direction != memory->direction || wrap_cell(config, (int32_t)memory->newest + direction) != cell) {
        memory->known = 0U; /* the ring only speaks of cells in a row */
        memory->direction = direction;
    }
    const uint32_t length = ring_length(config);
    memory->head = memory->head + 1U < length ? memory->head + 1U : 0U;
    memory->cell[config->cells + memory->head] = memory->cell[cell];
    memory->cell[cell] = value;
    memory->newest = cell;
    if (memory->known < length) {
        ++memory->known;
    }
}

static void correct_cell(const cgl_memory_config *config, cgl_memory *memory, int32_t n, int direction, cgl_real value)
{
    (void)direction;
    const uint32_t cell = wrap_cell(config, n);
    memory->cell[cell] = cgl_clamp(memory->cell[cell] + value, config->limit);
}

/* A straight line over positions: `before` at `from`, `value` at `distance` further; both in cells. */
typedef struct {
    cgl_real from, distance, before, value;
} stretch;

/* Calls `put` with each cell passed on the way and the line's value there. */
static void along(const cgl_memory_config *config, cgl_memory *memory, const stretch *way,
                  void (*put)(const cgl_memory_config *, cgl_memory *, int32_t, int, cgl_real))
{
    const cgl_real to = way->from + way->distance;
    const int direction = way->distance < CGL_R(0.0) ? -1 : 1;
    const int32_t start = (int32_t)way->from;
    int32_t n = direction > 0 || (cgl_real)start >= way->from ? start + direction : start;
    for (; direction > 0 ? (cgl_real)n <= to : (cgl_real)n >= to; n += direction) {
        const cgl_real share = ((cgl_real)n - way->from) / way->distance;
        put(config, memory, n, direction, cgl_clamp(way->before + share * (way->value - way->before), config->limit));
    }
}

/* From one position to another the shorter way round [cells]. */
static cgl_real between(const cgl_memory_config *config, cgl_real from, cgl_real to)
{
    const cgl_real cells = (cgl_real)config->cells;
    const cgl_real distance = to - from;
    return distance > CGL_R(0.5) * cells ? distance - cells
                                         : (distance < CGL_R(-0.5) * cells ? distance + cells : distance);
}

/* Adds the corrections where the rotor was `lead` samples ago, at the speed that it has now. */
static void correct_by_angle(const cgl_memory_config *config, cgl_memory *memory, cgl_real moved, cgl_real correction)
{
    const cgl_real cells = (cgl_real)config->cells;
    const cgl_real behind = (cgl_real)config->lead * moved;
    if (cgl_abs(behind) > CGL_R(0.25) * cells) {
        memory->lagging = false;
        return;
    }
    const cgl_real place = memory->next_position - behind;
    const cgl_real lag = place < CGL_R(0.0) ? place + cells : (place >= cells ? place - cells : place);
    const cgl_real passed = memory->lagging ? between(config, memory->lag_position, lag) : CGL_R(0.0);
    if (memory->lagging && passed * moved <= CGL_R(0.0)) {
        return; /* the rotor gains speed faster than it moves: wait until the place comes by again */
    }
    if (memory->lagging && cgl_abs(passed) <= CGL_R(0.25) * cells) {
        const stretch way = {memory->lag_position, passed, memory->correction, correction};
        along(config, memory, &way, correct_cell);
    }
    memory->lag_position = lag;
    memory->correction = correction;
    memory->lagging = true;
}

static void store_by_angle(const cgl_memory_config *config, cgl_memory *memory, cgl_real value, cgl_real correction)
{
    const cgl_real moved = between(config, memory->position, memory->next_position);
    const bool followed = memory->started && cgl_abs(moved) <= CGL_R(0.25) * (cgl_real)config->cells;
    if (followed && cgl_abs(moved) > CGL_R(0.0)) {
        const int before = memory->direction;
        const stretch way = {memory->position, moved, memory->value, value};
        along(config, memory, &way, write_cell);
        memory->lagging = memory->lagging && memory->direction == before;
        if (config->lead > 0U) {
            correct_by_angle(config, memory, moved, correction);
        }
    } else if (!followed) {
        memory->lagging = false;
    }
    memory->position = memory->next_position;
    memory->value = value;
    memory->started = true;
}

/* ---- by time: a ring of the last values ---- */

/* The value stored `age` samples ago, 1 for the last one. */
static cgl_real value_ago(const cgl_memory_config *config, const cgl_memory *memory, uint32_t age)
{
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    if (age > memory->known) {
        return CGL_R(0.0);
    }
    const uint32_t back = age - 1U;
    return memory->cell[memory->newest >= back ? memory->newest - back : memory->newest + length - back];
}

static bool recall_by_time(const cgl_memory_config *config, const cgl_memory *memory, cgl_real omega_ref,
                           cgl_real *filtered, cgl_real *held)
{
    const cgl_real turns_per_sample = cgl_abs(omega_ref) * config->ts * (CGL_R(1.0) / CGL_TWO_PI);
    const cgl_real periods = turns_per_sample * (cgl_real)config->periods_per_rev;
    if (!(periods * (cgl_real)config->cells >= CGL_R(1.0)
          && periods * (cgl_real)(config->q_half_width + 1U) <= CGL_R(1.0))) {
        return false;
    }
    const cgl_real period = CGL_R(1.0) / periods;
    uint32_t n = (uint32_t)period;
    n = n < config->cells ? n : config->cells; /* 1 / periods may round above the longest period */
    n = n > config->q_half_width ? n : config->q_half_width + 1U;
    const cgl_real part = cgl_clamp(period - (cgl_real)n, CGL_R(1.0));
    const uint32_t m = config->q_half_width;

    cgl_real sum = CGL_R(0.0);
    for (uint32_t age = n - m; age <= n + m; ++age) {
        sum += value_ago(config, memory, age);
    }
    const cgl_real moved = value_ago(config, memory, n + m + 1U) - value_ago(config, memory, n - m);
    *filtered = config->forgetting * (sum + part * moved) / (cgl_real)(2U * m + 1U);
    const cgl_real here = value_ago(config, memory, n);
    *held = here + part * (value_ago(config, memory, n + 1U) - here);
    return true;
}

static void store_by_time(const cgl_memory_config *config, cgl_memory *memory, cgl_real value, cgl_real correction)
{
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    memory->newest = memory->newest + 1U < length ? memory->newest + 1U : 0U;
    memory->cell[memory->newest] = value;
    if (memory->known < length) {
        ++memory->known;
    }
    if (config->lead > 0U && config->lead < memory->known) {
        const uint32_t lead = config->lead;
        const uint32_t then = memory->newest >= lead ? memory->newest - lead : memory->newest + length - lead;
        memory->cell[then] = cgl_clamp(memory->cell[then] + correction, config->limit);
    }
}

bool cgl_memory_recall(const cgl_memory_config *config, cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref,
                       cgl_real *filtered, cgl_real *held)
{
    *filtered = *held = CGL_R(0.0);
    const bool known = config->kind == CGL_MEMORY_ANGLE ? recall_by_angle(config, memory, theta_m, filtered, held)
                                                        : recall_by_time(config, memory, omega_ref, filtered, held);
    *filtered = cgl_clamp(*filtered, config->limit); /* sums round */
    *held = cgl_clamp(*held, config->limit);
    return known;
}

cgl_real cgl_memory_update(const cgl_memory_config *config, cgl_memory *memory, cgl_real value, cgl_real correction,
                           bool learn)
{
    const cgl_real change = learn ? cgl_clamp(correction, CGL_REAL_MAX) : CGL_R(0.0);
    const cgl_real acting = cgl_clamp(config->lead > 0U ? value : value + change, config->limit);
    if (config->kind == CGL_MEMORY_TIME) {
        store_by_time(config, memory, acting, change);
    } else if (learn) {
        store_by_angle(config, memory, acting, change);
    } else {
        memory->started = memory->lagging = false; /* the next value has no line back to this one */
        memory->known = 0U; /* and when the rotor comes round, what was overwritten is two periods old */
    }
    return acting;
}
