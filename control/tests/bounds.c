/* Configs at the documented ends of their fields: what lies on an end is taken, and what lies just beyond it is refused. */
#include "bounds.h"

#include <math.h>

#include "check.h"
#include "cogless/adrc.h"
#include "cogless/angle_observer.h"
#include "cogless/anti_cogging.h"
#include "cogless/current_reference.h"
#include "cogless/dead_time.h"
#include "cogless/drive.h"
#include "cogless/encoder.h"
#include "cogless/encoder_table.h"
#include "cogless/feedforward.h"
#include "cogless/foc.h"
#include "cogless/guard.h"
#include "cogless/hall.h"
#include "cogless/harmonic.h"
#include "cogless/low_pass.h"
#include "cogless/map_store.h"
#include "cogless/memory.h"
#include "cogless/microstepping.h"
#include "cogless/monitor.h"
#include "cogless/pi_afc.h"
#include "cogless/pi_ilc.h"
#include "cogless/quality.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/speed_count.h"
#include "cogless/speed_timed.h"
#include "cogless/trial.h"
#include "cogless/zero_phase.h"
#include "flash.h"

#define TS CGL_R(0.0009765625) /* [s], a power of two, so that bounds in periods are exact */
#define MORE CGL_R(1.0001)
#define LESS CGL_R(0.9999)
#define TINY (CGL_R(2.0) / CGL_REAL_MAX) /* its inverse is finite; that of an eighth of it is not */

static const cgl_loop loop = {.ts = TS, .current_limit = CGL_R(8.0)};

