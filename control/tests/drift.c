/* Hours of every law on a drive: does what it learned walk against an integral, or away?
 *
 *   cogless_control_drift                       a few minutes of every law, disturbed in every way; ends with 0 if nothing drifts
 *   cogless_control_drift HOURS [LAW] [ORDEAL] [SECONDS]    so many hours of each way apart, for all laws or one; "" stands for all.
 *                                               SECONDS: of an hour. Ten hours of a law in one way take 12 s of a core
 *
 * The plant: a rotor with inertia, cogging, stiction, friction and a load, windings with back-EMF on a bus of limited voltage, an
 * encoder of 14 bits, measured currents with an offset. The library is all of the controller: monitor, guard, law and current loop.
 * Only beside a foreign loop the feedback is of this file.
 *
 * Each hour is disturbed first. Then it runs calmly at one speed: what is learned settles for half a minute and is measured for
 * another one. An hour's measurements are compared with those of the first. The bounds:
 *
 *   sum       integral and learned current together hold load and friction, whichever of the two has how much. The mean of cogging
 *             over the time is not 0 where the speed ripples: at most the product of both, relative to the speed.
 *   learned   a map beside an integral keeps at most 15/16 of its mean in a period. So its mean is at most 16 times what a period
 *             adds to it. Learning adds gain e(theta); the mean of e over the time is 0, but over the angle it is
 *             -mean(e^2) / omega, as the rotor is longer where it is slow. What one period adds comes to it, as an error that returns once
 *             a turn is another one in each period of the map. A map without an integral has the mean: no more of it at rest
 *             than friction, load and acceleration ever took.
 *   integral  without a gain there is none: at most what a feedback gives for that mean of e.
 *   largest   a law that learned what there is to learn keeps it: at most a quarter more than in the first hour.
 *   ripple    at most a quarter more than in the first hour.
 *
 * The last three do not count where the guard held learning back: what it forgets is left to the feedback. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cogless.h"
#include "flash.h"

#define TAU 6.283185307179586
#define CURRENT_PERIOD 1e-3 /* s */
#define DIVIDER 2           /* of the law */
#define TS (DIVIDER * CURRENT_PERIOD)
#define SPEED TAU           /* rad/s */
#define POLE_PAIRS 4
#define K_T 0.4             /* N m/A */
#define INERTIA 4e-4        /* kg m^2 */
#define RESISTANCE 0.5      /* ohm */
#define INDUCTANCE 2e-3     /* H */
#define PSI_F (K_T / 1.5 / POLE_PAIRS)
#define BUS 24.0            /* V */
#define LIMIT 3.0           /* A */
#define LOAD 0.01           /* N m */
#define COULOMB 0.004       /* N m */
#define VISCOUS 1e-4        /* N m s/rad */
#define COUNTS 16384
#define WINDOW 8            /* periods of the current loop, over which the speed is a difference */
#define CELLS 128U
#define Q_HALF_WIDTH 5U
#define LEARNED_LIMIT 1.0   /* A */
#define TRIAL_SAMPLES 500U
#define KP 0.05             /* A s/rad */
#define PERIOD_GAIN 0.01    /* current that a period learns per speed error, at most [A s/rad] */
#define ACCELERATION 12.0   /* of the reference [rad/s^2] */
#define KI 0.5              /* A/rad */

static cgl_real r(double x)
{
    return (cgl_real)x;
}

static double limited(double x, double limit)
{
    return fmax(-limit, fmin(limit, x));
}

/* ---- the plant ---- */

typedef struct {
    double theta, omega, i_d, i_q; /* [rad], [rad/s], [A], [A] */
    double load, brake;            /* [N m]; a brake holds, but does not push */
    double bus;                    /* [V] */
    double offset[2];              /* of the measured currents of the phases a and b [A] */
    double turned;                 /* NAN, or the speed at which the rotor is turned from outside [rad/s] */
    long count[WINDOW + 1];        /* of the encoder, the newest first */
} plant;

static double cogging(double theta)
{
    const double c = cos(theta), s = sin(theta), c_2 = c * c - s * s, s_2 = 2 * c * s;
    const double c_4 = c_2 * c_2 - s_2 * s_2, s_4 = 2 * c_2 * s_2, c_8 = c_4 * c_4 - s_4 * s_4, s_8 = 2 * c_4 * s_4;
    const double s_16 = 2 * c_8 * s_8, c_16 = c_8 * c_8 - s_8 * s_8, s_24 = s_16 * c_8 + c_16 * s_8;
    return 0.002 * s + 0.02 * s_4 + 0.01 * (0.54 * s_8 + 0.84 * c_8) + 0.005 * s_24;
}

