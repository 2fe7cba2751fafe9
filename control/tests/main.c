/* The tests that need no Python: random inputs, the README's example, a calibration that is long for a float.
 * cogless_control_tests [CONFIGS]: so many random configs for each law, 300 steps or more each; default 500. */
#include <stdio.h>
#include <stdlib.h>

#include "board.h"
#include "check.h"
#include "cogless/anti_cogging.h"
#include "cogless/angle.h"
#include "cogless/transform.h"
#include "random_inputs.h"

bool control_start(void);
void current_loop_interrupt(void);

/* ---- a motor for the README's example: current loop sampled without delay, cogging of 6 periods a pole pair ---- */

static struct {
    cgl_real i_d, i_q, theta_m, omega_m;
} motor;
static cgl_real slowest, fastest;

board_sample board_measure(void)
{
    const cgl_real theta_e = CGL_R(4.0) * motor.theta_m;
    board_sample sample;
    cgl_real sine, cosine, alpha, beta;
    cgl_sincos(theta_e, &sine, &cosine);
    cgl_park_inverse(motor.i_d, motor.i_q, sine, cosine, &alpha, &beta);
    cgl_clarke_inverse(alpha, beta, sample.i_abc);
    sample.theta_m = motor.theta_m;
    sample.omega_m = motor.omega_m;
    sample.u_dc = CGL_R(310.0);
    return sample;
}

void board_set_duty(const cgl_real duty[3])
{
    const cgl_real ts = CGL_R(1.0) / CGL_R(15000.0), R = CGL_R(5.0), L = CGL_R(0.01), psi = CGL_R(0.068);
    const cgl_real omega_e = CGL_R(4.0) * motor.omega_m;
    cgl_real volts[3], alpha, beta, sine, cosine, u_d, u_q, cogging, unused;
    for (int x = 0; x < 3; ++x) {
        CHECK(duty[x] >= CGL_R(0.0) && duty[x] <= CGL_R(1.0));
        volts[x] = duty[x] * CGL_R(310.0);
    }
    cgl_clarke(volts, &alpha, &beta);
    cgl_sincos(CGL_R(4.0) * motor.theta_m + CGL_R(1.5) * ts * omega_e, &sine, &cosine);
    cgl_park(alpha, beta, sine, cosine, &u_d, &u_q);
    motor.i_d += ts / L * (u_d - R * motor.i_d + omega_e * L * motor.i_q);
    motor.i_q += ts / L * (u_q - R * motor.i_q - omega_e * (L * motor.i_d + psi));
    cgl_sincos(CGL_R(24.0) * motor.theta_m, &cogging, &unused);
    motor.omega_m += ts / CGL_R(2.5e-4) * (CGL_R(0.408) * motor.i_q - CGL_R(0.02) * cogging);
    motor.theta_m = CGL_TWO_PI * cgl_fraction((motor.theta_m + ts * motor.omega_m) / CGL_TWO_PI);
    slowest = motor.omega_m < slowest ? motor.omega_m : slowest;
    fastest = motor.omega_m > fastest ? motor.omega_m : fastest;
}

static cgl_real ripple_over(int interrupts)
{
    slowest = fastest = motor.omega_m;
    for (int n = 0; n < interrupts; ++n) {
        current_loop_interrupt();
    }
    return fastest - slowest;
}

static void readme_example(void)
{
    CHECK(control_start());
    ripple_over(15000);
    const cgl_real early = ripple_over(15000);
    ripple_over(8 * 15000);
    const cgl_real late = ripple_over(15000);
    CHECK(slowest > CGL_R(5.5) && fastest < CGL_R(7.0));
    CHECK(late < CGL_R(0.7) * early);
}

/* ---- 2e-5 rad a step over 75 rad: a sum of steps would stall in float, where neighbouring numbers are 8e-6 apart ---- */

static void long_calibration(void)
{
    static cgl_real table[16];
    const cgl_anti_cogging_config config = {{CGL_R(1.0), CGL_R(1.0), CGL_R(5.0e-5), CGL_R(2.0)},
                                            16U,
                                            CGL_R(0.4),
                                            12U,
                                            CGL_R(5.0),
                                            CGL_R(0.0)};
    cgl_anti_cogging law;
    CHECK(cgl_anti_cogging_init(&config, &law, table, 16U) == CGL_OK);
    cgl_anti_cogging_calibrate(&config, &law);
    const double step = (double)config.speed * (double)config.pi.ts;
    double theta = 0.0, furthest = 0.0;
    cgl_speed_input in = {CGL_R(0.0), config.speed, CGL_R(0.0), CGL_R(0.1), false};
    cgl_speed_output out = {CGL_R(0.0), 0U};
    do {
        cgl_anti_cogging_step(&config, &law, &in, &out);
        theta += law.stage == CGL_ANTI_COGGING_BACKWARD ? -step : step;
        furthest = theta > furthest ? theta : furthest;
        in.theta_m = (cgl_real)(theta - (double)((long)(theta / (double)CGL_TWO_PI)) * (double)CGL_TWO_PI);
        CHECK(cgl_abs(law.behind) < CGL_R(0.02)); /* the rotor goes as the path should */
    } while ((out.status & (unsigned)CGL_STATUS_BUSY) != 0U && furthest < 100.0);
    CHECK(furthest > 75.0 && furthest < 80.0);
    CHECK(cgl_abs(law.friction) < CGL_R(1.0e-6));
}

int main(int count, char **arguments)
{
    random_inputs(count > 1 ? strtol(arguments[1], NULL, 10) : 500L);
    readme_example();
    long_calibration();
    printf("%d failures\n", failures());
    return failures() > 0 ? 1 : 0;
}
