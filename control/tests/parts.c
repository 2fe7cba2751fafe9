/* Random bit patterns at the parts around a law: sensors, calibration, dead time, telemetry. Whatever comes in, what comes out is
 * finite and within its limits, and has the bits that it had when this was released. */
#include "parts.h"

#include <stddef.h>

#include "check.h"
#include "cogless/angle.h"
#include "cogless/angle_observer.h"
#include "cogless/calibration.h"
#include "cogless/current_reference.h"
#include "cogless/dead_time.h"
#include "cogless/drive.h"
#include "cogless/encoder.h"
#include "cogless/hall.h"
#include "cogless/low_pass.h"
#include "cogless/microstepping.h"
#include "cogless/range.h"
#include "cogless/encoder_table.h"
#include "cogless/speed_count.h"
#include "cogless/speed_timed.h"
#include "cogless/square_root.h"
#include "cogless/telemetry.h"

#define STEPS_PER_CONFIG 300

static cgl_dead_time_config random_dead_time(void)
{
    cgl_dead_time_config config;
    config.time = random_gain(CGL_R(1.0e-5));
    config.drop = random_gain(CGL_R(1.0));
    config.band = random_gain(CGL_R(0.1));
    config.lag = random_gain(CGL_R(1.0e-3));
    config.advance = random_gain(CGL_R(2.0));
    config.phases = random_below(2) ? 3U : 2U * random_below(2);
    return config;
}

static void try_dead_time(void)
{
    cgl_dead_time_config config;
    static cgl_dead_time dead_time, fresh;
    do {
        config = random_dead_time();
    } while (cgl_dead_time_init(&dead_time, &config, random_gain(CGL_R(1.0e-4))) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        if (random_below(100) == 0U) {
            config = random_dead_time();
            hear_bits((uint32_t)cgl_dead_time_retune(&dead_time, &config));
        }
        const cgl_foc_input in = {{CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)},
                                  random_real(CGL_R(7.0)),
                                  random_real(CGL_R(1000.0)),
                                  random_real(CGL_R(300.0)),
                                  random_real(CGL_R(5.0)),
                                  random_real(CGL_R(5.0))};
        cgl_real duty[3];
        for (int x = 0; x < 3; ++x) {
            duty[x] = random_below(8) ? cgl_abs(cgl_clamp(random_gain(CGL_R(1.0)), CGL_R(1.0))) : CGL_R(1.0);
        }
        cgl_dead_time_step(&dead_time, &in, duty);
        hear_all(duty, 3U);
        CHECK(are_duties(duty));
        CHECK(cgl_is_finite(dead_time.i_d) && cgl_is_finite(dead_time.i_q));
    }
    cgl_dead_time_reset(&dead_time);
    config = dead_time.config;
    CHECK(cgl_dead_time_init(&fresh, &config, dead_time.ts) == CGL_OK);
    check_bytes(&dead_time, &fresh, 0U, sizeof fresh);
}