/* A period of the current loop, with the duty cycles or an open bridge. */
static void turn(plant *motor, const cgl_real duty[3], bool open)
{
    const double omega_e = POLE_PAIRS * motor->omega, angle = POLE_PAIRS * motor->theta + 0.5 * CURRENT_PERIOD * omega_e;
    if (open) {
        motor->i_d = motor->i_q = 0; /* the EMF is below the bus voltage */
    } else {
        const double a = (double)duty[0], b = (double)duty[1], c = (double)duty[2];
        const double u_alpha = motor->bus * (2 * a - b - c) / 3, u_beta = motor->bus * (b - c) / sqrt(3.0);
        const double u_d = cos(angle) * u_alpha + sin(angle) * u_beta, u_q = cos(angle) * u_beta - sin(angle) * u_alpha;
        const double i_d = motor->i_d, i_q = motor->i_q, rate = CURRENT_PERIOD / INDUCTANCE;
        motor->i_d += rate * (u_d - RESISTANCE * i_d + omega_e * INDUCTANCE * i_q);
        motor->i_q += rate * (u_q - RESISTANCE * i_q - omega_e * (INDUCTANCE * i_d + PSI_F));
    }
    const double push = K_T * motor->i_q - cogging(motor->theta) - motor->load - VISCOUS * motor->omega;
    const double friction = COULOMB + motor->brake, kick = CURRENT_PERIOD / INERTIA;
    const double free = motor->omega + kick * push;
    motor->omega = fabs(free) > kick * friction ? free - copysign(kick * friction, free) : 0;
    if (!isnan(motor->turned)) {
        motor->omega = motor->turned;
    }
    motor->theta += CURRENT_PERIOD * motor->omega;
    memmove(motor->count + 1, motor->count, WINDOW * sizeof motor->count[0]);
    motor->count[0] = (long)floor(motor->theta / TAU * COUNTS);
    if (fabs(motor->theta) > 1024 * TAU) { /* removes whole turns, which are whole counts */
        const long away = motor->theta > 0 ? 1024 : -1024;
        motor->theta -= (double)away * TAU;
        for (int n = 0; n <= WINDOW; ++n) {
            motor->count[n] -= away * COUNTS;
        }
    }
}

static cgl_measurement measure(const plant *motor)
{
    const double angle = POLE_PAIRS * motor->theta, alpha = cos(angle) * motor->i_d - sin(angle) * motor->i_q;
    const double beta = sin(angle) * motor->i_d + cos(angle) * motor->i_q;
    const double i_a = alpha + motor->offset[0], i_b = -0.5 * alpha + 0.5 * sqrt(3.0) * beta + motor->offset[1];
    const long count = (motor->count[0] % COUNTS + COUNTS) % COUNTS;
    const cgl_measurement now = {{r(i_a), r(i_b), r(-alpha - (-0.5 * alpha + 0.5 * sqrt(3.0) * beta))},
                                 r(TAU * (double)count / COUNTS),
                                 r(TAU * (double)(motor->count[0] - motor->count[WINDOW]) / COUNTS / (WINDOW * CURRENT_PERIOD)),
                                 r(motor->bus)};
    return now;
}

/* ---- the laws ---- */

static union {
    cgl_pi pi;
    cgl_pi_ilc pi_ilc;
    cgl_robust_ilc robust_ilc;
    cgl_space_speed space_speed;
    cgl_space_position space_position;
    cgl_pi_afc pi_afc;
    cgl_harmonic harmonic;
    cgl_anti_cogging anti_cogging;
    cgl_adrc adrc;
    cgl_trial trial;
} law;

static cgl_real cells[4096], y_ref[TRIAL_SAMPLES];
static cgl_loop loop;

typedef struct {
    const char *name;
    cgl_error (*init)(void);
    void (*step)(const cgl_law_input *in, cgl_law_output *out);
    void (*currents)(double *integral, double *learned); /* of the last step [A] */
    cgl_map_result (*map)(cgl_map *map);                 /* NULL: it stores none */
    bool has_mean; /* the mean is in the map, as there is no other integral */
    bool foreign;  /* beside a foreign loop */
    bool trials;   /* of one motion */
} subject;

static cgl_pi_config pi_config(double ki)
{
    const cgl_pi_config config = {.kp = r(KP), .ki = r(ki), .limit = r(LIMIT)};
    return config;
}

static cgl_memory_config memory_config(cgl_memory_kind kind, uint32_t channels, double limit)
{
    /* by time a line is as long as the longest period at which a law learns */
    const cgl_memory_config config = {.kind = kind, .channels = channels, .cells = kind == CGL_MEMORY_ANGLE ? CELLS : 300U, .parts = POLE_PAIRS,
                                      .q_half_width = Q_HALF_WIDTH, .limit = {r(limit), r(0.1), r(0.1)}};
    return config;
}

static uint32_t entries_of(const cgl_memory_config *memory)
{
    return CGL_MEMORY_LENGTH(memory->kind, memory->channels, memory->cells, memory->q_half_width);
}

static cgl_error init_pi(void)
{
    const cgl_pi_config config = pi_config(KI);
    return cgl_pi_init(&law.pi, &config, &loop);
}

static void step_pi(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_speed_pi_step(&law.pi, in, out);
}

static void currents_of_pi(double *integral, double *learned)
{
    *integral = (double)law.pi.integral;
    *learned = 0;
}

static cgl_error init_pi_ilc_as(cgl_memory_kind kind, uint32_t lead, double ki)
{
    cgl_pi_ilc_config config = {.pi = pi_config(ki), .gain = r(PERIOD_GAIN), .memory = memory_config(kind, 1U, LEARNED_LIMIT)};
    config.memory.lead = lead;
    return cgl_pi_ilc_init(&law.pi_ilc, &config, &loop, cells, entries_of(&config.memory));
}

static cgl_error init_pi_ilc(void)
{
    return init_pi_ilc_as(CGL_MEMORY_ANGLE, 0U, KI);
}

static cgl_error init_pi_ilc_by_time(void)
{
    return init_pi_ilc_as(CGL_MEMORY_TIME, 0U, KI);
}

static cgl_error init_pi_ilc_with_lead(void)
{
    return init_pi_ilc_as(CGL_MEMORY_ANGLE, 3U, KI);
}

static cgl_error init_pi_ilc_without_integral(void)
{
    return init_pi_ilc_as(CGL_MEMORY_ANGLE, 0U, 0.0);
}

