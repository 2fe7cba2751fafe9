/* A simulated motor: four pole pairs, cogging of six periods a pole pair. Current loop sampled without delay. */
#include "board.h"

#include "cogless/angle.h"
#include "cogless/transform.h"

static struct {
    cgl_real i_d, i_q, theta_m, omega_m;
} motor; /* a model of hardware may be global: there is one */

cgl_measurement board_measure(void)
{
    cgl_measurement now;
    cgl_real sine, cosine, alpha, beta;
    cgl_sincos(CGL_R(4.0) * motor.theta_m, &sine, &cosine);
    cgl_park_inverse(motor.i_d, motor.i_q, sine, cosine, &alpha, &beta);
    cgl_clarke_inverse(alpha, beta, now.i_abc);
    now.theta_m = motor.theta_m;
    now.omega_m = motor.omega_m;
    now.u_dc = CGL_R(310.0);
    return now;
}

static void turn(cgl_real ts)
{
    cgl_real cogging, unused;
    cgl_sincos(CGL_R(24.0) * motor.theta_m, &cogging, &unused);
    motor.omega_m += ts / CGL_R(2.5e-4) * (CGL_R(0.408) * motor.i_q - CGL_R(0.02) * cogging);
    motor.theta_m = CGL_TWO_PI * cgl_fraction((motor.theta_m + ts * motor.omega_m) / CGL_TWO_PI);
}

void board_set_duty(const cgl_real duty[3])
{
    const cgl_real ts = CGL_R(1.0) / (cgl_real)BOARD_RATE, R = CGL_R(5.0), L = CGL_R(0.01), psi = CGL_R(0.068);
    const cgl_real omega_e = CGL_R(4.0) * motor.omega_m;
    cgl_real volts[3], alpha, beta, sine, cosine, u_d, u_q;
    for (int x = 0; x < 3; ++x) {
        volts[x] = duty[x] * CGL_R(310.0);
    }
    cgl_clarke(volts, &alpha, &beta);
    cgl_sincos(CGL_R(4.0) * motor.theta_m + CGL_R(1.5) * ts * omega_e, &sine, &cosine);
    cgl_park(alpha, beta, sine, cosine, &u_d, &u_q);
    motor.i_d += ts / L * (u_d - R * motor.i_d + omega_e * L * motor.i_q);
    motor.i_q += ts / L * (u_q - R * motor.i_q - omega_e * (L * motor.i_d + psi));
    turn(ts);
}

void board_open_bridge(void)
{
    motor.i_d = motor.i_q = CGL_R(0.0); /* soon, through the diodes */
    turn(CGL_R(1.0) / (cgl_real)BOARD_RATE);
}
