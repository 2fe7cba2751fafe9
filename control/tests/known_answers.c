/* Parts and laws with inputs whose answer is known: from the field that they work on, or in closed form. */
#include "known_answers.h"

#include <math.h>
#include <stddef.h>

#include "check.h"
#include "cogless/adrc.h"
#include "cogless/angle.h"
#include "cogless/calibration.h"
#include "cogless/encoder.h"
#include "cogless/encoder_table.h"
#include "cogless/feedforward.h"
#include "cogless/hall.h"
#include "cogless/harmonic.h"
#include "cogless/map.h"
#include "cogless/monitor.h"
#include "cogless/quality.h"
#include "cogless/sine.h"
#include "cogless/space_position.h"
#include "cogless/speed_pi.h"
#include "cogless/speed_timed.h"
#include "cogless/square_root.h"
#include "cogless/trial.h"
#include "cogless/trial_guard.h"
#include "cogless/turns.h"

/* Numbers that logs and other programs know. */
static void keep_the_numbers(void)
{
    static const int status[] = {CGL_STATUS_SATURATED,     CGL_STATUS_FAULT,       CGL_STATUS_FROZEN,  CGL_STATUS_BUSY, CGL_STATUS_ANGLE_LOST,
                                 CGL_STATUS_ANGLE_SHIFTED, CGL_STATUS_ANGLE_STUCK, CGL_STATUS_CURRENT, CGL_STATUS_BUS,  CGL_STATUS_OUTLIER,
                                 CGL_STATUS_OFF,           CGL_STATUS_GUARDED};
    static const int result[] = {CGL_MAP_OK,           CGL_MAP_BUSY,         CGL_MAP_NONE,         CGL_MAP_DAMAGED,   CGL_MAP_OTHER_VERSION,
                                 CGL_MAP_OTHER_MOTOR,  CGL_MAP_OTHER_MOTION, CGL_MAP_OTHER_LAYOUT, CGL_MAP_BAD_VALUE, CGL_MAP_FLASH_FAILED,
                                 CGL_MAP_CHANGED,      CGL_MAP_LEARNING,     CGL_MAP_NO_ROOM,      CGL_MAP_BY_TIME,   CGL_MAP_INVALID};
    static const int law[] = {CGL_MAP_LAW_OTHER,         CGL_MAP_LAW_PI_ILC, CGL_MAP_LAW_ROBUST_ILC,
                              CGL_MAP_LAW_ANTI_COGGING,  CGL_MAP_LAW_SPACE_POSITION, CGL_MAP_LAW_SPACE_SPEED,
                              CGL_MAP_LAW_TRIAL,         CGL_MAP_LAW_PI_AFC, CGL_MAP_LAW_HARMONIC};
    static const int unit[] = {CGL_MAP_UNIT_NONE,           CGL_MAP_UNIT_CURRENT,      CGL_MAP_UNIT_CURRENT_PER_SPEED,
                               CGL_MAP_UNIT_CURRENT_PER_ACCELERATION, CGL_MAP_UNIT_ACCELERATION, CGL_MAP_UNIT_OF_THE_TRIAL,
                               CGL_MAP_UNIT_COSINE_CURRENT, CGL_MAP_UNIT_SINE_CURRENT, CGL_MAP_UNIT_ORDER};
    for (int n = 0; n < 9; ++n) {
        CHECK(law[n] == n && unit[n] == n);
    }
    for (int n = 0; n < 12; ++n) {
        CHECK(status[n] == 1 << n);
    }
    for (int n = 0; n < 15; ++n) {
        CHECK(result[n] == n);
    }
}

/* Readings are unwrapped the shorter way. At the index the rotor is at zero, whatever its angle was thought to be. */
static void turn_an_encoder(void)
{
    const cgl_encoder_config config = {.counts = 1000U, .range = 65536U, .zero = 250U};
    static const uint32_t reading[] = {110U, 102U, 65530U, 4U, 1004U}, position[] = {10U, 2U, 894U, 904U, 904U};
    cgl_encoder encoder;
    CHECK(cgl_encoder_init(&encoder, &config, 100U) == CGL_OK && !encoder.placed);
    for (int n = 0; n < 5; ++n) {
        cgl_encoder_step(&encoder, reading[n]);
        CHECK(encoder.position == position[n] && encoder.count == reading[n] - 100U - (n == 2 ? 65536U : 0U));
        CHECK(within(cgl_radians(encoder.turns) - CGL_TWO_PI * (cgl_real)position[n] / CGL_R(1000.0), CGL_R(1.0e-6)));
    }
    cgl_encoder_index(&encoder, 1010U); /* 6 counts ahead of the last reading */
    CHECK(encoder.position == 244U && encoder.placed);
    cgl_encoder_index(&encoder, 65530U); /* and 1010 behind */
    CHECK(encoder.position == 260U);
}

/* Three sensors with offsets, read ten times: their means; and none where one of them moves by more than the spread. */
static void average_offsets(void)
{
    const cgl_offsets_config config = {.samples = 10U, .phases = 3U, .spread = CGL_R(0.05), .largest = CGL_R(0.5)};
    cgl_offsets offsets;
    for (uint32_t moving = 0; moving < 4U; ++moving) { /* 3: none */
        CHECK(cgl_offsets_init(&offsets, &config) == CGL_OK);
        for (uint32_t n = 0; n < 10U; ++n) {
            const cgl_real more = n == 2U ? CGL_R(0.04) : CGL_R(0.0);
            cgl_real i_abc[3] = {CGL_R(0.1) + more, CGL_R(-0.2) + more, CGL_R(0.3) + more};
            if (moving < 3U && n == 7U) {
                i_abc[moving] -= CGL_R(0.02);
            }
            const cgl_calibration good = n < 9U ? CGL_CALIBRATION_BUSY : CGL_CALIBRATION_DONE;
            CHECK(cgl_offsets_step(&offsets, i_abc) == (moving < 3U && n >= 7U ? CGL_CALIBRATION_FAILED : good));
        }
    }
    CHECK(within(offsets.mean[0] - CGL_R(0.104), CGL_R(1.0e-6)) && within(offsets.mean[1] + CGL_R(0.196), CGL_R(1.0e-6)));
    CHECK(within(offsets.mean[2] - CGL_R(0.304), CGL_R(1.0e-6)));
}

