// The speed laws of the control library, and the user's own, as values that the engine can run.
//
// A law is a constant configuration with start() and step(); its state is a separate value that can be copied. Where it can
// tell more, it has terms and read_terms(), its parts in A; learned(), its map; stored(), that map as it is stored.
// The learned cells live in the state, and the C state's pointer to them is set anew before each use, since a copy has its
// own.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "cogless/anti_cogging.h"
#include "cogless/pi_ilc.h"
#include "cogless/plugin.h"
#include "cogless/robust_ilc.h"
#include "cogless/speed_pi.h"
#include "law.hpp"

namespace cogless {

// The map of a memory by angle over one period; nothing by time.
inline Learned learned_map(const cgl_memory_config& config, const std::vector<cgl_real>& cell, double unit) {
    Learned map;
    if (config.kind != CGL_MEMORY_ANGLE) return map;
    if (config.periods_per_rev > 1) map.over = Over::electrical;
    for (std::uint32_t n = 0; n < config.cells; ++n) map.values.push_back(unit * static_cast<double>(cell[n]));
    return map;
}

struct PiLaw {
    struct State {
        cgl_pi law;
    };
    cgl_pi_config config;

    State start() const {
        State s;
        require(cgl_pi_init(&config, &s.law), "pi");
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        cgl_speed_pi_step(&config, &s.law, &in.c, &output);
        return from_c(output);
    }
    LawConfig describe() const { return {"pi", &config, sizeof config}; }
    static constexpr std::array<Term, 2> terms{{{"term_proportional"}, {"term_integral"}}};
    static void read_terms(const State& s, double* out) {
        out[0] = static_cast<double>(s.law.proportional);
        out[1] = static_cast<double>(s.law.integral);
    }
};

struct PiIlcLaw {
    struct State {
        cgl_pi_ilc law;
        std::vector<cgl_real> cell;
    };
    cgl_pi_ilc_config config;

    State start() const {
        State s;
        s.cell.resize(CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width));
        require(cgl_pi_ilc_init(&config, &s.law, s.cell.data(), static_cast<std::uint32_t>(s.cell.size())), "pi-ilc");
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        s.law.memory.cell = s.cell.data();
        cgl_pi_ilc_step(&config, &s.law, &in.c, &output);
        return from_c(output);
    }
    LawConfig describe() const {
        return {"pi-ilc", &config, sizeof config, CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width)};
    }
    static std::vector<cgl_real>& cells(State& s) { return s.cell; }
    static constexpr std::array<Term, 3> terms{{{"term_proportional"}, {"term_integral"}, {"term_ilc"}}};
    static void read_terms(const State& s, double* out) {
        out[0] = static_cast<double>(s.law.pi.proportional);
        out[1] = static_cast<double>(s.law.pi.integral);
        out[2] = static_cast<double>(s.law.learned);
    }
    Learned learned(const State& s) const { return learned_map(config.memory, s.cell, 1.0); }
    std::optional<Stored> stored(State s) const {
        s.law.memory.cell = s.cell.data();
        return stored_map<cgl_map_of_pi_ilc>(config, s.law);
    }
};

struct RobustIlcLaw {
    struct State {
        cgl_robust_ilc law;
        std::vector<cgl_real> cell;
    };
    cgl_robust_ilc_config config;