/* A config that is `base` but for one field. takes_PART() says whether it is taken. */
#define TAKES(part, base, field, value)                                                                                \
    do {                                                                                                               \
        cgl_##part##_config config = (base);                                                                           \
        config.field = (value);                                                                                        \
        CHECK(takes_##part(&config));                                                                                  \
    } while (false)
#define REFUSES(part, base, field, value)                                                                              \
    do {                                                                                                               \
        cgl_##part##_config config = (base);                                                                           \
        config.field = (value);                                                                                        \
        CHECK(!takes_##part(&config));                                                                                 \
    } while (false)
/* The ends of a whole number, of which 0 has no neighbour below. */
#define WHOLE(part, base, field, least, most)                                                                          \
    do {                                                                                                               \
        TAKES(part, base, field, least);                                                                               \
        TAKES(part, base, field, most);                                                                                \
        REFUSES(part, base, field, (most) + 1U);                                                                       \
        if ((least) > 0U) {                                                                                            \
            REFUSES(part, base, field, (least) - 1U);                                                                  \
        }                                                                                                              \
    } while (false)
#define AT_MOST(part, base, field, most)                                                                               \
    do {                                                                                                               \
        TAKES(part, base, field, most);                                                                                \
        REFUSES(part, base, field, MORE *(most));                                                                      \
    } while (false)
#define AT_LEAST(part, base, field, least)                                                                             \
    do {                                                                                                               \
        TAKES(part, base, field, least);                                                                               \
        REFUSES(part, base, field, LESS *(least));                                                                     \
    } while (false)
/* Three numbers of measured phases are known: none or the default, two and three. */
#define PHASES(part, base, field)                                                                                      \
    do {                                                                                                               \
        TAKES(part, base, field, 0U);                                                                                  \
        REFUSES(part, base, field, 1U);                                                                                \
        WHOLE(part, base, field, 2U, 3U);                                                                              \
    } while (false)

#define OF_LOOP(part)                                                                                                  \
    static bool takes_##part(const cgl_##part##_config *config)                                                        \
    {                                                                                                                  \
        return cgl_##part##_bad_field(config, &loop) == 0;                                                             \
    }
#define OF_PERIOD(part)                                                                                                \
    static bool takes_##part(const cgl_##part##_config *config)                                                        \
    {                                                                                                                  \
        return cgl_##part##_bad_field(config, TS) == 0;                                                                \
    }
#define BY_INIT(part, ...)                                                                                             \
    static bool takes_##part(const cgl_##part##_config *config)                                                        \
    {                                                                                                                  \
        static cgl_##part state;                                                                                       \
        return cgl_##part##_init(&state, config, __VA_ARGS__) == CGL_OK;                                               \
    }

OF_LOOP(adrc)
OF_LOOP(anti_cogging)
OF_LOOP(harmonic)
OF_LOOP(pi_afc)
OF_LOOP(robust_ilc)
OF_LOOP(space_position)
OF_PERIOD(drive)
OF_PERIOD(foc)
OF_PERIOD(memory)
OF_PERIOD(monitor)
OF_PERIOD(quality)
BY_INIT(angle_observer, TS)
BY_INIT(dead_time, TS)
BY_INIT(encoder, 0U)
BY_INIT(encoder_table, TS)
BY_INIT(low_pass, TS)

/* ---- laws ---- */

static void laws(void)
{
    const cgl_pi_config pi = {CGL_R(0.1), CGL_R(1.0), CGL_R(3.0)};
    const cgl_adrc_config adrc = {CGL_R(100.0), CGL_R(20.0), CGL_R(100.0), CGL_R(3.0)};
    AT_MOST(adrc, adrc, omega_o, CGL_R(2.0) / TS);
    TAKES(adrc, adrc, b, TINY);
    REFUSES(adrc, adrc, b, CGL_R(0.125) * TINY);
    REFUSES(adrc, adrc, b, CGL_R(0.5) * CGL_REAL_MAX); /* times the limit */

    const cgl_anti_cogging_config cogging = {.pi = pi, .cells = 64U, .speed = CGL_R(1.0), .revolutions = 2U};
    WHOLE(anti_cogging, cogging, cells, 4U, 65535U);
    WHOLE(anti_cogging, cogging, revolutions, 1U, 100U);

    const cgl_harmonic_config harmonic = {.pi = pi, .b = CGL_R(100.0), .base = 1U, .bends = 2U, .orders = 3U, .limit = CGL_R(3.0)};
    WHOLE(harmonic, harmonic, orders, 1U, CGL_HARMONIC_ORDERS);
    WHOLE(harmonic, harmonic, base, 1U, CGL_HARMONIC_ORDER_MAX / 3U);
    WHOLE(harmonic, harmonic, bends, 0U, 2U);
    WHOLE(harmonic, harmonic, fast, 0U, 3U);
    AT_MOST(harmonic, harmonic, delay, CGL_R(16.0) * TS);
    TAKES(harmonic, harmonic, held[CGL_HARMONIC_EDGES - 1U], CGL_R(0.5));
    REFUSES(harmonic, harmonic, held[0], CGL_R(-0.5));
    REFUSES(harmonic, harmonic, held[CGL_HARMONIC_EDGES - 1U], CGL_R(-0.5));
    REFUSES(harmonic, harmonic, b, TINY * TINY);

    cgl_pi_afc_config afc = {.pi = pi, .gain = CGL_R(1.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .orders = 1U};
    for (uint32_t k = 0; k < CGL_PI_AFC_ORDERS; ++k) {
        afc.order[k] = k + 1U;
    }
    WHOLE(pi_afc, afc, orders, 1U, CGL_PI_AFC_ORDERS);
    WHOLE(pi_afc, afc, order[0], 1U, CGL_PI_AFC_ORDER_MAX);
    afc.orders = 2U;
    afc.order[0] = 7U;
    WHOLE(pi_afc, afc, order[1], 8U, CGL_PI_AFC_ORDER_MAX);

    const cgl_robust_ilc_config robust = {.b = CGL_R(100.0), .eta = CGL_R(1.0), .limit = CGL_R(3.0),
                                          .memory = {.cells = 64U, .limit = {CGL_R(1.0)}}};
    WHOLE(robust_ilc, robust, memory.channels, 0U, 1U);
    TAKES(robust_ilc, robust, b, TINY);
    REFUSES(robust_ilc, robust, b, CGL_R(0.125) * TINY);
    REFUSES(robust_ilc, robust, b, CGL_R(0.5) * CGL_REAL_MAX);

    const cgl_space_position_config position = {.omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .memory = robust.memory};
    TAKES(space_position, position, index, CGL_SPACE_BY_ROTOR);
    REFUSES(space_position, position, index, (cgl_space_index)(CGL_SPACE_BY_ROTOR + 1));
    WHOLE(space_position, position, ratio, 0U, 65535U);
}

static void memories_of_laws(void)
{
    const cgl_memory_config map = {.channels = 3U, .cells = 64U, .limit = {CGL_R(1.0), CGL_R(1.0), CGL_R(1.0)}};
    WHOLE(memory, map, channels, 0U, (uint32_t)CGL_CHANNELS);
    WHOLE(memory, map, cells, 4U, CGL_CELLS_MAX);
    WHOLE(memory, map, turns, 0U, 65535U);
    WHOLE(memory, map, parts, 0U, 65535U);
    WHOLE(memory, map, q_half_width, 0U, 31U);
    WHOLE(memory, map, lead, 0U, 16U);
    AT_MOST(memory, map, forgetting, CGL_R(1.0));
    REFUSES(memory, map, limit[0], CGL_R(0.0));
    REFUSES(memory, map, limit[2], CGL_R(0.0));
    TAKES(memory, map, limit[2], CGL_R(0.499) * CGL_REAL_MAX);
    REFUSES(memory, map, limit[2], CGL_R(0.501) * CGL_REAL_MAX);
    cgl_memory_config one = map;
    one.channels = 0U;
    REFUSES(memory, one, limit[0], CGL_R(0.0));
    TAKES(memory, one, limit[1], CGL_R(0.0)); /* of a channel that is not there */
    cgl_memory_config filtered = map;
    filtered.q_half_width = 3U;
    TAKES(memory, filtered, limit[0], CGL_R(0.1249) * CGL_REAL_MAX);
    REFUSES(memory, filtered, limit[0], CGL_R(0.1251) * CGL_REAL_MAX);
    REFUSES(memory, map, kind, (cgl_memory_kind)(CGL_MEMORY_DELAY + 1));
    cgl_memory_config line = map;
    line.kind = CGL_MEMORY_DELAY;
    TAKES(memory, line, method, CGL_DELAY_INVERSION);
    REFUSES(memory, line, method, (cgl_delay_method)(CGL_DELAY_INVERSION + CGL_DELAY_ODE + 1));
    TAKES(memory, line, k_pp, LESS / TS);
    REFUSES(memory, line, k_pp, CGL_R(1.0) / TS);
    REFUSES(memory, line, k_pp, CGL_R(-1.0));
    WHOLE(memory, line, cells, 4U, CGL_SAMPLES_MAX);
    static cgl_real cell[3U * CGL_MEMORY_ROW(64U, 0U)];
    static const uint32_t ratio[] = {0U, 1U, 65535U, 65536U};
    for (uint32_t n = 0; n < 4U; ++n) {
        cgl_memory memory;
        CHECK(cgl_memory_init(&memory, &map, TS, ratio[n], cell, 3U * CGL_MEMORY_ROW(64U, 0U))
              == (n == 1U || n == 2U ? CGL_OK : CGL_ERROR_CONFIG));
    }
}

/* ---- a drive and its parts ---- */

static bool takes_current_reference(const cgl_current_reference_config *config)
{
    return cgl_current_reference_bad_field(config, CGL_R(8.0)) == 0;
}

static void drives(void)
{
    cgl_drive_config drive = {.pole_pairs = 4U, .divider = 8U,
                              .foc = {.kp_d = CGL_R(1.0), .kp_q = CGL_R(1.0), .current_limit = CGL_R(8.0)},
                              .quality = {.longest = CGL_R(1.0e5)}};
    WHOLE(drive, drive, pole_pairs, 1U, 10000U);
    WHOLE(drive, drive, divider, 1U, 65535U);
    TAKES(drive, drive, monitor.phases, 3U);
    REFUSES(drive, drive, monitor.phases, 2U);
    drive.foc.phases = 2U;
    TAKES(drive, drive, monitor.phases, 2U);
    REFUSES(drive, drive, monitor.phases, 3U);
    drive.foreign = true;
    TAKES(drive, drive, monitor.phases, 3U);
    TAKES(drive, drive, foc.current_limit, CGL_R(0.0));
    AT_MOST(drive, drive, foc.current_limit, CGL_CURRENT_MAX);

    const cgl_foc_config foc = {.current_limit = CGL_R(8.0)};
    AT_MOST(foc, foc, current_limit, CGL_CURRENT_MAX);
    PHASES(foc, foc, phases);

    const cgl_current_reference_config currents = {.L_d = CGL_R(1.0), .L_q = CGL_R(1.0), .psi_f = CGL_R(1.0)};
    AT_MOST(current_reference, currents, voltage_share, CGL_R(1.0));
    TAKES(current_reference, currents, L_q, CGL_R(1.0) + CGL_SALIENCY_MAX / CGL_R(8.0));
    REFUSES(current_reference, currents, L_q, CGL_R(1.1) + CGL_SALIENCY_MAX / CGL_R(8.0));
    TAKES(current_reference, currents, L_d, CGL_R(1.0) + CGL_SALIENCY_MAX / CGL_R(8.0));
    REFUSES(current_reference, currents, L_d, CGL_R(1.1) + CGL_SALIENCY_MAX / CGL_R(8.0));

    const cgl_dead_time_config dead_time = {.band = CGL_R(0.1)};
    AT_MOST(dead_time, dead_time, time, CGL_R(0.5) * TS);
    TAKES(dead_time, dead_time, band, TINY);
    REFUSES(dead_time, dead_time, band, CGL_R(0.125) * TINY);
    PHASES(dead_time, dead_time, phases);
    for (int n = 0; n < 2; ++n) { /* sums and products with the period that are numbers, and that are not */
        const cgl_real ts = n > 0 ? CGL_REAL_MAX : CGL_R(2.0);
        const cgl_dead_time_config lagging = {.band = CGL_R(0.1), .lag = CGL_REAL_MAX};
        const cgl_dead_time_config ahead = {.band = CGL_R(0.1), .advance = n > 0 ? CGL_R(1.5) : CGL_R(0.49) * CGL_REAL_MAX};
        cgl_dead_time any;
        CHECK(cgl_dead_time_init(&any, &lagging, ts) == (n > 0 ? CGL_ERROR_CONFIG : CGL_OK));
        CHECK(cgl_dead_time_init(&any, &ahead, ts) == (n > 0 ? CGL_ERROR_CONFIG : CGL_OK));
    }

    const cgl_monitor_config monitor = {.phases = 0U};
    AT_MOST(monitor, monitor, speed_window, CGL_R(1.0e9) * TS);
    AT_MOST(monitor, monitor, bridge, CGL_R(1.0e9) * TS);
    AT_MOST(monitor, monitor, hold, CGL_R(1.0e9) * TS);
    TAKES(monitor, monitor, stuck_time, CGL_R(9.0e7) * TS);
    REFUSES(monitor, monitor, stuck_time, CGL_R(9.1e7) * TS);
    PHASES(monitor, monitor, phases);
    CHECK(cgl_monitor_bad_field(&monitor, CGL_R(0.0)) != 0);

    const cgl_quality_config quality = {.longest = CGL_R(1.0)};
    AT_LEAST(quality, quality, longest, TS);
    AT_MOST(quality, quality, longest, CGL_R(1.0e9) * TS);
    AT_LEAST(quality, quality, outlier, CGL_R(1.0));
    TAKES(quality, quality, outlier, CGL_R(0.0));
    CHECK(cgl_quality_bad_field(&quality, CGL_R(0.0)) != 0);
}

/* ---- sensors and filters ---- */

static bool takes_hall(const cgl_hall_config *config)
{
    cgl_hall hall;
    return cgl_hall_init(&hall, config) == CGL_OK;
}

static bool takes_speed_timed(const cgl_speed_timed_config *config)
{
    cgl_speed_timed speed;
    return cgl_speed_timed_init(&speed, config) == CGL_OK;
}

static bool takes_microstepping(const cgl_microstepping_config *config)
{
    cgl_microstepping motor;
    return cgl_microstepping_init(&motor, config) == CGL_OK;
}

/* Bounds of a config whose init takes a length too are asked with all the memory that a length can tell. */
static bool takes_speed_count(const cgl_speed_count_config *config)
{
    static uint32_t before[1];
    cgl_speed_count speed;
    return cgl_speed_count_init(&speed, config, TS, before, 1U) != CGL_ERROR_CONFIG;
}

static void sensors(void)
{
    const cgl_encoder_config encoder = {.counts = 1000U, .range = 65536U, .zero = 1U};
    WHOLE(encoder, encoder, zero, 0U, 999U);
    TAKES(encoder, encoder, counts, 2U);
    TAKES(encoder, encoder, counts, UINT32_MAX);
    REFUSES(encoder, encoder, counts, 1U);
    TAKES(encoder, encoder, range, 0U);
    TAKES(encoder, encoder, range, 4U);
    REFUSES(encoder, encoder, range, 3U);
    REFUSES(encoder, encoder, range, 1U);
    const cgl_encoder_config absolute = {.counts = 1000U, .range = 1000U, .absolute = true};
    TAKES(encoder, absolute, range, 1000U);
    REFUSES(encoder, absolute, range, 1001U);

    const cgl_encoder_table_config table = {.orders = 2U, .order = {1U, 2U, 3U, 4U}, .gain = CGL_R(2.0), .omega_min = CGL_R(24.0),
                                            .bandwidth = CGL_R(2.0), .limit = CGL_R(0.0009765625)};
    WHOLE(encoder_table, table, orders, 1U, (uint32_t)CGL_ENCODER_TABLE_ORDERS);
    WHOLE(encoder_table, table, order[0], 1U, 1U);
    WHOLE(encoder_table, table, order[1], 2U, 1000U);
    AT_MOST(encoder_table, table, limit, CGL_R(0.5));
    AT_MOST(encoder_table, table, gain, CGL_R(0.1) / TS);
    AT_MOST(encoder_table, table, bandwidth, CGL_R(8.0));
    cgl_encoder_table_config later = table;
    later.order[0] = 2U;
    later.order[1] = 4U;
    AT_MOST(encoder_table, later, bandwidth, CGL_R(16.0));
    AT_MOST(encoder_table, later, limit, CGL_R(0.25));
    cgl_encoder_table slow; /* ten time constants are 1e9 steps at most */
    later.bandwidth = CGL_R(1.01e-8) / TS;
    CHECK(cgl_encoder_table_init(&slow, &later, TS) == CGL_OK);
    later.bandwidth = CGL_R(0.99e-8) / TS;
    CHECK(cgl_encoder_table_init(&slow, &later, TS) == CGL_ERROR_CONFIG);

    const cgl_hall_config hall = {.pole_pairs = 2U, .edges = 6U, .timer = CGL_R(1.0e6)};
    WHOLE(hall, hall, pole_pairs, 1U, 10000U);
    WHOLE(hall, hall, edges, 1U, (uint32_t)CGL_HALL_EDGES);
    const cgl_real fastest = CGL_REAL_MAX / CGL_TWO_PI; /* [turns/s] */
    TAKES(hall, hall, timer, LESS * CGL_R(0.75) * fastest); /* a twelfth of a turn in a tick, times 16 */
    REFUSES(hall, hall, timer, MORE * CGL_R(0.75) * fastest);

    const cgl_angle_observer_config observer = {CGL_R(10.0)};
    AT_MOST(angle_observer, observer, bandwidth, CGL_R(2.0) / TS);
    REFUSES(angle_observer, observer, bandwidth, CGL_R(0.0));
    cgl_angle_observer_config slower = {CGL_R(1.0e-3)};
    static const cgl_real period[] = {CGL_R(0.999e-9), CGL_R(1.0e-9), CGL_R(1.0e3), CGL_R(1.001e3)};
    for (uint32_t n = 0; n < 4U; ++n) {
        cgl_angle_observer any;
        CHECK(cgl_angle_observer_init(&any, &slower, period[n]) == (n == 1U || n == 2U ? CGL_OK : CGL_ERROR_CONFIG));
    }
    const cgl_low_pass_config filter = {CGL_R(10.0)};
    AT_MOST(low_pass, filter, bandwidth, CGL_R(2.0) / TS);
    REFUSES(low_pass, filter, bandwidth, CGL_R(0.0));

    cgl_dead_time dead_time; /* a period that is none */
    cgl_encoder_table table_of_none;
    cgl_guard guard;
    cgl_low_pass low_pass;
    const cgl_dead_time_config bridge = {.band = CGL_R(0.1)};
    CHECK(cgl_dead_time_init(&dead_time, &bridge, CGL_R(0.0)) == CGL_ERROR_CONFIG);
    CHECK(cgl_encoder_table_init(&table_of_none, &table, CGL_R(0.0)) == CGL_ERROR_CONFIG);
    CHECK(cgl_guard_init(&guard, CGL_R(0.0)) == CGL_ERROR_CONFIG && cgl_guard_init(&guard, TS) == CGL_OK);
    CHECK(cgl_low_pass_init(&low_pass, &filter, CGL_R(0.0)) == CGL_ERROR_CONFIG);
    const cgl_speed_count_config counted = {.counts = 4096U, .window = 1U};
    WHOLE(speed_count, counted, window, 1U, 1048576U);
    TAKES(speed_count, counted, counts, 1U);
    TAKES(speed_count, counted, counts, UINT32_MAX);
    REFUSES(speed_count, counted, counts, 0U);
    const cgl_speed_timed_config timed = {.counts = 4096U, .timer = CGL_R(1.0e6)};
    TAKES(speed_timed, timed, counts, 1U);
    TAKES(speed_timed, timed, counts, UINT32_MAX);
    REFUSES(speed_timed, timed, counts, 0U);
    REFUSES(speed_timed, timed, timer, CGL_R(0.0));
    TAKES(speed_timed, timed, timer, LESS * fastest * CGL_R(0.0000019073486328125)); /* 2^31 edges in a tick, 2^19 turns */
    REFUSES(speed_timed, timed, timer, MORE * fastest * CGL_R(0.0000019073486328125));
    for (int n = 0; n < 2; ++n) { /* 2^31 counts in a period, 2^19 turns */
        static uint32_t one[1];
        const cgl_real ts = (n > 0 ? LESS : MORE) * CGL_R(524288.0) / fastest;
        cgl_speed_count speed;
        CHECK(cgl_speed_count_init(&speed, &counted, ts, one, 1U) == (n > 0 ? CGL_ERROR_CONFIG : CGL_OK));
    }

    cgl_microstepping_config steps = {.teeth = 50U, .current = CGL_R(1.0)};
    steps.forward[0].magnitude = steps.backward[0].magnitude = CGL_R(0.0000076293945); /* 2^-17: half the slope at 65536 */
    steps.forward[CGL_MICROSTEPPING_WAVES - 1].order = steps.backward[CGL_MICROSTEPPING_WAVES - 1].order = 4U;
    WHOLE(microstepping, steps, teeth, 1U, 65535U);
    TAKES(microstepping, steps, microsteps, 0U);
    TAKES(microstepping, steps, microsteps, 1U);
    TAKES(microstepping, steps, microsteps, (uint32_t)CGL_MICROSTEPS_MAX);
    REFUSES(microstepping, steps, microsteps, 2U * (uint32_t)CGL_MICROSTEPS_MAX);
    REFUSES(microstepping, steps, microsteps, 96U);
    WHOLE(microstepping, steps, forward[0].order, 0U, 65535U);
    WHOLE(microstepping, steps, backward[0].order, 0U, 65535U);
    TAKES(microstepping, steps, forward[CGL_MICROSTEPPING_WAVES - 1].magnitude, CGL_R(0.2499));
    REFUSES(microstepping, steps, forward[CGL_MICROSTEPPING_WAVES - 1].magnitude, CGL_R(0.25));
    REFUSES(microstepping, steps, forward[CGL_MICROSTEPPING_WAVES - 1].magnitude, CGL_R(-0.1));
    REFUSES(microstepping, steps, backward[CGL_MICROSTEPPING_WAVES - 1].magnitude, CGL_R(0.25));
    REFUSES(microstepping, steps, backward[CGL_MICROSTEPPING_WAVES - 1].phase, CGL_ANGLE_MAX);
}

/* ---- trials ---- */

static bool takes_trial(const cgl_trial_config *config)
{
    static cgl_real memory[CGL_TRIAL_LENGTH(64U, 4U)];
    cgl_trial law;
    return cgl_trial_init(&law, config, memory, CGL_ENTRIES(memory)) != CGL_ERROR_CONFIG;
}

static bool takes_feedforward(const cgl_feedforward_config *config)
{
    cgl_feedforward feedforward;
    return cgl_feedforward_init(config, &feedforward) == CGL_OK;
}

static void trials(void)
{
    cgl_trial_config trial = {.samples = 64U, .states = 1U, .n = CGL_R(2.0), .c = {CGL_R(1.0)}, .k_3 = CGL_R(0.1), .shift = 1U,
                              .limit = CGL_R(1.0), .learned_limit = CGL_R(1.0)};
    WHOLE(trial, trial, samples, 2U, 16777216U);
    WHOLE(trial, trial, states, 1U, (uint32_t)CGL_TRIAL_STATES);
    WHOLE(trial, trial, shift, 1U, 63U);
    TAKES(trial, trial, learned_limit, CGL_R(0.499) * CGL_REAL_MAX);
    REFUSES(trial, trial, learned_limit, CGL_R(0.501) * CGL_REAL_MAX);
    REFUSES(trial, trial, limit, CGL_R(0.0));
    REFUSES(trial, trial, learned_limit, CGL_R(0.0));
    REFUSES(trial, trial, k_2, (cgl_real)NAN);
    REFUSES(trial, trial, k_3, (cgl_real)NAN);
    REFUSES(trial, trial, n, (cgl_real)NAN);
    REFUSES(trial, trial, k_1[0], (cgl_real)NAN);
    REFUSES(trial, trial, c[0], (cgl_real)NAN);
    TAKES(trial, trial, k_1[1], (cgl_real)NAN); /* of a state that is not there */
    trial.shift = 2U;
    trial.observer.response = CGL_R(0.1);
    TAKES(trial, trial, observer.pole, CGL_R(0.0));
    TAKES(trial, trial, observer.pole, LESS);
    REFUSES(trial, trial, observer.pole, CGL_R(1.0));
    REFUSES(trial, trial, observer.pole, CGL_R(-0.1));
    REFUSES(trial, trial, observer.response, CGL_R(-0.1));
    REFUSES(trial, trial, observer.response, CGL_R(0.125) * TINY);
    REFUSES(trial, trial, k_2, CGL_R(0.1));
    TAKES(trial, trial, observer.response, CGL_REAL_MAX); /* times the limit of 1 */
    cgl_trial_config wider = trial;
    wider.limit = CGL_R(2.0);
    REFUSES(trial, wider, observer.response, CGL_R(0.501) * CGL_REAL_MAX);
    WHOLE(trial, trial, shift, 2U, 2U);

    const cgl_feedforward_config feedforward = {.numerator = 1U, .denominator = 1U, .num = {CGL_R(1.0)}, .den = {CGL_R(1.0)}};
    WHOLE(feedforward, feedforward, numerator, 0U, (uint32_t)CGL_FEEDFORWARD_TAPS);
    WHOLE(feedforward, feedforward, denominator, 1U, (uint32_t)CGL_FEEDFORWARD_TAPS);
    WHOLE(feedforward, feedforward, preview, 0U, 65535U);
    cgl_feedforward_config longest = feedforward;
    longest.numerator = longest.denominator = CGL_FEEDFORWARD_TAPS;
    REFUSES(feedforward, longest, num[CGL_FEEDFORWARD_TAPS - 1], (cgl_real)NAN);
    TAKES(feedforward, longest, den[CGL_FEEDFORWARD_TAPS - 1], LESS);
    REFUSES(feedforward, longest, den[CGL_FEEDFORWARD_TAPS - 1], CGL_R(1.0));
    REFUSES(feedforward, longest, den[0], MORE);
    REFUSES(feedforward, longest, den[0], LESS);

    cgl_zero_phase_config filter = {.order = 1U, .b = {CGL_R(0.5), CGL_R(0.5)}, .a = {CGL_R(1.0)}};
    for (uint32_t order = 1U; order <= (uint32_t)CGL_ZERO_PHASE_ORDER + 1U; ++order) { /* samples beyond those of the reflection */
        filter.order = order;
        const bool known = order <= (uint32_t)CGL_ZERO_PHASE_ORDER;
        CHECK(cgl_zero_phase_init(&filter, 3U * (order + 1U) + 1U) == (known ? CGL_OK : CGL_ERROR_CONFIG));
        CHECK(cgl_zero_phase_init(&filter, 3U * (order + 1U)) == CGL_ERROR_CONFIG);
    }
    filter.order = 1U;
    filter.a[1] = CGL_R(1.0);
    CHECK(cgl_zero_phase_init(&filter, 64U) == CGL_ERROR_CONFIG);
}

/* ---- memory of the caller ---- */

/* Memory that is not there, or not aligned, or of another length than the config needs, is refused as memory. */
#define OWN_MEMORY(law, config, length)                                                                                \
    do {                                                                                                               \
        static cgl_##law state;                                                                                        \
        static cgl_real cell[512];                                                                                     \
        cgl_real *const odd = (cgl_real *)(void *)((char *)cell + 1);                                                  \
        CHECK(cgl_##law##_init(&state, &(config), &loop, cell, (length)) == CGL_OK);                                   \
        CHECK(cgl_##law##_init(&state, &(config), &loop, cell, (length) - 1U) == CGL_ERROR_MEMORY);                    \
        CHECK(cgl_##law##_init(&state, &(config), &loop, cell, (length) + 1U) == CGL_ERROR_MEMORY);                    \
        CHECK(cgl_##law##_init(&state, &(config), &loop, NULL, (length)) == CGL_ERROR_MEMORY);                         \
        CHECK(cgl_##law##_init(&state, &(config), &loop, odd, (length)) == CGL_ERROR_MEMORY);                          \
    } while (false)

static void lengths(void)
{
    const cgl_pi_config pi = {CGL_R(0.1), CGL_R(1.0), CGL_R(3.0)};
    const cgl_memory_config map = {.channels = 1U, .cells = 64U, .q_half_width = 2U, .limit = {CGL_R(1.0)}};
    const cgl_pi_ilc_config ilc = {.pi = pi, .gain = CGL_R(0.05), .memory = map};
    const cgl_robust_ilc_config robust = {.b = CGL_R(100.0), .eta = CGL_R(1.0), .limit = CGL_R(3.0), .memory = map};
    const cgl_space_position_config position = {.omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .memory = map};
    const cgl_space_speed_config speed = {.eta_bar = CGL_R(9.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .memory = map};
    const cgl_anti_cogging_config cogging = {.pi = pi, .cells = 64U, .speed = CGL_R(1.0), .revolutions = 2U};
    const cgl_harmonic_config harmonic = {.pi = pi, .b = CGL_R(100.0), .base = 1U, .orders = 3U, .limit = CGL_R(3.0)};
    const cgl_pi_afc_config afc = {.pi = pi, .gain = CGL_R(1.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .orders = 2U, .order = {1U, 3U}};
    OWN_MEMORY(pi_ilc, ilc, CGL_MEMORY_ROW(64U, 2U));
    OWN_MEMORY(robust_ilc, robust, CGL_MEMORY_ROW(64U, 2U));
    OWN_MEMORY(space_position, position, CGL_MEMORY_ROW(64U, 2U));
    OWN_MEMORY(space_speed, speed, CGL_MEMORY_ROW(64U, 2U));
    OWN_MEMORY(anti_cogging, cogging, 64U);
    OWN_MEMORY(harmonic, harmonic, CGL_HARMONIC_LENGTH(3U));
    OWN_MEMORY(pi_afc, afc, CGL_PI_AFC_LENGTH(2U));

    static uint32_t before[8];
    const cgl_speed_count_config counted = {.counts = 4096U, .window = 8U};
    cgl_speed_count count;
    CHECK(cgl_speed_count_init(&count, &counted, TS, before, 8U) == CGL_OK);
    CHECK(cgl_speed_count_init(&count, &counted, TS, before, 7U) == CGL_ERROR_MEMORY);
    CHECK(cgl_speed_count_init(&count, &counted, TS, NULL, 8U) == CGL_ERROR_MEMORY);
    CHECK(cgl_speed_count_init(&count, &counted, CGL_R(0.0), before, 8U) == CGL_ERROR_CONFIG);

    static cgl_real signals[CGL_TRIAL_LENGTH(16U, 1U)];
    cgl_trial_config trial = {.samples = 16U, .states = 1U, .c = {CGL_R(1.0)}, .k_3 = CGL_R(0.1), .shift = 1U, .limit = CGL_R(1.0),
                              .learned_limit = CGL_R(1.0)};
    cgl_trial law;
    for (uint32_t order = 0; order < 2U; ++order) { /* three signals, the filter's own, and with no guard one signal less */
        trial.q_filter = (cgl_zero_phase_config){.order = order, .b = {CGL_R(0.5), CGL_R(0.5)}, .a = {CGL_R(1.0)}};
        for (uint32_t unguarded = 0; unguarded < 2U; ++unguarded) {
            const uint32_t length = 16U * (3U + order - unguarded);
            trial.unguarded = unguarded > 0U;
            CHECK(cgl_trial_init(&law, &trial, signals, length) == CGL_OK);
            CHECK(cgl_trial_init(&law, &trial, signals, length - 1U) == CGL_ERROR_MEMORY);
            CHECK(cgl_trial_init(&law, &trial, NULL, length) == CGL_ERROR_MEMORY);
        }
    }
}

/* ---- stored maps ---- */

typedef cgl_map cgl_map_config; /* a map is its own config */
static bool takes_map(const cgl_map_config *map)
{
    return cgl_map_is_valid(map);
}

static bool takes_map_store(const cgl_map_store_config *config)
{
    static uint8_t buffer[CGL_MAP_WRITE_MAX];
    cgl_map_store store;
    return cgl_map_store_init(&store, config, buffer, sizeof buffer) == CGL_OK;
}

static void maps(void)
{
    static cgl_real entry[1];
    const cgl_map map = {.entry = entry, .stride = 64U, .cells = 64U, .channels = 3U, .turns = 1U, .parts = 1U, .ratio = 1U,
                         .limit = {CGL_R(1.0), CGL_R(1.0), CGL_R(1.0)}};
    WHOLE(map, map, cells, 1U, 64U);
    TAKES(map, map, stride, 64U);
    REFUSES(map, map, stride, 63U);
    WHOLE(map, map, channels, 1U, (uint32_t)CGL_MAP_CHANNELS);
    WHOLE(map, map, ratio, 1U, 65535U);
    WHOLE(map, map, law, 0U, 255U);
    WHOLE(map, map, unit[2], 0U, 255U);
    REFUSES(map, map, turns, 0U);
    REFUSES(map, map, parts, 0U);
    REFUSES(map, map, entry, NULL);
    REFUSES(map, map, limit[2], CGL_R(0.0));
    TAKES(map, map, limit[2], (cgl_real)3.402823466e38);
    cgl_map longest = map;
    longest.stride = UINT32_MAX;
    longest.turns = longest.parts = 0U; /* as of a trial */
    WHOLE(map, longest, cells, 1U, CGL_MAP_CELLS_MAX);

    flash all;
    flash_clear(&all, 1U);
    cgl_map_store_config store = flash_config(&all, 1U);
    store.slot_size = CGL_MAP_STORED_LENGTH(1U, 1U, CGL_MAP_WRITE_MAX);
    TAKES(map_store, store, write_size, 1U);
    TAKES(map_store, store, write_size, CGL_MAP_WRITE_MAX);
    REFUSES(map_store, store, write_size, 0U);
    REFUSES(map_store, store, write_size, 24U);
    REFUSES(map_store, store, write_size, 2U * CGL_MAP_WRITE_MAX);
    TAKES(map_store, store, slot_size, CGL_MAP_STORED_LENGTH(1U, 1U, 1U));
    REFUSES(map_store, store, slot_size, CGL_MAP_STORED_LENGTH(1U, 1U, 1U) - 1U);
    REFUSES(map_store, store, erase, NULL);
    REFUSES(map_store, store, write, NULL);
    REFUSES(map_store, store, read, NULL);
}

void bounds(void)
{
    laws();
    memories_of_laws();
    drives();
    sensors();
    trials();
    lengths();
    maps();
}
