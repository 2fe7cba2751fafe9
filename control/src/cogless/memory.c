#include "memory.h"

CGL_SELDOM cgl_error cgl_memory_init(cgl_memory *memory, const cgl_memory_config *config, cgl_real ts, cgl_real *cell,
                                     uint32_t length)
{
    const uint32_t most = config->kind == CGL_MEMORY_TIME ? CGL_SAMPLES_MAX : CGL_CELLS_MAX;
    if (!(config->cells >= 4U && config->cells <= most && config->periods_per_rev >= 1U
          && config->periods_per_rev <= 65535U && config->q_half_width < most
          && 2U * config->q_half_width + 1U <= config->cells && config->lead <= config->cells / 4U
          && config->forgetting > CGL_R(0.0) && config->forgetting <= CGL_R(1.0)
          && cgl_is_positive(config->limit) && cgl_is_positive(ts)
          && (config->kind == CGL_MEMORY_ANGLE || config->kind == CGL_MEMORY_TIME))) {
        return CGL_ERROR_CONFIG;
    }
    if (cell == 0 || length < CGL_MEMORY_LENGTH(config->cells, config->q_half_width)) {
        return CGL_ERROR_MEMORY;
    }
    memory->config = *config;
    memory->ts = ts;
    memory->cell = cell;
    memory->per_rad = (cgl_real)config->periods_per_rev / CGL_TWO_PI;
    memory->gain = config->forgetting / (cgl_real)(2U * config->q_half_width + 1U);
    memory->length = (cgl_real)config->cells;
    memory->lead = (cgl_real)config->lead;
    memory->fastest = CGL_R(0.25) * memory->length / (cgl_real)(config->lead > 0U ? config->lead : 1U);
    cgl_memory_reset(memory);
    return CGL_OK;
}

CGL_SELDOM void cgl_memory_reset(cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    for (uint32_t n = 0; n < length; ++n) {
        memory->cell[n] = CGL_R(0.0);
    }
    memory->position = memory->value = memory->next_position = memory->correction = CGL_R(0.0);
    memory->lag = memory->lag_position = memory->sum = memory->change = CGL_R(0.0);
    memory->at = memory->lag_cell = memory->next = memory->newest = memory->known = memory->head = 0U;
    memory->direction = 0;
    memory->started = memory->lagging = memory->steady = false;
}

/* ---- by angle: a map, and behind it a ring of the entries overwritten last, which the Q filter still needs ---- */

/* The cell of n in [-cells, 2 cells). */
static uint32_t wrap_cell(const cgl_memory_config *config, int32_t n)
{
    const int32_t cells = (int32_t)config->cells;
    return (uint32_t)(n < 0 ? n + cells : (n >= cells ? n - cells : n));
}

/* The entry that was overwritten `age` cells ago, age <= q_half_width. */
static cgl_real overwritten(const cgl_memory *memory, uint32_t age)
{
    const cgl_memory_config *const config = &memory->config;
    const int32_t place = (int32_t)memory->head - (int32_t)age - 1;
    return memory->cell[config->cells + (uint32_t)(place < 0 ? place + (int32_t)config->q_half_width + 1 : place)];
}

/* The entry of one period ago at cell k in [-cells, 2 cells), for a rotor between the cells n and n + 1. */
CGL_SELDOM static cgl_real old_entry(const cgl_memory *memory, int32_t n, int32_t k)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t cell = wrap_cell(config, k);
    if (memory->direction < 0 ? k <= n : k > n) {
        return memory->cell[cell]; /* the rotor has yet to pass it */
    }
    const int32_t ahead = (int32_t)memory->newest - (int32_t)cell;
    const uint32_t age = wrap_cell(config, memory->direction < 0 ? -ahead : ahead);
    return age < memory->known ? overwritten(memory, age) : memory->cell[cell];
}

/* The sum of the Q filter's entries, from n - m to n + m; *change: to that around the next cell. */
CGL_SELDOM static cgl_real sum_anywhere(const cgl_memory *memory, int32_t n, int32_t m,
                                        cgl_real *change)
{
    cgl_real sum = CGL_R(0.0);
    for (int32_t k = n - m; k <= n + m; ++k) {
        sum += old_entry(memory, n, k);
    }
    *change = old_entry(memory, n, n + m + 1) - old_entry(memory, n, n - m);
    return sum;
}

