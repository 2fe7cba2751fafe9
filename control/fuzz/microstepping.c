/* Microstepping: any config, and references that may be anything. Currents are within their amplitude, the command is a multiple
 * of the microstep and stays at a fault, and with a correction that init accepts it never turns back. */
#include "cogless/microstepping.h"
#include "cogless/angle.h"
#include "feed.h"

#define SWEEP_STEPS 128U /* of a turn: few, so that the command moves by less than half a turn in each, whatever the correction */

static void random_waves(cgl_microstepping_wave wave[CGL_MICROSTEPPING_WAVES])
{
    for (uint32_t k = random_below(CGL_MICROSTEPPING_WAVES + 1U); k > 0U; --k) {
        const uint32_t order = random_below(8U) ? 1U + random_below(12U) : random_bits();
        wave[k - 1U].order = order;
        wave[k - 1U].magnitude = random_below(8U) ? cgl_abs(random_real(CGL_R(0.5) / ((cgl_real)order + CGL_R(1.0))))
                                                      : random_real(CGL_R(1.0));
        wave[k - 1U].phase = random_real(CGL_R(7.0));
    }
}

static cgl_microstepping_config random_config(void)
{
    cgl_microstepping_config config;
    memset(&config, 0, sizeof config);
    config.teeth = random_below(8U) ? 1U + random_below(65535U) : random_bits();
    config.current = random_below(8U) ? random_gain(CGL_R(3.0)) : random_real(CGL_R(3.0));
    config.microsteps = random_below(8U) ? 1U << random_below(12U) : random_below(65536U);
    random_waves(config.forward);
    random_waves(config.backward);
    return config;
}

/* The command follows an angle that rises over an electrical turn. Rounding to a microstep leaves the order of two angles, but where
 * the corrected angle hardly rises, rounding of its sum may put it back over the middle between two microsteps: by one. */
static void check_rise(cgl_microstepping_config config, cgl_real omega_ref)
{
    cgl_microstepping motor;
    cgl_microstepping_output out;
    int64_t turned = 0, most = 0;
    config.teeth = 1U;
    config.microsteps = CGL_MICROSTEPS_MAX;
    CHECK(cgl_microstepping_init(&motor, &config) == CGL_OK);
    cgl_microstepping_step(&motor, CGL_R(0.0), omega_ref, &out);
    for (uint32_t n = 1U; n <= SWEEP_STEPS; ++n) {
        const uint32_t before = motor.command;
        cgl_microstepping_step(&motor, (cgl_real)n * (CGL_TWO_PI / (cgl_real)SWEEP_STEPS), omega_ref, &out);
        turned += (int32_t)(motor.command - before);
        CHECK(turned >= most - (int64_t)motor.microstep);
        most = turned > most ? turned : most;
    }
    CHECK(turned > INT64_C(0xFFFFFFFF) - 2 * (int64_t)motor.microstep); /* a whole turn, where it began */
}

static bool tune(cgl_microstepping *motor, cgl_error (*with)(cgl_microstepping *, const cgl_microstepping_config *))
{
    const cgl_microstepping_config config = random_config();
    const bool good = cgl_microstepping_bad_field(&config) == 0;
    CHECK(with(motor, &config) == (good ? CGL_OK : CGL_ERROR_CONFIG));
    if (good) {
        check_rise(config, CGL_R(1.0));
        check_rise(config, -CGL_R(1.0));
    }
    return good;
}

static void step(cgl_microstepping *motor, bool ready, cgl_real theta_ref, cgl_real omega_ref)
{
    const cgl_microstepping before = *motor;
    const bool plausible = cgl_is_angle(theta_ref) && cgl_is_finite(omega_ref);
    cgl_microstepping_output out;
    cgl_microstepping_step(motor, theta_ref, omega_ref, &out);
    if (!ready) {
        CHECK(within(out.i_a, CGL_R(0.0)) && within(out.i_b, CGL_R(0.0)));
        CHECK(out.status == ((unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_OFF));
        return;
    }
    CHECK(within(out.i_a, motor->config.current) && within(out.i_b, motor->config.current));
    CHECK(out.status == (plausible ? 0U : (unsigned)CGL_STATUS_FAULT));
    CHECK(motor->backward == (plausible && omega_ref != CGL_R(0.0) ? omega_ref < CGL_R(0.0) : before.backward));
    CHECK(plausible ? motor->command % motor->microstep == 0U : motor->command == before.command);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    feed(data, size);
    cgl_microstepping motor;
    memset(&motor, 0, sizeof motor);
    step(&motor, false, CGL_R(1.0), CGL_R(1.0));
    memset(&motor, 0xFF, sizeof motor);
    step(&motor, false, CGL_R(1.0), CGL_R(1.0));
    bool ready = tune(&motor, cgl_microstepping_init);
    while (fed()) {
        const uint32_t call = random_below(256U);
        if (call < 8U) {
            cgl_microstepping_reset(&motor);
            CHECK(motor.command == 0U && !motor.backward);
        } else if (call < 16U) {
            const cgl_microstepping before = motor;
            if (tune(&motor, cgl_microstepping_retune)) {
                ready = true;
            } else {
                CHECK(memcmp(&before, &motor, sizeof motor) == 0);
            }
        } else {
            const cgl_real theta_ref = random_real(CGL_R(7.0));
            step(&motor, ready, theta_ref, random_real(CGL_R(10.0)));
        }
    }
    return 0;
}
