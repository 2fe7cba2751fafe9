/* Random bit patterns at every init and step of every law. Whatever comes in, outputs are finite and within their limits,
 * so is what is learned, and nothing outside the caller's memory is written. To be run under the sanitizers too. And what
 * comes out has the bits that it had when this was released. */
#include "random_inputs.h"

#include <stddef.h>
#include <string.h>

#include "cogless/angle.h"
#include "cogless/drive.h"
#include "cogless/foc.h"
#include "cogless/modulation.h"
#include "cogless/trial_basis.h"
#include "harness.h"

#define STEPS_PER_CONFIG 300

/* A state that is reset, and one that is initialised again, is in every byte what init makes of the same config. All are
 * static, so that their padding is 0. */
#define CHECK_ANEW(name, state, ...)                                                                                   \
    do {                                                                                                               \
        static cgl_##name fresh, again;                                                                                \
        memcpy(&again, (state), sizeof again);                                                                         \
        cgl_##name##_reset(state);                                                                                     \
        CHECK(cgl_##name##_init(&fresh, __VA_ARGS__) == CGL_OK);                                                       \
        CHECK(cgl_##name##_init(&again, __VA_ARGS__) == CGL_OK);                                                       \
        check_bytes((state), &fresh, 0U, sizeof fresh);                                                                \
        check_bytes(&again, &fresh, 0U, sizeof fresh);                                                                 \
    } while (false)

/* ---- a law ---- */

static const law_harness *harness; /* of the law that is tried */

static void try_law(void)
{
    while (!begin_law(harness)) {
    }
    const int steps = harness->course != NULL ? 0 : (harness->steps > 0 ? harness->steps : STEPS_PER_CONFIG);
    for (int step = 0; step < steps; ++step) {
        if (harness->call != NULL && random_below(400) == 0U) {
            harness->call();
        }
        cgl_law_input in;
        cgl_law_output out;
        harness->input(&in, step);
        step_law(harness, &in, &out);
        if (random_below(1000) == 0U) {
            reset_law(harness);
        } else if (random_below(100) == 0U) {
            retune_law(harness);
        }
    }
    if (harness->course != NULL) {
        harness->course();
    }
    end_law(harness);
}

static void try_any_config(void) { spoil_law(harness); }

/* ---- one function a part: a random config that init accepts, then random steps ---- */

static void try_angle(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real sine, cosine;
        cgl_sincos(random_real(CGL_R(1.0e5)), &sine, &cosine);
        CHECK(within(sine, CGL_R(1.000001)) && within(cosine, CGL_R(1.000001)));
        hear(sine);
        hear(cosine);
        const cgl_real fraction = cgl_fraction(random_real(CGL_R(1.0e9)));
        CHECK(fraction >= CGL_R(0.0) && fraction < CGL_R(1.0));
        hear(fraction);
        const cgl_real theta = random_real(CGL_R(7.0)), last = random_real(CGL_R(100.0));
        const cgl_real unwrapped = cgl_unwrap(theta, last);
        hear(unwrapped);
        if (cgl_is_angle(theta) && cgl_is_angle(last)) {
            CHECK(cgl_abs(unwrapped - last) < CGL_R(3.18)); /* pi, and rounding at 1e5 rad */
        } else {
            CHECK(cgl_is_finite(unwrapped) || !cgl_is_finite(last));
        }
    }
}

static void try_modulation(void)
{
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_real duty[3];
        const cgl_real u_alpha = random_real(CGL_R(100.0)), u_beta = random_real(CGL_R(100.0));
        cgl_modulate(u_alpha, u_beta, random_real(CGL_R(100.0)), duty);
        hear_all(duty, 3U);
        CHECK(are_duties(duty));
    }
}

static cgl_foc_config random_foc(void)
{
    cgl_foc_config config;
    config.kp_d = random_gain(CGL_R(10.0));
    config.ki_d = random_gain(CGL_R(1000.0));
    config.kp_q = random_gain(CGL_R(10.0));
    config.ki_q = random_gain(CGL_R(1000.0));
    config.current_limit = random_gain(CGL_R(5.0));
    config.advance = random_gain(CGL_R(2.0));
    config.decoupling = random_below(2) != 0U;
    config.L_d = random_gain(CGL_R(1.0e-2));
    config.L_q = random_gain(CGL_R(1.0e-2));
    config.psi_f = random_gain(CGL_R(0.1));
    config.phases = random_below(2) ? 3U : 2U * random_below(2);
    return config;
}