static void step_pi_ilc(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_ilc_step(&law.pi_ilc, in, out);
}

static void currents_of_pi_ilc(double *integral, double *learned)
{
    *integral = (double)law.pi_ilc.pi.integral;
    *learned = (double)law.pi_ilc.learned;
}

static cgl_map_result map_of_pi_ilc(cgl_map *map)
{
    return cgl_map_of_pi_ilc(&law.pi_ilc, map);
}

static cgl_error init_robust_ilc_as(double gamma)
{
    const double b = K_T / INERTIA;
    const cgl_robust_ilc_config config = {.b = r(b), .c = r(10.0), .eta = r(0.05 * b), .q = r(1.0), .beta_2 = r(PERIOD_GAIN * b), .gamma = r(gamma),
                                          .limit = r(LIMIT), .memory = memory_config(CGL_MEMORY_ANGLE, 1U, LEARNED_LIMIT * b)};
    return cgl_robust_ilc_init(&law.robust_ilc, &config, &loop, cells, entries_of(&config.memory));
}

static cgl_error init_robust_ilc(void)
{
    return init_robust_ilc_as(100.0);
}

static cgl_error init_robust_ilc_alone(void)
{
    return init_robust_ilc_as(0.0);
}

static void step_robust_ilc(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_robust_ilc_step(&law.robust_ilc, in, out);
}

static void currents_of_robust_ilc(double *integral, double *learned)
{
    const cgl_robust_ilc_terms *const terms = &law.robust_ilc.terms;
    *integral = (double)(terms->adapted + terms->linear);
    *learned = (double)terms->learned;
}

static cgl_map_result map_of_robust_ilc(cgl_map *map)
{
    return cgl_map_of_robust_ilc(&law.robust_ilc, map);
}

static cgl_error init_space_speed_as(cgl_memory_kind kind)
{
    const cgl_space_speed_config config = {.k = r(KP), .mu_alpha = r(0.03), .mu_beta = r(0.0004), .eta_bar = r(6.0), .omega_min = r(0.5),
                                           .limit = r(LIMIT), .memory = memory_config(kind, 2U, LEARNED_LIMIT)};
    return cgl_space_speed_init(&law.space_speed, &config, &loop, cells, entries_of(&config.memory));
}

static cgl_error init_space_speed(void)
{
    return init_space_speed_as(CGL_MEMORY_ANGLE);
}

static cgl_error init_space_speed_by_delay(void)
{
    return init_space_speed_as(CGL_MEMORY_DELAY);
}

static void step_space_speed(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_space_speed_step(&law.space_speed, in, out);
}

static void currents_of_space_speed(double *integral, double *learned)
{
    *integral = (double)law.space_speed.terms.proportional;
    *learned = (double)(law.space_speed.terms.alpha + law.space_speed.terms.beta + law.space_speed.terms.h);
}

static cgl_map_result map_of_space_speed(cgl_map *map)
{
    return cgl_map_of_space_speed(&law.space_speed, map);
}

static cgl_error init_space_position_as(cgl_space_index index, bool hand_over)
{
    const cgl_space_position_config config = {.k_theta = r(10.0), .k_omega = r(KP), .k_i = r(KI), .mu_alpha = r(0.03), .mu_beta = r(0.0004),
                                              .hand_over = hand_over, .ramp = r(1.0), .omega_min = r(0.5), .index = index,
                                              .limit = r(LIMIT), .memory = memory_config(CGL_MEMORY_ANGLE, 2U, LEARNED_LIMIT)};
    return cgl_space_position_init(&law.space_position, &config, &loop, cells, entries_of(&config.memory));
}

static cgl_error init_space_position(void)
{
    return init_space_position_as(CGL_SPACE_BY_REFERENCE, false);
}

static cgl_error init_space_position_by_rotor(void)
{
    return init_space_position_as(CGL_SPACE_BY_ROTOR, false);
}

static cgl_error init_space_position_handed_over(void)
{
    return init_space_position_as(CGL_SPACE_BY_ROTOR, true);
}

static void step_space_position(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_space_position_step(&law.space_position, in, out);
}

static void currents_of_space_position(double *integral, double *learned)
{
    const cgl_space_position_terms *const terms = &law.space_position.terms;
    *integral = (double)terms->integral;
    *learned = (double)(terms->alpha + terms->beta + terms->h);
}

static cgl_map_result map_of_space_position(cgl_map *map)
{
    return cgl_map_of_space_position(&law.space_position, map);
}

static cgl_error init_pi_afc(void)
{
    const cgl_pi_afc_config config = {.pi = pi_config(KI), .orders = 3U, .order = {1U, POLE_PAIRS, 2U * POLE_PAIRS}, .gain = r(0.1),
                                      .lead = r(0.008), .omega_min = r(0.5), .limit = r(LEARNED_LIMIT)};
    return cgl_pi_afc_init(&law.pi_afc, &config, &loop, cells, CGL_PI_AFC_LENGTH(config.orders));
}

static void step_pi_afc(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_afc_step(&law.pi_afc, in, out);
}

static void currents_of_pi_afc(double *integral, double *learned)
{
    *integral = (double)law.pi_afc.pi.integral;
    *learned = (double)law.pi_afc.learned;
}

static cgl_map_result map_of_pi_afc(cgl_map *map)
{
    return cgl_map_of_pi_afc(&law.pi_afc, map);
}

