#include "faces.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "check.h"
#include "cogless/adrc.h"
#include "cogless/anti_cogging.h"
#include "cogless/calibration.h"
#include "cogless/current_reference.h"
#include "cogless/drive.h"
#include "cogless/harmonic.h"
#include "cogless/pi_afc.h"
#include "cogless/map.h"
#include "cogless/microstepping.h"
#include "cogless/pi_ilc.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/speed_pi.h"
#include "cogless/square_root.h"
#include "cogless/trial.h"

#ifdef COGLESS_NO_TEXTS
#define IS_NAMED(field, name) ((field) != NULL)
#else
#define IS_NAMED(field, name) ((field) != NULL && strcmp((field), (name)) == 0)
#endif

static const cgl_loop guarded_loop = {.ts = CGL_R(1.0e-3), .current_limit = CGL_R(3.0), .guarded = true};
CGL_MAP(map, 64U, 2U);

static cgl_drive_config some_drive(void)
{
    const cgl_drive_config config = {.pole_pairs = 4U, .divider = 10U,
                                     .foc = {.kp_d = CGL_R(1.0), .kp_q = CGL_R(1.0), .current_limit = CGL_R(3.0)}};
    return config;
}

static cgl_pi_ilc_config some_law(void)
{
    const cgl_pi_ilc_config config = {.pi = {CGL_R(0.1), CGL_R(1.0), CGL_R(3.0)}, .gain = CGL_R(0.05),
                                      .memory = {.cells = 64U, .q_half_width = 2U, .limit = {CGL_R(1.0)}}};
    return config;
}

/* ---- a state that no init made gives a fault and no current ---- */

static const cgl_law_input turning = {.omega_ref = CGL_R(10.0), .omega_m = CGL_R(9.0), .theta_m = CGL_R(1.0), .theta_ref = CGL_R(1.0),
                                      .learn = true};

static void check_refused(const cgl_law_output *out)
{
    const unsigned expected = (unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_OFF | (unsigned)CGL_STATUS_FROZEN;
    CHECK(within(out->i_q_ref, CGL_R(0.0)) && out->status == expected);
}

#define CHECK_UNMADE(name, state)                                                                                      \
    do {                                                                                                               \
        static state law;                                                                                              \
        static const int bytes[] = {0, 0xA5, 0xFF};                                                                    \
        for (int n = 0; n < 3; ++n) {                                                                                  \
            cgl_law_output out = {CGL_R(9.0), 0U};                                                                     \
            memset(&law, bytes[n], sizeof law);                                                                        \
            cgl_##name##_step(&law, &turning, &out);                                                                   \
            check_refused(&out);                                                                                       \
        }                                                                                                              \
    } while (false)

static void unmade_states(void)
{
    CHECK_UNMADE(speed_pi, cgl_pi);
    CHECK_UNMADE(adrc, cgl_adrc);
    CHECK_UNMADE(pi_ilc, cgl_pi_ilc);
    CHECK_UNMADE(robust_ilc, cgl_robust_ilc);
    CHECK_UNMADE(anti_cogging, cgl_anti_cogging);
    CHECK_UNMADE(pi_afc, cgl_pi_afc);
    CHECK_UNMADE(harmonic, cgl_harmonic);
    CHECK_UNMADE(space_position, cgl_space_position);
    CHECK_UNMADE(space_speed, cgl_space_speed);
    static cgl_microstepping motor;
    cgl_microstepping_output out = {CGL_R(9.0), CGL_R(9.0), 0U};
    cgl_microstepping_step(&motor, CGL_R(1.0), CGL_R(1.0), &out);
    CHECK(within(out.i_a, CGL_R(0.0)) && within(out.i_b, CGL_R(0.0)));
    CHECK(out.status == ((unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_OFF));
}

/* Parts of a drive that were initialised, and then refused. */
static void refused_parts(void)
{
    cgl_drive drive;
    cgl_drive_config config = some_drive();
    const cgl_measurement now = {.u_dc = CGL_R(24.0)};
    const cgl_reference reference = {.omega_ref = CGL_R(10.0)};
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK && cgl_drive_measure(&drive, &now, &reference));
    config.divider = 0U;
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_ERROR_CONFIG && !cgl_drive_measure(&drive, &now, &reference));
    cgl_microstepping motor;
    cgl_microstepping_config steps = {.teeth = 50U, .current = CGL_R(1.0)};
    cgl_microstepping_output out;
    CHECK(cgl_microstepping_init(&motor, &steps) == CGL_OK);
    cgl_microstepping_step(&motor, CGL_R(0.0), CGL_R(1.0), &out);
    CHECK(within(out.i_a - CGL_R(1.0), CGL_R(1.0e-3)) && out.status == 0U);
    steps.teeth = 0U;
    CHECK(cgl_microstepping_init(&motor, &steps) == CGL_ERROR_CONFIG);
    cgl_microstepping_step(&motor, CGL_R(0.0), CGL_R(1.0), &out);
    CHECK(within(out.i_a, CGL_R(0.0)) && (out.status & (unsigned)CGL_STATUS_OFF) != 0U);
}

