/* Random drives under the guard, in the library alone: beside the same feedback and beside the same law without a guard.
 *
 *   cc -O2 -I control/src benchmarks/guard_drives.c control/src/cogless/[a-z]*.c -lm -o guard_drives
 *   ./guard_drives SEED DRIVES [FIRST [LAST]]     a table; with a range of drives, one line for each of them
 *
 * A drive is a rotor with cogging and friction, a current loop that is a lag with a limit of voltage, a sensor, and a law
 * with gains, leads and models that are mostly wrong. A window is whole turns of the reference, 0.25 s to 5 s long. Its
 * ripple is the standard deviation of the speed error, or the rms where the rotor does not turn with its reference. It is
 * bad where the true and the sampled ripple both are more than 1.25 times that of the feedback alone. The promise is broken
 * where bad windows in a row last longer than 5 s and longer than 20 turns. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cogless.h"

#define TURN 6.283185307179586
#define DURATION 60.0    /* [s] */
#define START_TIME 0.5   /* [s], which does not count */
#define WINDOW_MOST 260U /* in a drive */
#define HARMFUL 1.25     /* times the ripple of the feedback alone */
#define LAST_TIME 15.0   /* [s] of the end */
#define CELLS_MOST 4096U

static uint64_t seed_state;

static double uniform(double low, double high)
{
    seed_state += 0x9e3779b97f4a7c15u;
    uint64_t z = seed_state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return low + (high - low) * (double)(z >> 11) / 9007199254740992.0;
}

static double spread(double low, double high)
{
    return exp(uniform(log(low), log(high)));
}

static uint32_t below(uint32_t n)
{
    return (uint32_t)uniform(0.0, (double)n) % n;
}

static bool chance(double share)
{
    return uniform(0.0, 1.0) < share;
}

enum { PI_ILC, ROBUST, SPACE, PI_AFC, HARMONIC, LAWS };
static const char *const law_name[] = {"pi-ilc", "robust", "space", "pi-afc", "harmonic"};
enum { STEADY, SPEEDS, LOADS, DIPS, OVERLOADS, SENSOR, MOVING, KINDS };
static const char *const kind_name[] = {"steady", "speeds", "loads", "dips", "overloads", "sensor", "moving"};
enum { EMPTY, LOADED, TABLE }; /* what is learned at the beginning: nothing; a map to learn on from; a table that stays */
static const char *const memory_name[] = {"empty", "loaded", "table"};
enum { ALONE, FREE, GUARDED, MODES };

typedef struct {
    uint32_t law, kind, content;
    double kt, inertia, coulomb, viscous, load, cogging[3], phase[3], poles; /* in [A] but kt and inertia */
    double resistance, inductance, bus, bandwidth, limit;
    double rate; /* of the current loop [Hz] */
    uint32_t divider, late; /* late: periods of the current loop from a reference to its action */
    double counts, wave, wave_phase; /* of the encoder; 0: ideal. wave: error once a turn [rad] */
    double omega, start_speed, depth, frequency;
    double event_time[16], event_value[16];
    uint32_t events;
    double learning_start;
    double map_scale, map_shift;
    cgl_pi_ilc_config pi_ilc;
    cgl_robust_ilc_config robust;
    cgl_space_speed_config space;
    cgl_pi_afc_config pi_afc;
    cgl_harmonic_config harmonic;
} drive_case;

static void draw_memory(drive_case *d, cgl_memory_config *m, double limit, double rate)
{
    static const uint32_t cells[] = {64, 128, 256, 512, 1024, 2048, 4096}, half[] = {0, 0, 1, 2, 3, 5, 8};
    m->kind = d->content == EMPTY && chance(0.3) ? CGL_MEMORY_TIME : CGL_MEMORY_ANGLE;
    m->channels = 1U;
    m->cells = d->content == EMPTY ? cells[below(7)] : cells[3U + below(4)];
    m->turns = 1U;
    m->parts = d->content == EMPTY && chance(0.5) ? (uint32_t)(d->poles / 2.0) : 1U;
    if (m->kind == CGL_MEMORY_TIME) {
        m->cells = (uint32_t)fmin(CELLS_MOST, 1.1 * TURN / (0.3 * d->omega) * rate / m->parts + 8.0);
    }
    m->q_half_width = half[below(7)];
    m->lead = below(7);
    m->forgetting = chance(0.7) ? CGL_R(1.0) : (cgl_real)uniform(0.8, 0.999);
    m->limit[0] = (cgl_real)limit;
}