/* Parts of a turn in 32 bits are what a division of 64 bits makes of them. */
static void divide_a_turn(void)
{
    for (uint32_t parts = 2U; parts <= 65536U; parts += 1U + parts / 64U) {
        for (uint32_t part = 0U; part < parts; part += 1U + parts / 97U) {
            CHECK(cgl_share_of_turn(part, parts) == (uint32_t)(((uint64_t)part << 32U) / parts));
        }
        CHECK(cgl_share_of_turn(parts - 1U, parts) == (uint32_t)(((uint64_t)(parts - 1U) << 32U) / parts));
        CHECK(cgl_share_of_turn(1U, 255U * parts) == (uint32_t)(((uint64_t)1U << 32U) / (255U * parts)));
        const cgl_encoder_config config = {.counts = UINT32_MAX / parts * 3U};
        cgl_encoder encoder;
        CHECK(cgl_encoder_init(&encoder, &config, 0U) == CGL_OK && encoder.per_count == UINT64_MAX / config.counts);
    }
}

#ifdef COGLESS_DOUBLE
#define PHASOR_ERROR CGL_R(1.3e-15) /* of an order, times the order */
#else
#define PHASOR_ERROR CGL_R(2.9e-7)
#endif

static void compare_phasors(cgl_phasor one, cgl_phasor other, cgl_real bound)
{
    CHECK(within(one.cosine - other.cosine, bound) && within(one.sine - other.sine, bound));
}

/* The phasors of 420 orders by products alone, one by one and by doubling, at 97 angles; and the phasor of an angle up to 100 rad,
 * which is halved up to nine times. */
static void turn_phasors(void)
{
    for (uint32_t n = 0U; n < 97U; ++n) {
        const uint32_t turns = n * 44278013U + 12345U;
        const cgl_phasor first = cgl_phasor_of(turns);
        cgl_phasor phasor = first, doubled = first;
        for (uint32_t order = 2U; order <= 420U; ++order) {
            phasor = cgl_product(phasor, first);
            compare_phasors(phasor, cgl_phasor_of(order * turns), (cgl_real)(order + 1U) * PHASOR_ERROR);
            if ((order & (order - 1U)) == 0U) {
                doubled = cgl_product(doubled, doubled);
                compare_phasors(doubled, cgl_phasor_of(order * turns), (cgl_real)(order + 1U) * PHASOR_ERROR);
            }
        }
        const cgl_real angle = (cgl_real)n * (cgl_real)n * CGL_R(0.01) - CGL_R(2.0);
        cgl_phasor direct;
        cgl_sincos(angle, &direct.sine, &direct.cosine);
        compare_phasors(cgl_phasor_ahead(angle), direct, (CGL_R(2.0) + CGL_R(8.0) * cgl_abs(angle)) * PHASOR_ERROR);
    }
}

/* A sensor off its middle, at a speed that the current does not change: its error is learned, and taken out of the angle, and of a
 * speed that is the mean over 60 steps, a revolution nearly. */
static void see_through_a_sensor(void)
{
    const cgl_encoder_table_config config = {.orders = 2U, .order = {1U, 2U}, .gain = CGL_R(2.0), .omega_min = CGL_R(20.0),
                                             .bandwidth = CGL_R(2.0), .limit = CGL_R(0.05)};
    const cgl_real ts = CGL_R(1.0e-3), omega = CGL_R(100.0);
    cgl_encoder_table_config twice = config;
    twice.order[1] = 1U;
    cgl_encoder_table table;
    cgl_real off = CGL_R(0.0), slips = CGL_R(0.0), shown[60] = {CGL_R(0.0)};
    CHECK(cgl_encoder_table_init(&table, &twice, ts) == CGL_ERROR_CONFIG);
    CHECK(cgl_encoder_table_init(&table, &config, ts) == CGL_OK);
    for (int n = 0; n < 8000; ++n) {
        const cgl_real theta = cgl_fraction(omega * ts * (cgl_real)n / CGL_TWO_PI) * CGL_TWO_PI;
        cgl_real sine, cosine, sine_2, cosine_2;
        cgl_sincos(theta, &sine, &cosine);
        cgl_sincos(CGL_R(2.0) * theta, &sine_2, &cosine_2);
        cgl_measurement now = {.theta_m = theta + CGL_R(0.01) * cosine + CGL_R(0.004) * sine_2, .omega_m = omega};
        const cgl_real error = CGL_R(0.01) * cosine + CGL_R(0.004) * sine_2, time = CGL_R(60.0) * ts;
        const cgl_real mean = omega + (error - shown[n % 60]) / time;
        shown[n % 60] = error;
        cgl_encoder_table_step(&table, &now, CGL_R(0.0), true);
        now.omega_m = cgl_encoder_table_speed(&table, mean, time);
        if (n >= 7900) {
            const cgl_real wrong = cgl_abs(now.theta_m - theta), slip = cgl_abs(now.omega_m - omega);
            off = wrong > off && wrong < CGL_R(6.0) ? wrong : off;
            slips = slip > slips ? slip : slips;
        }
    }
    CHECK(table.learning && within(table.a[0] - CGL_R(0.01), CGL_R(3.0e-4)) && within(table.c[1] - CGL_R(0.004), CGL_R(2.0e-4)));
    CHECK(off < CGL_R(5.0e-4) && slips < CGL_R(0.05));
}