static cgl_error init_harmonic_as(double k_theta)
{
    const cgl_harmonic_config config = {.pi = pi_config(KI), .k_theta = r(k_theta), .b = r(K_T / INERTIA), .delay = r(TS), .base = POLE_PAIRS,
                                        .bends = 1U, .orders = 6U, .rate = r(1.0), .rate_min = r(0.05), .limit = r(LEARNED_LIMIT)};
    return cgl_harmonic_init(&law.harmonic, &config, &loop, cells, CGL_HARMONIC_LENGTH(config.orders));
}

static cgl_error init_harmonic(void)
{
    return init_harmonic_as(0.0);
}

static cgl_error init_harmonic_of_positions(void)
{
    return init_harmonic_as(5.0);
}

static void step_harmonic(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_harmonic_step(&law.harmonic, in, out);
}

static void currents_of_harmonic(double *integral, double *learned)
{
    *integral = (double)law.harmonic.pi.integral;
    *learned = (double)law.harmonic.learned;
}

static cgl_map_result map_of_harmonic(cgl_map *map)
{
    return cgl_map_of_harmonic(&law.harmonic, map);
}

static cgl_error init_anti_cogging(void)
{
    const cgl_anti_cogging_config config = {.pi = pi_config(KI), .cells = 4U * CELLS, .speed = r(1.0), .revolutions = 1U, .position_gain = r(5.0)};
    return cgl_anti_cogging_init(&law.anti_cogging, &config, &loop, cells, config.cells);
}

static void step_anti_cogging(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_anti_cogging_step(&law.anti_cogging, in, out);
}

static void currents_of_anti_cogging(double *integral, double *learned)
{
    *integral = (double)law.anti_cogging.pi.integral;
    *learned = (double)law.anti_cogging.looked_up;
}

static cgl_map_result map_of_anti_cogging(cgl_map *map)
{
    return cgl_map_of_anti_cogging(&law.anti_cogging, map);
}

static cgl_error init_adrc(void)
{
    const cgl_adrc_config config = {.b = r(K_T / INERTIA), .omega_c = r(20.0), .omega_o = r(80.0), .limit = r(LIMIT)};
    return cgl_adrc_init(&law.adrc, &config, &loop);
}

static void step_adrc(const cgl_law_input *in, cgl_law_output *out)
{
    cgl_adrc_step(&law.adrc, in, out);
}

static void currents_of_adrc(double *integral, double *learned)
{
    *integral = (double)law.adrc.rejected;
    *learned = 0;
}

/* The filter is Butterworth's of second order at 4 Hz: the lag of the current loop, which the law does not know, leaves no more than
 * this to learn without a guard. */
static cgl_error init_trial(void)
{
    const double w = tan(0.5 * TAU * 4.0 * TS), a = 1 + sqrt(2.0) * w + w * w, b = w * w / a;
    const cgl_trial_config config = {
        .samples = TRIAL_SAMPLES, .states = 2U, .n = r(1.0), .c = {r(1.0)}, .k_3 = r(1.0), .shift = 2U, .filter_signal = true,
        .q_filter = {.order = 2U, .b = {r(b), r(2 * b), r(b)}, .a = {r(1.0), r(2 * (w * w - 1) / a), r((1 - sqrt(2.0) * w + w * w) / a)}},
        .observer = {.response = r(K_T / INERTIA * TS * TS), .pole = r(0.95)}, .limit = r(LIMIT), .learned_limit = r(LEARNED_LIMIT), .unguarded = !loop.guarded};
    const cgl_error error = cgl_trial_init(&law.trial, &config, cells, CGL_TRIAL_LENGTH(TRIAL_SAMPLES, config.q_filter.order));
    for (uint32_t p = 0; p < TRIAL_SAMPLES; ++p) {
        y_ref[p] = r(2 - 2 * cos(TAU * p / TRIAL_SAMPLES));
    }
    return error;
}

static void step_trial(const cgl_law_input *in, cgl_law_output *out)
{
    if (law.trial.y_ref == NULL || law.trial.sample >= TRIAL_SAMPLES) {
        (void)cgl_trial_end(&law.trial);
        cgl_trial_begin(&law.trial, y_ref);
    }
    cgl_trial_drive_step(&law.trial, in, out);
}

static void currents_of_trial(double *integral, double *learned)
{
    *integral = (double)law.trial.terms.integral;
    *learned = (double)law.trial.terms.learned;
}

static cgl_map_result map_of_trial(cgl_map *map)
{
    return cgl_map_of_trial(&law.trial, map);
}