static void try_foc(void)
{
    cgl_foc_config config;
    static cgl_foc foc;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_foc();
    } while (cgl_foc_init(&foc, &config, ts) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_foc_input in = {{random_real(CGL_R(5.0)), random_real(CGL_R(5.0)), random_real(CGL_R(5.0))},
                                  random_real(CGL_R(7.0)),
                                  random_real(CGL_R(1000.0)),
                                  random_real(CGL_R(300.0)),
                                  random_real(CGL_R(5.0)),
                                  random_real(CGL_R(5.0))};
        if (random_below(100) == 0U) {
            const cgl_foc_config other = random_foc();
            config = cgl_foc_retune(&foc, &other) == CGL_OK ? other : config;
        }
        const cgl_foc before = foc;
        cgl_foc_output out;
        cgl_foc_step(&foc, &in, &out);
        hear_all(out.duty, 3U);
        hear(out.i_d_ref);
        hear(out.i_q_ref);
        hear(out.i_d);
        hear(out.i_q);
        hear(out.u_d);
        hear(out.u_q);
        hear_bits(out.status);
        CHECK(are_duties(out.duty));
        CHECK(cgl_is_finite(out.u_d) && cgl_is_finite(out.u_q));
        CHECK(cgl_is_finite(out.i_d) && cgl_is_finite(out.i_q));
        CHECK(cgl_is_finite(foc.integral_d) && cgl_is_finite(foc.integral_q));
        if ((out.status & CGL_STATUS_FAULT) != 0U) {
            CHECK(!(foc.integral_d < before.integral_d) && !(foc.integral_d > before.integral_d));
            CHECK(!(foc.integral_q < before.integral_q) && !(foc.integral_q > before.integral_q));
        } else { /* the voltage is one that the bus has */
            const cgl_real u_d = out.u_d / in.u_dc, u_q = out.u_q / in.u_dc;
            const cgl_real longest = config.phases == 2U ? CGL_R(1.00001) : CGL_R(0.33334);
            CHECK(u_d * u_d + u_q * u_q <= longest || in.u_dc < CGL_R(1.0e-30));
        }
    }
    CHECK_ANEW(foc, &foc, &config, ts);
    CHECK_ZEROS(foc, &foc, integral_d, lost_q);
}