static void try_speed(void)
{
    const cgl_speed_count_config counting = {random_word(), random_below(20)};
    const cgl_speed_timed_config timing = {random_word(), random_gain(CGL_R(1.0e8)),
                                           random_below(2) != 0U};
    uint32_t before[20];
    cgl_speed_count counted;
    static cgl_speed_timed timed, fresh;
    cgl_edges edges = {0U, 0U, 0U, false, false};
    uint32_t now = random_bits();
    const bool counts = cgl_speed_count_init(&counted, &counting, random_gain(CGL_R(1.0e-3)), before, 20U) == CGL_OK;
    const bool times = cgl_speed_timed_init(&timed, &timing) == CGL_OK;
    CHECK(!counts || (counting.counts > 0U && counting.window > 0U));
    CHECK(!times || (timing.counts > 0U && timing.timer > CGL_R(0.0)));
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        now += random_below(50) ? random_below(5000) : random_bits();
        const uint32_t count = random_below(20) ? edges.count + random_below(5) - 2U : random_bits();
        cgl_edges_pass(&edges, count, now);
        const cgl_real by_count = counts ? cgl_speed_count_step(&counted, edges.count) : CGL_R(0.0);
        const cgl_real by_time = times ? cgl_speed_timed_step(&timed, &edges, now + random_below(5000)) : CGL_R(0.0);
        CHECK(cgl_is_finite(by_count) && cgl_is_finite(by_time));
        if (times && random_below(100) == 0U) {
            cgl_speed_timed_reset(&timed, &edges, now, by_time);
            CHECK(timed.edge == edges.time && timed.count == edges.count && timed.since == now - edges.time);
        }
        hear(by_count);
        hear(by_time);
        hear_bits(edges.count);
    }
    if (times) {
        static const cgl_edges none;
        cgl_speed_timed_reset(&timed, &none, 0U, CGL_R(0.0));
        CHECK(cgl_speed_timed_init(&fresh, &timing) == CGL_OK);
        check_bytes(&timed, &fresh, offsetof(cgl_speed_timed, per_tick), sizeof fresh);
    }
    if (counts) {
        cgl_speed_count_reset(&counted, edges.count);
        CHECK(within(cgl_speed_count_step(&counted, edges.count), CGL_R(0.0)) && counted.oldest == 1U % counting.window);
    }
}

static void try_angle_observer(void)
{
    cgl_angle_observer_config config;
    static cgl_angle_observer observer, fresh;
    do {
        config.bandwidth = random_gain(CGL_R(1.0e3));
    } while (cgl_angle_observer_init(&observer, &config, random_gain(CGL_R(1.0e-3))) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        if (random_below(50) == 0U) {
            const uint32_t theta = random_bits();
            cgl_angle_observer_reset(&observer, theta, random_real(CGL_R(100.0)));
        }
        if (random_below(100) == 0U) {
            config.bandwidth = random_gain(CGL_R(1.0e3));
            hear_bits((uint32_t)cgl_angle_observer_retune(&observer, &config));
        }
        cgl_angle_observer_step(&observer, random_word());
        hear_bits(observer.theta);
        hear(observer.omega);
        CHECK(within(observer.omega, observer.omega_max) && within(observer.alpha, observer.alpha_max));
    }
    config = observer.config;
    cgl_angle_observer_reset(&observer, 0U, CGL_R(0.0));
    CHECK(cgl_angle_observer_init(&fresh, &config, observer.ts) == CGL_OK);
    check_bytes(&observer, &fresh, 0U, sizeof fresh);
}

static void random_waves(cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES])
{
    for (uint32_t k = 0; k < CGL_MICROSTEPPING_WAVES; ++k) {
        wave[k].order = random_below(10) ? random_below(9) : random_bits();
        wave[k].magnitude = random_gain(CGL_R(0.02));
        wave[k].phase = random_real(CGL_PI);
    }
}

static cgl_microstepping_config random_microstepping(void)
{
    cgl_microstepping_config config;
    config.teeth = random_below(4) ? 50U : random_below(200);
    config.current = random_gain(CGL_R(1.0));
    config.microsteps = random_below(8) ? 1U << random_below(12) : random_below(300);
    random_waves(config.forward);
    random_waves(config.backward);
    return config;
}