static void draw_events(drive_case *d)
{
    double time = 0.0;
    for (d->events = 0U; d->events < 16U; ++d->events) {
        const bool second = d->events % 2U != 0U;
        time += d->kind == SPEEDS ? uniform(5.0, 15.0) : second ? spread(0.2, d->kind == LOADS ? 12.0 : 3.0) : uniform(3.0, 12.0);
        d->event_time[d->events] = time;
        const double speed = d->omega * spread(0.3, 1.0), dip = uniform(0.3, 0.8), load = d->limit * uniform(0.05, 0.4);
        const double overload = d->limit * uniform(0.8, 1.5);
        d->event_value[d->events] = d->kind == SPEEDS ? speed : d->kind == DIPS ? (second ? 1.0 : dip)
                                    : second ? 0.0 : d->kind == LOADS ? load : overload;
    }
}

static void draw(drive_case *d, uint32_t seed, uint32_t number)
{
    seed_state = (uint64_t)seed << 32 ^ number;
    (void)uniform(0.0, 1.0);
    memset(d, 0, sizeof *d);
    d->law = below(LAWS);
    d->content = d->law != HARMONIC && chance(0.25) ? LOADED + below(2) : EMPTY;
    d->kind = chance(0.3) ? STEADY : 1U + below(KINDS - 1U);
    static const double pole_pairs[] = {2, 4, 5, 7, 11, 14}, rates[] = {8000, 8000, 10000, 20000};
    static const uint32_t dividers[] = {4, 5, 8, 10, 16};
    d->poles = 2.0 * pole_pairs[below(6)];
    d->rate = rates[below(4)];
    d->divider = dividers[below(5)];
    const double rate = d->rate / d->divider, ts = 1.0 / rate, b = spread(500.0, 20000.0);
    d->kt = spread(0.02, 0.6);
    d->inertia = d->kt / b;
    d->limit = spread(1.0, 10.0);
    d->omega = spread(0.5, fmin(300.0, 0.35 * rate * TURN / (3.0 * d->poles)));
    const double cogging = d->limit * spread(0.005, 0.1), share[3] = {0.3, 1.0, 0.2};
    for (int k = 0; k < 3; ++k) {
        d->cogging[k] = cogging * share[k];
        d->phase[k] = uniform(-3.0, 3.0);
    }
    d->coulomb = chance(0.5) ? d->limit * spread(0.005, 0.1) : 0.0;
    d->viscous = chance(0.5) ? d->limit / d->omega * spread(0.005, 0.1) : 0.0;
    d->load = chance(0.5) ? d->limit * uniform(0.0, 0.3) : 0.0;
    const double emf = d->kt / 1.5 * d->omega;
    d->bus = 1.2 + emf * spread(1.5, 6.0);
    d->resistance = 0.3 * (d->bus - emf) / d->limit;
    d->inductance = d->resistance * spread(4e-4, 3e-3);
    d->bandwidth = TURN * fmin(spread(200.0, 1500.0), d->rate / 12.0);
    d->counts = chance(0.2) ? 0.0 : 4.0 * floor(spread(500.0, 16384.0));
    d->wave = chance(0.2) ? spread(1e-4, 3e-3) : 0.0;
    d->wave_phase = uniform(-3.0, 3.0);
    d->depth = uniform(0.2, 0.7);
    d->frequency = spread(0.03, 1.0);
    d->start_speed = chance(0.67) ? d->omega : 0.0;
    d->learning_start = chance(0.33) ? 2.0 : 0.0;
    d->map_scale = chance(0.5) ? 1.0 : spread(0.3, 3.0) * (chance(0.5) ? 1.0 : -1.0);
    d->map_shift = chance(0.5) ? 0.0 : uniform(-2.0, 2.0);
    draw_events(d);
    const double late = 1.0 / d->bandwidth + 1.5 * ts, margin = uniform(35.0, 70.0) * TURN / 360.0;
    const double crossover = fmin((TURN / 4.0 - 0.2 - margin) / late + 1.0, 0.2 / ts), kp = crossover / b;
    const cgl_pi_config pi = {(cgl_real)kp, (cgl_real)(kp * crossover / 5.0), (cgl_real)d->limit};
    const double gain = kp * spread(0.1, 20.0), believed = b * spread(0.8, 1.25);
    d->pi_ilc.pi = d->pi_afc.pi = d->harmonic.pi = pi;
    d->pi_ilc.gain = (cgl_real)gain;
    draw_memory(d, &d->pi_ilc.memory, d->limit, rate);
    d->robust.b = (cgl_real)believed;
    d->robust.c = d->robust.eta = (cgl_real)(b * kp / 2.0);
    d->robust.q = CGL_R(1.0);
    d->robust.beta_2 = (cgl_real)(gain * b);
    d->robust.beta_1 = (cgl_real)(chance(0.67) ? 0.0 : b * spread(1e-3, 0.05));
    d->robust.g = (cgl_real)(chance(0.5) ? 0.0 : b * spread(1e-3, 0.05));
    d->robust.limit = (cgl_real)d->limit;
    d->robust.memory = d->pi_ilc.memory;
    d->robust.memory.limit[0] = (cgl_real)(d->limit * believed);
    d->space.k = (cgl_real)kp;
    d->space.mu_alpha = (cgl_real)(gain * d->omega);
    d->space.eta_bar = (cgl_real)(d->omega * spread(0.5, 10.0));
    d->space.omega_min = (cgl_real)(0.02 * d->omega);
    d->space.limit = (cgl_real)d->limit;
    d->space.ratio = 1U;
    d->space.memory = d->pi_ilc.memory;
    d->space.memory.kind = CGL_MEMORY_ANGLE;
    d->space.memory.lead = 0U;
    d->pi_afc.orders = 3U;
    d->pi_afc.order[0] = (uint32_t)d->poles;
    d->pi_afc.order[1] = (uint32_t)(3.0 * d->poles);
    d->pi_afc.order[2] = (uint32_t)(6.0 * d->poles);
    d->pi_afc.gain = (cgl_real)(gain * spread(1.0, 100.0));
    d->pi_afc.lead = (cgl_real)(below(7) * ts);
    d->pi_afc.omega_min = (cgl_real)(0.02 * d->omega);
    d->pi_afc.limit = (cgl_real)d->limit;
    d->harmonic.b = (cgl_real)believed;
    d->harmonic.delay = (cgl_real)(1.0 / d->bandwidth);
    d->harmonic.step = (cgl_real)(d->counts > 0.0 ? TURN / d->counts : 0.0);
    d->harmonic.base = (uint32_t)(d->poles);
    d->harmonic.orders = 6U;
    d->harmonic.fast = 3U;
    d->harmonic.rate = (cgl_real)spread(5.0, 50.0);
    d->harmonic.rate_min = CGL_R(0.5);
    d->harmonic.limit = (cgl_real)d->limit;
    d->late = chance(0.5) ? 1U : 0U; /* from here on what the controller is not told */
    if (chance(0.5)) {
        d->inertia *= spread(0.5, 2.0);
        d->kt *= spread(0.5, 2.0);
    }
}