static const subject subjects[] = {
    {"pi", init_pi, step_pi, currents_of_pi, NULL, false, false, false},
    {"adrc", init_adrc, step_adrc, currents_of_adrc, NULL, false, false, false},
    {"anti-cogging", init_anti_cogging, step_anti_cogging, currents_of_anti_cogging, map_of_anti_cogging, false, false, false},
    {"pi-ilc", init_pi_ilc, step_pi_ilc, currents_of_pi_ilc, map_of_pi_ilc, false, false, false},
    {"pi-ilc by time", init_pi_ilc_by_time, step_pi_ilc, currents_of_pi_ilc, NULL, false, false, false},
    {"pi-ilc with a lead", init_pi_ilc_with_lead, step_pi_ilc, currents_of_pi_ilc, map_of_pi_ilc, false, false, false},
    {"pi-ilc without an integral", init_pi_ilc_without_integral, step_pi_ilc, currents_of_pi_ilc, map_of_pi_ilc, true, false, false},
    {"pi-ilc beside a foreign loop", init_pi_ilc, step_pi_ilc, currents_of_pi_ilc, map_of_pi_ilc, false, true, false},
    {"robust-ilc", init_robust_ilc, step_robust_ilc, currents_of_robust_ilc, map_of_robust_ilc, false, false, false},
    {"robust-ilc alone", init_robust_ilc_alone, step_robust_ilc, currents_of_robust_ilc, map_of_robust_ilc, true, false, false},
    {"space-speed", init_space_speed, step_space_speed, currents_of_space_speed, map_of_space_speed, true, false, false},
    {"space-speed by delay", init_space_speed_by_delay, step_space_speed, currents_of_space_speed, NULL, true, false, false},
    {"space-position", init_space_position, step_space_position, currents_of_space_position, map_of_space_position, false, false, false},
    {"space-position by rotor", init_space_position_by_rotor, step_space_position, currents_of_space_position, map_of_space_position, false,
     false, false},
    {"space-position handed over", init_space_position_handed_over, step_space_position, currents_of_space_position, map_of_space_position,
     true, false, false},
    {"pi-afc", init_pi_afc, step_pi_afc, currents_of_pi_afc, map_of_pi_afc, false, false, false},
    {"pi-afc beside a foreign loop", init_pi_afc, step_pi_afc, currents_of_pi_afc, map_of_pi_afc, false, true, false},
    {"harmonic", init_harmonic, step_harmonic, currents_of_harmonic, map_of_harmonic, false, false, false},
    {"harmonic of positions", init_harmonic_of_positions, step_harmonic, currents_of_harmonic, map_of_harmonic, false, false, false},
    {"trial", init_trial, step_trial, currents_of_trial, map_of_trial, true, false, true},
};

/* ---- the drive ---- */

typedef enum { ANGLE_TRUE, ANGLE_MISSING, ANGLE_HELD, ANGLE_SHIFTED } angle_fault;

/* Of some time [A], [rad/s]. */
typedef struct {
    double count, integral, learned, output, largest, squares, measured_squares;
    unsigned status;
} sums;

static struct {
    const subject *subject;
    plant motor;
    long shown[WINDOW + 1]; /* counts of the encoder as the firmware reads them, the newest first */
    cgl_drive drive;
    cgl_foc foc;             /* beside a foreign loop, this is the current loop */
    double integral;         /* of the foreign loop [A] */
    bool limited;            /* the foreign loop was at its limit */
    double theta_ref, omega_ref, omega_goal; /* [rad], [rad/s], [rad/s] */
    angle_fault fault;
    bool learn, torque, unguarded;
    double torque_current;   /* of torque mode [A] */
    unsigned status;         /* of the last period */
    sums sums;
    flash flash;
} rig;

static cgl_foc_config foc_config(void)
{
    const double bandwidth = 200.0; /* 1/s */
    const cgl_foc_config config = {.kp_d = r(INDUCTANCE * bandwidth), .ki_d = r(RESISTANCE * bandwidth), .kp_q = r(INDUCTANCE * bandwidth),
                                   .ki_q = r(RESISTANCE * bandwidth), .current_limit = r(LIMIT), .advance = r(0.5), .decoupling = true,
                                   .L_d = r(INDUCTANCE), .L_q = r(INDUCTANCE), .psi_f = r(PSI_F)};
    return config;
}

/* Drive and law as after a reset of the processor. */
static bool start(void)
{
    const bool foreign = rig.subject->foreign;
    const cgl_drive_config config = {
        .pole_pairs = POLE_PAIRS, .divider = DIVIDER, .foreign = foreign, .feed_forward = foreign, .learn_saturated = rig.subject->trials, .unguarded = rig.unguarded,
        .foc = foc_config(),
        .monitor = {.omega_max = r(100.0), .angle_step = r(TAU / COUNTS), .speed_window = r(WINDOW * CURRENT_PERIOD),
                    .stuck_angle = r(0.5), .stuck_time = r(0.1), .current_max = r(8.0), .current_sum = r(1.0), .bridge = r(0.005),
                    .hold = r(0.01), .phases = 3U},
        .quality = {.outlier = r(6.0), .floor = r(0.2)}};
    const cgl_foc_config foc = foc_config();
    rig.integral = 0;
    rig.limited = false;
    if (cgl_foc_init(&rig.foc, &foc, r(CURRENT_PERIOD)) != CGL_OK || cgl_drive_init(&rig.drive, &config, r(CURRENT_PERIOD)) != CGL_OK) {
        return false;
    }
    loop = rig.drive.loop;
    return rig.subject->init() == CGL_OK;
}

static cgl_measurement sensed(void)
{
    plant *const motor = &rig.motor;
    long *const shown = rig.shown;
    const long shift = rig.fault == ANGLE_SHIFTED ? 517 : 0;
    memmove(shown + 1, shown, WINDOW * sizeof shown[0]);
    shown[0] = rig.fault == ANGLE_HELD ? shown[1] : motor->count[0] + shift;
    cgl_measurement now = measure(motor);
    const long moved = shown[0] - shown[WINDOW], turns = lround((double)moved / COUNTS);
    now.theta_m = r(TAU * (double)((shown[0] % COUNTS + COUNTS) % COUNTS) / COUNTS);
    now.omega_m = r(TAU * (double)(moved - turns * COUNTS) / COUNTS / (WINDOW * CURRENT_PERIOD));
    if (rig.fault == ANGLE_MISSING) {
        now.theta_m = now.omega_m = r(NAN);
    }
    return now;
}