static void try_microstepping(void)
{
    cgl_microstepping_config config;
    static cgl_microstepping motor, fresh;
    cgl_microstepping_output out;
    do {
        config = random_microstepping();
    } while (cgl_microstepping_init(&motor, &config) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        if (random_below(100) == 0U) {
            config = random_microstepping();
            hear_bits((uint32_t)cgl_microstepping_retune(&motor, &config));
        }
        if (random_below(200) == 0U) {
            cgl_microstepping_reset(&motor);
        }
        const cgl_real theta_ref = random_real(CGL_R(6.0)), omega_ref = random_real(CGL_R(10.0));
        cgl_microstepping_step(&motor, theta_ref, omega_ref, &out);
        CHECK(within(out.i_a, motor.config.current) && within(out.i_b, motor.config.current));
        CHECK((motor.command & (motor.microstep - 1U)) == 0U);
        hear(out.i_a);
        hear(out.i_b);
        hear_bits(out.status);
    }
    cgl_microstepping_reset(&motor);
    config = motor.config;
    CHECK(cgl_microstepping_init(&fresh, &config) == CGL_OK);
    check_bytes(&motor, &fresh, offsetof(cgl_microstepping, ready), sizeof fresh);
}

static cgl_current_reference_config random_current_reference(void)
{
    cgl_current_reference_config config;
    config.mtpa = random_below(2) == 0U;
    config.field_weakening = random_below(4) != 0U;
    config.L_d = random_gain(CGL_R(1.0e-3));
    config.L_q = random_gain(CGL_R(1.0e-3));
    config.psi_f = random_gain(CGL_R(0.03));
    config.R_s = random_gain(CGL_R(0.3));
    config.voltage_share = random_below(3) ? CGL_R(0.0) : random_gain(CGL_R(1.0));
    return config;
}

static void try_current_reference(void)
{
    cgl_current_reference_config config;
    cgl_current_reference currents;
    cgl_drive_config around = {.pole_pairs = 4U, .divider = 10U, .unguarded = true, .quality = {.span = CGL_R(6.28), .longest = CGL_R(9.0)}};
    cgl_drive drive;
    cgl_error error;
    around.foc.phases = 2U + random_below(2);
    do {
        around.foc.current_limit = random_gain(CGL_R(10.0));
        config = random_current_reference();
        error = cgl_drive_init(&drive, &around, CGL_R(1.0e-4));
        error = error == CGL_OK ? cgl_current_reference_init(&currents, &config, &drive) : error;
    } while (error != CGL_OK);
    const cgl_real limit = around.foc.current_limit * CGL_R(1.00001);
    CHECK(cgl_is_finite(drive.loop.current_limit) && drive.loop.current_limit >= around.foc.current_limit);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const bool odd = random_below(8) == 0U;
        drive.command.i_q_ref = odd ? random_real(CGL_R(10.0)) : random_gain(CGL_R(10.0)) * (random_below(2) ? CGL_R(1.0) : CGL_R(-1.0));
        drive.command.status = 0U;
        drive.saturated = false;
        drive.currents.omega_e = random_real(CGL_R(3.0e3));
        drive.currents.u_dc = odd ? random_real(CGL_R(48.0)) : CGL_R(48.0);
        const cgl_real wanted = cgl_finite_or_zero(drive.command.i_q_ref);
        cgl_current_reference_step(&currents, &drive);
        const cgl_real d = drive.currents.i_d_ref / limit, q = drive.command.i_q_ref / limit;
        hear(drive.currents.i_d_ref);
        hear(drive.command.i_q_ref);
        hear_bits(drive.command.status);
        CHECK(d * d + q * q <= CGL_R(1.00001));
        CHECK(wanted * drive.command.i_q_ref >= CGL_R(0.0));
        CHECK(drive.saturated == ((drive.command.status & (unsigned)CGL_STATUS_SATURATED) != 0U));
        cgl_drive_output out;
        cgl_current_reference_actuate(&currents, &drive, &out);
        CHECK(are_duties(out.duty) && cgl_is_finite(drive.i_q));
        hear(drive.i_q);
    }
}

static void try_square_root(void)
{
    const cgl_real rounding = sizeof(cgl_real) == sizeof(float) ? CGL_R(2.4e-7) : CGL_R(4.5e-16);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_real x = random_real(CGL_R(10.0)), root = cgl_square_root(x);
        hear(root);
        if (x >= CGL_R(1.0e-30) && x <= CGL_R(1.0e38)) {
            CHECK(within(root * root / x - CGL_R(1.0), CGL_R(2.0) * rounding));
        } else {
            CHECK(!(root < CGL_R(0.0)) && !(root > CGL_R(0.0)));
        }
    }
}