/* Place of the angle in its period, in [0, 1). */
static inline cgl_real find_place(const cgl_memory *memory, cgl_real theta_m)
{
    const cgl_real periods = theta_m * memory->per_rad;
    const cgl_real fraction = cgl_rest(periods);
    if (!(fraction < CGL_R(0.0))) {
        return fraction;
    }
    const cgl_real positive = fraction + CGL_R(1.0);
    return positive < CGL_R(1.0) ? positive : CGL_R(0.0); /* a tiny negative one rounds up to 1 */
}

CGL_SELDOM static bool recall_by_angle(cgl_memory *memory, cgl_real theta_m, bool learn,
                                       cgl_real *value)
{
    const cgl_memory_config *const config = &memory->config;
    memory->newest = memory->steady ? memory->at : memory->newest;
    if (!cgl_is_angle(theta_m)) {
        memory->started = memory->steady = false;
        return false;
    }
    const cgl_real position = find_place(memory, theta_m) * memory->length;
    const uint32_t n = (uint32_t)(int32_t)position;
    memory->next_position = position;
    memory->next = n < config->cells ? n : 0U;
    cgl_real change;
    const cgl_real sum = sum_anywhere(memory, (int32_t)memory->next,
                                      learn ? (int32_t)config->q_half_width : 0, &change);
    *value = sum + (position - (cgl_real)(int32_t)position) * change;
    *value *= learn ? memory->gain : CGL_R(1.0);
    return true;
}

/* `count` cells back from n, against the direction, get values of a line of this slope that ends `rest` cells after n
 * with `value`; or, to correct them, they get it added. */
CGL_SELDOM static void write_line(const cgl_memory *memory, uint32_t n, uint32_t count,
                                  int direction, cgl_real value, cgl_real rest, cgl_real slope, bool add)
{
    const cgl_memory_config *const config = &memory->config;
    for (;;) {
        cgl_real *const entry = memory->cell + n;
        const cgl_real on_line = cgl_clamped(value - rest * slope, config->limit);
        *entry = add ? cgl_clamped(*entry + on_line, config->limit) : on_line;
        if (--count == 0U) {
            break;
        }
        rest += CGL_R(1.0);
        n = wrap_cell(config, (int32_t)n - direction);
    }
}

/* The entries of `count` cells from n on, in the direction, go into the ring. */
CGL_SELDOM static void remember(cgl_memory *memory, uint32_t n, uint32_t count,
                                int direction)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t last = config->q_half_width;
    for (;;) {
        memory->cell[config->cells + memory->head] = memory->cell[n];
        memory->head = memory->head < last ? memory->head + 1U : 0U;
        if (--count == 0U) {
            break;
        }
        n = wrap_cell(config, (int32_t)n + direction);
    }
    memory->newest = n;
}

/* The cells passed on the way between two positions, of which `from` and `to` are the cells at or before them. Forward a
 * position on a cell has passed it, backward too. */
typedef struct {
    uint32_t first, last, count;
    cgl_real rest; /* from the last to the end of the way [cells] */
} passage;

CGL_SELDOM static passage passage_of(const cgl_memory_config *config, uint32_t from, cgl_real start, uint32_t to,
                                 cgl_real end, bool backward)
{
    passage p;
    if (!backward) {
        p.first = from + 1U < config->cells ? from + 1U : 0U;
        p.last = to;
        p.count = to >= from ? to - from : to + config->cells - from;
        p.rest = end - (cgl_real)(int32_t)to;
    } else { /* the cells at or above */
        const uint32_t above_from = (cgl_real)(int32_t)from < start ? from + 1U : from;
        const uint32_t above_to = (cgl_real)(int32_t)to < end ? to + 1U : to;
        p.first = wrap_cell(config, (int32_t)above_from - 1);
        p.last = wrap_cell(config, (int32_t)above_to);
        p.count = above_from >= above_to ? above_from - above_to : above_from + config->cells - above_to;
        p.rest = (cgl_real)(int32_t)above_to - end;
    }
    return p;
}