static void try_memory(void)
{
    static cgl_real before[4U * CGL_MEMORY_ROW(CELLS_MAX, CELLS_MAX / 2U)];
    cgl_memory_config config;
    static cgl_memory memory;
    uint32_t length, ratio;
    cgl_real ts;
    do {
        give_back();
        ts = random_gain(CGL_R(1.0e-3));
        config = random_memory(1U + random_below(CGL_CHANNELS));
        length = memory_length(&config);
        ratio = random_count(50);
    } while (cgl_memory_init(&memory, &config, ts, ratio, borrow(length), length) != CGL_OK);
    CHECK(cgl_memory_fastest(&memory) >= CGL_R(0.0));
    const bool is_map = config.kind == CGL_MEMORY_ANGLE;
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        cgl_law_input in;
        next_position_input(&in, step);
        cgl_real value[CGL_CHANNELS], correction[CGL_CHANNELS];
        for (uint32_t c = 0; c < config.channels; ++c) {
            correction[c] = random_below(16) ? config.limit[c] * CGL_R(0.01) : random_real(config.limit[c]);
        }
        memcpy(before, memory.cell, length * sizeof before[0]);
        const cgl_memory old = memory;
        const bool learned = cgl_memory_step(&memory, in.theta_ref, in.omega_ref, in.learn, correction, value);
        CHECK(learned == memory.learning && (in.learn || !learned));
        hear_all(value, config.channels);
        hear_bits((learned ? 1U : 0U) | (is_map && memory.map.started ? 2U : 0U) | (is_map && memory.map.lagging ? 4U : 0U)
                  | (is_map && memory.map.follows ? 8U : 0U) | (!is_map && memory.line.tracking ? 16U : 0U));
        for (uint32_t c = 0; c < config.channels; ++c) {
            CHECK(!learned || cgl_is_finite(correction[c]));
            CHECK(cgl_is_finite(value[c]) || (learned && config.lead == 0U)); /* a large correction on a large value */
        }
        check_writing(&memory, &old, before);
        check_memory(&memory);
        if (random_below(1000) == 0U) {
            cgl_memory_reset(&memory);
        } else if (random_below(1000) == 0U) {
            const cgl_memory_config now = memory.config;
            const cgl_memory_config other = another_memory(&now);
            if (cgl_memory_retune(&memory, &other) != CGL_OK) {
                CHECK(memcmp(&memory.config, &now, sizeof now) == 0);
            }
            check_memory(&memory);
        }
    }
    hear_all(memory.cell, length);
    hear(cgl_memory_fastest(&memory));
    const cgl_memory_config now = memory.config;
    cgl_memory_reset(&memory);
    check_entries(memory.cell, length, CGL_R(0.0));
    memset(memory.cell, 0xFF, length * sizeof *memory.cell);
    CHECK_ANEW(memory, &memory, &now, ts, ratio, memory.cell, length);
    check_entries(memory.cell, length, CGL_R(0.0));
    check_fences();
    CHECK(!memory.learning && !memory.map.started && !memory.map.follows && !memory.map.lagging && !memory.map.backward);
    for (const cgl_channel *channel = memory.channel; channel < memory.channel + CGL_CHANNELS; ++channel) {
        CHECK(within(channel->value, CGL_R(0.0)));
        check_zeros(channel, offsetof(cgl_channel, sum), sizeof *channel);
    }
}

static void try_zero_phase(void)
{
    const cgl_trial_config *const trial = harness_trial.config;
    cgl_zero_phase_config config;
    uint32_t samples;
    do {
        give_back();
        harness_trial.draw(CGL_R(1.0));
        config = trial->q_filter;
        samples = 1U + random_below(SAMPLES_MAX);
    } while (cgl_zero_phase_init(&config, samples) != CGL_OK);
    const uint32_t tail = CGL_ZERO_PHASE_TAIL(samples, config.order);
    give_back();
    cgl_real *const x = borrow(samples + tail);
    for (int n = 0; n < 10; ++n) {
        memset(x, 0xFF, (samples + tail) * sizeof *x);
        const bool finite = random_below(2) != 0U;
        for (uint32_t i = 0; i < samples; ++i) {
            x[i] = finite ? cgl_clamp(random_real(CGL_R(1.0)), CGL_REAL_MAX) : random_real(CGL_R(1.0));
        }
        cgl_zero_phase(&config, x, samples, x + samples);
        if (finite || config.order > 0U) {
            check_entries(x, samples, CGL_REAL_MAX);
        }
        hear_all(x, samples);
        check_fences();
    }
}

/* What was learned for one reference, moved to another. */
static void try_trial_basis(void)
{
    static cgl_real y_ref[2][SAMPLES_MAX];
    const cgl_trial_config *const config = harness_trial.config;
    cgl_trial *const law = harness_trial.state;
    while (!begin_law(&harness_trial)) {
    }
    for (int trial = 0; trial < 8; ++trial) {
        const bool calm = random_below(4) != 0U;
        for (uint32_t p = 0; p < config->samples; ++p) {
            const cgl_real step = calm ? gain_of_any_sign(CGL_R(0.1)) : random_real(CGL_R(3.0));
            y_ref[trial % 2][p] = random_below(4) != 0U && p > 0U ? y_ref[trial % 2][p - 1U] + step : step;
            law->learned[p] = cgl_clamped(gain_of_any_sign(config->learned_limit), config->learned_limit);
        }
        const bool carried = cgl_trial_carry(law, random_below(16) ? y_ref[trial % 2] : NULL);
        CHECK(trial > 0 || !carried);
        CHECK(!carried || !cgl_trial_end(law));
        hear_bits(carried ? 1U : 0U);
        hear_all(law->learned, config->samples);
        check_entries(law->learned, config->samples, config->learned_limit);
        check_fences();
        cgl_trial_begin(law, y_ref[trial % 2]);
    }
}