/* A rotor that is nothing but inertia, and a load: the observer finds the load, and the speed has no error left. */
static void reject_a_load(void)
{
    const cgl_real ts = CGL_R(1.0e-3), load = CGL_R(-30.0); /* [rad/s^2] */
    const cgl_adrc_config config = {.b = CGL_R(100.0), .omega_c = CGL_R(20.0), .omega_o = CGL_R(100.0), .limit = CGL_R(5.0)};
    const cgl_loop loop = {.ts = ts, .current_limit = CGL_R(100.0)};
    cgl_adrc law;
    cgl_law_input in = {.omega_ref = CGL_R(10.0), .learn = true};
    cgl_law_output out;
    CHECK(cgl_adrc_init(&law, &config, &loop) == CGL_OK);
    for (int n = 0; n < 2000; ++n) {
        cgl_adrc_step(&law, &in, &out);
        in.omega_m += ts * (config.b * out.i_q_ref + load);
    }
    CHECK(within(in.omega_m - in.omega_ref, CGL_R(1.0e-3)) && within(law.omega - in.omega_m, CGL_R(1.0e-3)));
    CHECK(within(law.f - load, CGL_R(0.05)) && within(out.i_q_ref + load / config.b, CGL_R(1.0e-3)));
    CHECK(within(law.rejected + law.proportional - out.i_q_ref, CGL_R(1.0e-6)));
}

/* A step of a rotor [rad, rad/s] that cogs, seen by a sensor off its middle. */
static void turn_by_orders(cgl_harmonic *law, cgl_real rotor[2], cgl_real reference, cgl_real theta_ref)
{
    const cgl_real ts = CGL_R(1.0e-3), off = CGL_R(0.01);
    cgl_real sine, cosine;
    cgl_sincos(rotor[0], &sine, &cosine);
    cgl_real shown = rotor[0] + off * cosine;
    shown += shown < CGL_R(0.0) ? CGL_TWO_PI : CGL_R(0.0);
    const cgl_law_input in = {.theta_ref = theta_ref, .omega_ref = reference, .omega_m = rotor[1] * (CGL_R(1.0) - off * sine),
                              .theta_m = shown, .learn = true};
    cgl_law_output out;
    cgl_harmonic_step(law, &in, &out);
    for (int part = 0; part < 4; ++part) {
        cgl_sincos(CGL_R(6.0) * rotor[0], &sine, &cosine);
        const cgl_real alpha = law->config.b * out.i_q_ref + CGL_R(50.0) * cosine + CGL_R(40.0) * (cosine * cosine - sine * sine);
        rotor[1] += CGL_R(0.25) * ts * alpha;
        rotor[0] = cgl_fraction((rotor[0] + CGL_R(0.25) * ts * rotor[1]) / CGL_TWO_PI) * CGL_TWO_PI;
    }
}

/* The ripple of its true speed in the last of so many seconds. */
static cgl_real ripple_of(cgl_harmonic *law, cgl_real rotor[2], cgl_real reference, int seconds)
{
    cgl_real low = reference, high = reference;
    for (int n = 0; n < 1000 * seconds; ++n) {
        turn_by_orders(law, rotor, reference, CGL_R(0.0));
        if (n >= 1000 * (seconds - 1)) {
            low = rotor[1] < low ? rotor[1] : low;
            high = rotor[1] > high ? rotor[1] : high;
        }
    }
    return high - low;
}

/* A law that has learned what the sensor is off follows a position with the rotor, not with what the sensor shows. */
static void follow_positions(cgl_harmonic *law, cgl_real rotor[2])
{
    const cgl_real omega = CGL_R(20.0), ts = CGL_R(1.0e-3);
    const cgl_harmonic_config config = law->config;
    const cgl_harmonic_bend *const bend = &law->bend;
    cgl_harmonic_config position = config;
    cgl_real theta_ref = rotor[0], low = CGL_R(1.0), high = CGL_R(-1.0);
    position.k_theta = CGL_R(10.0);
    CHECK(cgl_harmonic_retune(law, &position) == CGL_OK);
    for (int n = 0; n < 1600; ++n) {
        turn_by_orders(law, rotor, omega, theta_ref);
        theta_ref = cgl_fraction((theta_ref + omega * ts) / CGL_TWO_PI) * CGL_TWO_PI;
        if (n >= 1200) {
            cgl_real sine, cosine;
            const cgl_real apart = cgl_unwrap(rotor[0] - theta_ref, CGL_R(0.0));
            low = apart < low ? apart : low;
            high = apart > high ? apart : high;
            cgl_sincos(rotor[0] - omega * ts, &sine, &cosine);
            const cgl_real angle = bend->share * (bend->part[0] * cosine + bend->part[1] * sine) / CGL_TWO_PI;
            CHECK(within(bend->angle - angle, CGL_R(5.0e-5))); /* between the bend's turns, too */
        }
    }
    CHECK(high - low < CGL_R(0.007)); /* a loop that believed the sensor: 0.02 rad * 10 / hypot(10, 20) = 0.009 rad */
    CHECK(cgl_harmonic_retune(law, &config) == CGL_OK);
}