static void unmade_drive(void)
{
    static cgl_drive drive;
    static const int bytes[] = {0, 0xA5, 0xFF};
    const cgl_measurement now = {.u_dc = CGL_R(24.0)};
    const cgl_reference reference = {.omega_ref = CGL_R(10.0), .learn = true};
    for (int n = 0; n < 3; ++n) {
        cgl_drive_output out;
        memset(&drive, bytes[n], sizeof drive);
        CHECK(!cgl_drive_measure(&drive, &now, &reference));
        cgl_drive_actuate(&drive, &out);
        CHECK(are_duties(out.duty) && within(out.i_q_ref, CGL_R(0.0)) && within(out.u_q, CGL_R(0.0)));
        CHECK((out.status & (unsigned)CGL_STATUS_OFF) != 0U && (out.status & (unsigned)CGL_STATUS_FAULT) != 0U);
    }
}

/* A law that was initialised, and then refused, is none. */
static void refused_again(void)
{
    cgl_pi_ilc law;
    cgl_pi_ilc_config config = some_law();
    cgl_law_output out;
    CHECK(cgl_pi_ilc_init(&law, &config, &guarded_loop, map, CGL_ENTRIES(map)) == CGL_OK);
    cgl_pi_ilc_step(&law, &turning, &out);
    CHECK((out.status & (unsigned)CGL_STATUS_FAULT) == 0U);
    config.gain = CGL_R(-1.0);
    CHECK(cgl_pi_ilc_init(&law, &config, &guarded_loop, map, CGL_ENTRIES(map)) == CGL_ERROR_CONFIG);
    cgl_pi_ilc_step(&law, &turning, &out);
    check_refused(&out);
    config = some_law();
    CHECK(cgl_pi_ilc_init(&law, &config, &guarded_loop, map, (uint32_t)sizeof map) == CGL_ERROR_MEMORY);
    cgl_pi_ilc_step(&law, &turning, &out);
    check_refused(&out);
}

/* ---- what is refused is named ---- */

static void names_of_the_drive(void)
{
    const cgl_real ts = CGL_R(1.0e-4);
    cgl_drive_config config = some_drive();
    CHECK(cgl_drive_bad_field(&config, ts) == NULL);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, CGL_R(0.0)), "ts"));
    config.foc.current_limit = CGL_R(1.0e6);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "foc.current_limit"));
    config = some_drive();
    config.foreign = true; /* foreign firmware need not tell its limit */
    config.foc.current_limit = CGL_R(0.0);
    CHECK(cgl_drive_bad_field(&config, ts) == NULL);
    config.foc.current_limit = CGL_R(-1.0);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "foc.current_limit"));
    config = some_drive();
    config.foc.kp_q = CGL_R(-1.0);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "foc.kp_q"));
    config = some_drive();
    config.monitor.bridge = CGL_R(-1.0);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "monitor.bridge"));
    config = some_drive();
    config.monitor.phases = 2U;
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "monitor.phases"));
    config = some_drive();
    config.quality.outlier = CGL_R(0.5);
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "quality.outlier"));
    config = some_drive();
    config.divider = 0U;
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "drive.divider"));
    config = some_drive();
    config.feed_forward = true; /* beside a current loop of our own */
    CHECK(IS_NAMED(cgl_drive_bad_field(&config, ts), "drive.feed_forward"));
}

