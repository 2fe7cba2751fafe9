// The laws of a user, from a shared library or in Python, as values that the engine can run.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "law.hpp"
#include "plugin.h"

namespace cogless {

// A map without entries, which a user's law gets to fill in.
inline cogless_plugin_map empty_map() {
    cogless_plugin_map map{};
    map.law = 128U;  // the first of the application's own
    map.parts = 1U;
    return map;
}

// Converts a user's learned map to what firmware stores; none if the map has no entries. limit: of the map's currents, A. Throws
// std::runtime_error for a map that can't be stored.
inline std::optional<Stored> own_stored(const cogless_plugin_map& map, double limit) {
    const auto refuse = [](const std::string& why) { throw std::runtime_error("the learned map: " + why); };
    if (map.entries == 0U) return {};
    const bool orders = map.current == nullptr;
    if (orders && (map.cosine == nullptr || map.sine == nullptr || map.order == nullptr)) {
        refuse("expected current, or cosine, sine and order");
    }
    if (map.law < 128U || map.law > 255U) refuse("law " + std::to_string(map.law) + ": expected 128 to 255");
    if (map.entries > CGL_MAP_CELLS_MAX) refuse(std::to_string(map.entries) + " entries: expected at most 16777216");
    if (map.parts < 1U || (orders && map.parts != 1U)) {
        refuse("parts " + std::to_string(map.parts) + ": expected " + (orders ? "1 with orders" : "1 or more"));
    }
    Stored stored{};
    cgl_map& about = stored.about;
    about.cells = static_cast<std::uint32_t>(map.entries);
    about.channels = orders ? 3U : 1U;
    about.turns = about.ratio = 1U;
    about.parts = map.parts;
    about.law = map.law;
    const double* const channels[] = {orders ? map.cosine : map.current, map.sine, map.order};
    const std::uint32_t units[] = {orders ? CGL_MAP_UNIT_COSINE_CURRENT : CGL_MAP_UNIT_CURRENT, CGL_MAP_UNIT_SINE_CURRENT,
                                   CGL_MAP_UNIT_ORDER};
    for (std::uint32_t c = 0; c < about.channels; ++c) {
        about.unit[c] = units[c];
        about.limit[c] = static_cast<cgl_real>(c == 2U ? CGL_HARMONIC_ORDER_MAX : limit);
        stored.entries.insert(stored.entries.end(), channels[c], channels[c] + map.entries);
    }
    for (std::size_t n = 0; n < stored.entries.size(); ++n) {
        if (!std::isfinite(stored.entries[n])) {
            refuse("entry " + std::to_string(n % map.entries) + " is not a finite number");
        }
    }
    if (orders) {
        std::vector<double> sorted(map.order, map.order + map.entries);
        std::sort(sorted.begin(), sorted.end());
        const bool whole = std::all_of(sorted.begin(), sorted.end(), [](double h) { return h == std::floor(h); });
        if (!whole || sorted.front() < 1.0 || sorted.back() > CGL_HARMONIC_ORDER_MAX ||
            std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
            refuse("expected whole orders from 1 to 65535, each once");
        }
    }
    return stored;
}

// Lives while a user's library is called. If the library calls exit(), the process ends, so refuse_exit() says why.
class InLibrary {
public:
    explicit InLibrary(const std::string& path) { path_ = path.c_str(); }
    ~InLibrary() { path_ = nullptr; }
    InLibrary(const InLibrary&) = delete;
    InLibrary& operator=(const InLibrary&) = delete;

    // Called by exit(), in the thread that called it.
    static void refuse_exit() {
        if (path_ == nullptr) return;
        std::fprintf(stderr, "%s: called exit: expected a law that lets the command go on\n", path_);
        std::_Exit(2);
    }

private:
    static inline thread_local const char* path_ = nullptr;
};

// A law from a user's shared library (plugin.h).
struct PluginLaw {
    using State = std::vector<unsigned char>;  // from operator new: aligned for any type

