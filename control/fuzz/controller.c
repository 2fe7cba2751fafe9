/* Whole controllers: a drive and a law, whose harness is HARNESS, configured by the fuzzer's bytes and called in any order with any
 * inputs. Outputs are within their limits, duty cycles within [0, 1], states finite, and what is frozen stays. */
#include "cogless/drive.h"
#include "feed.h"
#include "harness.h"

static cgl_drive_config random_drive(cgl_real ts)
{
    cgl_drive_config config;
    config.pole_pairs = 1U + (random_below(2U) ? random_below(16U) : random_below(10000U));
    config.divider = 1U + random_below(4U);
    config.foreign = random_below(4U) == 0U;
    config.feed_forward = config.foreign && random_below(2U) == 0U;
    config.unguarded = random_below(4U) == 0U;
    config.learn_saturated = random_below(2U) != 0U;
    config.foc.kp_d = random_gain(CGL_R(10.0));
    config.foc.ki_d = random_gain(CGL_R(1000.0));
    config.foc.kp_q = random_gain(CGL_R(10.0));
    config.foc.ki_q = random_gain(CGL_R(1000.0));
    config.foc.current_limit = random_gain(CGL_R(5.0));
    config.foc.advance = random_gain(CGL_R(2.0));
    config.foc.decoupling = random_below(2U) != 0U;
    config.foc.L_d = random_gain(CGL_R(1.0e-2));
    config.foc.L_q = random_gain(CGL_R(1.0e-2));
    config.foc.psi_f = random_gain(CGL_R(0.1));
    config.foc.phases = random_below(2U) ? 3U : 2U;
    config.monitor.omega_max = random_below(2U) ? CGL_R(0.0) : random_gain(CGL_R(1000.0));
    config.monitor.angle_step = random_gain(CGL_R(0.1));
    config.monitor.speed_window = random_gain(CGL_R(5.0) * ts);
    config.monitor.stuck_angle = random_below(2U) ? CGL_R(0.0) : random_gain(CGL_R(1.0));
    config.monitor.stuck_time = random_gain(CGL_R(5.0) * ts);
    config.monitor.current_max = random_below(2U) ? CGL_R(0.0) : random_gain(CGL_R(20.0));
    config.monitor.current_sum = random_below(2U) ? CGL_R(0.0) : random_gain(CGL_R(20.0));
    config.monitor.bridge = random_gain(CGL_R(5.0) * ts);
    config.monitor.hold = random_gain(CGL_R(5.0) * ts);
    config.monitor.phases = config.foreign ? 0U : config.foc.phases;
    config.quality.span = random_gain(CGL_R(7.0));
    config.quality.longest = random_gain(CGL_R(100.0) * (cgl_real)config.divider * ts);
    config.quality.outlier = random_below(2U) ? CGL_R(0.0) : CGL_R(1.0) + random_gain(CGL_R(5.0));
    config.quality.floor = random_gain(CGL_R(1.0));
    return config;
}

static cgl_real theta, omega;
static cgl_real limit; /* of the law when it gave the command that the drive has */

/* A rotor that turns, with measurements that may be anything. */
static cgl_measurement random_measurement(void)
{
    cgl_measurement now;
    const uint32_t kind = random_below(256U);
    if ((kind & 1U) != 0U) {
        omega = random_real(CGL_R(300.0));
    }
    theta = (kind & 2U) != 0U ? random_real(CGL_R(7.0)) : theta + CGL_R(1.0e-3) * omega;
    now.theta_m = theta;
    now.omega_m = omega;
    for (int x = 0; x < 3; ++x) {
        now.i_abc[x] = (kind & 4U) != 0U ? random_real(CGL_R(5.0)) : CGL_R(0.0);
    }
    now.u_dc = (kind & 8U) != 0U ? random_real(CGL_R(300.0)) : CGL_R(300.0);
    return now;
}

static cgl_reference random_reference(void)
{
    cgl_reference reference;
    const bool any = random_below(2U) != 0U;
    reference.theta_ref = any ? random_real(CGL_R(7.0)) : CGL_R(1.0);
    reference.omega_ref = any ? random_real(CGL_R(300.0)) : CGL_R(100.0);
    reference.alpha_ref = any ? random_real(CGL_R(1000.0)) : CGL_R(0.0);
    reference.i_d_ref = any ? random_real(CGL_R(5.0)) : CGL_R(0.0);
    reference.learn = !any || random_below(2U) != 0U;
    reference.torque = any && random_below(4U) == 0U;
    reference.i_q_ref = reference.torque ? random_real(CGL_R(5.0)) : CGL_R(0.0);
    return reference;
}