static void try_low_pass(void)
{
    cgl_low_pass_config config;
    static cgl_low_pass filter, fresh;
    do {
        config.bandwidth = random_gain(CGL_R(1.0e3));
    } while (cgl_low_pass_init(&filter, &config, random_gain(CGL_R(1.0e-3))) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_real x = random_real(CGL_R(100.0)), before = filter.y;
        const cgl_real y = cgl_low_pass_step(&filter, x);
        hear(y);
        CHECK(cgl_is_finite(filter.y) && (!cgl_is_finite(x) || within(y, cgl_abs(x) + cgl_abs(before))));
        if (random_below(50) == 0U) {
            const cgl_low_pass_config other = {random_gain(CGL_R(1.0e3))};
            config = cgl_low_pass_retune(&filter, &other) == CGL_OK ? other : config;
            CHECK(within(filter.config.bandwidth - config.bandwidth, CGL_R(0.0)));
        }
    }
    cgl_low_pass_reset(&filter, CGL_R(0.0));
    CHECK(cgl_low_pass_init(&fresh, &config, filter.ts) == CGL_OK);
    check_bytes(&filter, &fresh, 0U, sizeof fresh);
    cgl_low_pass_reset(&filter, CGL_R(2.5));
    CHECK(within(cgl_low_pass_step(&filter, CGL_R(2.5)) - CGL_R(2.5), CGL_R(1.0e-6)));
}

static void try_hall(void)
{
    cgl_hall_config config;
    static cgl_hall hall, fresh;
    do {
        config.pole_pairs = random_word();
        config.edges = random_below(8);
        config.timer = random_gain(CGL_R(1.0e8));
    } while (cgl_hall_init(&hall, &config) != CGL_OK);
    CHECK(config.pole_pairs >= 1U && config.pole_pairs <= 10000U && config.edges >= 1U && config.edges <= CGL_HALL_EDGES);
    CHECK(config.timer > CGL_R(0.0));
    cgl_hall_config too_fast = config;
    too_fast.timer = (cgl_real)config.pole_pairs * (CGL_REAL_MAX * CGL_R(0.0625)); /* a sector in a tick: too fast */
    CHECK(cgl_hall_init(&hall, &too_fast) == CGL_ERROR_CONFIG);
    uint32_t now = random_bits();
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const uint32_t edge = random_below(8) ? now + random_below(100) : random_bits();
        now = edge + (random_below(8) ? random_below(100) : random_bits());
        cgl_hall_step(&hall, random_below(2) ? (hall.position + random_below(3)) % 6U : random_bits(), edge, now);
        hear_bits(hall.turns);
        hear(hall.omega_m);
        CHECK(hall.position < hall.sectors && within(hall.omega_m, hall.per_tick));
        const cgl_real theta = cgl_radians(hall.turns);
        CHECK(theta >= CGL_R(0.0) && theta < CGL_TWO_PI);
    }
    cgl_hall_reset(&hall, 0U);
    CHECK(cgl_hall_init(&fresh, &config) == CGL_OK);
    check_bytes(&hall, &fresh, 0U, offsetof(cgl_hall, interval)); /* those are unknown */
    check_bytes(&hall, &fresh, offsetof(cgl_hall, last), sizeof fresh);
}

