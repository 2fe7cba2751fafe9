// The laws of a user, from a shared library or in Python, as values that the engine can run.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

#include "law.hpp"
#include "plugin.h"

namespace cogless {

// A law from a user's shared library (plugin.h).
struct PluginLaw {
    using State = std::vector<unsigned char>;  // from operator new: aligned for any type

    std::shared_ptr<void> library;  // keeps it loaded
    decltype(&cogless_plugin_state_size) state_size;
    decltype(&cogless_plugin_init) init;
    decltype(&cogless_plugin_step) step_function;
    // null if the library has none, as are the next ones
    decltype(&cogless_plugin_begin_trial) begin_function;
    decltype(&cogless_plugin_end_trial) end_function;
    decltype(&cogless_plugin_design) design_function;
    decltype(&cogless_plugin_i_q_learned) learned_function;
    decltype(&cogless_plugin_current_step) current_function;
    std::vector<double> params;
    cogless_plugin_drive drive;
    double ts;

    State start() const {
        const std::size_t size = state_size();
        if (size > 1048576U) throw std::invalid_argument("the library asks for more than 1 MiB of state");
        State s(size + 1, 0);  // never empty
        if (init(s.data(), params.data(), params.size(), ts) != 0) {
            throw std::invalid_argument("the library's cogless_plugin_init refuses these params");
        }
        if (design_function != nullptr && design_function(s.data(), &drive) != 0) {
            throw std::invalid_argument("the library's cogless_plugin_design refuses this drive");
        }
        return s;
    }
    Command step(State& s, const LawInput& in) const { return call(step_function, s, in, {}); }
    bool has_current_step() const { return current_function != nullptr; }
    Command current_step(State& s, const LawInput& in, const Command& last) const { return call(current_function, s, in, last); }
    bool has_learned() const { return learned_function != nullptr; }
    double learned(const State& s) const { return learned_function(s.data()); }
    void begin(State& s, const std::vector<cgl_real>& reference) const {
        const std::vector<double> theta_ref(reference.begin(), reference.end());
        if (begin_function != nullptr) begin_function(s.data(), theta_ref.data(), theta_ref.size());
    }
    void end(State& s) const {
        if (end_function != nullptr) end_function(s.data());
    }

private:
    static Command call(decltype(&cogless_plugin_step) function, State& s, const LawInput& in, const Command& last) {
        const cogless_plugin_input input{in.time,  in.omega_ref, in.omega_m,       in.theta_m,   in.i_d,       in.i_q,
                                         in.i_limit, in.ts,      in.learn ? 1 : 0, in.theta_ref, in.alpha_ref, in.off ? 1 : 0};
        cogless_plugin_output output{last.i_d_ref, last.i_q_ref};
        function(s.data(), &input, &output);
        return {output.i_d_ref, output.i_q_ref, last.status};
    }
};

// A law written in Python. Its object holds the law's state, so a copy of the drive's state shares it.
struct CallbackLaw {
    struct State {};
    std::function<Command(const LawInput&)> function;
    // empty if there is none, as are the next ones
    std::function<void(const std::vector<cgl_real>&)> begin_function = {};  // of a trial
    std::function<void()> end_function = {};
    std::function<double()> learned_function = {};
    std::function<Command(const LawInput&, const Command& last)> current_function = {};

    State start() const { return {}; }
    Command step(State&, const LawInput& in) const { return function(in); }
    bool has_current_step() const { return static_cast<bool>(current_function); }
    Command current_step(State&, const LawInput& in, const Command& last) const { return current_function(in, last); }
    bool has_learned() const { return static_cast<bool>(learned_function); }
    double learned(const State&) const { return learned_function(); }
    void begin(State&, const std::vector<cgl_real>& reference) const {
        if (begin_function) begin_function(reference);
    }
    void end(State&) const {
        if (end_function) end_function();
    }
};

}  // namespace cogless