/* A law that is initialised after a retune of the drive is told of the new limit. */
static void another_limit(void)
{
    cgl_drive drive;
    cgl_drive_config config = some_drive();
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK);
    config.foc.current_limit *= CGL_R(0.5);
    CHECK(cgl_drive_retune(&drive, &config) == CGL_OK);
    CHECK(cgl_abs(drive.loop.current_limit - config.foc.current_limit) <= CGL_R(0.0));
}

/* Beside a foreign current loop the output is a reference of the current. Voltages and duties are those of a drive at rest, whatever
 * stood there before. */
static void reference_of_a_foreign_loop(void)
{
    cgl_drive drive;
    cgl_drive_config config = some_drive();
    config.foreign = true;
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK);
    const cgl_measurement now = {.u_dc = CGL_R(24.0)};
    const cgl_reference reference = {.omega_ref = CGL_R(10.0)};
    CHECK(cgl_drive_measure(&drive, &now, &reference));
    drive.command.i_q_ref = CGL_R(0.5);
    cgl_drive_output out;
    memset(&out, 0xA5, sizeof out);
    cgl_drive_actuate(&drive, &out);
    CHECK(within(out.i_q_ref - CGL_R(0.5), CGL_R(0.0)) && within(out.i_d_ref, CGL_R(0.0)));
    CHECK(within(out.u_d, CGL_R(0.0)) && within(out.u_q, CGL_R(0.0)) && within(out.i_d, CGL_R(0.0)) && within(out.i_q, CGL_R(0.0)));
    for (int x = 0; x < 3; ++x) {
        CHECK(within(out.duty[x] - CGL_R(0.5), CGL_R(0.0)));
    }
}

/* The mean is taken from each centred channel, and nothing else is written. */
static void centre_of_a_map(void)
{
    cgl_real entry[2][5];
    const cgl_map two_channels = {.entry = entry[0], .stride = 5U, .cells = 4U, .channels = 2U, .limit = {CGL_R(1.0), CGL_R(1.0)},
                                  .centred = 1U};
    for (uint32_t n = 0; n < 5U; ++n) {
        entry[0][n] = entry[1][n] = CGL_R(0.125) * (cgl_real)n;
    }
    cgl_map_centre(&two_channels);
    for (uint32_t n = 0; n < 5U; ++n) {
        const cgl_real before = CGL_R(0.125) * (cgl_real)n;
        CHECK(within(entry[0][n] - before + (n < 4U ? CGL_R(0.1875) : CGL_R(0.0)), CGL_R(1.0e-7)));
        CHECK(within(entry[1][n] - before, CGL_R(0.0)));
    }
}

/* The first sample that a trial's input can reach is the next one. */
static void trials_without_a_delay(void)
{
    static cgl_real memory[CGL_TRIAL_LENGTH(8U, 0U)];
    cgl_trial law;
    cgl_trial_config config = {.samples = 8U, .states = 1U, .c = {CGL_R(1.0)}, .k_3 = CGL_R(0.1), .shift = 1U, .limit = CGL_R(1.0),
                               .learned_limit = CGL_R(1.0)};
    CHECK(cgl_trial_init(&law, &config, memory, CGL_ENTRIES(memory)) == CGL_OK);
    config.shift = 0U;
    CHECK(cgl_trial_init(&law, &config, memory, CGL_ENTRIES(memory)) == CGL_ERROR_CONFIG);
    config.shift = 8U;
    CHECK(cgl_trial_init(&law, &config, memory, CGL_ENTRIES(memory)) == CGL_ERROR_CONFIG);
}

