/* The tests that need no Python: known answers, random inputs, the README's example, a calibration that is long for a float, and
 * what the transcriptions in NumPy say of the same inputs; misuse of the interface, and foreign loops that a learner helps.
 * cogless_control_tests [CONFIGS]: so many random configs for each law, 300 steps or more each; default 500, and never fewer
 * than have a checksum. */
#include <stdio.h>
#include <stdlib.h>

#include "board.h"
#include "bounds.h"
#include "check.h"
#include "cogless/anti_cogging.h"
#include "cogless/quality.h"
#include "control.h"
#include "faces.h"
#include "foreign.h"
#include "guarded.h"
#include "known_answers.h"
#include "memories.h"
#include "parts.h"
#include "random_inputs.h"
#include "stored_maps.h"
#include "vectors.h"

/* ---- the README's example on the simulated motor ---- */

static cgl_real slowest, fastest;

static cgl_real ripple_over(int interrupts)
{
    slowest = fastest = board_measure().omega_m;
    for (int n = 0; n < interrupts; ++n) {
        current_loop_interrupt();
        const cgl_real omega_m = board_measure().omega_m;
        slowest = omega_m < slowest ? omega_m : slowest;
        fastest = omega_m > fastest ? omega_m : fastest;
    }
    return fastest - slowest;
}

static void readme_example(void)
{
    CHECK(control_start());
    ripple_over(BOARD_RATE);
    const cgl_real early = ripple_over(BOARD_RATE);
    ripple_over(8 * BOARD_RATE);
    const cgl_real late = ripple_over(BOARD_RATE);
    CHECK(slowest > CGL_R(5.5) && fastest < CGL_R(7.0));
    CHECK(late < CGL_R(0.7) * early);
}

/* ---- 2e-5 rad a step over 75 rad: a sum of steps would stall in float, where neighbouring numbers are 8e-6 apart ---- */

static void long_calibration(void)
{
    static cgl_real table[16];
    const cgl_anti_cogging_config config = {{CGL_R(1.0), CGL_R(1.0), CGL_R(2.0)},
                                            16U,
                                            CGL_R(0.4),
                                            12U,
                                            CGL_R(5.0),
                                            CGL_R(0.0)};
    const cgl_loop loop = {.ts = CGL_R(5.0e-5), .current_limit = CGL_R(100.0)};
    cgl_anti_cogging law;
    CHECK(cgl_anti_cogging_init(&law, &config, &loop, table, 16U) == CGL_OK);
    cgl_anti_cogging_calibrate(&law);
    const double step = (double)config.speed * (double)CGL_R(5.0e-5);
    double theta = 0.0, furthest = 0.0;
    cgl_law_input in = {.omega_m = config.speed, .i_q = CGL_R(0.1), .learn = true};
    cgl_law_output out = {CGL_R(0.0), 0U};
    do {
        cgl_anti_cogging_step(&law, &in, &out);
        theta += law.stage == CGL_ANTI_COGGING_BACKWARD ? -step : step;
        furthest = theta > furthest ? theta : furthest;
        in.theta_m = (cgl_real)(theta - (double)((long)(theta / (double)CGL_TWO_PI)) * (double)CGL_TWO_PI);
        CHECK(cgl_abs(law.behind) < CGL_R(0.02)); /* the rotor goes as the path should */
    } while ((out.status & (unsigned)CGL_STATUS_BUSY) != 0U && furthest < 100.0);
    CHECK(furthest > 75.0 && furthest < 80.0);
    CHECK(cgl_abs(law.friction) < CGL_R(1.0e-6));
}

/* ---- more samples than a float counts ---- */

static void long_window(void)
{
    const cgl_quality_config config = {CGL_TWO_PI, CGL_R(1.0e5), CGL_R(0.0), CGL_R(0.0)};
    cgl_quality quality;
    CHECK(cgl_quality_init(&quality, &config, CGL_R(1.0e-3)) == CGL_OK);
    for (uint32_t n = 0; quality.windows == 0U; ++n) {
        cgl_quality_step(&quality, n % 2U ? CGL_R(1.0) : CGL_R(-1.0), CGL_R(0.0), false);
    }
    CHECK(cgl_is_within(cgl_quality_read(&quality).residual - CGL_R(1.0), CGL_R(1.0e-4)));
}

int main(int count, char **arguments)
{
    const long asked = count > 1 ? strtol(arguments[1], NULL, 10) : 500L;
    const long configs = asked > CHECKED_CONFIGS ? asked : CHECKED_CONFIGS;
    known_answers();
    golden_vectors();
    bounds();
    memories();
    faces();
    foreign_loops();
    guarded(configs);
    random_inputs(configs);
    try_parts(configs);
    random_flash(10L * configs);
    stored_maps();
    readme_example();
    long_calibration();
    long_window();
    printf("%d failures\n", failures());
    return failures() > 0 ? 1 : 0;
}
