#include "loops.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "learner.h"
#include "rotor.h"

#define TWO_PI 6.283185307179586
#define PLANT_RATE 120000 /* [Hz] steps of the rotor */
#define SPEED 6.0         /* [rad/s] that each loop is asked for */

static const rotor_config gimbal = {.torque_constant = 0.06, .inertia = 4.0e-5, .coulomb = 2.0e-3, .viscous = 2.0e-5,
                                    .lag = 5.0e-4, .order = 14, .cogging = 6.0e-3, .counts = 16384};

static double limited(double x, double limit)
{
    return x > limit ? limit : (x < -limit ? -limit : x);
}

/* The angle within a turn, as the learner takes it [rad]. */
static cgl_real angle_of(double turns)
{
    return (cgl_real)(TWO_PI * (turns - floor(turns)));
}

/* Deviation of the true speed over the last seconds of a run. */
typedef struct {
    double count, sum, squares;
} ripple;

static void observe(ripple *self, double omega)
{
    self->count += 1.0;
    self->sum += omega;
    self->squares += omega * omega;
}

static double deviation(const ripple *self)
{
    const double mean = self->sum / self->count;
    return sqrt(self->squares / self->count - mean * mean);
}

/* A loop's period: from the count to the current reference [A]. Its members are those of the firmware that it follows. */
typedef double (*loop_step)(void *state, int64_t count, learner *help);

static ripple run(loop_step step, void *state, int rate, learner *help)
{
    const int parts = PLANT_RATE / rate, seconds = 40, last = 4;
    rotor motor = {.config = gimbal};
    ripple seen = {0.0, 0.0, 0.0};
    for (int n = 0; n < seconds * rate; ++n) {
        const double current = step(state, rotor_count(&motor), help);
        for (int part = 0; part < parts; ++part) {
            rotor_step(&motor, current, 1.0 / PLANT_RATE);
        }
        if (n >= (seconds - last) * rate) {
            observe(&seen, motor.omega);
        }
    }
    return seen;
}

/* The loop `alone`, and the same loop `helped` by a learner. */
static loop_result compared(loop_step step, void *alone, void *helped, int rate, const loop_gains *gains)
{
    static learner help;
    loop_result result = {.refused = learner_start(&help, gains)};
    const ripple before = run(step, alone, rate, NULL), after = run(step, helped, rate, &help);
    result.before = deviation(&before);
    result.after = deviation(&after);
    result.mean = after.sum / after.count;
    return result;
}

/* ---- as SimpleFOC ---- */

typedef struct {
    double P, I, output_ramp, limit, Tf; /* [A s/rad], [A/rad], [A/s], [A], [s] */
    double shaft_velocity, integral, output;
    double feed_forward_current_q; /* [A]; comes after the limit */
    int64_t last;
    bool started;
} simplefoc;

enum { SIMPLEFOC_RATE = 1000 };

static double simplefoc_step(void *state, int64_t count, learner *help)
{
    simplefoc *const motor = state;
    const double ts = 1.0 / SIMPLEFOC_RATE, velocity = TWO_PI * (double)(count - motor->last) / gimbal.counts / ts;
    motor->last = count;
    motor->shaft_velocity += motor->started ? (velocity - motor->shaft_velocity) * ts / (motor->Tf + ts) : 0.0;
    motor->started = true;
    const double error = SPEED - motor->shaft_velocity, before = motor->output;
    motor->integral = limited(motor->integral + motor->I * ts * error, motor->limit);
    motor->output = limited(motor->P * error + motor->integral, motor->limit);
    motor->output = before + limited(motor->output - before, motor->output_ramp * ts);
    if (help != NULL) {
        motor->feed_forward_current_q = (double)learner_current(help, angle_of((double)count / gimbal.counts),
                                                                (cgl_real)motor->shaft_velocity, (cgl_real)SPEED,
                                                                fabs(motor->output) < motor->limit);
    }
    return motor->output + motor->feed_forward_current_q;
}