/* The amplitudes are those of the cogging, and the bend is the sensor's; a new speed is learned at once. */
static void learn_orders(void)
{
    static cgl_real cell[CGL_HARMONIC_LENGTH(4U)];
    const cgl_harmonic_config config = {.pi = {CGL_R(0.06), CGL_R(0.9), CGL_R(3.0)}, .b = CGL_R(800.0), .base = 6U, .bends = 1U,
                                        .orders = 4U, .fast = 4U, .rate = CGL_R(8.0), .rate_min = CGL_R(0.5), .limit = CGL_R(1.0)};
    const cgl_loop loop = {.ts = CGL_R(1.0e-3), .current_limit = CGL_R(100.0)};
    cgl_harmonic law;
    cgl_real rotor[2] = {CGL_R(0.0), CGL_R(20.0)};
    cgl_harmonic_config without_limit = config;
    without_limit.pi.limit = CGL_R(-1.0);
    CHECK(cgl_harmonic_init(&law, &without_limit, &loop, cell, CGL_HARMONIC_LENGTH(4U)) == CGL_ERROR_CONFIG);
    CHECK(cgl_harmonic_init(&law, &config, &loop, NULL, CGL_HARMONIC_LENGTH(4U)) == CGL_ERROR_MEMORY);
    CHECK(cgl_harmonic_init(&law, &config, &loop, cell, CGL_HARMONIC_LENGTH(4U) - 1U) == CGL_ERROR_MEMORY);
    CHECK(cgl_harmonic_init(&law, &config, &loop, cell, CGL_HARMONIC_LENGTH(4U)) == CGL_OK);
    const cgl_real early = ripple_of(&law, rotor, CGL_R(20.0), 1);
    (void)ripple_of(&law, rotor, CGL_R(20.0), 4);
    CHECK(within(law.bend.share, CGL_R(0.0))); /* a bend is not believed before it stands out from how its turns differ */
    (void)ripple_of(&law, rotor, CGL_R(20.0), 1);
    CHECK(law.bend.share > CGL_R(0.5) && law.bend.share < CGL_R(0.8));
    CHECK(ripple_of(&law, rotor, CGL_R(20.0), 3) < CGL_R(0.15) * early);
    CHECK(within(cell[0] + CGL_R(50.0) / config.b, CGL_R(5.0e-4)) && within(cell[1] + CGL_R(40.0) / config.b, CGL_R(5.0e-4)));
    CHECK(within(cell[4], CGL_R(2.0e-3)) && within(cell[5], CGL_R(2.0e-3)));
    CHECK(within(law.bend.part[0] - CGL_R(0.01), CGL_R(2.5e-3)) && within(law.bend.part[1], CGL_R(2.0e-3)));
    CHECK(within(law.bend.part[2], CGL_R(0.0)) && within(law.bend.part[3], CGL_R(0.0))); /* a bend of one order */
    CHECK(law.bend.share > CGL_R(0.95) && within(law.time - CGL_R(8.94), CGL_R(0.05)));
    follow_positions(&law, rotor);
    CHECK(ripple_of(&law, rotor, CGL_R(45.0), 2) < CGL_R(0.25) * early);
    CHECK(within(law.time - CGL_R(2.0), CGL_R(0.05)) && law.rate > CGL_R(1.2) && law.rate < CGL_R(1.5)); /* it learns anew there */
    (void)ripple_of(&law, rotor, CGL_R(12.0), 2);
    CHECK(within(law.time - CGL_R(2.0), CGL_R(0.1))); /* and there; a speed between earlier ones isn't new */
    (void)ripple_of(&law, rotor, CGL_R(30.0), 1);
    (void)ripple_of(&law, rotor, CGL_R(15.0), 1);
    CHECK(within(law.time - CGL_R(4.0), CGL_R(0.2)));
    cgl_harmonic_config lower = config;
    lower.delay = CGL_R(16.0) * law.pi.loop.ts; /* the longest that it takes */
    CHECK(cgl_harmonic_retune(&law, &lower) == CGL_OK);
    lower.delay = CGL_R(17.0) * law.pi.loop.ts;
    CHECK(cgl_harmonic_retune(&law, &lower) == CGL_ERROR_CONFIG);
    lower = config;
    lower.limit = CGL_R(0.02);
    CHECK(cgl_harmonic_retune(&law, &lower) == CGL_OK && within(cell[0] + lower.limit, CGL_R(1.0e-6)));
}

/* Hall sensors at a constant speed, either way: the angle goes on evenly from edge to edge. */
static void turn_by_halls(void)
{
    const cgl_hall_config config = {.pole_pairs = 2U, .edges = 6U, .timer = CGL_R(1.0e6)};
    const int32_t per_sector = 5000, sectors = 12; /* ticks of a sector */
    for (int32_t way = -1; way <= 1; way += 2) {
        cgl_hall hall;
        CHECK(cgl_hall_init(&hall, &config) == CGL_OK);
        for (int32_t now = 0; now < 200 * per_sector; now += 700) {
            const int32_t passed = (now + per_sector / 2) / per_sector; /* it begins in the middle of sector 0 */
            const int32_t position = ((way * passed) % sectors + sectors) % sectors;
            const int32_t edge = passed > 0 ? passed * per_sector - per_sector / 2 : 0;
            cgl_hall_step(&hall, (uint32_t)(position % 6), (uint32_t)edge, (uint32_t)now);
            if (now > 20 * per_sector) {
                const cgl_real turned = (cgl_real)way * (cgl_real)now / (cgl_real)(per_sector * sectors)
                                        + CGL_R(0.5) / (cgl_real)sectors;
                const cgl_real theta = cgl_fraction(turned) * CGL_TWO_PI;
                CHECK(within(cgl_unwrap(cgl_radians(hall.turns) - theta, CGL_R(0.0)), CGL_R(1.0e-3)));
                CHECK(within(hall.omega_m - (cgl_real)way * CGL_TWO_PI / CGL_R(0.06), CGL_R(0.1)));
            }
        }
    }
}