/* All of a learning matrix is read before it is taken, and nothing behind it. */
static void matrix_of_a_trial(void)
{
    static cgl_real memory[CGL_TRIAL_LENGTH(4U, 0U)], matrix[4U * 4U + 4U];
    cgl_trial law;
    const cgl_trial_config config = {.samples = 4U, .states = 1U, .c = {CGL_R(1.0)}, .k_3 = CGL_R(0.1), .shift = 1U, .limit = CGL_R(1.0),
                                     .learned_limit = CGL_R(1.0), .learning_matrix = matrix};
    for (uint32_t i = 0; i < CGL_ENTRIES(matrix); ++i) {
        matrix[i] = i < 16U ? CGL_R(0.1) : (cgl_real)NAN;
    }
    CHECK(cgl_trial_init(&law, &config, memory, CGL_ENTRIES(memory)) == CGL_OK);
    matrix[15] = (cgl_real)NAN;
    CHECK(cgl_trial_init(&law, &config, memory, CGL_ENTRIES(memory)) == CGL_ERROR_CONFIG);
}

static void names_of_a_law(void)
{
    cgl_pi_ilc_config config = some_law();
    CHECK(cgl_pi_ilc_bad_field(&config, &guarded_loop) == NULL);
    config.pi.limit = CGL_R(1.0e6);
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &guarded_loop), "pi.limit"));
    config = some_law();
    config.memory.limit[0] = CGL_R(1.0e6);
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &guarded_loop), "memory.limit"));
    config = some_law();
    config.memory.cells = 3U;
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &guarded_loop), "memory.cells"));
    config = some_law();
    config.gain = CGL_R(-1.0);
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &guarded_loop), "pi_ilc.gain"));
    cgl_loop loop = guarded_loop;
    loop.ts = CGL_R(0.0);
    config = some_law();
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &loop), "loop.ts"));
}

/* What the guard bounds by a feedback of 0 never learns: it is refused, or it is said in the status. */
static void gains_of_nothing(void)
{
    cgl_pi_ilc law;
    cgl_pi_ilc_config config = some_law();
    config.pi.kp = CGL_R(0.0);
    CHECK(IS_NAMED(cgl_pi_ilc_bad_field(&config, &guarded_loop), "pi.kp"));
    cgl_loop unguarded = guarded_loop;
    unguarded.guarded = false;
    CHECK(cgl_pi_ilc_bad_field(&config, &unguarded) == NULL);
    config = some_law();
    config.gain = CGL_R(0.0);
    CHECK(cgl_pi_ilc_init(&law, &config, &guarded_loop, map, CGL_ENTRIES(map)) == CGL_OK);
    for (int n = 0; n < 100; ++n) {
        cgl_law_output out;
        cgl_law_input in = turning;
        in.theta_m = CGL_R(0.02) * (cgl_real)n;
        cgl_pi_ilc_step(&law, &in, &out);
        CHECK((out.status & (unsigned)CGL_STATUS_FROZEN) != 0U);
    }
    const cgl_robust_ilc_config robust = {.b = CGL_R(100.0), .q = CGL_R(1.0), .beta_2 = CGL_R(1.0), .limit = CGL_R(3.0),
                                          .memory = {.cells = 64U, .limit = {CGL_R(1.0)}}};
    CHECK(IS_NAMED(cgl_robust_ilc_bad_field(&robust, &guarded_loop), "robust_ilc.eta"));
    const cgl_space_speed_config space = {.mu_alpha = CGL_R(1.0), .eta_bar = CGL_R(9.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0),
                                          .memory = {.cells = 62U, .q_half_width = 2U, .limit = {CGL_R(1.0)}}};
    cgl_space_speed by_angle; /* the first step leaves its gain as proven, later ones nothing of it */
    static cgl_real cells[65];
    CHECK(cgl_space_speed_init(&by_angle, &space, &guarded_loop, cells, 65U) == CGL_OK);
    for (int n = 0; n < 200; ++n) {
        cgl_law_output out;
        cgl_law_input in = turning;
        in.theta_m = CGL_R(0.02) * (cgl_real)n;
        in.gentle = n < 100 ? 1U : 3U;
        cgl_space_speed_step(&by_angle, &in, &out);
        CHECK(n == 0 || n == 100 || ((out.status & (unsigned)CGL_STATUS_FROZEN) != 0U) == (n > 100) || n < 10);
    }
}

/* Every law opens with the same check: of the loop, of its limit against that of the loop, and of a foreign feedback if it needs its
 * own. `bound` is the limit, and `text` its name. */