static double reference_at(const drive_case *d, double time)
{
    double speed = d->omega;
    if (d->kind == MOVING) {
        return d->omega * (1.0 + d->depth * (sin(TURN * d->frequency * time) - 1.0) / 2.0);
    }
    for (uint32_t n = 0U; d->kind == SPEEDS && n < d->events && time > d->event_time[n]; ++n) {
        const double ramp = fmin((time - d->event_time[n]) / 0.2, 1.0);
        speed += ramp * (d->event_value[n] - speed);
    }
    return speed;
}

static double event_at(const drive_case *d, double time, double otherwise)
{
    double value = otherwise;
    for (uint32_t n = 0U; n < d->events && time > d->event_time[n]; ++n) {
        value = d->event_value[n];
    }
    return value;
}

static cgl_real cell[CELLS_MOST + 64U];

typedef struct {
    cgl_pi_ilc pi_ilc;
    cgl_robust_ilc robust;
    cgl_space_speed space;
    cgl_pi_afc pi_afc;
    cgl_harmonic harmonic;
} law_state;

static uint32_t entries_of(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

static bool init_law(law_state *law, const drive_case *d, cgl_real ts)
{
    const cgl_loop loop = {.ts = ts, .current_limit = CGL_REAL_MAX};
    switch (d->law) {
    case PI_ILC:
        return cgl_pi_ilc_init(&law->pi_ilc, &d->pi_ilc, &loop, cell, entries_of(&d->pi_ilc.memory)) == CGL_OK;
    case ROBUST:
        return cgl_robust_ilc_init(&law->robust, &d->robust, &loop, cell, entries_of(&d->robust.memory)) == CGL_OK;
    case SPACE:
        return cgl_space_speed_init(&law->space, &d->space, &loop, cell, entries_of(&d->space.memory)) == CGL_OK;
    case PI_AFC:
        return cgl_pi_afc_init(&law->pi_afc, &d->pi_afc, &loop, cell, CGL_PI_AFC_LENGTH(d->pi_afc.orders)) == CGL_OK;
    default:
        return cgl_harmonic_init(&law->harmonic, &d->harmonic, &loop, cell, CGL_HARMONIC_LENGTH(d->harmonic.orders)) == CGL_OK;
    }
}

static void step_law(law_state *law, const drive_case *d, const cgl_law_input *in, cgl_law_output *out)
{
    switch (d->law) {
    case PI_ILC:
        cgl_pi_ilc_step(&law->pi_ilc, in, out);
        break;
    case ROBUST:
        cgl_robust_ilc_step(&law->robust, in, out);
        break;
    case SPACE:
        cgl_space_speed_step(&law->space, in, out);
        break;
    case PI_AFC:
        cgl_pi_afc_step(&law->pi_afc, in, out);
        break;
    default:
        cgl_harmonic_step(&law->harmonic, in, out);
        break;
    }
}

/* The current that holds the cogging at an angle, as a map of it has it. */
static double cogging_at(const drive_case *d, double theta)
{
    double current = 0.0;
    static const double order[3] = {1.0, 3.0, 6.0};
    for (int k = 0; k < 3; ++k) {
        current += d->cogging[k] * sin(order[k] * d->poles * theta + d->phase[k]);
    }
    return current;
}

static void load_map(const drive_case *d)
{
    const cgl_memory_config *const m = d->law == SPACE ? &d->space.memory : &d->pi_ilc.memory;
    for (uint32_t n = 0U; n < m->cells; ++n) {
        const double theta = TURN * n / m->cells + d->map_shift / (3.0 * d->poles);
        const double current = d->map_scale * cogging_at(d, theta);
        cell[n] = (cgl_real)(d->law == ROBUST ? -current * (double)d->robust.b : current);
    }
    for (uint32_t k = 0U; d->law == PI_AFC && k < 3U; ++k) {
        const double phase = d->phase[k] + d->map_shift;
        cell[k] = (cgl_real)(d->map_scale * d->cogging[k] * sin(phase));
        cell[3U + k] = (cgl_real)(d->map_scale * d->cogging[k] * cos(phase));
    }
}

typedef struct {
    double end, turns;       /* of the window [s], [turns] */
    double ripple[MODES][3]; /* variances: of the true error, of the sampled one, of its mean over two samples */
    bool acts;               /* the guard did */
} window;

typedef struct {
    double sum[3], squares[3], reference, turned, begin;
    uint32_t count, acting;
} gathering;

static void end_window(window *w, gathering *g, uint32_t mode, double time)
{
    for (int k = 0; k < 3; ++k) {
        const double mean = g->sum[k] / g->count, variance = fmax(g->squares[k] / g->count - mean * mean, 0.0);
        w->ripple[mode][k] = variance + (fabs(mean) > 0.5 * fabs(g->reference) / g->count ? mean * mean : 0.0);
    }
    w->end = time;
    w->turns = g->turned;
    w->acts = mode == GUARDED ? g->acting * 2U > g->count : w->acts;
    memset(g, 0, sizeof *g);
    g->begin = time;
}

/* What the sensor tells of the speed: from edge to edge of an encoder, or the mean over a period. */
typedef struct {
    double count, edge_time, from, from_time, speed;
} sensor_state;

static double measure(sensor_state *s, const drive_case *d, double shown, double time, double ts)
{
    if (!(d->counts > 0.0)) {
        s->speed = (shown - s->from) / ts;
        s->from = shown;
        return s->speed;
    }
    const double unit = TURN / d->counts;
    if (s->count > s->from || s->count < s->from) {
        s->speed = (s->count - s->from) * unit / fmax(s->edge_time - s->from_time, 0.2 * ts);
        s->from = s->count;
        s->from_time = s->edge_time;
    } else {
        const double most = unit / fmax(time - s->from_time, ts);
        s->speed = fmin(fmax(s->speed, -most), most);
    }
    return s->speed;
}

static bool trace_guard;

static uint32_t simulate(const drive_case *d, uint32_t mode, window *windows)
{
    static law_state law;
    static cgl_guard guard;
    static cgl_quality quality;
    const double dt = 1.0 / d->rate, ts = dt * d->divider;
    const cgl_quality_config quality_config = {CGL_TWO_PI, CGL_R(60.0), CGL_R(0.0), CGL_R(0.0)};
    memset(&law, 0, sizeof law);
    if (!init_law(&law, d, (cgl_real)ts) || cgl_guard_init(&guard, (cgl_real)ts) != CGL_OK
        || cgl_quality_init(&quality, &quality_config, (cgl_real)ts) != CGL_OK) {
        return 0U;
    }
    if (d->content != EMPTY) {
        load_map(d);
    }
    cgl_law_input in;
    cgl_law_output out = {CGL_R(0.0), 0U};
    memset(&in, 0, sizeof in);
    double omega = d->start_speed, theta = 0.3, current = 0.0, target = 0.0, last_seen = 0.0, offset = 0.0;
    bool saturated = false;
    sensor_state sensor = {0.0, 0.0, 0.0, 0.0, omega};
    sensor.from = d->counts > 0.0 ? floor(theta * d->counts / TURN) : theta;
    sensor.count = sensor.from;
    gathering g;
    memset(&g, 0, sizeof g);
    uint32_t count = 0U;
    const double share = 1.0 - exp(-d->bandwidth * dt), emf = d->kt / 1.5;
    const uint64_t noise_state = seed_state;
    for (uint64_t n = 0U; (double)n * ts < DURATION && count < WINDOW_MOST; ++n) {
        const double time = (double)n * ts, reference = reference_at(d, time);
        const double bus = d->bus * (d->kind == DIPS ? event_at(d, time, 1.0) : 1.0);
        const double load = d->load + (d->kind == LOADS || d->kind == OVERLOADS ? event_at(d, time, 0.0) : 0.0);
        const double shown = theta + d->wave * sin(theta + d->wave_phase);
        const double seen = measure(&sensor, d, shown, time, ts);
        bool plausible = true, trusted = true;
        if (d->kind == SENSOR) { /* of each two events, one is a jump of the angle for a while, the other a short dropout */
            uint32_t k = 0U;
            for (; k < d->events && time > d->event_time[k]; ++k) { }
            const double since = k > 0U ? time - d->event_time[k - 1U] : 0.0;
            offset = k % 4U == 1U ? 0.3 : 0.0;
            plausible = !(k % 4U == 3U && since < 0.03);
            trusted = plausible && !(offset > 0.0);
        }
        double angle = d->counts > 0.0 ? sensor.count * TURN / d->counts : shown;
        angle -= TURN * floor(angle / TURN);
        const bool learned = in.learn && (out.status & (unsigned)CGL_STATUS_FROZEN) == 0U;
        const bool wanted = mode != ALONE && d->content != TABLE && time >= d->learning_start;
        in.theta_m = plausible ? (cgl_real)(angle + offset) : in.theta_m;
        in.omega_m = plausible ? (cgl_real)seen : in.omega_m;
        in.theta_ref = in.theta_m;
        in.omega_ref = (cgl_real)reference;
        in.learn = wanted && trusted && !saturated;
        in.muted = mode == ALONE ? CGL_R(1.0) : CGL_R(0.0);
        const cgl_real error = in.omega_ref - in.omega_m;
        if (cgl_quality_step(&quality, error, in.omega_m, in.learn && learned)) {
            in.learn = false;
        }
        bool acts = false;
        if (mode == GUARDED) {
            const cgl_guard_input looked = {error, in.omega_ref, plausible, saturated, wanted, learned};
            const uint8_t phase = guard.phase;
            cgl_guard_step(&guard, &looked);
            in.muted = CGL_R(1.0) - guard.share;
            in.gentle = guard.gentle;
            in.forget = cgl_guard_forgets(&guard);
            in.learn = in.learn && cgl_guard_may_learn(&guard);
            acts = cgl_guard_acts(&guard);
            if (trace_guard && guard.phase != phase) {
                printf("    %7.3f s: phase %u -> %u, step %u\n", time, phase, guard.phase, guard.gentle);
            }
        }
        step_law(&law, d, &in, &out);
        saturated = false;
        for (uint32_t k = 0U; k < d->divider; ++k) {
            const double most = bus - emf * omega, least = -bus - emf * omega;
            target = k == d->late ? (double)out.i_q_ref : target;
            const double high = current + dt / d->inductance * (most - d->resistance * current);
            const double low = current + dt / d->inductance * (least - d->resistance * current);
            double next = current + share * (target - current);
            saturated = saturated || next > high || next < low;
            next = fmin(fmax(next, low), high);
            const double sine = sin(d->poles * theta), cosine = cos(d->poles * theta);
            const double sine3 = sine * (3.0 - 4.0 * sine * sine), cosine3 = cosine * (4.0 * cosine * cosine - 3.0);
            const double cogging = d->cogging[0] * (sine * cos(d->phase[0]) + cosine * sin(d->phase[0]))
                                   + d->cogging[1] * (sine3 * cos(d->phase[1]) + cosine3 * sin(d->phase[1]))
                                   + d->cogging[2] * (2.0 * sine3 * cosine3 * cos(d->phase[2])
                                                      + (1.0 - 2.0 * sine3 * sine3) * sin(d->phase[2]));
            const double drag = (d->coulomb + load) * omega / (fabs(omega) + 0.02 * d->omega) + d->viscous * omega;
            omega += dt * d->kt / d->inertia * (0.5 * (current + next) - cogging - drag);
            theta += dt * omega;
            current = next;
            if (d->counts > 0.0) {
                const double place = (theta + d->wave * sin(theta + d->wave_phase)) * d->counts / TURN;
                if (floor(place) > sensor.count || floor(place) < sensor.count) {
                    const double speed = omega * d->counts / TURN, past = omega > 0.0 ? place - floor(place) : ceil(place) - place;
                    sensor.count = floor(place);
                    sensor.edge_time = time + dt * (k + 1U) - fmin(past / fmax(fabs(speed), 1e-9), dt);
                }
            }
        }
        const double true_error = reference_at(d, time + ts) - omega, seen_error = plausible ? reference - seen : last_seen;
        if (time < START_TIME) {
            g.begin = time;
            last_seen = seen_error;
            continue;
        }
        const double value[3] = {true_error, seen_error, 0.5 * (seen_error + last_seen)};
        last_seen = seen_error;
        for (int k = 0; k < 3; ++k) {
            g.sum[k] += value[k];
            g.squares[k] += value[k] * value[k];
        }
        g.reference += reference;
        ++g.count;
        g.acting += acts ? 1U : 0U;
        const double turned = g.turned;
        g.turned += reference * ts / TURN;
        if (time - g.begin >= 5.0 || (time - g.begin >= 0.25 && floor(g.turned) > floor(turned))) {
            end_window(&windows[count++], &g, mode, time);
        }
    }
    seed_state = noise_state;
    return count;
}

typedef struct {
    double drives, ends, time, longest, beyond, worst, logs, lost, gains, held, helped, convicted;
} tally;

static double ratio_of(const window *w, uint32_t mode)
{
    const double tiny = 1e-18, seen = w->ripple[mode][1] / (w->ripple[ALONE][1] + tiny);
    const double mean = w->ripple[mode][2] / (w->ripple[ALONE][2] + tiny);
    return sqrt(fmin(w->ripple[mode][0] / (w->ripple[ALONE][0] + tiny), fmax(seen, mean)));
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Adds a drive to the tallies; false where the feedback alone does not turn the rotor. */
static bool judge(const drive_case *d, const window *w, uint32_t count, tally *to, bool shown, uint32_t number)
{
    double bad = 0.0, run = 0.0, turns = 0.0, longest = 0.0, worst = 0.0, logs = 0.0, held = 0.0, total = w[count - 1U].end - START_TIME;
    double power[MODES] = {0.0, 0.0, 0.0}, ratios[WINDOW_MOST];
    uint32_t last = 0U, free_bad = 0U, alone_lost = 0U, harm_after = 0U;
    bool beyond = false;
    for (uint32_t n = 0U; n < count; ++n) {
        const double length = w[n].end - (n > 0U ? w[n - 1U].end : START_TIME), ratio = ratio_of(&w[n], GUARDED);
        alone_lost += w[n].ripple[ALONE][0] > 0.09 * d->omega * d->omega ? 1U : 0U;
        bad += ratio > HARMFUL ? length : 0.0;
        run = ratio > HARMFUL ? run + length : 0.0;
        turns = ratio > HARMFUL ? turns + w[n].turns : 0.0;
        longest = fmax(longest, run);
        beyond = beyond || (run > 5.0 && turns > 20.0);
        worst = fmax(worst, ratio);
        logs += log(fmax(ratio, 1e-3)) / count;
        held += w[n].acts ? length : 0.0;
        free_bad += ratio_of(&w[n], FREE) > 1.05 ? 1U : 0U;
        harm_after += ratio_of(&w[n], FREE) > 1.0 && w[n].end > 5.0 ? 1U : 0U;
        if (w[n].end > w[count - 1U].end - LAST_TIME) {
            for (uint32_t mode = 0U; mode < MODES; ++mode) {
                power[mode] += w[n].ripple[mode][0] * length;
            }
            ratios[last++] = ratio;
        }
    }
    if (alone_lost * 4U > count || last == 0U) {
        return false;
    }
    qsort(ratios, last, sizeof ratios[0], compare);
    const double end = ratios[last / 2U];
    for (uint32_t mode = 0U; mode < MODES; ++mode) {
        power[mode] = sqrt(power[mode]);
    }
    const bool gains = power[FREE] < 0.8 * power[ALONE], helps = harm_after == 0U && free_bad * 20U < count && gains;
    const double loss = gains ? fmin(fmax((power[GUARDED] - power[FREE]) / (power[ALONE] - power[FREE]), 0.0), 2.0) : 0.0;
    to->drives += 1.0;
    to->ends += end > HARMFUL ? 1.0 : 0.0;
    to->time += bad / total;
    to->longest = fmax(to->longest, longest);
    to->beyond += beyond ? 1.0 : 0.0;
    to->worst += worst > 4.0 ? 1.0 : 0.0;
    to->logs += logs;
    to->lost += loss;
    to->gains += gains ? 1.0 : 0.0;
    to->helped += helps ? 1.0 : 0.0;
    to->held += helps && held > LAST_TIME ? 1.0 : 0.0;
    if (shown) {
        printf("%4u %-8s %-9s %-6s w %6.2f end %6.3f time %4.1f%% longest %5.2f%s worst %7.2f lost %5.3f held %5.1f%s free %.3f\n", number,
               law_name[d->law], kind_name[d->kind], memory_name[d->content], d->omega, end, 100.0 * bad / total, longest,
               beyond ? " BEYOND" : "", worst, loss, held, helps ? " (helps)" : "", power[FREE] / power[ALONE]);
    }
    return true;
}

static void print_tally(const char *name, const tally *t)
{
    const double n = fmax(t->drives, 1.0);
    printf("%-10s %5.0f %6.0f %6.2f%% %8.1f %7.0f %6.0f %8.3f %7.1f%% of %3.0f %5.0f of %3.0f\n", name, t->drives, t->ends,
           100.0 * t->time / n, t->longest, t->beyond, t->worst, t->logs / n, 100.0 * t->lost / fmax(t->gains, 1.0), t->gains, t->held,
           t->helped);
}

static void add(tally *to, const tally *from)
{
    double *const a = (double *)to;
    const double *const b = (const double *)from;
    for (size_t k = 0U; k < sizeof *to / sizeof(double); ++k) {
        a[k] = k == 3U ? fmax(a[k], b[k]) : a[k] + b[k];
    }
}

int main(int argc, char **argv)
{
    static drive_case d;
    static window windows[WINDOW_MOST];
    static tally law[LAWS], kind[KINDS], content[3], all;
    const uint32_t seed = argc > 1 ? (uint32_t)atoi(argv[1]) : 1U, drives = argc > 2 ? (uint32_t)atoi(argv[2]) : 100U;
    const uint32_t first = argc > 3 ? (uint32_t)atoi(argv[3]) : 0U, last = argc > 4 ? (uint32_t)atoi(argv[4]) : argc > 3 ? first : drives - 1U;
    trace_guard = argc == 4;
    for (uint32_t number = first; number <= last; ++number) {
        draw(&d, seed, number);
        uint32_t count = WINDOW_MOST;
        for (uint32_t mode = 0U; mode < MODES && count > 0U; ++mode) {
            const uint32_t n = simulate(&d, mode, windows);
            count = n < count ? n : count;
        }
        tally one;
        memset(&one, 0, sizeof one);
        if (count == 0U || !judge(&d, windows, count, &one, argc > 3, number)) {
            if (argc > 3) {
                printf("%4u %s refused\n", number, law_name[d.law]);
            }
            continue;
        }
        for (uint32_t n = 0U; argc == 4 && n < count; ++n) {
            printf("    %7.3f free %7.3f guarded %7.3f%s\n", windows[n].end, ratio_of(&windows[n], FREE), ratio_of(&windows[n], GUARDED),
                   windows[n].acts ? " acts" : "");
        }
        add(&law[d.law], &one);
        add(&kind[d.kind], &one);
        add(&content[d.content], &one);
        add(&all, &one);
    }
    printf("%-10s %5s %6s %7s %8s %7s %6s %8s %8s %10s\n", "", "n", "ends", "time", "longest", "beyond", "worst", "ln", "lost", "held");
    for (uint32_t k = 0U; k < LAWS; ++k) {
        print_tally(law_name[k], &law[k]);
    }
    for (uint32_t k = 0U; k < KINDS; ++k) {
        print_tally(kind_name[k], &kind[k]);
    }
    for (uint32_t k = 0U; k < 3U; ++k) {
        print_tally(memory_name[k], &content[k]);
    }
    print_tally("all", &all);
    return 0;
}