    State start() const {
        State s;
        s.cell.resize(CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width));
        require(cgl_robust_ilc_init(&config, &s.law, s.cell.data(), static_cast<std::uint32_t>(s.cell.size())),
                "robust-ilc");
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        s.law.memory.cell = s.cell.data();
        cgl_robust_ilc_step(&config, &s.law, &in.c, &output);
        return from_c(output);
    }
    LawConfig describe() const {
        return {"robust-ilc", &config, sizeof config, CGL_MEMORY_LENGTH(config.memory.cells, config.memory.q_half_width)};
    }
    static std::vector<cgl_real>& cells(State& s) { return s.cell; }
    static constexpr std::array<Term, 5> terms{{{"term_surface"}, {"term_switching"}, {"term_linear"}, {"term_f_hat"}, {"term_r_hat"}}};
    static void read_terms(const State& s, double* out) {
        const cgl_robust_ilc_terms& t = s.law.terms;
        out[0] = static_cast<double>(t.surface);
        out[1] = static_cast<double>(t.switching);
        out[2] = static_cast<double>(t.linear);
        out[3] = static_cast<double>(t.learned);
        out[4] = static_cast<double>(t.adapted);
    }
    Learned learned(const State& s) const {
        return learned_map(config.memory, s.cell, -1.0 / static_cast<double>(config.b));
    }
    std::optional<Stored> stored(State s) const {
        s.law.memory.cell = s.cell.data();
        return stored_map<cgl_map_of_robust_ilc>(config, s.law);
    }
};

struct AntiCoggingLaw {
    struct State {
        cgl_anti_cogging law;
        std::vector<cgl_real> cell;
    };
    cgl_anti_cogging_config config;
    bool calibrate;  // start with the calibration run

    State start() const {
        State s;
        s.cell.resize(config.cells);
        require(cgl_anti_cogging_init(&config, &s.law, s.cell.data(), config.cells), "anti-cogging");
        if (calibrate) cgl_anti_cogging_calibrate(&config, &s.law);
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        s.law.table = s.cell.data();
        cgl_anti_cogging_step(&config, &s.law, &in.c, &output);
        return from_c(output);
    }
    LawConfig describe() const { return {"anti-cogging", &config, sizeof config, config.cells}; }
    static std::vector<cgl_real>& cells(State& s) { return s.cell; }
    static constexpr std::array<Term, 3> terms{{{"term_proportional"}, {"term_integral"}, {"term_table"}}};
    static void read_terms(const State& s, double* out) {
        out[0] = static_cast<double>(s.law.pi.proportional);
        out[1] = static_cast<double>(s.law.pi.integral);
        out[2] = static_cast<double>(s.law.looked_up);
    }
    Learned learned(const State& s) const {
        return {std::vector<double>(s.cell.begin(), s.cell.end()), Over::mechanical};
    }
    std::optional<Stored> stored(State s) const {
        s.law.table = s.cell.data();
        return stored_map<cgl_map_of_anti_cogging>(config, s.law);
    }
};

// A law from a user's shared library (cogless/plugin.h).
struct PluginLaw {
    using State = std::vector<unsigned char>;  // from operator new: aligned for any type

    std::shared_ptr<void> library;  // keeps it loaded
    decltype(&cogless_plugin_state_size) state_size;
    decltype(&cogless_plugin_init) init;
    decltype(&cogless_plugin_step) step_function;
    std::vector<double> params;
    double ts;

    State start() const {
        const std::size_t size = state_size();
        if (size > 1048576U) throw std::invalid_argument("the library asks for more than 1 MiB of state");
        State s(size + 1, 0);  // never empty
        if (init(s.data(), params.data(), params.size(), ts) != 0) {
            throw std::invalid_argument("the library's cogless_plugin_init refuses these params");
        }
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        const cogless_plugin_input input{in.time,    in.omega_ref, in.omega_m,           in.theta_m,   in.i_d,      in.i_q,
                                         in.i_limit, in.ts,        in.learn ? 1 : 0, in.theta_ref, in.alpha_ref};
        cogless_plugin_output output{0.0, 0.0};
        step_function(s.data(), &input, &output);
        return {output.i_d_ref, output.i_q_ref, 0};
    }
    LawConfig describe() const { return {"library"}; }
};

// A law written in Python; its object holds the state, and a copy of the drive's state shares it.
struct CallbackLaw {
    struct State {};
    std::function<Command(const LawInput&)> function;

    State start() const { return {}; }
    Command step(State&, const LawInput& in) const { return function(in); }
    LawConfig describe() const { return {"python"}; }
};

}  // namespace cogless