#define CHECK_OPENING(name, config, bound, text, needs_own)                                                            \
    do {                                                                                                               \
        cgl_##name##_config other = (config);                                                                          \
        cgl_loop loop = guarded_loop;                                                                                  \
        CHECK(cgl_##name##_bad_field(&other, &loop) == NULL);                                                          \
        loop.feed_forward = true;                                                                                      \
        const char *const refused = cgl_##name##_bad_field(&other, &loop);                                             \
        CHECK((needs_own) ? IS_NAMED(refused, "loop.feed_forward") : refused == NULL);                                 \
        loop.feed_forward = false;                                                                                     \
        loop.ts = CGL_R(0.0);                                                                                          \
        CHECK(IS_NAMED(cgl_##name##_bad_field(&other, &loop), "loop.ts"));                                             \
        loop.ts = guarded_loop.ts;                                                                                     \
        loop.current_limit = CGL_R(-3.0);                                                                              \
        CHECK(IS_NAMED(cgl_##name##_bad_field(&other, &loop), "loop.current_limit"));                                  \
        loop.current_limit = CGL_R(2.99);                                                                              \
        CHECK(IS_NAMED(cgl_##name##_bad_field(&other, &loop), (text)));                                                \
        other.bound = CGL_R(2.99);                                                                                     \
        CHECK(cgl_##name##_bad_field(&other, &loop) == NULL);                                                          \
        other.bound = CGL_R(0.0);                                                                                      \
        CHECK(IS_NAMED(cgl_##name##_bad_field(&other, &loop), (text)));                                                \
    } while (false)

/* What a law's part refuses, the law names and its retune refuses too. */
#define CHECK_PART(name, config, field, value, text, ...)                                                              \
    do {                                                                                                               \
        static cgl_##name law;                                                                                         \
        cgl_##name##_config other = (config);                                                                          \
        CHECK(cgl_##name##_init(&law, &other, &guarded_loop, __VA_ARGS__) == CGL_OK);                                  \
        CHECK(cgl_##name##_retune(&law, &other) == CGL_OK);                                                            \
        other.field = (value);                                                                                         \
        CHECK(IS_NAMED(cgl_##name##_bad_field(&other, &guarded_loop), (text)));                                        \
        CHECK(cgl_##name##_retune(&law, &other) == CGL_ERROR_CONFIG);                                                  \
    } while (false)

/* A law that was initialised, and then refused for its limit, does not step. */
#define CHECK_REFUSED(name, step, config, bound, ...)                                                                  \
    do {                                                                                                               \
        static cgl_##name law;                                                                                         \
        cgl_##name##_config other = (config);                                                                          \
        cgl_law_output out;                                                                                            \
        CHECK(cgl_##name##_init(&law, &other, __VA_ARGS__) == CGL_OK);                                                 \
        cgl_##step##_step(&law, &turning, &out);                                                                       \
        CHECK((out.status & (unsigned)CGL_STATUS_OFF) == 0U);                                                          \
        other.bound = CGL_R(0.0);                                                                                      \
        CHECK(cgl_##name##_init(&law, &other, __VA_ARGS__) == CGL_ERROR_CONFIG);                                       \
        cgl_##step##_step(&law, &turning, &out);                                                                       \
        check_refused(&out);                                                                                           \
    } while (false)

static void opening_checks(void)
{
    const cgl_memory_config memory = {.cells = 64U, .limit = {CGL_R(1.0)}};
    const cgl_pi_config pi = {CGL_R(0.1), CGL_R(1.0), CGL_R(3.0)};
    const cgl_adrc_config adrc = {CGL_R(100.0), CGL_R(20.0), CGL_R(100.0), CGL_R(3.0)};
    const cgl_robust_ilc_config robust = {.b = CGL_R(100.0), .eta = CGL_R(1.0), .limit = CGL_R(3.0), .memory = memory};
    const cgl_space_speed_config speed = {.eta_bar = CGL_R(9.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .memory = memory};
    const cgl_space_position_config position = {.omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .memory = memory};
    const cgl_pi_config weak = {CGL_R(0.1), CGL_R(1.0), CGL_R(1.0)};
    const cgl_pi_afc_config afc = {.pi = weak, .gain = CGL_R(1.0), .omega_min = CGL_R(0.1), .limit = CGL_R(3.0), .orders = 1U, .order = {7U}};
    const cgl_harmonic_config harmonic = {.pi = weak, .b = CGL_R(100.0), .base = 1U, .orders = 3U, .limit = CGL_R(3.0)};
    const cgl_anti_cogging_config cogging = {.pi = pi, .cells = 4U, .speed = CGL_R(1.0), .revolutions = 1U};
    const cgl_pi_ilc_config ilc = some_law();
    CHECK_OPENING(pi, pi, limit, "pi.limit", false);
    CHECK_OPENING(pi_ilc, ilc, pi.limit, "pi.limit", false);
    CHECK_OPENING(anti_cogging, cogging, pi.limit, "pi.limit", false);
    CHECK_OPENING(pi_afc, afc, limit, "pi_afc.limit", false);
    CHECK_OPENING(harmonic, harmonic, limit, "harmonic.limit", true);
    CHECK_OPENING(adrc, adrc, limit, "adrc.limit", true);
    CHECK_OPENING(robust_ilc, robust, limit, "robust_ilc.limit", true);
    CHECK_OPENING(space_speed, speed, limit, "space_speed.limit", true);
    CHECK_OPENING(space_position, position, limit, "space_position.limit", true);
    static cgl_real cells[128];
    CHECK_PART(pi_ilc, ilc, memory.lead, 17U, "memory.lead", cells, CGL_MEMORY_ROW(64U, 2U));
    CHECK_PART(robust_ilc, robust, memory.lead, 17U, "memory.lead", cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_PART(space_speed, speed, memory.lead, 17U, "memory.lead", cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_PART(space_position, position, memory.lead, 17U, "memory.lead", cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_PART(pi_ilc, ilc, pi.ki, CGL_R(-1.0), "pi.ki", cells, CGL_MEMORY_ROW(64U, 2U));
    CHECK_PART(anti_cogging, cogging, pi.ki, CGL_R(-1.0), "pi.ki", cells, 4U);
    CHECK_PART(pi_afc, afc, pi.ki, CGL_R(-1.0), "pi.ki", cells, CGL_PI_AFC_LENGTH(1U));
    CHECK_PART(harmonic, harmonic, pi.ki, CGL_R(-1.0), "pi.ki", cells, CGL_HARMONIC_LENGTH(3U));
    CHECK_REFUSED(pi, speed_pi, pi, limit, &guarded_loop);
    CHECK_REFUSED(adrc, adrc, adrc, limit, &guarded_loop);
    CHECK_REFUSED(pi_ilc, pi_ilc, ilc, pi.limit, &guarded_loop, cells, CGL_MEMORY_ROW(64U, 2U));
    CHECK_REFUSED(robust_ilc, robust_ilc, robust, limit, &guarded_loop, cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_REFUSED(space_speed, space_speed, speed, limit, &guarded_loop, cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_REFUSED(space_position, space_position, position, limit, &guarded_loop, cells, CGL_MEMORY_ROW(64U, 0U));
    CHECK_REFUSED(anti_cogging, anti_cogging, cogging, pi.limit, &guarded_loop, cells, 4U);
    CHECK_REFUSED(pi_afc, pi_afc, afc, limit, &guarded_loop, cells, CGL_PI_AFC_LENGTH(1U));
    CHECK_REFUSED(harmonic, harmonic, harmonic, limit, &guarded_loop, cells, CGL_HARMONIC_LENGTH(3U));
}

/* Laws whose learning needs a feedback of their own say so. */
static void laws_that_are_not_fed_forward(void)
{
    cgl_loop loop = guarded_loop;
    loop.feed_forward = true;
    const cgl_adrc_config adrc = {CGL_R(100.0), CGL_R(20.0), CGL_R(100.0), CGL_R(3.0)};
    CHECK(cgl_adrc_bad_field(&adrc, &guarded_loop) == NULL);
    CHECK(IS_NAMED(cgl_adrc_bad_field(&adrc, &loop), "loop.feed_forward"));
    const cgl_pi_ilc_config ilc = some_law();
    CHECK(cgl_pi_ilc_bad_field(&ilc, &loop) == NULL);
}

/* ---- torque mode ---- */

/* A law is given the rotor itself as its reference, so that no error is left to it. */
static void references_of_torque_mode(void)
{
    cgl_drive drive;
    const cgl_drive_config config = some_drive();
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK);
    const cgl_reference reference = {.theta_ref = CGL_R(2.0), .omega_ref = CGL_R(5.0), .alpha_ref = CGL_R(7.0), .learn = true,
                                     .torque = true, .i_q_ref = CGL_R(0.5)};
    int due = 0;
    for (int n = 0; n < 100; ++n) {
        const cgl_measurement now = {.theta_m = CGL_R(2.0e-4) * (cgl_real)n, .omega_m = CGL_R(2.0), .u_dc = CGL_R(24.0)};
        cgl_drive_output out;
        if (cgl_drive_measure(&drive, &now, &reference)) {
            ++due;
            CHECK(within(drive.in.omega_m - CGL_R(2.0), CGL_R(0.0)) && within(drive.in.omega_ref - CGL_R(2.0), CGL_R(0.0)));
            CHECK(within(drive.in.theta_ref - drive.in.theta_m, CGL_R(0.0)) && within(drive.in.alpha_ref, CGL_R(0.0)));
            CHECK(drive.in.torque && !drive.in.learn && within(drive.in.i_q_ref - CGL_R(0.5), CGL_R(0.0)));
        }
        cgl_drive_actuate(&drive, &out);
    }
    CHECK(due >= 10);
}

/* ---- a drive begins anew ---- */

/* The law's first input after a reset is that after init: no current, and no speed of the run before. */
static void first_input_after_a_reset(void)
{
    cgl_drive drive;
    const cgl_drive_config config = some_drive();
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK);
    const cgl_reference reference = {.omega_ref = CGL_R(2.0)};
    const cgl_measurement now = {.theta_m = CGL_R(1.0), .omega_m = CGL_R(2.0), .i_abc = {CGL_R(1.0), CGL_R(-0.5), CGL_R(-0.5)},
                                 .u_dc = CGL_R(24.0)};
    cgl_drive_output out;
    CHECK(cgl_drive_measure(&drive, &now, &reference));
    const cgl_law_input first = drive.in;
    for (int n = 0; n < 50; ++n) {
        cgl_drive_actuate(&drive, &out);
        (void)cgl_drive_measure(&drive, &now, &reference);
    }
    CHECK(!within(drive.in.i_q, CGL_R(0.1)) && within(first.i_q, CGL_R(0.0)));
    cgl_drive_reset(&drive);
    CHECK(cgl_drive_measure(&drive, &now, &reference));
    CHECK(within(drive.in.i_q - first.i_q, CGL_R(0.0)) && within(drive.in.omega_m - first.omega_m, CGL_R(0.0)));
}

/* ---- 0 is the default ---- */

static void defaults(void)
{
    cgl_memory short_one, full_one;
    static cgl_real other[CGL_MEMORY_ROW(64U, 2U)];
    const cgl_memory_config short_config = {.cells = 64U, .q_half_width = 2U, .limit = {CGL_R(1.0)}};
    const cgl_memory_config full_config = {.kind = CGL_MEMORY_ANGLE, .channels = 1U, .cells = 64U, .turns = 1U, .parts = 1U,
                                           .q_half_width = 2U, .forgetting = CGL_R(1.0), .limit = {CGL_R(1.0)}};
    CHECK(cgl_memory_init(&short_one, &short_config, CGL_R(1.0e-3), 1U, map, CGL_ENTRIES(map)) == CGL_OK);
    CHECK(cgl_memory_init(&full_one, &full_config, CGL_R(1.0e-3), 1U, other, CGL_ENTRIES(other)) == CGL_OK);
    for (int n = 0; n < 3000; ++n) {
        const cgl_real theta = CGL_R(0.01) * (cgl_real)n, correction = CGL_R(0.001) * (cgl_real)(n % 7);
        cgl_real one, two;
        CHECK(cgl_memory_step(&short_one, theta, CGL_R(10.0), true, &correction, &one)
              == cgl_memory_step(&full_one, theta, CGL_R(10.0), true, &correction, &two));
        CHECK(within(one - two, CGL_R(0.0)));
    }
    CHECK(memcmp(map, other, sizeof map) == 0 && cgl_memory_retune(&short_one, &full_config) == CGL_OK);
    cgl_drive drive;
    const cgl_drive_config config = some_drive();
    CHECK(cgl_drive_init(&drive, &config, CGL_R(1.0e-4)) == CGL_OK);
    CHECK(drive.monitor.config.phases == 3U && within(drive.quality.config.span - CGL_TWO_PI, CGL_R(0.0)));
    CHECK(within(drive.loop.ts - CGL_R(1.0e-3), CGL_R(1.0e-9)) && within(drive.loop.current_limit - CGL_R(3.0), CGL_R(0.0)));
    CHECK(drive.loop.guarded && !drive.loop.feed_forward);
}

/* The values that stand for a 0 in the configs of the parts. */
static void defaults_of_parts(void)
{
    const cgl_real ts = CGL_R(1.0e-4);
    const cgl_align_config of_align = {.pole_pairs = 4U, .current = CGL_R(1.0), .ramp = CGL_R(0.1), .speed = CGL_R(1.0), .settle = CGL_R(0.1)};
    cgl_align align;
    CHECK(cgl_align_init(&align, &of_align, ts) == CGL_OK);
    CHECK(within(align.config.sweep - CGL_R(0.5) * CGL_PI, CGL_R(0.0)) && within(align.config.tolerance - CGL_R(0.25), CGL_R(0.0)));
    const cgl_quality_config of_quality = {.span = CGL_R(0.0)};
    cgl_quality quality;
    CHECK(cgl_quality_init(&quality, &of_quality, CGL_R(0.5)) == CGL_OK);
    CHECK(within(quality.config.span - CGL_TWO_PI, CGL_R(0.0)) && quality.longest == 120U); /* a minute */
    cgl_drive drive;
    const cgl_drive_config of_drive = some_drive();
    const cgl_current_reference_config of_currents = {.psi_f = CGL_R(0.01)};
    cgl_current_reference currents;
    CHECK(cgl_drive_init(&drive, &of_drive, ts) == CGL_OK && cgl_current_reference_init(&currents, &of_currents, &drive) == CGL_OK);
    CHECK(within(currents.share * cgl_square_root(CGL_R(3.0)) - CGL_R(0.95), CGL_R(1.0e-6))); /* of u_dc / sqrt 3 */
    const cgl_microstepping_config of_motor = {.teeth = 50U, .current = CGL_R(1.0)};
    cgl_microstepping motor;
    CHECK(cgl_microstepping_init(&motor, &of_motor) == CGL_OK && motor.microstep == 0x40000000U / 256U);
    const cgl_memory_config of_line = {.kind = CGL_MEMORY_DELAY, .cells = 64U, .limit = {CGL_R(1.0)}};
    static cgl_real line[CGL_MEMORY_LENGTH(CGL_MEMORY_DELAY, 1U, 64U, 0U)];
    cgl_memory memory;
    CHECK(cgl_memory_init(&memory, &of_line, ts, 1U, line, CGL_ENTRIES(line)) == CGL_OK);
    CHECK(within(memory.config.k_pp - CGL_R(10.0), CGL_R(0.0)) && within(memory.config.forgetting - CGL_R(1.0), CGL_R(0.0)));
    CHECK(memory.config.channels == 1U && memory.config.turns == 1U && memory.config.parts == 1U);
}

void faces(void)
{
    another_limit();
    reference_of_a_foreign_loop();
    centre_of_a_map();
    trials_without_a_delay();
    matrix_of_a_trial();
    unmade_states();
    unmade_drive();
    refused_parts();
    refused_again();
    names_of_the_drive();
    names_of_a_law();
    gains_of_nothing();
    opening_checks();
    laws_that_are_not_fed_forward();
    references_of_torque_mode();
    first_input_after_a_reset();
    defaults();
    defaults_of_parts();
}
