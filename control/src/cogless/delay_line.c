#include "delay_line.h"

#define MOVES 8U /* largest number of samples by which `then`, the place of one period ago, moves in a step */

CGL_SELDOM bool cgl_delay_is_valid(const cgl_memory_config *config, cgl_real ts)
{
    return config->kind == CGL_MEMORY_DELAY
           && (config->method == CGL_DELAY_INVERSION
               || (config->method == CGL_DELAY_ODE && cgl_is_positive(config->k_pp) && config->k_pp * ts < CGL_R(1.0)));
}

CGL_SELDOM void cgl_delay_reset(cgl_delay_line *line)
{
    line->newest = line->known = line->then = 0U;
    line->x = line->p_t = line->distance = line->part = CGL_R(0.0);
    line->tracking = false;
}

CGL_SELDOM static uint32_t newer(const cgl_memory *memory, uint32_t at)
{
    return at + 1U < memory->row ? at + 1U : 0U;
}

CGL_SELDOM static uint32_t older(const cgl_memory *memory, uint32_t at)
{
    return at > 0U ? at - 1U : memory->row - 1U;
}

/* Returns the number of samples from index `from` of the ring on to the later index `to`. */
static uint32_t samples_to(const cgl_memory *memory, uint32_t from, uint32_t to)
{
    return to >= from ? to - from : to + memory->row - from;
}

/* Returns a distance [periods] as the shorter way round, in (-1/2, 1/2]. */
CGL_SELDOM static cgl_real shorter_way(cgl_real distance)
{
    return distance > CGL_R(0.5) ? distance - CGL_R(1.0)
                                 : (distance <= CGL_R(-0.5) ? distance + CGL_R(1.0) : distance);
}

/* ---- kind time: finding the place of one period ago ---- */

/* Finds the place in the ring of one period before the next sample; `speed` gives the period. Returns false if the period is longer than
 * the line, or has fewer samples than memory->fewest. */
CGL_SELDOM static bool find_time(cgl_memory *memory, cgl_real speed)
{
    cgl_delay_line *const line = &memory->line;
    const cgl_memory_config *const config = &memory->config;
    const cgl_real per_rad = (cgl_real)memory->periods / ((cgl_real)config->turns * CGL_TWO_PI);
    const cgl_real periods = cgl_abs(speed) * memory->ts * per_rad; /* periods by which the rotor moves in a sample */
    if (!(periods > CGL_R(0.0) && periods * (cgl_real)config->cells >= CGL_R(1.0)
          && periods * (cgl_real)memory->fewest <= CGL_R(1.0))) {
        return false;
    }
    const cgl_real period = CGL_R(1.0) / periods;
    uint32_t age = (uint32_t)cgl_clamp(period, (cgl_real)config->cells); /* rounding may make the period longer than the line */
    age = age > config->q_half_width ? age : config->q_half_width + 1U;
    line->part = cgl_clamp(period - (cgl_real)age, CGL_R(1.0));
    const uint32_t place = line->newest + memory->row + 1U - age;
    line->then = place < memory->row ? place : place - memory->row;
    return true;
}

/* ---- kind delay: finding P_t, and the place of the time P_t ago ---- */

static bool is_oldest(const cgl_memory *memory)
{
    const cgl_delay_line *const line = &memory->line;
    return line->then == (line->known < memory->row ? 0U : newer(memory, line->newest));
}

/* Returns the rise of the angle from the sample before `at` to the sample `at` [periods]. */
CGL_SELDOM static cgl_real rise(const cgl_memory *memory, uint32_t at)
{
    return shorter_way(memory->cell[at] - memory->cell[older(memory, at)]);
}

CGL_SELDOM static void go_newer(cgl_memory *memory)
{
    memory->line.then = newer(memory, memory->line.then);
    memory->line.distance -= rise(memory, memory->line.then);
}

CGL_SELDOM static void go_older(cgl_memory *memory)
{
    memory->line.distance += rise(memory, memory->line.then);
    memory->line.then = older(memory, memory->line.then);
}

/* Finds P_t by inversion. Moves `then` to the oldest sample whose angle is at most a period behind the present angle. */
static void invert(cgl_memory *memory)
{
    cgl_delay_line *const line = &memory->line;
    uint32_t moves = MOVES;
    for (; moves > 0U && line->then != line->newest && line->distance > CGL_R(1.0); --moves) {
        go_newer(memory);
    }
    for (; moves > 0U && !is_oldest(memory) && line->distance + rise(memory, line->then) <= CGL_R(1.0); --moves) {
        go_older(memory);
    }
    line->tracking = !is_oldest(memory) && moves > 0U;
    line->part = line->tracking
                     ? cgl_clamp((CGL_R(1.0) - line->distance) / rise(memory, line->then), CGL_R(1.0))
                     : CGL_R(0.0);
}

/* Finds P_t [samples] by a step of the differential equation. */
static void follow_equation(cgl_memory *memory, cgl_real moved)
{
    cgl_delay_line *const line = &memory->line;
    const cgl_real slope = rise(memory, line->then);
    const cgl_real error = line->distance - moved + line->part * slope - CGL_R(1.0);
    /* The equation has 1 minus this quotient. The 1 needs no code, because every sample is older by one sample now. */
    line->part -= (moved + memory->config.k_pp * memory->ts * error) / slope;
    uint32_t moves = MOVES;
    for (; moves > 0U && line->part < CGL_R(0.0) && line->then != line->newest; --moves) {
        go_newer(memory);
        line->part += CGL_R(1.0);
    }
    for (; moves > 0U && line->part >= CGL_R(1.0) && !is_oldest(memory); --moves) {
        go_older(memory);
        line->part -= CGL_R(1.0);
    }
    line->tracking = !is_oldest(memory) && line->part >= CGL_R(0.0) && line->part < CGL_R(1.0);
}

