/* Whole controllers: a drive and a law, configured by the fuzzer's bytes and called in any order with any inputs. Outputs
 * are within their limits, duty cycles within [0, 1], states finite, and what is frozen stays. */
#include "cogless/drive.h"
#include "law.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static cgl_drive_config feed_drive(feed *from, cgl_real ts)
{
    cgl_drive_config config;
    config.pole_pairs = 1U + (feed_bool(from) ? feed_below(from, 16U) : feed_below(from, 10000U));
    config.divider = 1U + feed_below(from, 4U);
    config.foreign = feed_below(from, 4U) == 0U;
    config.feed_forward = config.foreign && feed_below(from, 2U) == 0U;
    config.unguarded = feed_below(from, 4U) == 0U;
    config.learn_saturated = feed_bool(from);
    config.foc.kp_d = feed_gain(from, CGL_R(10.0));
    config.foc.ki_d = feed_gain(from, CGL_R(1000.0));
    config.foc.kp_q = feed_gain(from, CGL_R(10.0));
    config.foc.ki_q = feed_gain(from, CGL_R(1000.0));
    config.foc.current_limit = feed_gain(from, CGL_R(5.0));
    config.foc.advance = feed_gain(from, CGL_R(2.0));
    config.foc.decoupling = feed_bool(from);
    config.foc.L_d = feed_gain(from, CGL_R(1.0e-2));
    config.foc.L_q = feed_gain(from, CGL_R(1.0e-2));
    config.foc.psi_f = feed_gain(from, CGL_R(0.1));
    config.foc.phases = feed_bool(from) ? 3U : 2U;
    config.monitor.omega_max = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1000.0));
    config.monitor.angle_step = feed_gain(from, CGL_R(0.1));
    config.monitor.speed_window = feed_gain(from, CGL_R(5.0) * ts);
    config.monitor.stuck_angle = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(1.0));
    config.monitor.stuck_time = feed_gain(from, CGL_R(5.0) * ts);
    config.monitor.current_max = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(20.0));
    config.monitor.current_sum = feed_bool(from) ? CGL_R(0.0) : feed_gain(from, CGL_R(20.0));
    config.monitor.bridge = feed_gain(from, CGL_R(5.0) * ts);
    config.monitor.hold = feed_gain(from, CGL_R(5.0) * ts);
    config.monitor.phases = config.foreign ? 0U : config.foc.phases;
    config.quality.span = feed_gain(from, CGL_R(7.0));
    config.quality.longest = feed_gain(from, CGL_R(100.0) * (cgl_real)config.divider * ts);
    config.quality.outlier = feed_bool(from) ? CGL_R(0.0) : CGL_R(1.0) + feed_gain(from, CGL_R(5.0));
    config.quality.floor = feed_gain(from, CGL_R(1.0));
    return config;
}

static cgl_real theta, omega;

/* A rotor that turns, with measurements that may be anything. */
static cgl_measurement feed_measurement(feed *from)
{
    cgl_measurement now;
    const uint32_t kind = feed_bits(from, 1U);
    if ((kind & 1U) != 0U) {
        omega = feed_real(from, CGL_R(300.0));
    }
    theta = (kind & 2U) != 0U ? feed_real(from, CGL_R(7.0)) : theta + CGL_R(1.0e-3) * omega;
    now.theta_m = theta;
    now.omega_m = omega;
    for (int x = 0; x < 3; ++x) {
        now.i_abc[x] = (kind & 4U) != 0U ? feed_real(from, CGL_R(5.0)) : CGL_R(0.0);
    }
    now.u_dc = (kind & 8U) != 0U ? feed_real(from, CGL_R(300.0)) : CGL_R(300.0);
    return now;
}

static cgl_reference feed_reference(feed *from)
{
    cgl_reference reference;
    const bool any = feed_bool(from);
    reference.theta_ref = any ? feed_real(from, CGL_R(7.0)) : CGL_R(1.0);
    reference.omega_ref = any ? feed_real(from, CGL_R(300.0)) : CGL_R(100.0);
    reference.alpha_ref = any ? feed_real(from, CGL_R(1000.0)) : CGL_R(0.0);
    reference.i_d_ref = any ? feed_real(from, CGL_R(5.0)) : CGL_R(0.0);
    reference.learn = !any || feed_bool(from);
    reference.torque = any && feed_below(from, 4U) == 0U;
    reference.i_q_ref = reference.torque ? feed_real(from, CGL_R(5.0)) : CGL_R(0.0);
    return reference;
}

