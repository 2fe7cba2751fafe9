/* A law on a drive of a few lines for ten hours. `ten_hours LAW` prints name and value of each result, a line each.
 *
 * The plant is an inertia with cogging and a constant load. Its current follows after a period, and its encoder has 14 bits with
 * the speed over two periods. The law is disturbed in the first minute and again at the end: what it has learned fades out for
 * five seconds, as when the guard probes, and then the angle is lost for 0.1 s at each of eight angles. Last comes torque mode at a
 * command of zero, while the rotor is turned from outside. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cogless/anti_cogging.h"
#include "cogless/harmonic.h"
#include "cogless/pi_afc.h"
#include "cogless/pi_ilc.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/trial.h"

#define TAU 6.283185307179586
#define TS 2e-3     /* s, of the law */
#define OMEGA TAU   /* rad/s */
#define POLE_PAIRS 4U
#define K_T 0.4     /* N m/A */
#define J 4e-4      /* kg m^2 */
#define LOAD 0.01   /* N m */
#define CELLS 128U
#define COUNT (TAU / 16384)
#define SECOND 500L /* steps */
#define HOURS (10L * 3600L * SECOND)

static cgl_real cells[4U * 1024U];

static union {
    cgl_pi_ilc pi_ilc;
    cgl_robust_ilc robust_ilc;
    cgl_space_speed space_speed;
    cgl_space_position space_position;
    cgl_pi_afc pi_afc;
    cgl_harmonic harmonic;
    cgl_anti_cogging anti_cogging;
} law;

typedef void stepper(const cgl_law_input *in, cgl_law_output *out);

#define STEP(name)                                                                     \
    static void step_##name(const cgl_law_input *in, cgl_law_output *out)              \
    {                                                                                  \
        cgl_##name##_step(&law.name, in, out);                                         \
    }
STEP(pi_ilc)
STEP(robust_ilc)
STEP(space_speed)
STEP(space_position)
STEP(pi_afc)
STEP(harmonic)
STEP(anti_cogging)

static const cgl_pi_config pi = {.kp = 0.05f, .ki = 0.5f, .limit = 3.0f};

static uint32_t entries_of(const cgl_memory_config *memory)
{
    return CGL_MEMORY_LENGTH(memory->kind, memory->channels, memory->cells, memory->q_half_width);
}

static stepper *init(const char *name)
{
    const cgl_loop loop = {.ts = (cgl_real)TS, .current_limit = 3.0f};
    cgl_memory_config memory = {.channels = 1U, .cells = CELLS, .turns = 1U, .parts = POLE_PAIRS, .q_half_width = 3U,
                                .forgetting = 1.0f, .limit = {1.0f, 1.0f, 1.0f}};
    cgl_error error = CGL_ERROR_CONFIG;
    stepper *step = NULL;
    if (strncmp(name, "pi-ilc", 6) == 0) {
        memory.kind = strcmp(name, "pi-ilc by time") == 0 ? CGL_MEMORY_TIME : CGL_MEMORY_ANGLE;
        memory.cells = memory.kind == CGL_MEMORY_TIME ? 200U : CELLS;
        memory.lead = strcmp(name, "pi-ilc with a lead") == 0 ? 3U : 0U;
        const cgl_pi_ilc_config config = {.pi = pi, .gain = 0.01f, .memory = memory};
        error = cgl_pi_ilc_init(&law.pi_ilc, &config, &loop, cells, entries_of(&memory));
        step = step_pi_ilc;
    } else if (strncmp(name, "robust-ilc", 10) == 0) {
        const cgl_real b = (cgl_real)(K_T / J);
        memory.limit[0] = b;
        const cgl_robust_ilc_config config = {.b = b, .c = 10.0f, .eta = 0.05f * b, .q = 1.0f, .beta_2 = 0.01f * b,
                                              .gamma = strcmp(name, "robust-ilc alone") == 0 ? 0.0f : 100.0f, .limit = 3.0f,
                                              .memory = memory};
        error = cgl_robust_ilc_init(&law.robust_ilc, &config, &loop, cells, entries_of(&memory));
        step = step_robust_ilc;
    } else if (strcmp(name, "space-speed") == 0) {
        memory.channels = 2U;
        const cgl_space_speed_config config = {.k = 0.05f, .mu_alpha = 0.03f, .mu_beta = 0.0004f, .eta_bar = 6.0f,
                                               .omega_min = 0.5f, .limit = 3.0f, .ratio = 1U, .memory = memory};
        error = cgl_space_speed_init(&law.space_speed, &config, &loop, cells, entries_of(&memory));
        step = step_space_speed;
    } else if (strncmp(name, "space-position", 14) == 0) {
        memory.channels = 2U;
        const cgl_space_position_config config = {
            .ratio = 1U, .k_theta = 10.0f, .k_omega = 0.05f, .k_i = 0.5f, .mu_alpha = 0.03f, .mu_beta = 0.0004f,
            .hand_over = strstr(name, "handed over") != NULL, .ramp = 1.0f, .omega_min = 0.5f,
            .index = strstr(name, "rotor") != NULL ? CGL_SPACE_BY_ROTOR : CGL_SPACE_BY_REFERENCE, .limit = 3.0f,
            .memory = memory};
        error = cgl_space_position_init(&law.space_position, &config, &loop, cells, entries_of(&memory));
        step = step_space_position;
    } else if (strcmp(name, "pi-afc") == 0) {
        const cgl_pi_afc_config config = {.pi = pi, .orders = 2U, .order = {POLE_PAIRS, 2U * POLE_PAIRS}, .gain = 0.1f,
                                          .lead = 0.005f, .omega_min = 0.5f, .limit = 1.0f};
        error = cgl_pi_afc_init(&law.pi_afc, &config, &loop, cells, CGL_PI_AFC_LENGTH(config.orders));
        step = step_pi_afc;
    } else if (strcmp(name, "harmonic") == 0) {
        const cgl_harmonic_config config = {.pi = pi, .b = (cgl_real)(K_T / J), .delay = (cgl_real)TS, .base = POLE_PAIRS,
                                            .bends = 1U, .orders = 4U, .rate = 1.0f, .rate_min = 0.05f, .limit = 1.0f};
        error = cgl_harmonic_init(&law.harmonic, &config, &loop, cells, CGL_HARMONIC_LENGTH(config.orders));
        step = step_harmonic;
    } else if (strcmp(name, "anti-cogging") == 0) {
        const cgl_anti_cogging_config config = {.pi = pi, .cells = 4U * CELLS, .speed = 1.0f, .revolutions = 1U,
                                                .position_gain = 5.0f};
        error = cgl_anti_cogging_init(&law.anti_cogging, &config, &loop, cells, config.cells);
        cgl_anti_cogging_calibrate(&law.anti_cogging);
        step = step_anti_cogging;
    }
    return error == CGL_OK ? step : NULL;
}