static const simplefoc simplefoc_tuned = {.P = 0.04, .I = 0.8, .output_ramp = 1000.0, .limit = 2.0, .Tf = 0.005};

/* Amplitude of the measured speed that a sine of 0.1 A makes, per ampere, by its correlation over whole periods. */
static double speed_per_current(double frequency)
{
    const double amplitude = 0.1, w = TWO_PI * frequency;
    simplefoc motor = simplefoc_tuned;
    rotor plant = {.config = gimbal};
    double in_phase = 0.0, across = 0.0;
    int samples = 0;
    for (int n = 0; n < 12 * SIMPLEFOC_RATE; ++n) {
        const double phase = w * n / SIMPLEFOC_RATE;
        motor.feed_forward_current_q = amplitude * sin(phase);
        const double current = simplefoc_step(&motor, rotor_count(&plant), NULL);
        for (int part = 0; part < PLANT_RATE / SIMPLEFOC_RATE; ++part) {
            rotor_step(&plant, current, 1.0 / PLANT_RATE);
        }
        if (n >= 2 * SIMPLEFOC_RATE) {
            in_phase += motor.shaft_velocity * sin(phase);
            across += motor.shaft_velocity * cos(phase);
            ++samples;
        }
    }
    return 2.0 * sqrt(in_phase * in_phase + across * across) / samples / amplitude;
}

double simplefoc_measured_kp(void)
{
    static const double frequencies[] = {1.5, 3.0, 6.0, 9.0, 12.0, 18.0, 30.0}; /* [Hz] none of them is the cogging's */
    double largest = 0.0;
    for (unsigned n = 0; n < sizeof frequencies / sizeof frequencies[0]; ++n) {
        const double gain = speed_per_current(frequencies[n]);
        largest = gain > largest ? gain : largest;
    }
    return 1.0 / largest;
}

loop_result simplefoc_like(double kp)
{
    const simplefoc tuned = simplefoc_tuned;
    const loop_gains gains = {.rate = SIMPLEFOC_RATE, .kp = (cgl_real)(kp > 0.0 ? kp : tuned.P), .ki = (cgl_real)tuned.I, .delay = CGL_R(0.006),
                              .current_limit = (cgl_real)tuned.limit};
    simplefoc alone = tuned, helped = tuned;
    return compared(simplefoc_step, &alone, &helped, SIMPLEFOC_RATE, &gains);
}

/* ---- as ODrive ---- */

typedef struct {
    double pos_gain, vel_gain, vel_integrator_gain, torque_limit, bandwidth; /* [1/s], [N m s/turn], [N m/turn], [N m], [1/s] */
    double pos_setpoint, pos_estimate, vel_estimate, torque_integral;        /* [turn], [turn], [turn/s], [N m] */
    double input_torque;                                                     /* [N m] */
    int periods;
} odrive;

enum { ODRIVE_RATE = 8000, ODRIVE_DIVIDER = 8 };

static double odrive_step(void *state, int64_t count, learner *help)
{
    odrive *const axis = state;
    const double ts = 1.0 / ODRIVE_RATE, kp = 2.0 * axis->bandwidth, ki = axis->bandwidth * axis->bandwidth;
    axis->pos_estimate += ts * axis->vel_estimate;
    const double delta = floor((double)count - axis->pos_estimate * gimbal.counts + 0.5) / gimbal.counts;
    axis->pos_estimate += ts * kp * delta;
    axis->vel_estimate += ts * ki * delta;
    const double vel_setpoint = SPEED / TWO_PI; /* input_vel */
    axis->pos_setpoint += ts * vel_setpoint;
    const double vel_error = vel_setpoint + axis->pos_gain * (axis->pos_setpoint - axis->pos_estimate) - axis->vel_estimate;
    const double wanted = axis->vel_gain * vel_error + axis->torque_integral + axis->input_torque;
    const double torque = limited(wanted, axis->torque_limit);
    const bool free = fabs(wanted) < axis->torque_limit;
    axis->torque_integral = free ? axis->torque_integral + axis->vel_integrator_gain * ts * vel_error : 0.99 * axis->torque_integral;
    if (help != NULL && axis->periods++ % ODRIVE_DIVIDER == 0) {
        axis->input_torque = gimbal.torque_constant
                             * (double)learner_current(help, angle_of((double)count / gimbal.counts),
                                                       (cgl_real)(TWO_PI * axis->vel_estimate), (cgl_real)SPEED, free);
    }
    return torque / gimbal.torque_constant;
}