static void try_encoder(void)
{
    cgl_encoder_config config;
    static cgl_encoder encoder, fresh;
    do {
        config.counts = random_word();
        config.absolute = random_below(2) != 0U;
        config.range = config.absolute ? config.counts : random_word();
        config.zero = random_word();
        config.backward = random_below(2) != 0U;
    } while (cgl_encoder_init(&encoder, &config, random_bits()) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_encoder_step(&encoder, random_below(2) ? encoder.reading + random_below(9) - 4U : random_bits());
        if (random_below(20) == 0U) {
            cgl_encoder_index(&encoder, random_word());
        } else if (random_below(20) == 0U) {
            cgl_encoder_place(&encoder, random_bits());
        }
        CHECK(encoder.position < config.counts);
        hear_bits(encoder.turns);
        hear_bits(encoder.count);
        const cgl_real theta = cgl_radians(encoder.turns);
        CHECK(theta >= CGL_R(0.0) && theta < CGL_TWO_PI);
    }
    const uint32_t now = encoder.reading;
    cgl_encoder_reset(&encoder, now);
    CHECK(cgl_encoder_init(&fresh, &config, now) == CGL_OK);
    check_bytes(&encoder, &fresh, offsetof(cgl_encoder, per_count), sizeof fresh);
}

static void try_encoder_table(void)
{
    cgl_encoder_table_config config;
    static cgl_encoder_table table, fresh;
    cgl_real theta, omega;
    do {
        config.orders = random_below(CGL_ENCODER_TABLE_ORDERS + 2U);
        for (uint32_t k = 0, order = 0U; k < CGL_ENCODER_TABLE_ORDERS; ++k) {
            order += 1U + random_below(20);
            config.order[k] = order;
        }
        config.gain = random_gain(CGL_R(5.0));
        config.omega_min = random_gain(CGL_R(100.0));
        config.bandwidth = random_gain(CGL_R(20.0));
        config.b = random_gain(CGL_R(500.0));
        config.limit = random_gain(CGL_R(0.02));
        theta = CGL_R(1.0);
        omega = (cgl_real)random_below(200);
    } while (cgl_encoder_table_init(&table, &config, random_gain(CGL_R(1.0e-3))) != CGL_OK);
    CHECK(config.orders >= 1U && config.orders <= CGL_ENCODER_TABLE_ORDERS);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        if (random_below(100) == 0U) {
            cgl_encoder_table_config other = config;
            other.gain = random_gain(CGL_R(5.0));
            other.limit = random_gain(CGL_R(0.02));
            other.order[0] += random_below(4) ? 0U : 1U;
            config = cgl_encoder_table_retune(&table, &other) == CGL_OK ? other : config;
            CHECK(within(table.config.gain - config.gain, CGL_R(0.0)) && within(table.config.limit - config.limit, CGL_R(0.0)));
        }
        if (random_below(500) == 0U) {
            cgl_encoder_table_reset(&table);
            CHECK(!table.learning && table.wait == table.settle);
        }
        const bool wild = random_below(4) == 0U;
        theta = cgl_fraction((theta + CGL_R(0.01) * omega) / CGL_TWO_PI) * CGL_TWO_PI;
        cgl_measurement now = {{CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)}, wild ? random_real(CGL_R(7.0)) : theta,
                               wild ? random_real(CGL_R(100.0)) : omega, CGL_R(24.0)};
        const bool plausible = cgl_is_angle(now.theta_m) && cgl_is_finite(now.omega_m);
        const bool learn = random_below(8) != 0U;
        cgl_encoder_table_step(&table, &now, random_real(CGL_R(2.0)), learn);
        if (plausible) {
            CHECK(cgl_is_finite(now.theta_m) && cgl_is_finite(now.omega_m));
        }
        for (uint32_t k = 0; k < CGL_ENCODER_TABLE_ORDERS; ++k) {
            CHECK(within(table.a[k], config.limit) && within(table.c[k], config.limit));
        }
        hear(now.theta_m);
        hear(now.omega_m);
        const cgl_real mean = random_real(CGL_R(200.0)), time = random_below(4) ? random_gain(CGL_R(0.01)) : random_real(CGL_R(0.01));
        const cgl_real speed = cgl_encoder_table_speed(&table, mean, time);
        CHECK(!cgl_is_finite(mean) || cgl_is_finite(speed));
        hear(speed);
        hear_bits(cgl_encoder_table_turns(&table, random_bits()));
        hear_bits(table.learning);
        hear_bits(table.wait);
        CHECK(within(table.observer.omega, table.observer.omega_max));
    }
    cgl_encoder_table_reset(&table);
    config = table.config;
    CHECK(cgl_encoder_table_init(&fresh, &config, table.observer.ts) == CGL_OK);
    check_bytes(&table, &fresh, offsetof(cgl_encoder_table, a), sizeof fresh);
}