/* ---- the controller around a law ---- */

static cgl_monitor_config random_monitor(cgl_real ts, uint32_t phases)
{
    cgl_monitor_config config;
    config.omega_max = random_below(4) ? random_gain(CGL_R(1000.0)) : CGL_R(0.0);
    config.angle_step = random_gain(CGL_R(0.01));
    config.speed_window = random_below(4) ? random_gain(CGL_R(20.0)) * ts : random_gain(CGL_R(0.01));
    config.stuck_time = random_below(4) ? random_gain(CGL_R(20.0) * ts) : CGL_R(0.0);
    config.stuck_angle = random_below(4) ? random_gain(CGL_R(0.5)) : CGL_R(0.0);
    config.current_max = random_below(4) ? random_gain(CGL_R(10.0)) : CGL_R(0.0);
    config.current_sum = random_below(4) ? random_gain(CGL_R(5.0)) : CGL_R(0.0);
    config.bridge = random_below(4) ? random_gain(CGL_R(20.0)) * ts : CGL_R(0.0);
    config.hold = random_below(4) ? random_gain(CGL_R(20.0)) * ts : CGL_R(0.0);
    config.phases = phases;
    return config;
}

static cgl_quality_config random_quality(cgl_real ts)
{
    const cgl_quality_config config = {random_below(4) ? CGL_TWO_PI : random_gain(CGL_R(10.0)),
                                       random_below(4) ? CGL_R(50.0) * ts : random_gain(CGL_R(60.0)),
                                       random_below(2) ? random_gain(CGL_R(10.0)) : CGL_R(0.0),
                                       random_gain(CGL_R(1.0))};
    return config;
}

/* Any bits, or a rotor that turns, whose sensors fail now and then. */
static void next_measurement(cgl_measurement *now, int step)
{
    static cgl_real theta, omega, jump;
    if (step == 0 || random_below(200) == 0U) {
        omega = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(500.0));
        theta = random_gain(CGL_R(6.0));
        jump = random_below(2) ? CGL_R(0.0) : random_gain(CGL_R(3.0));
    }
    theta = CGL_TWO_PI * cgl_fraction((theta + CGL_R(1.0e-4) * omega) / CGL_TWO_PI);
    for (int x = 0; x < 3; ++x) {
        now->i_abc[x] = random_below(40) ? CGL_R(0.01) * (cgl_real)x : random_real(CGL_R(5.0));
    }
    now->theta_m = random_below(20) ? theta + jump : random_real(CGL_R(6.0));
    now->omega_m = random_below(40) ? omega : random_real(CGL_R(500.0));
    now->u_dc = random_below(40) ? CGL_R(24.0) : random_real(CGL_R(300.0));
}

static void check_monitor(const cgl_monitor_config *config, const cgl_monitor *monitor)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    CHECK(monitor->theta_m >= CGL_R(0.0) && monitor->theta_m < CGL_TWO_PI);
    CHECK(monitor->theta_sensor >= CGL_R(0.0) && monitor->theta_sensor < CGL_TWO_PI);
    CHECK(cgl_is_finite(monitor->omega_m) && within(monitor->sensor_offset, CGL_R(3.1416)));
    CHECK(!(config->omega_max > CGL_R(1.0e-15)) /* whose square is a number */
          || within(monitor->omega_m, CGL_R(1.000001) * config->omega_max));
    CHECK(cgl_is_finite(monitor->ref_turned));
    CHECK(monitor->missing_angles <= limits->bridge + 1U && monitor->hold_wait <= limits->hold + 1U);
    CHECK(monitor->speed_wait <= limits->window + 1U && monitor->gap_periods >= monitor->missing_angles);
    CHECK(monitor->stuck_after <= monitor->standstill && monitor->full_current <= monitor->standstill);
    CHECK((monitor->status & (unsigned)CGL_STATUS_ANGLE_STUCK) == 0U || monitor->stuck_after > 0U);
    CHECK(monitor->safe == (monitor->hold_wait > 0U));
    CHECK(!(monitor->safe && monitor->trusted));
    CHECK((monitor->status == 0U && monitor->missing_angles == 0U && monitor->speed_wait == 0U && monitor->standstill == 0U
           && !monitor->stuck_since_moved)
          == monitor->trusted);
    CHECK((monitor->speed_wait > 0U) == (monitor->speed_lost > 0U));
    CHECK(monitor->safe == ((monitor->status & (unsigned)CGL_STATUS_FAULT) != 0U));
}