/* Finds P_t for an angle that has risen by `moved` since the newest sample. Within this function, `distance` ends at the present angle,
 * not at the newest sample. */
CGL_SELDOM static void find_period(cgl_memory *memory, cgl_real moved)
{
    cgl_delay_line *const line = &memory->line;
    line->distance += moved;
    line->tracking = line->tracking && !is_oldest(memory); /* the period may have become longer than the line */
    if (line->tracking && memory->config.method == CGL_DELAY_ODE) {
        follow_equation(memory, moved);
    }
    if (!line->tracking || memory->config.method == CGL_DELAY_INVERSION) {
        invert(memory);
    }
    line->distance -= moved;
}

/* Finds P_t if the angle has risen. Returns whether the angle has risen. */
static bool find_angle(cgl_memory *memory, uint32_t place, cgl_real speed)
{
    cgl_delay_line *const line = &memory->line;
    line->x = (cgl_real)place * CGL_R(2.3283064365386963e-10);
    const cgl_real moved =
        line->known > 0U ? shorter_way(line->x - memory->cell[line->newest]) : CGL_R(1.0);
    if (!(speed > CGL_R(0.0) && moved > CGL_R(0.0))) {
        return false;
    }
    if (line->known > 0U) {
        find_period(memory, moved);
    }
    const uint32_t age = samples_to(memory, line->then, line->newest) + 1U;
    line->p_t = line->tracking ? ((cgl_real)age + line->part) * memory->ts : CGL_R(0.0);
    return true;
}

/* Stores the angle of a sample, and updates `distance`. A sum of rises would drift. So `distance` is the difference of two stored
 * angles, plus whole periods. The sum of rises tells how many whole periods. */
CGL_SELDOM static void store_angle(cgl_memory *memory, uint32_t next)
{
    cgl_delay_line *const line = &memory->line;
    memory->cell[next] = line->x;
    const cgl_real apart = line->x - memory->cell[line->then];
    const cgl_real sum = line->known > 0U ? line->distance + rise(memory, next) : CGL_R(0.0);
    const cgl_real most = (cgl_real)CGL_SAMPLES_MAX; /* bound [periods]: the angle rises by less than one period in a sample */
    line->distance = apart + (cgl_real)(int32_t)cgl_clamp(sum - apart + CGL_R(0.5), most);
}

/* ---- kinds time and delay: recalling, correcting and storing a sample ---- */

/* Returns the sum of 2 m + 1 samples about the place of one period ago. This place is between the sample `then` and the sample before
 * `then`, and the sum is interpolated between sums about these two samples. */
CGL_SELDOM static cgl_real mean_of(const cgl_memory *memory, const cgl_real *row, uint32_t m)
{
    const uint32_t length = memory->row;
    uint32_t n = memory->line.then + m;
    n = n < length ? n : n - length;
    const cgl_real first = row[n];
    cgl_real sum = first;
    for (uint32_t count = 0; count < 2U * m; ++count) {
        n = older(memory, n);
        sum += row[n];
    }
    return sum + memory->line.part * (row[older(memory, n)] - first);
}

CGL_SELDOM bool cgl_delay_step(cgl_memory *memory, uint32_t place, cgl_real speed, bool learn, const cgl_real *correction,
                    cgl_real *value)
{
    cgl_delay_line *const line = &memory->line;
    const cgl_memory_config *const config = &memory->config;
    const uint32_t length = memory->row, channels = config->channels;
    const bool by_time = config->kind == CGL_MEMORY_TIME;
    if (!(by_time ? find_time(memory, speed) : find_angle(memory, place, speed))) { /* the line stores nothing */
        for (uint32_t c = 0; c < channels; ++c) {
            value[c] = memory->channel[c].value;
        }
        return false;
    }
    const uint32_t age = samples_to(memory, line->then, line->newest) + 1U;
    const bool found = by_time || line->tracking;
    const bool fits = age > config->q_half_width && age + config->q_half_width < length;
    const bool reads = found && fits; /* if there is no sample of one period ago, the recalled value is 0 */
    learn = learn && ((reads && age >= memory->fewest) || (line->known < length && !line->tracking));
    const uint32_t next = line->known > 0U ? newer(memory, line->newest) : 0U;
    const uint32_t back = next + length - (config->lead <= line->known ? config->lead : 0U);
    const uint32_t lagging = back < length ? back : back - length;
    cgl_real *row = memory->cell + (by_time ? 0U : length);
    for (uint32_t c = 0; c < channels; ++c, row += length) {
        value[c] = CGL_R(0.0);
        if (reads) {
            value[c] = learn ? memory->gain * mean_of(memory, row, config->q_half_width) - memory->gain * memory->channel[c].drain
                             : mean_of(memory, row, 0U);
        }
        value[c] += learn && config->lead == 0U ? correction[c] : CGL_R(0.0);
        memory->channel[c].value = row[next] = cgl_clamp(value[c], config->limit[c]);
        if (learn && lagging != next) {
            row[lagging] = cgl_clamp(row[lagging] + correction[c], config->limit[c]);
        }
    }
    if (!by_time && line->known == length && next == line->then) {
        go_newer(memory);
    }
    line->newest = next;
    if (!by_time) {
        store_angle(memory, next);
    }
    line->known += line->known < length ? 1U : 0U;
    return learn;
}