/* A reset hands over a speed, which stays until the timer has gone on; a speed that is not finite counts as 0. */
static void hand_over_a_speed(void)
{
    const cgl_speed_timed_config config = {.counts = 4096U, .timer = CGL_R(1.0e6), .last_interval = true};
    const cgl_edges edges = {.count = 7U, .time = 100U};
    const cgl_real speeds[] = {CGL_R(-3.5), (cgl_real)NAN}, kept[] = {CGL_R(-3.5), CGL_R(0.0)};
    for (uint32_t n = 0; n < CGL_ENTRIES(speeds); ++n) {
        cgl_speed_timed speed;
        CHECK(cgl_speed_timed_init(&speed, &config) == CGL_OK);
        CHECK(within(cgl_speed_timed_step(&speed, &(cgl_edges){0}, 0U), CGL_R(0.0)));
        cgl_speed_timed_reset(&speed, &edges, 100U, speeds[n]);
        CHECK(within(cgl_speed_timed_step(&speed, &edges, 100U) - kept[n], CGL_R(0.0)));
    }
}

/* Learning that only makes the error larger is a strike. The best v then runs for four trials, and learning begins anew. */
static void hold_the_best_trial(void)
{
    static const cgl_real errors[] = {CGL_R(1.0), CGL_R(3.0), CGL_R(3.5), CGL_R(1.0), CGL_R(1.0), CGL_R(1.0), CGL_R(1.0)};
    static const cgl_trial_phase phases[] = {CGL_TRIAL_LEARN, CGL_TRIAL_LEARN, CGL_TRIAL_REPLAY, CGL_TRIAL_HOLD,
                                             CGL_TRIAL_HOLD,  CGL_TRIAL_HOLD,  CGL_TRIAL_LEARN};
    cgl_trial_guard guard;
    cgl_trial_guard_reset(&guard);
    for (uint32_t n = 0; n < CGL_ENTRIES(errors); ++n) {
        guard.error = errors[n];
        const cgl_trial_verdict verdict = cgl_trial_guard_judge(&guard, false);
        CHECK(guard.phase == phases[n] && verdict.learn == (phases[n] == CGL_TRIAL_LEARN));
    }
    CHECK(guard.strikes == 1U && within(guard.share - CGL_R(0.125), CGL_R(0.0)));
}

/* Learning goes on while too large an error falls, but for five trials only. Then v is compared with none. */
static void compare_after_five_trials_above(void)
{
    static const cgl_real errors[] = {CGL_R(1.0), CGL_R(9.0), CGL_R(8.1), CGL_R(7.3), CGL_R(6.6), CGL_R(5.95)};
    cgl_trial_guard guard;
    cgl_trial_guard_reset(&guard);
    for (uint32_t n = 0; n < CGL_ENTRIES(errors); ++n) {
        guard.error = errors[n];
        const cgl_trial_verdict verdict = cgl_trial_guard_judge(&guard, false);
        CHECK(guard.phase == (n < 5U ? CGL_TRIAL_LEARN : CGL_TRIAL_COMPARE) && verdict.store == (n == 0U || n == 5U));
    }
}

/* In the trial that repeats the best v the plant has changed. J_1 is of that trial: so far from F that v needs no comparison. */
static void learn_on_a_changed_plant(void)
{
    static const cgl_real errors[] = {CGL_R(100.0), CGL_R(1.0), CGL_R(90.0), CGL_R(90.0), CGL_R(2.0)};
    static const cgl_trial_phase phases[] = {CGL_TRIAL_LEARN, CGL_TRIAL_LEARN, CGL_TRIAL_LEARN, CGL_TRIAL_REPLAY, CGL_TRIAL_LEARN};
    cgl_trial_guard guard;
    cgl_trial_guard_reset(&guard);
    for (uint32_t n = 0; n < CGL_ENTRIES(errors); ++n) {
        guard.error = errors[n];
        (void)cgl_trial_guard_judge(&guard, n == 0U);
        CHECK(guard.phase == phases[n]);
    }
    CHECK(guard.strikes == 0U && within(guard.best - CGL_R(2.0), CGL_R(0.0)) && within(guard.feedback - CGL_R(100.0), CGL_R(0.0)));
}

/* The guard after trials of these J, the first with v = 0 and the last with u at its limit or not; J = 0 ends the list. */
static cgl_trial_guard judged(const cgl_real *errors, bool limited)
{
    cgl_trial_guard guard;
    cgl_trial_guard_reset(&guard);
    for (uint32_t n = 0; errors[n] > CGL_R(0.0); ++n) {
        guard.error = errors[n];
        guard.limited = limited && !(errors[n + 1U] > CGL_R(0.0));
        (void)cgl_trial_guard_judge(&guard, n == 0U);
    }
    return guard;
}

#define JUDGED(limited, ...) judged((const cgl_real[]){__VA_ARGS__, CGL_R(0.0)}, (limited))