/* Whether new bounds hold in this step: else counts and speed may stay outside them for a while. */
static bool hold_at_once(const cgl_monitor *monitor, const cgl_monitor_config *other)
{
    return monitor->trusted && (!(other->omega_max > CGL_R(0.0)) || cgl_abs(monitor->omega_m) < other->omega_max);
}

static void try_monitor(void)
{
    cgl_monitor_config config;
    static cgl_monitor monitor;
    cgl_monitor long_way;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_monitor(ts, random_below(4));
    } while (cgl_monitor_init(&monitor, &config, ts) != CGL_OK);
    for (int step = 0; step < 4 * STEPS_PER_CONFIG; ++step) {
        cgl_measurement now;
        next_measurement(&now, step);
        const cgl_real omega_ref = random_below(8) ? CGL_R(100.0) : random_real(CGL_R(100.0));
        const bool full = random_below(4) != 0U;
        long_way = monitor;
        cgl_monitor_step(&monitor, &now, omega_ref, full);
        cgl_monitor_look(&long_way, &now, omega_ref, full);
        hear(monitor.theta_m);
        hear(monitor.omega_m);
        hear(monitor.sensor_offset);
        hear_bits(monitor.status + (monitor.trusted ? 1U << 31 : 0U));
        check_monitor(&config, &monitor);
        check_monitor(&config, &long_way);
        CHECK(monitor.status == long_way.status && monitor.trusted == long_way.trusted);
        CHECK(!(monitor.theta_m < long_way.theta_m) && !(monitor.theta_m > long_way.theta_m));
        CHECK(!(monitor.omega_m < long_way.omega_m) && !(monitor.omega_m > long_way.omega_m));
        if (random_below(500) == 0U) {
            cgl_monitor_trust(&monitor);
        } else if (random_below(500) == 0U) {
            const cgl_monitor_config other = random_monitor(ts, random_below(4));
            config = hold_at_once(&monitor, &other) && cgl_monitor_retune(&monitor, &other) == CGL_OK ? other : config;
        } else if (random_below(1000) == 0U) {
            cgl_monitor_reset(&monitor);
        } else if (random_below(500) == 0U) { /* as after years */
            monitor.gap_periods = monitor.missing_angles > 0U ? UINT32_MAX : 0U;
            monitor.jumps = UINT32_MAX;
        }
    }
    CHECK_ANEW(monitor, &monitor, &config, ts);
    CHECK(monitor.safe);
    CHECK_ZEROS(monitor, &monitor, trusted, ref_turned);
}

static void check_quality(const cgl_quality *quality)
{
    CHECK(cgl_is_finite(quality->sum + quality->outlier_sum) && cgl_is_finite(quality->squares + quality->outlier_squares));
    CHECK(cgl_is_finite(quality->turned) && cgl_is_finite(quality->centre));
    CHECK(quality->ripple >= CGL_R(0.0) && cgl_is_finite(quality->ripple));
    CHECK(quality->ripple_before >= CGL_R(0.0) && cgl_is_finite(quality->ripple_before));
    CHECK(cgl_is_finite(quality->outlier_square) && (quality->outlier_square >= CGL_R(0.0) || quality->windows == 0U));
    CHECK(quality->run_length <= quality->outliers && quality->refused_square >= quality->outlier_square);
    CHECK(within(quality->trend, CGL_R(0.16001)));
    CHECK(quality->remaining >= 1U && quality->remaining <= quality->longest);
    CHECK(quality->missing + quality->outliers <= quality->longest - quality->remaining);
    const cgl_quality_report report = cgl_quality_read(quality);
    CHECK(report.residual >= CGL_R(0.0) && report.residual <= CGL_R(1.1e14));
    CHECK(cgl_is_finite(report.progress) && report.progress <= CGL_R(1.0));
    CHECK(!(report.improving && report.worsening));
}