/* The foreign loop's part of a period: PI of the speed, then the currents. */
static void act_foreign(const cgl_measurement *now, cgl_drive_output *out)
{
    const double angle = isnan((double)now->theta_m) ? rig.motor.theta : (double)now->theta_m;
    const double error = isnan((double)now->omega_m) ? 0 : rig.omega_ref - (double)now->omega_m;
    const double wanted = rig.torque ? rig.torque_current : KP * error + rig.integral;
    const double output = limited(wanted + (double)out->i_q_ref, LIMIT);
    const cgl_foc_input in = {{now->i_abc[0], now->i_abc[1], now->i_abc[2]}, r(POLE_PAIRS * angle), r(POLE_PAIRS * rig.motor.omega), now->u_dc, r(0.0),
                              r(output)};
    const unsigned status = out->status;
    cgl_foc_step(&rig.foc, &in, out);
    rig.limited = fabs(wanted + (double)rig.drive.command.i_q_ref) >= LIMIT || out->status != 0U;
    out->status |= status & ~(unsigned)CGL_STATUS_OFF;
    if (rig.torque) {
        rig.integral = rig.torque_current;
    } else if (!rig.limited || error * output < 0) {
        rig.integral = limited(rig.integral + KI * CURRENT_PERIOD * error, LIMIT);
    }
}

static void lead_speed(void)
{
    const double step = ACCELERATION * CURRENT_PERIOD, before = rig.omega_ref;
    if (rig.subject->trials) {
        const uint32_t p = law.trial.sample < TRIAL_SAMPLES ? law.trial.sample : 0U;
        rig.omega_ref = 2 * TAU / (TRIAL_SAMPLES * TS) * sin(TAU * p / TRIAL_SAMPLES);
        rig.theta_ref = (double)y_ref[p];
        return;
    }
    rig.omega_ref += limited(rig.omega_goal - before, step);
    rig.theta_ref = fmod(rig.theta_ref + CURRENT_PERIOD * rig.omega_ref, TAU);
    if ((rig.status & (unsigned)CGL_STATUS_OFF) != 0U || rig.torque) {
        rig.theta_ref = fmod(rig.motor.theta, TAU);
    }
}

static void add_to_sums(void)
{
    const double error = rig.subject->trials ? remainder(rig.theta_ref - rig.motor.theta, TAU) : rig.omega_ref - rig.motor.omega;
    double integral, learned;
    rig.subject->currents(&integral, &learned);
    rig.sums.count += 1;
    rig.sums.integral += rig.subject->foreign ? rig.integral : integral;
    rig.sums.learned += learned;
    rig.sums.output += rig.motor.i_q;
    rig.sums.largest = fmax(rig.sums.largest, fabs(learned));
    rig.sums.squares += error * error;
    const double measured = (double)(rig.drive.in.omega_ref - rig.drive.in.omega_m);
    rig.sums.measured_squares += measured * measured;
    rig.sums.status |= rig.status;
}

/* One period of the current loop. */
static void period(void)
{
    const double before = rig.omega_ref;
    lead_speed();
    const cgl_measurement now = sensed();
    const cgl_reference reference = {.theta_ref = r(rig.theta_ref), .omega_ref = r(rig.omega_ref),
                                     .alpha_ref = r((rig.omega_ref - before) / CURRENT_PERIOD), .learn = rig.learn && !rig.limited,
                                     .torque = rig.torque, .i_q_ref = r(rig.subject->foreign ? 0 : rig.torque_current)};
    cgl_drive_output out;
    if (cgl_drive_measure(&rig.drive, &now, &reference)) {
        rig.subject->step(&rig.drive.in, &rig.drive.command);
        add_to_sums();
    }
    cgl_drive_actuate(&rig.drive, &out);
    if (rig.subject->foreign) {
        act_foreign(&now, &out);
    }
    rig.status = out.status;
    turn(&rig.motor, out.duty, (out.status & (unsigned)CGL_STATUS_OFF) != 0U);
}

static void run(double seconds)
{
    for (long n = lround(seconds / CURRENT_PERIOD); n > 0; --n) {
        period();
    }
}

static void run_at(double omega, double seconds)
{
    rig.omega_goal = omega;
    run(seconds);
}

/* ---- what an hour brings ---- */

static void run_steadily(double seconds)
{
    run(seconds);
}

static void run_to_and_fro(double seconds)
{
    for (double left = seconds; left > 0; left -= 16) {
        run_at(SPEED, 5);
        run_at(0, 1.5);
        run_at(-SPEED, 6);
        run_at(-0.5 * SPEED, 2);
        run_at(0, 1.5);
    }
}

static void stop_and_go(double seconds)
{
    for (double left = seconds; left > 0; left -= 8) {
        run_at(SPEED, 5);
        run_at(0, 3);
    }
}

static void lose_angle(angle_fault fault, double seconds)
{
    rig.fault = fault;
    run(seconds);
    rig.fault = ANGLE_TRUE;
    run(1.37);
}

static void run_with_dropouts(double seconds)
{
    for (double left = seconds; left > 0; left -= 12) {
        lose_angle(ANGLE_MISSING, 0.003);
        lose_angle(ANGLE_MISSING, 0.1);
        lose_angle(ANGLE_HELD, 0.02);
        lose_angle(ANGLE_HELD, 1.0);
        lose_angle(ANGLE_SHIFTED, 0.5);
        for (int n = 0; n < 20; ++n) {
            rig.fault = ANGLE_MISSING;
            period();
            rig.fault = ANGLE_TRUE;
            run(0.05);
        }
        (void)cgl_monitor_trust(&rig.drive.monitor); /* a sensor that was held while the rotor turned has jumped: the firmware homes */
    }
}