/* Adds the corrections where the rotor was `lead` samples ago, at the speed that it has now. */
CGL_SELDOM static void correct_by_angle(cgl_memory *memory, cgl_real moved,
                                    cgl_real correction, cgl_real quarter)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real behind = memory->lead * moved;
    if (!cgl_is_within(behind, quarter)) {
        memory->lagging = false;
        return;
    }
    const cgl_real before = memory->lag + moved, passed = before - behind;
    if (memory->lagging && passed * moved <= CGL_R(0.0)) {
        memory->lag = before;
        return; /* the rotor gains speed faster than it moves: wait until the place comes by again */
    }
    const cgl_real cells = memory->length;
    cgl_real place = memory->next_position - behind;
    place = place < CGL_R(0.0) ? place + cells : place;
    place = place >= cells ? place - cells : place;
    const uint32_t cell = (uint32_t)(int32_t)place;
    if (memory->lagging && cgl_is_within(passed, quarter)) {
        const bool backward = moved < CGL_R(0.0);
        const passage p = passage_of(config, memory->lag_cell, memory->lag_position, cell, place, backward);
        if (p.count > 0U && p.count <= config->cells / 2U) {
            write_line(memory, p.last, p.count, backward ? -1 : 1, correction, p.rest,
                       (correction - memory->correction) / cgl_abs(passed), true);
        }
    }
    memory->lag = behind;
    memory->lag_position = place;
    memory->lag_cell = cell;
    memory->correction = correction;
    memory->lagging = true;
}

CGL_SELDOM static void store_by_angle(cgl_memory *memory, cgl_real value, cgl_real correction)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real cells = memory->length, quarter = CGL_R(0.25) * cells;
    const cgl_real position = memory->next_position;
    cgl_real moved = position - memory->position;
    if (!cgl_is_within(moved, CGL_R(0.5) * cells)) { /* the shorter way round */
        moved += moved < CGL_R(0.0) ? cells : -cells;
    }
    if (!(memory->started && cgl_is_within(moved, quarter))) {
        memory->lagging = false;
    } else if (moved < CGL_R(0.0) || moved > CGL_R(0.0)) {
        const bool backward = moved < CGL_R(0.0);
        const int direction = backward ? -1 : 1;
        const passage p = passage_of(config, memory->at, memory->position, memory->next, position, backward);
        if (p.count > 0U && p.count <= config->cells / 2U) {
            const uint32_t ring = config->q_half_width + 1U;
            memory->lagging = memory->lagging && memory->direction == direction;
            if (direction != memory->direction
                || wrap_cell(config, (int32_t)memory->newest + direction) != p.first) {
                memory->known = 0U; /* the ring only speaks of cells in a row */
                memory->direction = direction;
            }
            memory->known = memory->known + p.count < ring ? memory->known + p.count : ring;
            remember(memory, p.first, p.count, direction);
            write_line(memory, p.last, p.count, direction, value, p.rest,
                       (value - memory->value) / cgl_abs(moved), false);
        }
        if (config->lead > 0U) {
            correct_by_angle(memory, moved, correction, quarter);
        }
    }
    memory->position = position;
    memory->at = memory->next;
    memory->value = value;
    memory->started = true;
    memory->steady = memory->direction > 0 && memory->known > config->q_half_width && memory->newest == memory->at
                     && (config->lead == 0U || (memory->lagging && cgl_is_within(memory->correction, config->limit)));
    if (memory->steady) {
        memory->sum = sum_anywhere(memory, (int32_t)memory->at, (int32_t)config->q_half_width, &memory->change);
    }
}

/* ---- by angle, in short: for a rotor that goes on forward ---- */

/* The sum of the Q filter's entries around cell 0, when the rotor comes there: summed anew, as changes to it round. The
 * entry at `head` has left the window. */
CGL_SELDOM static cgl_real sum_at_start(const cgl_memory *memory, uint32_t head)
{
    const cgl_memory_config *const config = &memory->config;
    cgl_real sum = CGL_R(0.0);
    for (uint32_t n = 0; n <= config->q_half_width; ++n) {
        sum += memory->cell[n];
        sum += n != head ? memory->cell[config->cells + n] : CGL_R(0.0);
    }
    return sum;
}

/* The rotor comes to cell n, whose old entry goes into the ring. */
static inline void pass_cell(cgl_memory *memory, uint32_t n)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t cells = config->cells, last = config->q_half_width;
    cgl_real *const entry = memory->cell, *const ring = entry + cells;
    uint32_t head = memory->head;
    memory->sum = CGL_OFTEN(n > 0U) ? memory->sum + memory->change : sum_at_start(memory, head);
    ring[head] = entry[n];
    head = head < last ? head + 1U : 0U;
    const uint32_t ahead = n + last + 1U;
    memory->change = entry[ahead < cells ? ahead : ahead - cells] - ring[head];
    memory->head = head;
}

/* The rotor passes all but the last of `count` cells. */
CGL_SELDOM static void pass_more(cgl_memory *memory, uint32_t count)
{
    const cgl_memory_config *const config = &memory->config;
    for (uint32_t n = memory->at; count > 1U; --count) {
        n = n + 1U < config->cells ? n + 1U : 0U;
        pass_cell(memory, n);
    }
}