static void try_calibration(void)
{
    const cgl_offsets_config averaging = {1U + random_below(400), 2U + random_below(2), random_gain(CGL_R(1.0)),
                                          random_gain(CGL_R(10.0))};
    static cgl_offsets offsets, other;
    const bool averages = cgl_offsets_init(&offsets, &averaging) == CGL_OK;
    cgl_align_config config;
    static cgl_align align, fresh;
    do {
        config.pole_pairs = 1U + random_below(20);
        config.current = random_gain(CGL_R(5.0));
        config.ramp = random_gain(CGL_R(0.01));
        config.sweep = random_gain(CGL_R(2.0));
        config.speed = random_gain(CGL_R(100.0));
        config.settle = random_gain(CGL_R(0.01));
        config.tolerance = random_gain(CGL_R(1.0));
    } while (cgl_align_init(&align, &config, random_gain(CGL_R(1.0e-3))) != CGL_OK);
    const bool wild = random_below(4) == 0U;
    const cgl_real zero = CGL_R(0.01) * (cgl_real)random_below(628) - CGL_R(3.14);
    const cgl_real lag = CGL_R(0.0005) * (cgl_real)random_below(20); /* the rotor is behind the field, by friction */
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_align_output out;
        const cgl_real placed = zero + align.theta_e / (cgl_real)config.pole_pairs + (align.stage < 3U ? -lag : lag);
        const cgl_real theta = wild ? random_real(CGL_R(6.0)) : placed;
        const cgl_calibration result = cgl_align_step(&align, theta, &out);
        if (!wild && result == CGL_CALIBRATION_DONE && config.settle > CGL_R(2.0) * align.ts) { /* the rotor follows a step late */
            CHECK(within(align.zero - zero, CGL_R(1.0e-5)) && within(align.apart - lag, CGL_R(1.0e-5)));
        }
        CHECK(cgl_is_finite(out.omega_e) && within(out.theta_e, cgl_or_default(config.sweep, CGL_R(0.5) * CGL_PI)));
        CHECK(out.i_d_ref >= CGL_R(0.0) && out.i_d_ref <= config.current * CGL_R(1.00001));
        CHECK(result == CGL_CALIBRATION_BUSY || (within(out.i_d_ref, CGL_R(0.0)) && within(align.current, CGL_R(0.0))));
        CHECK(cgl_is_finite(align.zero) && cgl_is_finite(align.apart));
        hear(out.theta_e);
        hear(out.omega_e);
        hear(out.i_d_ref);
        hear(align.zero);
        hear_bits((uint32_t)result);
        cgl_real i_abc[3];
        for (int x = 0; x < 3; ++x) {
            i_abc[x] = wild && random_below(20) == 0U ? random_real(CGL_R(0.1)) : CGL_R(1.0e-4) * (cgl_real)random_below(100);
        }
        if (averages) {
            hear_bits((uint32_t)cgl_offsets_step(&offsets, i_abc));
            hear_all(offsets.mean, 3U);
            CHECK(cgl_is_finite(offsets.mean[0]) && cgl_is_finite(offsets.mean[1]) && cgl_is_finite(offsets.mean[2]));
        }
    }
    cgl_align_reset(&align);
    CHECK(cgl_align_init(&fresh, &config, align.ts) == CGL_OK);
    check_bytes(&align, &fresh, 0U, sizeof fresh);
    if (averages) {
        cgl_offsets_reset(&offsets);
        CHECK(cgl_offsets_init(&other, &averaging) == CGL_OK);
        check_bytes(&offsets, &other, 0U, sizeof other);
    }
}