loop_result odrive_like(void)
{
    const odrive tuned = {.pos_gain = 10.0, .vel_gain = 0.016, .vel_integrator_gain = 0.16, .torque_limit = 0.12, .bandwidth = 400.0};
    /* a turn is 2 pi rad; the current is the torque by torque_constant. The position's gain acts as an integral of the speed error */
    const double kp = tuned.vel_gain / TWO_PI / gimbal.torque_constant;
    const double ki = (tuned.vel_integrator_gain + tuned.pos_gain * tuned.vel_gain) / TWO_PI / gimbal.torque_constant;
    const loop_gains gains = {.rate = (cgl_real)ODRIVE_RATE / ODRIVE_DIVIDER, .kp = (cgl_real)kp, .ki = (cgl_real)ki,
                              .delay = CGL_R(0.004), .current_limit = (cgl_real)(tuned.torque_limit / gimbal.torque_constant)};
    odrive alone = tuned, helped = tuned;
    return compared(odrive_step, &alone, &helped, ODRIVE_RATE, &gains);
}

/* ---- as moteus ---- */

typedef struct {
    double kp, ki, kd, ilimit, max_torque, bandwidth;     /* [N m/turn], [N m/turn/s], [N m s/turn], [N m], [N m], [1/s] */
    double control_position, position, velocity, integral; /* [turn], [turn], [turn/s], [N m] */
    double feedforward_torque;                             /* [N m] */
    int periods;
} moteus;

enum { MOTEUS_RATE = 15000, MOTEUS_DIVIDER = 15 };

static double moteus_step(void *state, int64_t count, learner *help)
{
    moteus *const servo = state;
    const double ts = 1.0 / MOTEUS_RATE, rate = SPEED / TWO_PI;
    const double delta = (double)count / gimbal.counts - servo->position; /* the encoder's filter */
    servo->position += ts * (servo->velocity + 2.0 * servo->bandwidth * delta);
    servo->velocity += ts * servo->bandwidth * servo->bandwidth * delta;
    servo->control_position += ts * rate;
    const double error = servo->control_position - servo->position;
    servo->integral = limited(servo->integral + servo->ki * ts * error, servo->ilimit);
    const double wanted = servo->kp * error + servo->integral + servo->kd * (rate - servo->velocity) + servo->feedforward_torque;
    if (help != NULL && servo->periods++ % MOTEUS_DIVIDER == 0) {
        servo->feedforward_torque = gimbal.torque_constant
                                    * (double)learner_current(help, angle_of(servo->position), (cgl_real)(TWO_PI * servo->velocity),
                                                              (cgl_real)SPEED, fabs(wanted) < servo->max_torque);
    }
    return limited(wanted, servo->max_torque) / gimbal.torque_constant;
}

loop_result moteus_like(void)
{
    const moteus tuned = {.kp = 0.4, .ki = 0.4, .kd = 0.016, .ilimit = 0.03, .max_torque = 0.12, .bandwidth = 600.0};
    /* kd acts on the speed error, and kp on its integral */
    const loop_gains gains = {.rate = (cgl_real)MOTEUS_RATE / MOTEUS_DIVIDER,
                              .kp = (cgl_real)(tuned.kd / TWO_PI / gimbal.torque_constant),
                              .ki = (cgl_real)(tuned.kp / TWO_PI / gimbal.torque_constant), .delay = CGL_R(0.003),
                              .current_limit = (cgl_real)(tuned.max_torque / gimbal.torque_constant)};
    moteus alone = tuned, helped = tuned;
    return compared(moteus_step, &alone, &helped, MOTEUS_RATE, &gains);
}
