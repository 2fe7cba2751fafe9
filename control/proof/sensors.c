/* Sensors: the angle within a turn; of the speeds, that nothing undefined happens. */
#include "cogless/angle_observer.h"
#include "cogless/encoder.h"
#include "cogless/hall.h"
#include "cogless/low_pass.h"
#include "cogless/speed_timed.h"
#include "proof.h"

int main(void)
{
    const cgl_angle_observer_config bandwidth = {any_real()};
    const cgl_speed_timed_config timing = {any_bits(), any_real(), any_bool()};
    const cgl_encoder_config config = {any_bits(), any_bits(), any_bits(), any_bool(), any_bool()};
    const cgl_hall_config sectors = {any_bits(), any_bits(), any_real()};
    const cgl_low_pass_config corner = {any_real()};
    /* stepped by the analysis where init refuses, too: it does not keep apart what init returns */
    static cgl_angle_observer observer;
    static cgl_speed_timed timed;
    static cgl_encoder encoder;
    static cgl_hall hall;
    static cgl_low_pass filter;
    cgl_edges edges = {0U, 0U, 0U, false, false};
    if (cgl_encoder_init(&encoder, &config, any_bits()) == CGL_OK) {
        while (any_bool()) {
            cgl_encoder_step(&encoder, any_bits());
            cgl_encoder_index(&encoder, any_bits());
            cgl_encoder_place(&encoder, any_bits());
            const cgl_real theta = cgl_radians(encoder.turns);
            PROVE(theta >= CGL_R(0.0) && theta < CGL_TWO_PI);
        }
    }
    if (cgl_angle_observer_init(&observer, &bandwidth, any_real()) == CGL_OK) {
        while (any_bool()) {
            cgl_angle_observer_step(&observer, any_bits());
        }
    }
    if (cgl_speed_timed_init(&timed, &timing) == CGL_OK) {
        while (any_bool()) {
            cgl_edges_pass(&edges, any_bits(), any_bits());
            (void)cgl_speed_timed_step(&timed, &edges, any_bits());
        }
    }
    if (cgl_hall_init(&hall, &sectors) == CGL_OK) {
        while (any_bool()) {
            cgl_hall_step(&hall, any_bits(), any_bits(), any_bits());
            const cgl_real theta = cgl_radians(hall.turns);
            PROVE(theta >= CGL_R(0.0) && theta < CGL_TWO_PI);
        }
    }
    if (cgl_low_pass_init(&filter, &corner, any_real()) == CGL_OK) {
        while (any_bool()) {
            (void)cgl_low_pass_step(&filter, any_real());
        }
    }
    return 0;
}