static void try_quality(void)
{
    cgl_quality_config config;
    static cgl_quality quality;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_quality(ts);
    } while (cgl_quality_init(&quality, &config, ts) != CGL_OK);
    for (int step = 0; step < STEPS_PER_CONFIG; ++step) {
        const cgl_real error = random_below(10) ? CGL_R(0.1) * (cgl_real)random_below(10) : random_real(CGL_R(10.0));
        const cgl_real omega_m = random_below(10) ? CGL_R(100.0) : random_real(CGL_R(100.0));
        const bool outlier = cgl_quality_step(&quality, error, omega_m, random_below(2) != 0U);
        const cgl_quality_report report = cgl_quality_read(&quality);
        hear(report.residual);
        hear(report.progress);
        hear_bits((uint32_t)outlier + 2U * (uint32_t)report.improving + 4U * (uint32_t)report.worsening);
        CHECK(cgl_is_finite(error) || outlier);
        CHECK(!outlier || config.outlier > CGL_R(0.0) || !(cgl_abs(error) <= CGL_R(1.0e14)));
        check_quality(&quality);
        if (random_below(100) == 0U) {
            quality.windows = UINT32_MAX;
        } else if (random_below(200) == 0U) {
            cgl_quality_config other = random_quality(ts);
            other.outlier = config.outlier; /* another one holds from the next window on */
            config = cgl_quality_retune(&quality, &other) == CGL_OK ? other : config;
        }
    }
    CHECK_ANEW(quality, &quality, &config, ts);
    CHECK_ZEROS(quality, &quality, run_positive, run_remaining);
    CHECK_ZEROS(quality, &quality, missing, last_peak_square);
    CHECK_ZEROS(quality, &quality, turned, turned);
    CHECK_ZEROS(quality, &quality, ripple, trend);
}

static cgl_drive_config random_drive(cgl_real ts)
{
    cgl_drive_config config;
    config.pole_pairs = random_below(10) ? 1U + random_below(10) : random_word();
    config.divider = random_below(10) ? 1U + random_below(20) : random_word();
    config.foreign = random_below(3) == 0U;
    config.feed_forward = config.foreign && random_below(3) == 0U;
    config.learn_saturated = random_below(2) != 0U;
    config.unguarded = random_below(2) != 0U;
    config.foc = random_foc();
    config.monitor = random_monitor(ts, random_below(4));
    config.quality = random_quality((cgl_real)config.divider * ts);
    return config;
}

static void check_drive(const cgl_drive_config *config, const cgl_drive *drive, const cgl_drive_output *out)
{
    check_monitor(&config->monitor, &drive->monitor);
    check_quality(&drive->quality);
    CHECK(are_duties(out->duty));
    CHECK(cgl_is_finite(out->i_d) && cgl_is_finite(out->i_q) && cgl_is_finite(out->u_d) && cgl_is_finite(out->u_q));
    CHECK(cgl_is_finite(out->i_d_ref) && cgl_is_finite(out->i_q_ref) && cgl_is_finite(drive->i_q));
    CHECK(cgl_is_finite(drive->foc.integral_d) && cgl_is_finite(drive->foc.integral_q));
    if (drive->monitor.safe) {
        CHECK(within(out->u_d, CGL_R(0.0)) && within(out->u_q, CGL_R(0.0)) && within(out->i_q_ref, CGL_R(0.0)));
        CHECK(within(drive->foc.integral_d, CGL_R(0.0)) && within(drive->foc.integral_q, CGL_R(0.0)));
        CHECK((out->status & (unsigned)CGL_STATUS_OFF) != 0U && (out->status & (unsigned)CGL_STATUS_FAULT) != 0U);
    }
    if (drive->monitor.safe || config->foreign) {
        for (int x = 0; x < 3; ++x) {
            CHECK(within(out->duty[x] - CGL_R(0.5), CGL_R(0.0)));
        }
    }
}