    std::shared_ptr<void> library;  // keeps it loaded
    std::string path;
    decltype(&cogless_plugin_state_size) state_size;
    decltype(&cogless_plugin_init) init;
    decltype(&cogless_plugin_step) step_function;
    // This and the next functions are null if the library has none.
    decltype(&cogless_plugin_begin_trial) begin_function;
    decltype(&cogless_plugin_end_trial) end_function;
    decltype(&cogless_plugin_design) design_function;
    decltype(&cogless_plugin_i_q_learned) learned_function;
    decltype(&cogless_plugin_current_step) current_function;
    decltype(&cogless_plugin_learned_map) map_function;
    decltype(&cogless_plugin_load_map) load_function;
    std::vector<double> params;
    cogless_plugin_drive drive;
    double ts, current_limit;

    State start() const {
        const InLibrary inside(path);
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
    double learned(const State& s) const {
        const InLibrary inside(path);
        return learned_function(s.data());
    }
    std::optional<Stored> stored(const State& s) const { return own_stored(learned_map(s), current_limit); }
    void load(State& s, const std::vector<std::vector<double>>& values) const {
        if (load_function == nullptr) throw std::runtime_error("the library does not export cogless_plugin_load_map");
        cogless_plugin_map map = empty_map();
        map.parts = learned_map(s).parts;
        map.entries = values.at(0).size();
        if (values.size() == 1) {
            map.current = values[0].data();
        } else {
            map.cosine = values[0].data();
            map.sine = values.at(1).data();
            map.order = values.at(2).data();
        }
        const InLibrary inside(path);
        if (load_function(s.data(), &map) != 0) throw std::runtime_error("the library's cogless_plugin_load_map refuses this map");
    }
    void begin(State& s, const std::vector<cgl_real>& reference) const {
        const std::vector<double> theta_ref(reference.begin(), reference.end());
        const InLibrary inside(path);
        if (begin_function != nullptr) begin_function(s.data(), theta_ref.data(), theta_ref.size());
    }
    void end(State& s) const {
        const InLibrary inside(path);
        if (end_function != nullptr) end_function(s.data());
    }

private:
    cogless_plugin_map learned_map(const State& s) const {
        cogless_plugin_map map = empty_map();
        const InLibrary inside(path);
        if (map_function != nullptr) map_function(s.data(), &map);
        return map;
    }
    Command call(decltype(&cogless_plugin_step) function, State& s, const LawInput& in, const Command& last) const {
        const cogless_plugin_input input{in.time,  in.omega_ref, in.omega_m,       in.theta_m,   in.i_d,       in.i_q,
                                         in.i_limit, in.ts,      in.learn ? 1 : 0, in.theta_ref, in.alpha_ref, in.off ? 1 : 0};
        cogless_plugin_output output{last.i_d_ref, last.i_q_ref};
        const InLibrary inside(path);
        function(s.data(), &input, &output);
        return {output.i_d_ref, output.i_q_ref, last.status};
    }
};

// A law written in Python. Its object holds the law's state, so a copy of the drive's state shares it.
struct CallbackLaw {
    struct State {};
    std::function<Command(const LawInput&)> function;
    // This and the next functions are empty if the law has none.
    std::function<void(const std::vector<cgl_real>&)> begin_function = {};  // begins a trial
    std::function<void()> end_function = {};
    std::function<double()> learned_function = {};
    std::function<Command(const LawInput&, const Command& last)> current_function = {};
    std::function<std::optional<Stored>(double current_limit)> map_function = {};
    std::function<void(const std::vector<std::vector<double>>&)> load_function = {};
    double current_limit = 0.0;  // A

    State start() const { return {}; }
    Command step(State&, const LawInput& in) const { return function(in); }
    bool has_current_step() const { return static_cast<bool>(current_function); }
    Command current_step(State&, const LawInput& in, const Command& last) const { return current_function(in, last); }
    bool has_learned() const { return static_cast<bool>(learned_function); }
    double learned(const State&) const { return learned_function(); }
    std::optional<Stored> stored(const State&) const { return map_function ? map_function(current_limit) : std::nullopt; }
    void load(State&, const std::vector<std::vector<double>>& values) const {
        if (!load_function) throw std::runtime_error("the class has no method load_map(learned)");
        load_function(values);
    }
    void begin(State&, const std::vector<cgl_real>& reference) const {
        if (begin_function) begin_function(reference);
    }
    void end(State&) const {
        if (end_function) end_function();
    }
};

}  // namespace cogless