static void check_output(const cgl_drive_config *config, const cgl_drive_output *out)
{
    for (int x = 0; x < 3; ++x) {
        CHECK(out->duty[x] >= CGL_R(0.0) && out->duty[x] <= CGL_R(1.0));
    }
    CHECK(cgl_is_finite(out->i_d) && cgl_is_finite(out->i_q) && cgl_is_finite(out->u_d) && cgl_is_finite(out->u_q));
    CHECK(cgl_is_finite(out->i_d_ref) && within(out->i_q_ref, limit));
    if (!config->foreign && (out->status & ((unsigned)CGL_STATUS_SATURATED | (unsigned)CGL_STATUS_OFF)) == 0U) {
        CHECK(within(out->i_d_ref, config->foc.current_limit) && within(out->i_q_ref, config->foc.current_limit));
    }
}

static void check_drive(const cgl_drive *drive)
{
    CHECK(drive->monitor.theta_m >= CGL_R(0.0) && drive->monitor.theta_m <= CGL_TWO_PI);
    CHECK(cgl_is_finite(drive->monitor.omega_m) && cgl_is_finite(drive->monitor.theta_sensor));
    CHECK(cgl_is_finite(drive->monitor.ref_turned));
    CHECK(within(drive->monitor.sensor_offset, CGL_R(3.15)));
    CHECK(cgl_is_finite(drive->foc.integral_d) && cgl_is_finite(drive->foc.integral_q));
    CHECK(cgl_is_finite(drive->quality.sum + drive->quality.outlier_sum));
    CHECK(cgl_is_finite(drive->quality.squares + drive->quality.outlier_squares));
    CHECK(cgl_is_finite(drive->quality.turned) && cgl_is_finite(drive->quality.ripple));
    CHECK(cgl_is_finite(drive->quality.ripple_before) && cgl_is_finite(drive->quality.trend));
    const cgl_quality_report report = cgl_quality_read(&drive->quality);
    CHECK(cgl_is_finite(report.residual) && cgl_is_finite(report.progress));
}

static void run(const cgl_drive_config *config, cgl_drive *drive)
{
    while (fed()) {
        const uint32_t call = random_below(256U);
        if (call < 4U) {
            cgl_drive_reset(drive);
        } else if (call < 8U) {
            reset_law(&HARNESS);
        } else if (call < 12U) {
            cgl_monitor_trust(&drive->monitor);
        } else if (call < 22U && HARNESS.call != NULL) {
            HARNESS.call();
        } else if (call < 32U) {
            retune_law(&HARNESS);
        } else if (call < 48U) { /* the law by itself, with what no monitor has looked at */
            cgl_law_input in = {random_real(CGL_R(7.0)),   random_real(CGL_R(100.0)),
                                random_real(CGL_R(100.0)), random_real(CGL_R(7.0)),
                                random_real(CGL_R(100.0)), random_real(CGL_R(5.0)),
                                random_below(2U) != 0U,    random_below(8U) == 0U,
                                random_below(8U) == 0U,    random_real(CGL_R(1.0)),
                                random_below(8U),          random_below(8U) == 0U,
                                random_real(CGL_R(5.0))};
            cgl_law_output out;
            step_law(&HARNESS, &in, &out);
        } else {
            const cgl_measurement now = random_measurement();
            const cgl_reference reference = random_reference();
            cgl_drive_output out;
            if (cgl_drive_measure(drive, &now, &reference)) {
                step_law(&HARNESS, &drive->in, &drive->command);
                limit = HARNESS.limit();
            }
            cgl_drive_actuate(drive, &out);
            check_output(config, &out);
        }
        check_drive(drive);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    feed(data, size);
    if (HARNESS.spoil != NULL && random_below(16U) == 0U) {
        spoil_law(&HARNESS);
        return 0;
    }
    cgl_drive drive;
    theta = omega = limit = CGL_R(0.0);
    const cgl_real ts = random_gain(CGL_R(1.0e-3));
    const cgl_drive_config config = random_drive(ts);
    if (cgl_drive_init(&drive, &config, ts) == CGL_OK && begin_law(&HARNESS)) {
        run(&config, &drive);
        end_law(&HARNESS);
    }
    return 0;
}