/* A drive that is reset waits for its first measurement, like a new one, and its law has no input and no command. */
static void check_drive_anew(const cgl_drive_config *config, cgl_drive *drive, cgl_real ts)
{
    static const cgl_law_input no_input;
    static const cgl_foc_input no_currents;
    static cgl_drive fresh;
    cgl_drive_reset(drive);
    CHECK(cgl_drive_init(&fresh, config, ts) == CGL_OK);
    check_bytes(&drive->in, &no_input, 0U, offsetof(cgl_law_input, gentle) + sizeof no_input.gentle);
    CHECK(!drive->in.torque && within(drive->in.i_q_ref, CGL_R(0.0)));
    check_bytes(&drive->currents, &no_currents, 0U, sizeof no_currents);
    CHECK(within(drive->command.i_q_ref, CGL_R(0.0)) && drive->command.status == 0U && within(drive->i_q, CGL_R(0.0)));
    CHECK(drive->countdown == 0U && drive->status == 0U && drive->held == 0U && !drive->saturated && !drive->off);
    check_bytes(&drive->monitor, &fresh.monitor, 0U, offsetof(cgl_monitor, limits));
    check_bytes(&drive->quality, &fresh.quality, 0U, sizeof fresh.quality);
    check_bytes(&drive->guard, &fresh.guard, 0U, sizeof fresh.guard);
    check_bytes(&drive->foc, &fresh.foc, 0U, config->foreign ? 0U : sizeof fresh.foc); /* a foreign loop has none */
}

static void try_drive(void)
{
    cgl_drive_config config;
    static cgl_drive drive;
    cgl_pi pi;
    cgl_pi_config law;
    cgl_real ts;
    do {
        ts = random_gain(CGL_R(1.0e-3));
        config = random_drive(ts);
        law = random_pi();
    } while (cgl_drive_init(&drive, &config, ts) != CGL_OK || cgl_pi_init(&pi, &law, any_loop(ts)) != CGL_OK);
    uint32_t since = config.divider;
    for (int step = 0; step < 2 * STEPS_PER_CONFIG; ++step) {
        cgl_measurement now;
        next_measurement(&now, step);
        const cgl_reference reference = {random_real(CGL_R(6.0)), random_below(4) ? CGL_R(50.0) : random_real(CGL_R(100.0)),
                                         random_real(CGL_R(10.0)), random_real(CGL_R(1.0)), random_below(8) != 0U,
                                         random_below(20) == 0U, random_real(CGL_R(1.0))};
        const bool spoilt = (drive.saturated && !config.learn_saturated) || drive.off;
        const bool due = cgl_drive_measure(&drive, &now, &reference);
        CHECK(due == (since >= config.divider));
        since = due ? 1U : since + 1U;
        if (due) {
            CHECK(!drive.in.learn || (reference.learn && drive.monitor.trusted && !spoilt));
            CHECK(drive.in.off || !drive.monitor.safe);
            CHECK(cgl_is_finite(drive.in.theta_m) && cgl_is_finite(drive.in.omega_m) && cgl_is_finite(drive.in.i_q));
            cgl_speed_pi_step(&pi, &drive.in, &drive.command);
        }
        cgl_drive_output out;
        cgl_drive_actuate(&drive, &out);
        hear_all(out.duty, 3U);
        hear(out.i_d_ref);
        hear(out.i_q_ref);
        hear(out.i_q);
        hear(drive.i_q);
        hear(out.u_d);
        hear(out.u_q);
        hear_bits(out.status + (drive.in.learn ? 1U << 31 : 0U));
        hear(drive.quality.ripple);
        check_drive(&config, &drive, &out);
        CHECK(within(out.i_q_ref, law.limit));
        if (random_below(1000) == 0U) {
            cgl_drive_reset(&drive);
            CHECK(drive.in.gentle == 0U && !drive.in.learn && !drive.in.off && within(drive.in.muted, CGL_R(0.0)));
            since = config.divider;
        } else if (random_below(200) == 0U) {
            cgl_drive_config other = random_drive(ts);
            other.pole_pairs = config.pole_pairs;
            other.divider = config.divider + (random_below(10) == 0U ? 1U : 0U);
            other.foreign = config.foreign;
            other.unguarded = config.unguarded;
            const cgl_drive before = drive;
            const bool taken = hold_at_once(&drive.monitor, &other.monitor) && cgl_drive_retune(&drive, &other) == CGL_OK;
            const cgl_drive_config *const now_in = taken ? &other : &config;
            CHECK(memcmp(&drive.monitor.config.hold, &now_in->monitor.hold, sizeof now_in->monitor.hold) == 0);
            CHECK(config.foreign || memcmp(&drive.foc.config.kp_q, &now_in->foc.kp_q, sizeof now_in->foc.kp_q) == 0);
            CHECK(drive.divider == config.divider && drive.learn_saturated == now_in->learn_saturated);
            CHECK(taken || memcmp(&before.quality.remaining, &drive.quality.remaining, sizeof drive.quality.remaining) == 0);
            config = taken ? other : config;
        }
    }
    check_drive_anew(&config, &drive, ts);
}

