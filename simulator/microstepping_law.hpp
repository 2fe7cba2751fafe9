// Microstepping as a law of a drive: the currents of the coils that the control library commands, in the rotor's frame.
//
// The drive's current loop stands for that of a step motor's driver. The position sensor serves only to turn the coils' currents into
// the rotor's frame: the commanded currents do not depend on it.
#pragma once

#include "cogless/angle.h"
#include "cogless/microstepping.h"
#include "cogless/transform.h"
#include "law.hpp"
#include "section.hpp"

namespace cogless {

struct MicrosteppingLaw {
    struct State {
        cgl_microstepping law;
        cgl_microstepping_output output;  // of the last step
    };
    static constexpr const char* name = "microstepping";

    cgl_microstepping_config config;

    static MicrosteppingLaw of(const Section& s) { return {s.packed<cgl_microstepping_config>("config")}; }

    // Throws std::invalid_argument for a configuration that the control library refuses.
    State start() const {
        State s{};
        require(cgl_microstepping_init(&s.law, &config), name, cgl_microstepping_bad_field(&config));
        return s;
    }
    Command step(State& s, const cgl_law_input& in) const {
        const cgl_microstepping_output& out = s.output;
        cgl_microstepping_step(&s.law, in.theta_ref, in.omega_ref, &s.output);
        if (in.off || !cgl_is_angle(in.theta_m)) return {0.0, 0.0, out.status};
        const cgl_phasor rotor = cgl_phasor_of(config.teeth * cgl_turns(in.theta_m));
        cgl_real i_d, i_q;
        cgl_park(out.i_a, out.i_b, rotor.sine, rotor.cosine, &i_d, &i_q);
        return {static_cast<double>(i_d), static_cast<double>(i_q), out.status};
    }
};

}  // namespace cogless