/* What is at a factor of the guard's, and what is just beyond it. F is the first J, J_best the second. */
static void judge_at_the_factors(void)
{
    const cgl_real f = CGL_R(100.0), best = CGL_R(1.0), more = CGL_R(1.0001), less = CGL_R(0.9999);
    const cgl_real worse = CGL_R(1.1025), changed = CGL_R(1.21);
    CHECK(JUDGED(false, f, CGL_R(4.0), CGL_R(9.0)).above == 0U && JUDGED(false, f, CGL_R(4.0), more * CGL_R(9.0)).above == 1U);
    CHECK(JUDGED(true, f, best, worse).above == 0U && JUDGED(true, f, best, more * worse).above == 1U);
    CHECK(JUDGED(false, f, worse * f).above == 0U && JUDGED(false, f, more * worse * f).above == 1U);
    /* J falls, or does not; then it has halved, or has not */
    const cgl_real high = CGL_R(9.0), fallen = CGL_R(11.0);
    CHECK(JUDGED(false, f, best, worse * high, high).phase == CGL_TRIAL_LEARN);
    CHECK(JUDGED(false, f, best, worse * high, more * high).phase == CGL_TRIAL_REPLAY);
    CHECK(JUDGED(false, f, best, CGL_R(40.0), fallen, CGL_R(10.0)).phase == CGL_TRIAL_COMPARE);
    CHECK(JUDGED(false, f, best, CGL_R(40.0), fallen, more * CGL_R(10.0)).phase == CGL_TRIAL_REPLAY);
    /* the best v again: as before, or changed */
    CHECK(JUDGED(false, f, best, high, high, changed).phase == CGL_TRIAL_HOLD);
    CHECK(JUDGED(false, f, changed, high, high, best).phase == CGL_TRIAL_HOLD);
    CHECK(JUDGED(false, f, best, high, high, more * changed).strikes == 0U);
    CHECK(JUDGED(false, f, changed, high, high, less * best).strikes == 0U);
    /* what F and J_1 show: they differ by a factor of 4, and the larger one is 8 (J + J_best) */
    const cgl_real wide = CGL_R(1000.0), early = CGL_R(4.0);
    CHECK(JUDGED(false, wide, best, f, f, CGL_R(124.0)).phase == CGL_TRIAL_LEARN);
    CHECK(JUDGED(false, wide, best, f, f, more * CGL_R(124.0)).phase == CGL_TRIAL_COMPARE);
    CHECK(JUDGED(false, CGL_R(64.0), CGL_R(0.5), early, early, early).phase == CGL_TRIAL_LEARN);
    CHECK(JUDGED(false, CGL_R(16.0), CGL_R(0.5), early, early, early).phase == CGL_TRIAL_COMPARE);
    /* a strike is taken back at a quarter */
    const cgl_real quarter = CGL_R(0.25);
    CHECK(JUDGED(false, f, best, high, high, best, best, best, best, best, quarter).strikes == 0U);
    CHECK(JUDGED(false, f, best, high, high, best, best, best, best, best, more * quarter).strikes == 1U);
    /* F again: the same as before, or of another plant */
    const cgl_real above = CGL_R(6.0), now = worse * CGL_R(2.0); /* F = 2 is measured before */
    CHECK(JUDGED(false, CGL_R(2.0), best, above, above, above, now).strikes == 1U);
    CHECK(JUDGED(false, CGL_R(2.0), best, above, above, above, more * now).strikes == 0U);
}

/* A best v of J = 1, then two trials of J = 1.2. That is too much only where u was at its limit, even in one sample before the last. */
static void judge_at_the_limit(void)
{
    static cgl_real memory[CGL_TRIAL_LENGTH(4U, 0U)];
    const cgl_real of_trial[] = {CGL_R(100.0), CGL_R(1.0), CGL_R(1.2), CGL_R(1.2)}, y_ref[4] = {CGL_R(0.0)};
    const cgl_trial_config config = {.samples = 4U, .states = 1U, .k_1 = {CGL_R(1.0)}, .n = CGL_R(1.0), .c = {CGL_R(1.0)},
                                     .k_3 = CGL_R(0.01), .shift = 1U, .limit = CGL_R(100.0), .learned_limit = CGL_R(1.0)};
    for (int limited = 0; limited < 2; ++limited) {
        cgl_trial law;
        cgl_trial_output out;
        cgl_trial_config bound = config;
        bound.limit = limited > 0 ? CGL_R(0.9) : config.limit; /* below |K_1 x| in sample 1 of each trial */
        CHECK(cgl_trial_init(&law, &bound, memory, CGL_ENTRIES(memory)) == CGL_OK);
        for (uint32_t trial = 0; trial <= CGL_ENTRIES(of_trial); ++trial) {
            cgl_trial_begin(&law, y_ref);
            for (uint32_t p = 0; p < 4U; ++p) {
                const bool big = p == 1U && trial < CGL_ENTRIES(of_trial);
                const cgl_trial_input in = {.x = {big ? cgl_square_root(of_trial[trial]) : CGL_R(0.0)}, .learn = true};
                cgl_trial_step(&law, &in, &out);
                CHECK(((out.status & (unsigned)CGL_STATUS_GUARDED) != 0U) == (limited > 0 && trial == CGL_ENTRIES(of_trial)));
            }
            CHECK(cgl_trial_end(&law) && law.guard.returns == (limited > 0 && trial > 2U ? 1U : 0U));
        }
    }
}

/* Two windows with a run of errors of 8: the next one may learn from errors of up to 16, however many, and from none beyond. */
static void learn_from_a_lasting_error(void)
{
    const cgl_quality_config config = {.span = CGL_R(1.0e6), .longest = CGL_R(64.0), .outlier = CGL_R(3.0)};
    for (int beyond = 0; beyond < 2; ++beyond) {
        const cgl_real lasting = beyond > 0 ? CGL_R(16.001) : CGL_R(16.0);
        cgl_quality quality;
        CHECK(cgl_quality_init(&quality, &config, CGL_R(1.0)) == CGL_OK);
        for (uint32_t n = 0; n < 4U * 64U; ++n) {
            const bool runs = n >= 64U && n % 64U >= 16U && n % 64U < 24U;
            const cgl_real run = n < 3U * 64U ? CGL_R(8.0) : lasting;
            const bool outlier = cgl_quality_step(&quality, runs ? run : (n % 2U ? CGL_R(1.0) : CGL_R(-1.0)), CGL_R(0.0), true);
            /* after the fourth of a run, 4 samples, a sixteenth of a window, pass in which nothing is learned */
            const bool waits = n >= 64U && n % 64U >= 24U && n % 64U < 27U;
            CHECK(outlier == ((runs || waits) && (n < 3U * 64U || beyond > 0)));
        }
    }
}