/* x, a number, within the limit */
static inline cgl_real limited(cgl_real x, cgl_real limit)
{
    if (CGL_OFTEN(cgl_is_within(x, limit))) {
        return x;
    }
    return x > CGL_R(0.0) ? limit : -limit;
}

/* Adds the corrections where the rotor was `lead` samples ago. */
static inline void correct_on(cgl_memory *memory, cgl_real position, cgl_real moved,
                              cgl_real correction)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t cells = config->cells;
    const cgl_real behind = memory->lead * moved, limit = config->limit;
    cgl_real place = position - behind, passed = place - memory->lag_position;
    if (place < CGL_R(0.0)) {
        place += memory->length;
        passed += memory->length;
    }
    const uint32_t cell = (uint32_t)(int32_t)place;
    uint32_t count = cell - memory->lag_cell;
    if (cell < memory->lag_cell) {
        count += cells;
        passed += memory->length;
    }
    if (!(passed > CGL_R(0.0) && count < cells / 4U && cell < cells)) {
        memory->next_position = position;
        memory->newest = memory->at;
        correct_by_angle(memory, moved, correction, CGL_R(0.25) * memory->length);
        memory->steady = memory->lagging;
        return;
    }
    if (count > 0U) {
        const cgl_real slope = (correction - memory->correction) / passed;
        cgl_real change = correction - (place - (cgl_real)(int32_t)cell) * slope, *entry = memory->cell + cell;
        *entry = limited(*entry + change, limit);
        while (--count > 0U) {
            change -= slope;
            entry = (entry > memory->cell ? entry : memory->cell + cells) - 1;
            *entry = limited(*entry + change, limit);
        }
    }
    memory->lag = behind;
    memory->lag_position = place;
    memory->lag_cell = cell;
    memory->correction = correction;
}

/* Recalls and updates, if this is such a step; else changes nothing. What acts is the new value. */
static inline bool step_on(cgl_memory *memory, cgl_real theta_m, cgl_real correction)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real limit = config->limit;
    if (!(cgl_is_angle(theta_m) && cgl_is_within(correction, limit))) {
        return false;
    }
    const cgl_real position = find_place(memory, theta_m) * memory->length;
    const uint32_t n = (uint32_t)(int32_t)position, cells = config->cells;
    uint32_t count = n - memory->at; /* cells passed */
    cgl_real moved = position - memory->position;
    if (n < memory->at) {
        count += cells;
        moved += memory->length;
    }
    if (!(moved < memory->fastest && n < cells)) { /* back by some cells is too far on, too */
        return false;
    }
    cgl_real *entry = memory->cell + n;
    if (count > 0U) {
        if (config->q_half_width == 0U) {
            memory->cell[cells] = memory->sum = *entry;
            memory->change = memory->cell[n + 1U < cells ? n + 1U : 0U] - memory->sum;
        } else {
            if (count > 1U) {
                pass_more(memory, count);
            }
            pass_cell(memory, n);
        }
    }
    const cgl_real part = position - (cgl_real)(int32_t)n;
    const cgl_real recalled = memory->gain * (memory->sum + part * memory->change);
    const cgl_real value = cgl_clamp(config->lead > 0U ? recalled : recalled + correction, limit);
    if (count > 0U) {
        const cgl_real slope = (value - memory->value) / moved;
        cgl_real on_line = value - part * slope;
        *entry = limited(on_line, limit);
        while (--count > 0U) {
            on_line -= slope;
            entry = (entry > memory->cell ? entry : memory->cell + cells) - 1;
            *entry = limited(on_line, limit);
        }
        memory->at = n;
    } else if (!(moved > CGL_R(0.0))) {
        if (moved < CGL_R(0.0)) {
            return false;
        }
        memory->value = value; /* it stands still, or a coarse encoder says so */
        return true;
    }
    memory->position = position;
    memory->value = value;
    if (config->lead > 0U) {
        correct_on(memory, position, moved, correction);
    }
    return true;
}

/* ---- by time: a ring of the last values ---- */

/* The value stored `age` samples ago, 1 for the last one. */
static cgl_real value_ago(const cgl_memory *memory, uint32_t age)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    if (age > memory->known) {
        return CGL_R(0.0);
    }
    const uint32_t place = memory->newest + length + 1U - age;
    return memory->cell[place < length ? place : place - length];
}