/* A load at the limit, a bus below the EMF of the crests, a rotor that is held. */
static void run_short_of_current(double seconds)
{
    const double third = fmin(60, seconds / 4);
    for (double left = seconds; left > 0; left -= 4 * third) {
        rig.motor.load = K_T * LIMIT - 0.03;
        run(third);
        rig.motor.load = LOAD;
        rig.motor.bus = 3.2;
        run(third);
        rig.motor.bus = 2.4;
        run(third);
        rig.motor.bus = BUS;
        rig.motor.brake = 2 * K_T * LIMIT;
        run(0.3 * third);
        rig.motor.brake = 0;
        run(0.7 * third);
    }
}

static bool restart_with_stored_map(void)
{
    static uint8_t buffer[256];
    static cgl_map_store store;
    cgl_map map;
    const cgl_map_store_config config = flash_config(&rig.flash, 1U);
    rig.learn = false;
    run(0.01);
    if (rig.subject->trials) {
        cgl_trial_begin(&law.trial, NULL);
    }
    bool whole = rig.subject->map(&map) == CGL_MAP_OK && cgl_map_store_init(&store, &config, buffer, sizeof buffer) == CGL_OK
                 && cgl_map_store_begin(&store, &map) == CGL_MAP_OK;
    cgl_map_result result = whole ? CGL_MAP_BUSY : CGL_MAP_INVALID;
    while (result == CGL_MAP_BUSY) {
        result = cgl_map_store_step(&store);
    }
    whole = result == CGL_MAP_OK && start() && rig.subject->map(&map) == CGL_MAP_OK && cgl_map_store_load(&store, &map) == CGL_MAP_OK;
    rig.learn = true;
    return whole;
}

static void run_with_stored_maps(double seconds)
{
    for (int n = 0; n < 6 && rig.subject->map != NULL; ++n) {
        run(seconds / 6);
        if (!restart_with_stored_map()) {
            printf("%s: the stored map does not load\n", rig.subject->name);
            exit(2);
        }
    }
}

/* A static load, then one that shakes the rotor to and fro. */
static void stand_still(double seconds)
{
    run_at(0, 2);
    rig.motor.load = 2 * LOAD;
    run(0.6 * seconds);
    for (long n = 0; n < lround(0.4 * seconds / CURRENT_PERIOD); ++n) {
        rig.motor.load = LOAD + 0.3 * sin(TAU * 3 * CURRENT_PERIOD * (double)n);
        period();
    }
    rig.motor.load = LOAD;
    run(2);
}

static void run_in_torque_mode(double seconds)
{
    const double half = fmin(60, seconds / 2);
    for (double left = seconds; left > 0; left -= 2 * half) {
        rig.torque = true;
        rig.torque_current = 0.05;
        rig.motor.turned = 0.25 * SPEED;
        run(half);
        rig.torque = false;
        rig.torque_current = 0;
        rig.motor.turned = NAN;
        run(half);
    }
}

typedef struct {
    const char *name;
    void (*hour)(double seconds);
    double offset;  /* of the measured currents, all the time [A] */
    bool unguarded; /* the guard does not judge what is learned meanwhile */
} ordeal;

static void run_through_all(double seconds);

static const ordeal ordeals[] = {
    {"steady", run_steadily, 0, false},      {"to and fro", run_to_and_fro, 0, false},  {"stop and go", stop_and_go, 0, false},
    {"dropouts", run_with_dropouts, 0, true}, {"short", run_short_of_current, 0, true}, {"stored", run_with_stored_maps, 0, false},
    {"standstill", stand_still, 0, false},   {"torque", run_in_torque_mode, 0, false},  {"everything", run_through_all, 0, true},
    {"offset", run_to_and_fro, 0.08, false},
};
enum { ORDEALS = sizeof ordeals / sizeof ordeals[0], EVERYTHING = ORDEALS - 2 };

static void run_through_all(double seconds)
{
    for (int n = 0; n < EVERYTHING; ++n) {
        ordeals[n].hour(seconds / EVERYTHING);
        run_at(SPEED, 3);
    }
}

/* ---- what is left of it ---- */

typedef struct {
    double integral, learned, sum; /* means over the time [A] */
    double largest;                /* learned current [A] */
    double ripple;                 /* of the speed [rad/s]; by trials that of the angle [rad] */
    double measured_square;        /* mean of the square of the measured speed's error [rad^2/s^2] */
    double map_mean;               /* of the first channel's entries, 0 where there are no cells over the angle [A] */
    bool guarded;                  /* the guard held learning back meanwhile */
} state;

/* Mean of the first channel over the cells of its map [A]. */
static double mean_of_map(void)
{
    cgl_map map;
    if (rig.subject->map == NULL || rig.subject->map(&map) != CGL_MAP_OK || map.unit[0] == (uint32_t)CGL_MAP_UNIT_COSINE_CURRENT) {
        return 0;
    }
    double sum = 0;
    for (uint32_t n = 0; n < map.cells; ++n) {
        sum += (double)map.entry[n];
    }
    return sum / map.cells * (map.unit[0] == (uint32_t)CGL_MAP_UNIT_ACCELERATION ? -INERTIA / K_T : 1);
}

static state calm(double settling, double seconds)
{
    static const sums none;
    run_at(SPEED, settling);
    rig.sums = none;
    run(seconds);
    const sums *const all = &rig.sums;
    const state now = {all->integral / all->count, all->learned / all->count, all->output / all->count, all->largest,
                       sqrt(all->squares / all->count), all->measured_squares / all->count, mean_of_map(),
                       (all->status & (unsigned)CGL_STATUS_GUARDED) != 0U};
    return now;
}