/* One step of the law, with what it says checked against what it did. */
static void step_law(const cgl_law_input *in, cgl_law_output *out)
{
    static cgl_real before[8U * CELLS_MAX]; /* the longest is that of 128 orders */
    uint32_t length;
    const cgl_real *learned = law_learned(&length);
    HOLDS(length <= sizeof before / sizeof before[0]);
    memcpy(before, learned, length * sizeof before[0]);
    law_step(in, out);
    HOLDS(within(out->i_q_ref, law_limit()));
    if (in->off) {
        HOLDS(within(out->i_q_ref, CGL_R(0.0)));
    }
    const bool frozen = (out->status & (unsigned)CGL_STATUS_FROZEN) != 0U || !in->learn;
    if (in->torque) {
        HOLDS((out->status & (unsigned)CGL_STATUS_FROZEN) != 0U);
    }
    if (in->off || in->torque || (frozen && !in->forget)) {
        HOLDS(memcmp(before, law_learned(&length), length * sizeof before[0]) == 0);
    }
}

static void check_output(const cgl_drive_config *config, const cgl_drive_output *out)
{
    for (int x = 0; x < 3; ++x) {
        HOLDS(out->duty[x] >= CGL_R(0.0) && out->duty[x] <= CGL_R(1.0));
    }
    HOLDS(cgl_is_finite(out->i_d) && cgl_is_finite(out->i_q) && cgl_is_finite(out->u_d) && cgl_is_finite(out->u_q));
    HOLDS(cgl_is_finite(out->i_d_ref) && within(out->i_q_ref, law_limit()));
    if (!config->foreign && (out->status & ((unsigned)CGL_STATUS_SATURATED | (unsigned)CGL_STATUS_OFF)) == 0U) {
        HOLDS(within(out->i_d_ref, config->foc.current_limit) && within(out->i_q_ref, config->foc.current_limit));
    }
}

static void check_drive(const cgl_drive *drive)
{
    HOLDS(drive->monitor.theta_m >= CGL_R(0.0) && drive->monitor.theta_m <= CGL_TWO_PI);
    HOLDS(cgl_is_finite(drive->monitor.omega_m) && cgl_is_finite(drive->monitor.theta_sensor));
    HOLDS(cgl_is_finite(drive->monitor.ref_turned));
    HOLDS(within(drive->monitor.sensor_offset, CGL_R(3.15)));
    HOLDS(cgl_is_finite(drive->foc.integral_d) && cgl_is_finite(drive->foc.integral_q));
    HOLDS(cgl_is_finite(drive->quality.sum + drive->quality.outlier_sum));
    HOLDS(cgl_is_finite(drive->quality.squares + drive->quality.outlier_squares));
    HOLDS(cgl_is_finite(drive->quality.turned) && cgl_is_finite(drive->quality.ripple));
    HOLDS(cgl_is_finite(drive->quality.ripple_before) && cgl_is_finite(drive->quality.trend));
    const cgl_quality_report report = cgl_quality_read(&drive->quality);
    HOLDS(cgl_is_finite(report.residual) && cgl_is_finite(report.progress));
}

static void run(feed *from, const cgl_drive_config *config, cgl_drive *drive)
{
    while (fed(from)) {
        const uint32_t call = feed_bits(from, 1U);
        if (call < 4U) {
            cgl_drive_reset(drive);
        } else if (call < 8U) {
            law_reset();
        } else if (call < 12U) {
            cgl_monitor_trust(&drive->monitor);
        } else if (call < 32U) {
            law_other(from);
        } else if (call < 48U) { /* the law by itself, with what no monitor has looked at */
            cgl_law_input in = {feed_real(from, CGL_R(7.0)),   feed_real(from, CGL_R(100.0)),
                                feed_real(from, CGL_R(100.0)), feed_real(from, CGL_R(7.0)),
                                feed_real(from, CGL_R(100.0)), feed_real(from, CGL_R(5.0)),
                                feed_bool(from),               feed_below(from, 8U) == 0U,
                                feed_below(from, 8U) == 0U,    feed_real(from, CGL_R(1.0)),
                                feed_below(from, 8U),          feed_below(from, 8U) == 0U,
                                feed_real(from, CGL_R(5.0))};
            cgl_law_output out;
            step_law(&in, &out);
        } else {
            const cgl_measurement now = feed_measurement(from);
            const cgl_reference reference = feed_reference(from);
            cgl_drive_output out;
            if (cgl_drive_measure(drive, &now, &reference)) {
                step_law(&drive->in, &drive->command);
            }
            cgl_drive_actuate(drive, &out);
            check_output(config, &out);
        }
        check_drive(drive);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    feed from = {data, size};
    cgl_drive drive;
    theta = omega = CGL_R(0.0);
    const cgl_real ts = feed_gain(&from, CGL_R(1.0e-3));
    const cgl_drive_config config = feed_drive(&from, ts);
    if (cgl_drive_init(&drive, &config, ts) == CGL_OK) {
        if (law_begin(&from)) {
            run(&from, &config, &drive);
        }
        law_end();
    }
    return 0;
}
