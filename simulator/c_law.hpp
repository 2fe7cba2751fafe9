// The laws of the control library as values that the engine can run, each from its row in laws.def.
//
// A law is a constant configuration with start() and step(); its state is a separate value that can be copied. The caller's
// memory lives in that state, and the C state's pointer to it is set anew before each use, since a copy has its own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <type_traits>
#include <vector>

#include "cogless/anti_cogging.h"
#include "cogless/pi_ilc.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/speed_pi.h"
#include "cogless/trial.h"
#include "law.hpp"

namespace cogless {

#define CGL_NAMES(law, stem, step_function)         \
    using Config = cgl_##stem##_config;             \
    using State = cgl_##stem;                       \
    static constexpr const char* name = law;        \
    static constexpr auto init = cgl_##stem##_init; \
    static constexpr auto step = step_function;
#define CGL_LAW_WITHOUT_MEMORY(law, stem, header, step_function) \
    struct stem##_row {                                          \
        CGL_NAMES(law, stem, step_function)                      \
    };
#define CGL_LAW(law, stem, header, step_function, cells, entries)                                \
    struct stem##_row {                                                                          \
        CGL_NAMES(law, stem, step_function)                                                      \
        static constexpr auto map_of = cgl_map_of_##stem;                                        \
        static std::uint32_t length(const Config& c) { return entries; }                         \
        static void set_memory(State& s, std::vector<cgl_real>& cell) { s.cells = cell.data(); } \
    };
#define CGL_TERM(stem, signal, unit, member, share, when)
#include "cogless/laws.def"
#undef CGL_NAMES
#undef CGL_LAW_WITHOUT_MEMORY
#undef CGL_LAW
#undef CGL_TERM

// Calls take(signal, unit, value_of) for each part of what a law asks for that it has with this configuration.
template <class Row, class Config, class Take>
void each_term(const Config& c, Take take) {
#define CGL_LAW_WITHOUT_MEMORY(law, stem, header, step_function)
#define CGL_LAW(law, stem, header, step_function, cells, entries)
#define CGL_TERM(stem, signal, unit, member, share, when)                                                       \
    if constexpr (std::is_same_v<Row, stem##_row>) {                                                     \
        if (when) take(signal, unit, [](const auto& s) { return static_cast<double>(s.member); });        \
    }
#include "cogless/laws.def"
#undef CGL_LAW_WITHOUT_MEMORY
#undef CGL_LAW
#undef CGL_TERM
}

template <class Row>
std::vector<Term> terms_of(const typename Row::Config& config) {
    std::vector<Term> all;
    each_term<Row>(config, [&all](const char* signal, const char* unit, auto) { all.push_back({signal, unit}); });
    return all;
}

// Writes the terms of a state, and returns what is behind them.
template <class Row>
double* put_terms(const typename Row::Config& config, const typename Row::State& state, double* out) {
    each_term<Row>(config, [&](const char*, const char*, auto value_of) { *out++ = value_of(state); });
    return out;
}

template <class Row>
concept HasMemory = requires(const typename Row::Config& c) { Row::length(c); };

// The law's state, with the caller's memory where it has one.
template <class Row>
struct CState {
    typename Row::State law;
};
template <HasMemory Row>
struct CState<Row> {
    typename Row::State law;
    std::vector<cgl_real> cell;
};

// ---- what is learned over an angle

// The map of a memory by angle over one period; nothing by time.
inline Learned learned_map(const cgl_memory_config& config, const std::vector<cgl_real>& cell, double unit) {
    Learned map;
    if (config.kind != CGL_MEMORY_ANGLE) return map;
    if (config.periods_per_rev > 1) map.over = Over::electrical;
    for (std::uint32_t n = 0; n < config.cells; ++n) map.values.push_back(unit * static_cast<double>(cell[n]));
    return map;
}

inline Learned learned_of(const cgl_pi_ilc_config& c, const std::vector<cgl_real>& cell, int) {
    return learned_map(c.memory, cell, 1.0);
}