/* The first bound of those above that an hour breaks; NULL: none. */
static const char *broken_bound(const state *first, const state *now)
{
    static const double needed = (LOAD + COULOMB + VISCOUS * SPEED) / K_T, cogging_rms = 0.0162 / K_T; /* A */
    const double unsteady = now->ripple / SPEED, scatter = 1e-4; /* A */
    const bool owned = !rig.subject->has_mean;
    const double held = 16 * PERIOD_GAIN * now->measured_square / SPEED;
    const double period = PERIOD_GAIN * sqrt(2 * now->measured_square);
    if (!(fabs(now->learned) + now->largest <= 2 * LIMIT && fabs(now->sum) <= LIMIT)) {
        return "finite";
    }
    if (rig.subject->trials) {
        if (!(fabs(now->sum - LOAD / K_T) <= (COULOMB + 2 * VISCOUS * SPEED) / K_T + sqrt(6.0) * cogging_rms)) {
            return "sum";
        }
    } else if (!(fabs(now->sum - needed) <= unsteady * (cogging_rms + fabs(rig.motor.offset[0])) + scatter)) {
        return "sum";
    }
    if (owned && !(fabs(now->map_mean) <= held + period + scatter)) {
        return "map";
    }
    if (owned && !(fabs(now->learned) <= held + unsteady * now->largest + scatter)) {
        return "learned";
    }
    if (!owned && !now->guarded && !rig.subject->trials && !(fabs(now->integral) <= KP * now->measured_square / SPEED + scatter)) {
        return "integral";
    }
    if (!owned && !(fabs(now->map_mean) <= (LOAD + COULOMB + INERTIA * ACCELERATION) / K_T)) {
        return "map";
    }
    if (!first->guarded && !now->guarded && !(now->largest <= 1.25 * first->largest + scatter)) {
        return "largest";
    }
    return first->guarded || now->guarded || now->ripple <= 1.25 * first->ripple ? NULL : "ripple";
}

static void print(const char *what, const state *now)
{
    printf("%-12s integral %+.5f learned %+.5f sum %+.5f A, largest %.4f map %+.6f A, ripple %.4f measured %.4f%s\n", what, now->integral,
           now->learned, now->sum, now->largest, now->map_mean, now->ripple, sqrt(now->measured_square), now->guarded ? ", guarded" : "");
}

static void begin(const subject *self, double offset, bool unguarded)
{
    memset(&rig, 0, sizeof rig);
    rig.subject = self;
    rig.unguarded = unguarded;
    rig.motor.load = LOAD;
    rig.motor.bus = BUS;
    rig.motor.turned = NAN;
    rig.motor.offset[0] = offset;
    rig.motor.offset[1] = -0.6 * offset;
    rig.learn = true;
    flash_clear(&rig.flash, 8U);
    if (!start()) {
        printf("%s: refused\n", self->name);
        exit(2);
    }
    if (self->step == step_anti_cogging) {
        cgl_anti_cogging_calibrate(&law.anti_cogging);
        do {
            period();
        } while ((rig.status & (unsigned)CGL_STATUS_BUSY) != 0U || rig.sums.count < 10);
    }
    run_at(SPEED, 60);
}

/* So many hours of one ordeal; shows the first, the last, and those that break a bound. Returns whether there were any. */
static bool drifts(const subject *self, const ordeal *trouble, long hours, double seconds)
{
    state first = {0};
    const char *broken = NULL;
    begin(self, trouble->offset, trouble->unguarded);
    for (long hour = 1; hour <= hours; ++hour) {
        char name[32];
        trouble->hour(seconds - 90);
        const state now = calm(30, 60);
        first = hour == 1 ? now : first;
        const char *const bound = broken_bound(&first, &now);
        broken = broken == NULL ? bound : broken;
        snprintf(name, sizeof name, "%ld%s%s", hour, bound ? " " : "", bound ? bound : "");
        if (bound != NULL || hour == 1 || hour == hours) {
            printf("%s, %s, hour ", self->name, trouble->name);
            print(name, &now);
        }
        fflush(stdout);
    }
    if (broken != NULL) {
        printf("%s, %s: DRIFTS (%s)\n", self->name, trouble->name, broken);
    }
    return broken != NULL;
}

/* Two rounds of all ordeals, each of a few seconds, without a guard. */
static bool drifts_soon(const subject *self)
{
    state first = {0};
    begin(self, 0, true);
    for (int round = 0; round < 2; ++round) {
        run_through_all(100);
        const state now = calm(20, 5);
        first = round == 0 ? now : first;
        const char *const bound = broken_bound(&first, &now);
        if (bound != NULL) {
            printf("%s, round %d: DRIFTS (%s): ", self->name, round + 1, bound);
            print("", &now);
            return true;
        }
    }
    return false;
}

int main(int count, char **arguments)
{
    const long hours = count > 1 ? strtol(arguments[1], NULL, 10) : 0;
    const double seconds = count > 4 ? strtod(arguments[4], NULL) : 3600;
    int broken = 0;
    for (size_t k = 0; k < sizeof subjects / sizeof subjects[0]; ++k) {
        const subject *const self = &subjects[k];
        if (count > 2 && arguments[2][0] != '\0' && strcmp(arguments[2], self->name) != 0) {
            continue;
        }
        broken += hours == 0 && drifts_soon(self);
        for (int n = 0; n < ORDEALS && hours > 0; ++n) {
            if (count <= 3 || arguments[3][0] == '\0' || strcmp(arguments[3], ordeals[n].name) == 0) {
                broken += drifts(self, &ordeals[n], hours, seconds);
            }
        }
    }
    printf("%d drift\n", broken);
    return broken > 0 ? 1 : 0;
}