static void try_telemetry(void)
{
    cgl_telemetry telemetry;
    cgl_telemetry_reset(&telemetry);
    cgl_snapshot snapshot;
    CHECK(!cgl_telemetry_read(&telemetry, &snapshot));
    static cgl_drive drive;
    static cgl_drive_output out;
    for (uint32_t n = 1; n < 100U; ++n) {
        const cgl_real x = (cgl_real)(100U * n);
        drive.monitor.theta_m = x;
        drive.monitor.omega_m = x + CGL_R(1.0);
        drive.in.omega_ref = x + CGL_R(2.0);
        drive.currents.u_dc = x + CGL_R(3.0);
        const cgl_drive_output now = {.i_d = x + CGL_R(4.0), .i_q = x + CGL_R(5.0), .u_d = x + CGL_R(6.0), .u_q = x + CGL_R(7.0),
                                      .i_d_ref = x + CGL_R(8.0), .i_q_ref = x + CGL_R(9.0), .status = n};
        out = now;
        cgl_telemetry_write(&telemetry, &drive, &out);
        CHECK(cgl_telemetry_read(&telemetry, &snapshot) && snapshot.count == n && snapshot.status == n);
        const cgl_real said[] = {snapshot.theta_m, snapshot.omega_m, snapshot.omega_ref, snapshot.u_dc,    snapshot.i_d,
                                 snapshot.i_q,     snapshot.u_d,     snapshot.u_q,       snapshot.i_d_ref, snapshot.i_q_ref};
        for (uint32_t k = 0; k < sizeof said / sizeof said[0]; ++k) {
            CHECK(within(said[k] - x - (cgl_real)k, CGL_R(0.0)));
        }
    }
    telemetry.count = UINT32_MAX; /* as after years; a snapshot of number 0 would be none */
    cgl_telemetry_write(&telemetry, &drive, &out);
    CHECK(cgl_telemetry_read(&telemetry, &snapshot) && snapshot.count == 2U);
    telemetry.buffer[0].count = 4U; /* one that is being written */
    CHECK(!cgl_telemetry_read(&telemetry, &snapshot));
    cgl_telemetry_reset(&telemetry);
    CHECK(!cgl_telemetry_read(&telemetry, &snapshot) && telemetry.count == 0U && telemetry.buffer[1].count == 0U);
}

void try_parts(long configs)
{
    static const random_subject subjects[] = {
        {"dead_time", try_dead_time, 0xea399657U, 0x7eda2521U},
        {"speed", try_speed, 0x3989de0eU, 0x2510e6bcU},
        {"angle_observer", try_angle_observer, 0xfc9c7959U, 0x7dfbe762U},
        {"encoder", try_encoder, 0x169f7619U, 0x169f7619U},
        {"encoder_table", try_encoder_table, 0x0eb0789dU, 0x409e4b71U},
        {"calibration", try_calibration, 0xe681e117U, 0x0562a910U},
        {"low_pass", try_low_pass, 0x3fdd7ae4U, 0x576bdf15U},
        {"hall", try_hall, 0xb8415665U, 0x3a0696a6U},
        {"telemetry", try_telemetry, 0x00000000U, 0x00000000U},
        {"current_reference", try_current_reference, 0xbef6cf94U, 0x92606f06U},
        {"square_root", try_square_root, 0x0f9de291U, 0xcb825a3cU},
        {"microstepping", try_microstepping, 0x8a359b39U, 0x4bad28a9U},
    };
    try_subjects(subjects, sizeof subjects / sizeof subjects[0], configs);
}