/* State of the drive, and the results. */
static double theta, omega, i_q, shown[3], theta_ref;
static double i_sum, squares, deviation;

static double cogging(double x)
{
    return 0.02 * sin(POLE_PAIRS * x) + 0.01 * sin(2 * POLE_PAIRS * x + 1) + 0.005 * sin(6 * POLE_PAIRS * x);
}

typedef enum { ROTOR_RUNS, ANGLE_LOST, TORQUE_MODE } state;

/* Runs some steps. Each mutes the learned part by `muting`. In torque mode the rotor turns at `speed_share` of the speed. */
static unsigned run(stepper *step, long steps, double muting, state now, double speed_share)
{
    const bool lost = now == ANGLE_LOST, torque = now == TORQUE_MODE;
    static double muted = 0;
    cgl_law_output out = {0};
    i_sum = squares = deviation = 0;
    for (long n = 0; n < steps; ++n) {
        shown[2] = shown[1];
        shown[1] = shown[0];
        shown[0] = floor(theta / COUNT) * COUNT;
        muted = fmin(1.0, fmax(0.0, muted + muting));
        cgl_law_input in = {.theta_ref = (cgl_real)fmod(theta_ref, TAU), .omega_ref = (cgl_real)OMEGA,
                            .theta_m = lost ? (cgl_real)NAN : (cgl_real)(shown[0] - TAU * floor(shown[0] / TAU)),
                            .omega_m = (cgl_real)((shown[0] - shown[2]) / (2 * TS)), .i_q = (cgl_real)i_q,
                            .learn = !lost && !(muted > 0), .off = lost, .muted = (cgl_real)muted, .torque = torque};
        if (torque) {
            omega = speed_share * OMEGA;
            in.omega_ref = in.omega_m;
            in.theta_ref = in.theta_m;
        }
        step(&in, &out);
        for (int part = 0; part < 2; ++part) {
            omega += torque ? 0 : 0.5 * TS * (K_T * i_q - cogging(theta) - LOAD) / J;
            theta += 0.5 * TS * omega;
        }
        i_q = (double)out.i_q_ref;
        theta_ref += TS * OMEGA;
        if (lost) {
            theta_ref = theta;
        }
        if (theta > 1024 * TAU) { /* removes whole turns, which are whole counts */
            theta -= 1024 * TAU;
            theta_ref -= 1024 * TAU;
            for (int k = 0; k < 3; ++k) {
                shown[k] -= 1024 * TAU;
            }
        }
        i_sum += i_q;
        squares += (omega - OMEGA) * (omega - OMEGA);
        deviation = fmax(deviation, fabs(omega - OMEGA));
    }
    return out.status;
}

