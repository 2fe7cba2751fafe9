// The space-learning laws of the control library (Verrelli 2016) as values that the engine can run; see speed_laws.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <type_traits>
#include <vector>

#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "law.hpp"

namespace cogless {

// A space-learning law: its C config, state, init and step, with the maps of the memory in the engine's state.
template <class Config, class CState, auto init, auto step_function, auto map_of>
struct SpaceLaw {
    struct State {
        CState law;
        std::vector<cgl_real> cell;
    };
    Config config;
    int pole_pairs;
    std::vector<Term> terms = terms_of(config);

    State start() const {
        State s{};
        const cgl_space_memory_config& m = config.memory;
        s.cell.resize(CGL_SPACE_MEMORY_LENGTH(m.kind, m.channels, m.cells, m.q_half_width));
        require(init(&config, &s.law, s.cell.data(), static_cast<std::uint32_t>(s.cell.size())), "space law");
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        s.law.memory.cell = s.cell.data();
        step_function(&config, &s.law, &in.c, &output);
        return {0.0, static_cast<double>(output.i_q_ref), output.status};
    }

    LawConfig describe() const {
        const cgl_space_memory_config& m = config.memory;
        const bool position = std::is_same_v<Config, cgl_space_position_config>;
        return {position ? "space-position" : "space-speed", &config, sizeof config,
                CGL_SPACE_MEMORY_LENGTH(m.kind, m.channels, m.cells, m.q_half_width)};
    }
    static std::vector<cgl_real>& cells(State& s) { return s.cell; }

    // Revolutions of the rotor that are a whole number of the memory's periods.
    int turns() const {
        const std::uint64_t periods = std::uint64_t{config.ratio} * config.memory.parts;
        return static_cast<int>(config.memory.turns / std::gcd(std::uint64_t{config.memory.turns}, periods));
    }

    void read_terms(const State& s, double* out) const {
        const auto& t = s.law.terms;
        const auto put = [&out](cgl_real value) { *out++ = static_cast<double>(value); };
        put(t.proportional);
        if constexpr (requires { t.integral; }) put(t.integral);
        const cgl_real learned[] = {t.alpha, t.beta, t.h};
        for (std::uint32_t c = 0; c < config.memory.channels; ++c) put(learned[c]);
        if (config.memory.kind == CGL_SPACE_DELAY) put(s.law.memory.p_t);
    }

    // Over the map's period, in the rotor's angle if that makes it one revolution, else in the electrical one where ratio is
    // that of electrical quantities.
    Learned learned(const State& s) const {
        const cgl_space_memory_config& m = config.memory;
        Learned map;
        if (m.kind != CGL_SPACE_MAP) return map;
        const double turns = static_cast<double>(m.turns) / m.parts, ratio = config.ratio;
        const bool electrical = config.ratio != 1U && static_cast<int>(config.ratio) == pole_pairs && turns != ratio;
        map.over = electrical ? Over::electrical : Over::mechanical;
        map.period = 2.0 * std::numbers::pi * (electrical ? turns : turns / ratio);
        std::vector<double>* const into[] = {&map.values, &map.beta, &map.h};
        for (std::uint32_t c = 0; c < m.channels; ++c) {
            const auto first = s.cell.begin() + static_cast<std::ptrdiff_t>(c * CGL_MEMORY_LENGTH(m.cells, m.q_half_width));
            into[c]->assign(first, first + m.cells);
        }
        return map;
    }

    std::optional<Stored> stored(State s) const {
        s.law.memory.cell = s.cell.data();
        return stored_map<map_of>(config, s.law);
    }

private:
    static std::vector<Term> terms_of(const Config& config) {
        std::vector<Term> all{{"term_proportional"}};
        if constexpr (requires { config.k_i; }) all.push_back({"term_integral"});
        constexpr Term learned[] = {{"term_alpha"}, {"term_beta"}, {"term_h"}};
        all.insert(all.end(), learned, learned + config.memory.channels);
        if (config.memory.kind == CGL_SPACE_DELAY) all.push_back({"P_t", "s"});
        return all;
    }
};

using SpacePositionLaw =
    SpaceLaw<cgl_space_position_config, cgl_space_position, cgl_space_position_init, cgl_space_position_step,
             cgl_map_of_space_position>;
using SpaceSpeedLaw = SpaceLaw<cgl_space_speed_config, cgl_space_speed, cgl_space_speed_init, cgl_space_speed_step,
                               cgl_map_of_space_speed>;

}  // namespace cogless