/* A period in which one measurement is at its bound is trusted; one beyond it is not, and says which. The short way of a step and the
 * long way agree. */
static void measure_at_the_bounds(void)
{
    const cgl_real ts = CGL_R(0.0009765625), travel = CGL_R(0.03125); /* powers of two, so that the bounds are exact */
    cgl_monitor_config config = {.omega_max = CGL_R(16.0), .angle_step = CGL_R(0.015625), .current_max = CGL_R(4.0),
                                 .current_sum = CGL_R(0.5), .phases = 3U};
    const cgl_measurement usual = {.theta_m = CGL_R(1.0), .omega_m = CGL_R(1.0), .u_dc = CGL_R(24.0)};
    static const struct {
        cgl_real i_abc[3], moved, omega_m;
        uint32_t phases;
        unsigned beyond; /* the status when they are by a thousandth more */
    } cases[] = {{{CGL_R(0.0)}, CGL_R(1.0), CGL_R(1.0), 3U, CGL_STATUS_ANGLE_LOST},
                 {{CGL_R(0.0)}, CGL_R(-1.0), CGL_R(1.0), 3U, CGL_STATUS_ANGLE_LOST},
                 {{CGL_R(0.0)}, CGL_R(0.0), CGL_R(16.0), 3U, CGL_STATUS_ANGLE_LOST},
                 {{CGL_R(0.0)}, CGL_R(0.0), CGL_R(-16.0), 3U, CGL_STATUS_ANGLE_LOST},
                 {{CGL_R(4.0), CGL_R(-2.0), CGL_R(-2.0)}, CGL_R(0.0), CGL_R(1.0), 3U, CGL_STATUS_CURRENT},
                 {{CGL_R(1.0), CGL_R(-0.25), CGL_R(-0.25)}, CGL_R(0.0), CGL_R(1.0), 3U, CGL_STATUS_CURRENT},
                 {{CGL_R(-1.0), CGL_R(0.25), CGL_R(0.25)}, CGL_R(0.0), CGL_R(1.0), 3U, CGL_STATUS_CURRENT},
                 {{CGL_R(0.0), CGL_R(4.0), CGL_R(9.0)}, CGL_R(0.0), CGL_R(1.0), 2U, CGL_STATUS_CURRENT}};
    for (uint32_t n = 0; n < 4U * CGL_ENTRIES(cases); ++n) {
        const cgl_real by = n % 2U > 0U ? CGL_R(1.001) : CGL_R(1.0);
        const uint32_t k = n / 4U;
        cgl_measurement now = usual;
        cgl_monitor monitor;
        config.phases = cases[k].phases;
        CHECK(cgl_monitor_init(&monitor, &config, ts) == CGL_OK);
        for (int step = 0; step < 3; ++step) {
            cgl_monitor_step(&monitor, &now, CGL_R(0.0), false);
        }
        CHECK(monitor.trusted && monitor.status == 0U);
        for (int x = 0; x < 3; ++x) {
            now.i_abc[x] = by * cases[k].i_abc[x];
        }
        now.theta_m += by * travel * cases[k].moved;
        now.omega_m = (cgl_abs(cases[k].omega_m) > CGL_R(1.0) ? by : CGL_R(1.0)) * cases[k].omega_m;
        (n % 4U < 2U ? cgl_monitor_step : cgl_monitor_look)(&monitor, &now, CGL_R(0.0), false);
        CHECK(monitor.trusted == (n % 2U == 0U));
        CHECK((monitor.status & ~(unsigned)CGL_STATUS_FAULT) == (n % 2U > 0U ? cases[k].beyond : 0U));
    }
    cgl_monitor monitor; /* no bus */
    cgl_measurement dead = usual;
    dead.u_dc = CGL_R(0.0);
    CHECK(cgl_monitor_init(&monitor, &config, ts) == CGL_OK);
    cgl_monitor_step(&monitor, &usual, CGL_R(0.0), false);
    cgl_monitor_step(&monitor, &usual, CGL_R(0.0), false);
    cgl_monitor_step(&monitor, &dead, CGL_R(0.0), false);
    CHECK(monitor.safe && monitor.status == ((unsigned)CGL_STATUS_BUS | (unsigned)CGL_STATUS_FAULT));
}