/* The speed error while the learned part is muted, and after angle dropouts at eight angles. */
static void disturb(stepper *step, const char *when)
{
    const double fade = 1.0 / (SECOND / 2);
    (void)run(step, SECOND / 2, fade, ROTOR_RUNS, 1.0);
    double most = deviation;
    (void)run(step, 5 * SECOND, 0, ROTOR_RUNS, 1.0);
    most = fmax(most, deviation);
    (void)run(step, SECOND / 2, -fade, ROTOR_RUNS, 1.0);
    most = fmax(most, deviation);
    (void)run(step, 5 * SECOND, 0, ROTOR_RUNS, 1.0);
    printf("%s_muted %.9g\n", when, fmax(most, deviation));
    most = 0;
    for (int eighth = 0; eighth < 8; ++eighth) {
        while (fabs(remainder(POLE_PAIRS * theta - TAU * eighth / 8, TAU)) > 0.5 * POLE_PAIRS * TS * OMEGA) {
            (void)run(step, 1, 0, ROTOR_RUNS, 1.0);
        }
        (void)run(step, SECOND / 10, 0, ANGLE_LOST, 1.0);
        (void)run(step, 5 * SECOND, 0, ROTOR_RUNS, 1.0);
        most = fmax(most, deviation);
    }
    printf("%s_dropout %.9g\n", when, most);
}

enum { TRIAL_SAMPLES = 50, TRIALS = 36000 };

/* The same time for trials of a second: error and learned mean on a first-order plant, whose disturbance has a mean. */
static int run_trials(void)
{
    static cgl_trial trial;
    static cgl_real y_ref[TRIAL_SAMPLES];
    const cgl_trial_config config = {.samples = TRIAL_SAMPLES, .states = 1U, .k_1 = {-0.5f}, .k_2 = 0.2f, .n = 0.5f,
                                     .c = {1.0f}, .through_integrator = true, .k_3 = 0.3f, .shift = 1U, .limit = 100.0f,
                                     .learned_limit = 100.0f};
    if (cgl_trial_init(&trial, &config, cells, sizeof cells / sizeof cells[0]) != CGL_OK) {
        return 2;
    }
    for (int p = 0; p < TRIAL_SAMPLES; ++p) {
        y_ref[p] = (cgl_real)(1 - cos(TAU * p / TRIAL_SAMPLES));
    }
    for (long count = 1; count <= TRIALS; ++count) {
        double y = 0, mean = 0, most = 0;
        cgl_trial_begin(&trial, y_ref);
        for (int p = 0; p < TRIAL_SAMPLES; ++p) {
            const cgl_trial_input in = {.x = {(cgl_real)(floor(y * 1024) / 1024)}, .learn = true};
            cgl_trial_output out;
            cgl_trial_step(&trial, &in, &out);
            most = p > 0 ? fmax(most, fabs(y - (double)y_ref[p])) : 0;
            y = 0.9 * y + (double)out.u - 0.3 - 0.2 * sin(TAU * 3 * p / TRIAL_SAMPLES);
        }
        (void)cgl_trial_end(&trial);
        for (int p = 0; p < TRIAL_SAMPLES; ++p) {
            mean += (double)trial.learned[p] / TRIAL_SAMPLES;
        }
        if (count == 300 || count == TRIALS) {
            printf("%s_error %.9g\n%s_mean %.9g\n", count == 300 ? "early" : "late", most, count == 300 ? "early" : "late", mean);
        }
    }
    return 0;
}

int main(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], "trial") == 0) {
        return run_trials();
    }
    stepper *const step = argc > 1 ? init(argv[1]) : NULL;
    if (step == NULL) {
        return 2;
    }
    omega = OMEGA;
    if (step == step_anti_cogging) {
        omega = 0;
        while ((run(step, 1, 0, ROTOR_RUNS, 1.0) & (unsigned)CGL_STATUS_BUSY) != 0U) {
        }
    }
    (void)run(step, 10 * SECOND, 0, ROTOR_RUNS, 1.0);
    disturb(step, "early");
    (void)run(step, 300 * SECOND, 0, ROTOR_RUNS, 1.0);
    (void)run(step, 60 * SECOND, 0, ROTOR_RUNS, 1.0);
    printf("early_ripple %.9g\n", sqrt(squares / (60 * SECOND)));
    (void)run(step, HOURS, 0, ROTOR_RUNS, 1.0);
    (void)run(step, 60 * SECOND, 0, ROTOR_RUNS, 1.0);
    printf("late_ripple %.9g\n", sqrt(squares / (60 * SECOND)));
    printf("load_current %.9g\n", i_sum / (60 * SECOND));
    disturb(step, "late");
    (void)run(step, 60 * SECOND, 0, ROTOR_RUNS, 1.0);
    (void)run(step, 60 * SECOND, 0, TORQUE_MODE, 1.0);
    printf("torque_current %.9g\n", i_sum / (60 * SECOND));
    (void)run(step, 60 * SECOND, 0, TORQUE_MODE, 0.25);
    printf("slow_torque_current %.9g\n", i_sum / (60 * SECOND));
    return 0;
}