CGL_SELDOM static bool recall_by_time(const cgl_memory *memory, cgl_real omega_ref, bool learn,
                           cgl_real *value)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real periods = cgl_abs(omega_ref) * memory->ts * memory->per_rad; /* in a sample */
    if (!(periods > CGL_R(0.0) && periods * (cgl_real)config->cells >= CGL_R(1.0)
          && periods * (cgl_real)(config->q_half_width + 1U) <= CGL_R(1.0))) {
        return false;
    }
    const cgl_real period = CGL_R(1.0) / periods;
    uint32_t n = (uint32_t)cgl_clamped(period, (cgl_real)config->cells); /* it may round above the longest period */
    n = n > config->q_half_width ? n : config->q_half_width + 1U;
    const cgl_real part = cgl_clamped(period - (cgl_real)n, CGL_R(1.0));
    const uint32_t m = learn ? config->q_half_width : 0U;

    cgl_real sum = CGL_R(0.0), first = CGL_R(0.0);
    for (uint32_t age = n + m; age >= n - m; --age) {
        first = value_ago(memory, age);
        sum += first;
    }
    sum += part * (value_ago(memory, n + m + 1U) - first);
    *value = learn ? memory->gain * sum : sum;
    return true;
}

CGL_SELDOM static void store_by_time(cgl_memory *memory, cgl_real value, cgl_real correction)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t length = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    memory->newest = memory->newest + 1U < length ? memory->newest + 1U : 0U;
    memory->cell[memory->newest] = value;
    if (memory->known < length) {
        ++memory->known;
    }
    if (config->lead > 0U && config->lead < memory->known) {
        const uint32_t place = memory->newest + length - config->lead;
        const uint32_t then = place < length ? place : place - length;
        memory->cell[then] = cgl_clamped(memory->cell[then] + correction, config->limit);
    }
}

CGL_SELDOM static bool recall(cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref, bool learn,
                   cgl_real *value)
{
    const cgl_memory_config *const config = &memory->config;
    if (config->kind == CGL_MEMORY_TIME) {
        return recall_by_time(memory, omega_ref, learn, value);
    }
    return recall_by_angle(memory, theta_m, learn, value);
}

CGL_SELDOM bool cgl_memory_recall(cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref,
                       bool learn, cgl_real *value)
{
    const cgl_memory_config *const config = &memory->config;
    const bool known = recall(memory, theta_m, omega_ref, learn, value);
    *value = known ? cgl_clamped(*value, config->limit) : CGL_R(0.0); /* sums round */
    return known;
}

CGL_SELDOM cgl_real cgl_memory_update(cgl_memory *memory, cgl_real value, cgl_real correction,
                           bool learn)
{
    const cgl_memory_config *const config = &memory->config;
    const cgl_real change = learn ? cgl_clamped(correction, CGL_REAL_MAX) : CGL_R(0.0);
    const cgl_real acting = cgl_clamped(config->lead > 0U ? value : value + change, config->limit);
    if (config->kind == CGL_MEMORY_TIME) {
        store_by_time(memory, acting, change);
    } else if (learn) {
        store_by_angle(memory, acting, change);
    } else {
        memory->started = memory->lagging = memory->steady = false; /* the next value has no line back to this one */
        memory->known = 0U; /* and when the rotor comes round, what was overwritten is two periods old */
    }
    return acting;
}

CGL_SELDOM static cgl_real step_anywhere(cgl_memory *memory, cgl_real theta_m,
                                         cgl_real omega_ref, cgl_real correction, bool *learn)
{
    cgl_real value;
    *learn = *learn && cgl_is_finite(correction) && cgl_is_angle(theta_m);
    *learn = cgl_memory_recall(memory, theta_m, omega_ref, *learn, &value) && *learn;
    return cgl_memory_update(memory, value, correction, *learn);
}

CGL_SELDOM void cgl_memory_soften(cgl_memory *memory, cgl_real factor)
{
    memory->gain = factor * memory->config.forgetting / (cgl_real)(2U * memory->config.q_half_width + 1U);
}

CGL_SELDOM void cgl_memory_forget(cgl_memory *memory, cgl_real theta_m)
{
    cgl_real value;
    if (memory->config.kind == CGL_MEMORY_TIME) {
        memory->known = 0U;
    } else if (recall_by_angle(memory, theta_m, true, &value)) {
        store_by_angle(memory, CGL_R(0.0), CGL_R(0.0));
    }
}

cgl_real cgl_memory_step(cgl_memory *memory, cgl_real theta_m, cgl_real omega_ref,
                         cgl_real correction, bool *learn)
{
    if (*learn && memory->steady && step_on(memory, theta_m, correction)) {
        return memory->value;
    }
    return step_anywhere(memory, theta_m, omega_ref, correction, learn);
}