inline Learned learned_of(const cgl_robust_ilc_config& c, const std::vector<cgl_real>& cell, int) {
    return learned_map(c.memory, cell, -1.0 / static_cast<double>(c.b));
}

inline Learned learned_of(const cgl_anti_cogging_config&, const std::vector<cgl_real>& cell, int) {
    return {std::vector<double>(cell.begin(), cell.end()), Over::mechanical};
}

// Over the map's period, in the rotor's angle if that makes it one revolution, else in the electrical one where ratio is
// that of electrical quantities.
template <class Config>
    requires requires(const Config& c) { c.memory.turns; }
Learned learned_of(const Config& c, const std::vector<cgl_real>& cell, int pole_pairs) {
    const cgl_space_memory_config& m = c.memory;
    Learned map;
    if (m.kind != CGL_SPACE_MAP) return map;
    const double turns = static_cast<double>(m.turns) / m.parts, ratio = c.ratio;
    const bool electrical = c.ratio != 1U && static_cast<int>(c.ratio) == pole_pairs && turns != ratio;
    map.over = electrical ? Over::electrical : Over::mechanical;
    map.period = 2.0 * std::numbers::pi * (electrical ? turns : turns / ratio);
    std::vector<double>* const into[] = {&map.values, &map.beta, &map.h};
    for (std::uint32_t n = 0; n < m.channels; ++n) {
        const auto first = cell.begin() + static_cast<std::ptrdiff_t>(n * CGL_MEMORY_LENGTH(m.cells, m.q_half_width));
        into[n]->assign(first, first + m.cells);
    }
    return map;
}

// ---- a law

template <class Row>
struct CLaw {
    using Config = typename Row::Config;
    using State = CState<Row>;
    Config config;
    int pole_pairs;
    bool calibrate = false;  // start with the calibration run of a law that has one

    State start() const {
        State s{};
        if constexpr (HasMemory<Row>) {
            s.cell.resize(Row::length(config));
            require(Row::init(&config, &s.law, s.cell.data(), static_cast<std::uint32_t>(s.cell.size())), Row::name);
        } else {
            require(Row::init(&config, &s.law), Row::name);
        }
        if constexpr (std::is_same_v<Row, anti_cogging_row>) {
            if (calibrate) cgl_anti_cogging_calibrate(&config, &s.law);
        }
        return s;
    }
    Command step(State& s, const LawInput& in) const {
        cgl_law_output output;
        if constexpr (HasMemory<Row>) Row::set_memory(s.law, s.cell);
        Row::step(&config, &s.law, &in.c, &output);
        return from_c(output);
    }
    LawConfig describe() const {
        LawConfig law{Row::name, &config, sizeof config};
        if constexpr (HasMemory<Row>) law.memory_length = Row::length(config);
        return law;
    }
    std::vector<Term> terms() const { return terms_of<Row>(config); }
    double* put_terms(const State& s, double* out) const { return cogless::put_terms<Row>(config, s.law, out); }

    static std::vector<cgl_real>& cells(State& s)
        requires HasMemory<Row>
    {
        return s.cell;
    }
    Learned learned(const State& s) const
        requires HasMemory<Row>
    {
        return learned_of(config, s.cell, pole_pairs);
    }
    std::optional<Stored> stored(State s) const
        requires HasMemory<Row>
    {
        Row::set_memory(s.law, s.cell);
        return stored_map<Row::map_of>(config, s.law);
    }
    // Revolutions of the rotor that are a whole number of the memory's periods, of a law that learns over an angle.
    int turns() const
        requires requires(const Config& c) { c.memory.turns; }
    {
        const std::uint64_t periods = std::uint64_t{config.ratio} * config.memory.parts;
        return static_cast<int>(config.memory.turns / std::gcd(std::uint64_t{config.memory.turns}, periods));
    }
};

}  // namespace cogless