/* Configs of any bits: init may refuse them, and does no more than that. */
static void try_any_sizes(void)
{
    const uint32_t length = random_below(CELLS_MAX);
    const cgl_real ts = random_gain(CGL_R(1.0e-3));
    cgl_memory_config memory = random_memory(1U + random_below(CGL_CHANNELS));
    *(random_below(2) ? &memory.cells : &memory.q_half_width) = random_word();
    *(random_below(2) ? &memory.channels : &memory.parts) = random_word();
    cgl_memory state;
    give_back();
    if (cgl_memory_init(&state, &memory, ts, random_word(), borrow(length), length) == CGL_OK) {
        CHECK(memory_length(&memory) <= length);
    }
    check_fences();
    cgl_foc_config currents = random_foc();
    currents.phases = random_below(5);
    currents.kp_q = random_real(CGL_R(1.0));
    cgl_foc foc;
    const bool valid = (currents.phases == 0U || currents.phases == 2U || currents.phases == 3U) && currents.kp_q >= CGL_R(0.0)
                       && cgl_is_finite(currents.kp_q) && ts > CGL_R(0.0);
    CHECK(cgl_foc_init(&foc, &currents, ts) != CGL_OK || valid);
}

static void try_laws(long configs)
{
    static const law_harness *const laws[] = {
#define CGL_LAW_WITHOUT_MEMORY(name, stem, header, step) &harness_##stem,
#include "cogless/laws.def"
    };
    for (size_t n = 0; n < sizeof laws / sizeof laws[0]; ++n) {
        harness = laws[n];
        const random_subject subjects[] = {{harness->name, try_law, harness->in_float, harness->in_double},
                                           {harness->name, try_any_config, 0U, 0U}};
        try_subjects(subjects, harness->spoil != NULL ? 2U : 1U, configs);
    }
}

void random_inputs(long configs)
{
    static const random_subject subjects[] = {
        {"angle", try_angle, 0x24552c34U, 0x32ee43c6U},
        {"modulation", try_modulation, 0x3f9fb973U, 0x03e77d72U},
        {"foc", try_foc, 0x5b274328U, 0xe2d0ab4cU},
        {"memory", try_memory, 0x4701d53aU, 0x5a9e5b6bU},
        {"zero_phase", try_zero_phase, 0x976e6987U, 0x2b39666bU},
        {"monitor", try_monitor, 0xa109457eU, 0xbac9d8d4U},
        {"quality", try_quality, 0x532bf318U, 0xf480206bU},
        {"drive", try_drive, 0xd3db1a8cU, 0x3d201677U},
        {"any_sizes", try_any_sizes, 0x00000000U, 0x00000000U},
        {"trial_basis", try_trial_basis, 0xc46efd6fU, 0xfb704286U},
    };
    try_subjects(subjects, sizeof subjects / sizeof subjects[0], configs);
    try_laws(configs);
}