/* Each bound of the calibrations alone, and what lies on it. */
static void bound_calibrations(void)
{
    const cgl_real ts = CGL_R(1.0e-3), long_time = CGL_R(1.0e9) * ts;
    const cgl_offsets_config averaging = {.samples = 65535U, .phases = 3U, .largest = CGL_R(1.0), .spread = CGL_R(0.1)};
    cgl_offsets_config wrong[] = {averaging, averaging, averaging, averaging, averaging, averaging};
    cgl_offsets offsets;
    wrong[0].samples = 0U;
    wrong[1].samples = 65536U;
    wrong[2].phases = 1U;
    wrong[3].phases = 4U;
    wrong[4].largest = CGL_R(0.0);
    wrong[5].spread = CGL_R(0.0);
    CHECK(cgl_offsets_init(&offsets, &averaging) == CGL_OK);
    for (uint32_t n = 0; n < sizeof wrong / sizeof wrong[0]; ++n) {
        CHECK(cgl_offsets_init(&offsets, &wrong[n]) == CGL_ERROR_CONFIG);
    }
    const cgl_align_config config = {.pole_pairs = 10000U, .current = CGL_R(1.0), .ramp = long_time, .sweep = CGL_PI, .speed = CGL_R(1.0),
                                     .settle = long_time, .tolerance = CGL_R(0.999)};
    cgl_align_config beyond[12];
    cgl_align align;
    for (uint32_t n = 0; n < sizeof beyond / sizeof beyond[0]; ++n) {
        beyond[n] = config;
    }
    beyond[0].pole_pairs = 0U;
    beyond[1].pole_pairs = 10001U;
    beyond[2].current = CGL_R(0.0);
    beyond[3].ramp = CGL_R(0.0);
    beyond[4].ramp = CGL_R(1.01) * long_time;
    beyond[5].sweep = CGL_R(1.01) * CGL_PI;
    beyond[6].speed = CGL_R(0.0);
    beyond[7].speed = CGL_R(0.99) * CGL_PI / long_time;
    beyond[8].settle = CGL_R(0.0);
    beyond[9].settle = CGL_R(1.01) * long_time;
    beyond[10].tolerance = CGL_R(1.0);
    beyond[11].tolerance = CGL_R(-0.1);
    CHECK(cgl_align_init(&align, &config, ts) == CGL_OK && cgl_align_init(&align, &config, CGL_R(0.0)) == CGL_ERROR_CONFIG);
    for (uint32_t n = 0; n < sizeof beyond / sizeof beyond[0]; ++n) {
        CHECK(cgl_align_init(&align, &beyond[n], ts) == CGL_ERROR_CONFIG);
    }
}

/* A loop without an integral keeps nothing of torque mode: no gain would ever correct it. */
static void leave_torque_mode(void)
{
    static cgl_real cell[2U * CGL_MEMORY_ROW(16U, 0U)];
    const cgl_loop loop = {.ts = CGL_R(1.0e-3), .current_limit = CGL_R(3.0)};
    const cgl_law_input pushed = {.torque = true, .i_q_ref = CGL_R(1.0)}, still = {.learn = true};
    cgl_law_output out;
    for (int with = 0; with < 2; ++with) {
        const cgl_real ki = with > 0 ? CGL_R(1.0) : CGL_R(0.0);
        const cgl_pi_config config = {.kp = CGL_R(0.1), .ki = ki, .limit = CGL_R(3.0)};
        const cgl_space_position_config position = {.k_theta = CGL_R(1.0), .k_omega = CGL_R(0.1), .k_i = ki, .omega_min = CGL_R(1.0),
                                                    .limit = CGL_R(3.0), .memory = {.cells = 16U, .limit = {CGL_R(1.0)}}};
        cgl_pi pi;
        cgl_space_position law;
        CHECK(cgl_pi_init(&pi, &config, &loop) == CGL_OK);
        cgl_speed_pi_step(&pi, &pushed, &out);
        CHECK(within(out.i_q_ref - CGL_R(1.0), CGL_R(0.0)));
        cgl_speed_pi_step(&pi, &still, &out);
        CHECK(within(out.i_q_ref - ki, CGL_R(0.0)));
        CHECK(cgl_space_position_init(&law, &position, &loop, cell, CGL_MEMORY_ROW(16U, 0U)) == CGL_OK);
        cgl_space_position_step(&law, &pushed, &out);
        CHECK(within(out.i_q_ref - CGL_R(1.0), CGL_R(0.0)));
        cgl_space_position_step(&law, &still, &out);
        CHECK(within(out.i_q_ref - ki, CGL_R(0.0)));
    }
}

/* The filter against its difference equation; it begins at rest. */
static void feed_forward(void)
{
    const cgl_feedforward_config config = {.numerator = 2U, .denominator = 3U, .preview = 1U, .num = {CGL_R(1.0), CGL_R(0.5)},
                                           .den = {CGL_R(1.0), CGL_R(-0.5), CGL_R(0.25)}};
    const cgl_real y[4] = {CGL_R(1.0), CGL_R(2.0), CGL_R(-1.0), CGL_R(4.0)}, gain = CGL_R(1.5) / CGL_R(0.75);
    const cgl_real nothing[4] = {CGL_R(0.0)};
    cgl_real before = gain * y[0], before_that = before;
    cgl_feedforward feedforward;
    CHECK(cgl_feedforward_init(&config, &feedforward) == CGL_OK);
    CHECK(within(cgl_feedforward_step(&config, &feedforward, nothing, 4U, 0U), CGL_R(0.0)));
    cgl_feedforward_reset(&config, &feedforward, y[0]);
    for (uint32_t p = 0; p < 12U; ++p) {
        const cgl_real now = y[p < 3U ? p : 3U], next = y[p + 1U < 3U ? p + 1U : 3U];
        const cgl_real f = next + CGL_R(0.5) * now + CGL_R(0.5) * before - CGL_R(0.25) * before_that;
        CHECK(within(cgl_feedforward_step(&config, &feedforward, y, 4U, p) - f, CGL_R(1.0e-5)));
        before_that = before;
        before = f;
    }
}

void known_answers(void)
{
    keep_the_numbers();
    turn_an_encoder();
    divide_a_turn();
    turn_phasors();
    average_offsets();
    see_through_a_sensor();
    reject_a_load();
    learn_orders();
    turn_by_halls();
    hand_over_a_speed();
    hold_the_best_trial();
    compare_after_five_trials_above();
    measure_at_the_bounds();
    learn_on_a_changed_plant();
    judge_at_the_factors();
    judge_at_the_limit();
    learn_from_a_lasting_error();
    bound_calibrations();
    leave_torque_mode();
    feed_forward();
}
