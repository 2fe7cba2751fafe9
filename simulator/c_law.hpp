// The laws of the control library as values that the engine can run, each from its row in laws.def.
//
// A law is a constant configuration with start() and step(); its state is a separate value that can be copied. The state also has
// the memory that a C caller provides. A copied state has its own memory, so the C state's pointer to it is set before each use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <type_traits>
#include <vector>

#include "cogless/harmonic_parts.h"
#include "cogless/laws.def"
#include "law.hpp"
#include "section.hpp"

namespace cogless {

#define CGL_NAMES(law, stem, step_function)         \
    using Config = cgl_##stem##_config;             \
    using State = cgl_##stem;                       \
    static constexpr const char* name = law;        \
    static constexpr auto init = cgl_##stem##_init; \
    static constexpr auto step = step_function;     \
    template <class C>                              \
    static const char* bad_field(const C* config, const cgl_loop* loop) { return cgl_##stem##_bad_field(config, loop); }
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
#include "cogless/laws.def"
#undef CGL_NAMES

// Calls take(signal, unit, value_of) for each term of the law's output that exists with this configuration.
template <class Row, class Config, class Take>
void each_term(const Config& c, Take take) {
#define CGL_TERM(stem, signal, unit, member, share, when)                                          \
    if constexpr (std::is_same_v<Row, stem##_row>) {                                               \
        if (when) take(signal, unit, [](const auto& s) { return static_cast<double>(s.member); }); \
    }
#include "cogless/laws.def"
}

template <class Row>
std::vector<Term> terms_of(const typename Row::Config& config) {
    std::vector<Term> all;
    each_term<Row>(config, [&all](const char* signal, const char* unit, auto) { all.push_back({signal, unit}); });
    return all;
}

// Writes the terms of a state to `out`, and returns the position after them.
template <class Row>
double* put_terms(const typename Row::Config& config, const typename Row::State& state, double* out) {
    each_term<Row>(config, [&](const char*, const char*, auto value_of) { *out++ = value_of(state); });
    return out;
}

template <class Row>
concept HasMemory = requires(const typename Row::Config& c) { Row::length(c); };

// Calls the law's init and returns its error. The trial law's init takes no loop, since it knows only samples. For any other law,
// throws std::invalid_argument if init refuses the configuration.
template <class Row, class... Memory>
cgl_error init_law(typename Row::State& state, const typename Row::Config& config, const cgl_loop& loop, Memory... memory) {
    if constexpr (std::is_same_v<Row, trial_row>) {
        return Row::init(&state, &config, memory...);
    } else {
        const cgl_error error = Row::init(&state, &config, &loop, memory...);
        if (error == CGL_ERROR_CONFIG) require(error, Row::name, Row::bad_field(&config, &loop));
        return error;
    }
}

// Throws std::invalid_argument for a configuration that init refuses. It needs no memory, whose length a refused configuration may
// not bound: init checks the configuration before the memory.
template <HasMemory Row>
void require_config(const typename Row::Config& config, const cgl_loop& loop) {
    typename Row::State unused;
    const cgl_error error = init_law<Row>(unused, config, loop, nullptr, 0);
    if (error != CGL_ERROR_MEMORY) require(error, Row::name);
}

// The input of a sum of the harmonic law's orders, the error that its PI controls, rad/s, and the sum, A.
struct OrderSum {
    cgl_orders orders;
    cgl_real error, sum;
};

extern "C" {
bool cgl_harmonic_begin(cgl_harmonic* law, const cgl_law_input* in, cgl_real* error, cgl_orders* orders);
void cgl_harmonic_end(cgl_harmonic* law, const cgl_law_input* in, cgl_real error, const cgl_orders* orders, cgl_real sum,
                      cgl_law_output* out);
}

// The law's state, with the caller's memory if the law has one.
template <class Row>
struct CState {
    typename Row::State law;
};
template <HasMemory Row>
struct CState<Row> {
    typename Row::State law;
    std::vector<cgl_real> cell;
};

template <class Row>
struct CLaw {
    using Config = typename Row::Config;
    using State = CState<Row>;
    static constexpr const char* name = Row::name;
    Config config;
    cgl_loop loop;
    bool calibrate = false;  // start with the calibration run, if the law has one

    // Throws std::invalid_argument for a configuration of another size and, if the law has a memory, for one that init refuses.
    // For a law without a memory start() throws it.
    static CLaw of(const Section& s, const cgl_loop& loop) {
        const CLaw law{s.packed<Config>("config"), loop, s.has("calibrate") && s.get<bool>("calibrate")};
        if constexpr (HasMemory<Row>) require_config<Row>(law.config, loop);
        return law;
    }

    State start() const {
        State s{};
        if constexpr (HasMemory<Row>) {
            s.cell.resize(Row::length(config));
            require(init_law<Row>(s.law, config, loop, s.cell.data(), static_cast<std::uint32_t>(s.cell.size())), Row::name);
        } else {
            require(init_law<Row>(s.law, config, loop), Row::name);
        }
        if constexpr (std::is_same_v<Row, anti_cogging_row>) {
            if (calibrate) cgl_anti_cogging_calibrate(&s.law);
        }
        return s;
    }
    Command step(State& s, const cgl_law_input& in) const {
        cgl_law_output output;
        if constexpr (HasMemory<Row>) Row::set_memory(s.law, s.cell);
        Row::step(&s.law, &in, &output);
        return from_c(output);
    }
    // step() in two parts, between which the sum of the orders is taken: see harmonic.c.
    bool begin(auto& s, const cgl_law_input& in, OrderSum& sum) const
        requires std::is_same_v<Row, harmonic_row>
    {
        Row::set_memory(s.law, s.cell);
        return cgl_harmonic_begin(&s.law, &in, &sum.error, &sum.orders);
    }
    Command end(auto& s, const cgl_law_input& in, const OrderSum& sum) const
        requires std::is_same_v<Row, harmonic_row>
    {
        cgl_law_output output;
        cgl_harmonic_end(&s.law, &in, sum.error, &sum.orders, sum.sum, &output);
        return from_c(output);
    }
    std::vector<Term> terms() const { return terms_of<Row>(config); }
    double* put_terms(const auto& s, double* out) const { return cogless::put_terms<Row>(config, s.law, out); }

    static std::vector<cgl_real>& cells(auto& s)
        requires HasMemory<Row>
    {
        return s.cell;
    }
    std::optional<Stored> stored(auto s) const
        requires HasMemory<Row>
    {
        Row::set_memory(s.law, s.cell);
        return stored_map<Row::map_of>(s.law);
    }
    void load(auto& s, const std::vector<std::vector<double>>& values) const
        requires HasMemory<Row>
    {
        Row::set_memory(s.law, s.cell);
        put_map<Row::map_of>(s.law, values);
    }
    // For a law that learns over an angle: revolutions of the rotor that contain a whole number of the memory's periods.
    int turns() const
        requires requires(const Config& c) { c.ratio; c.memory.turns; }
    {
        const std::uint64_t periods = std::uint64_t{config.ratio} * config.memory.parts;
        return static_cast<int>(config.memory.turns / std::gcd(std::uint64_t{config.memory.turns}, periods));
    }
};

}  // namespace cogless
