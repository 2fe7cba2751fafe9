// Inputs, outputs and learned values that all laws have in common.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cogless/law.h"
#include "cogless/map.h"

namespace cogless {

// Currents that a law asks for, A, and its status bits.
struct Command {
    double i_d_ref = 0.0, i_q_ref = 0.0;
    unsigned status = 0;
};

// The input to a user's own law. A law of the control library takes a cgl_law_input.
struct LawInput {
    double time;              // s
    double omega_ref;         // rad/s
    double theta_ref;         // rad, wrapped to [0, the law's `turns`); in trials not wrapped
    double alpha_ref;         // rad/s^2; not in trials
    double omega_m, theta_m;  // as checked by the drive's monitor: rad/s, rad
    double i_d, i_q;          // measured, A
    double i_limit;           // A, limit of the current reference
    double ts;                // s, speed-loop period
    bool learn;               // false: hold what is learned
    bool off;                 // true: the law's output has no effect
};

inline Command from_c(const cgl_law_output& out) { return {0.0, static_cast<double>(out.i_q_ref), out.status}; }

// A term of a law's output, as a recorded signal.
struct Term {
    const char* name;
    const char* unit = "A";
};

// What a law has learned: the control library's description for storing it, and the entries, channel by channel.
struct Stored {
    cgl_map about;
    std::vector<double> entries;
};

// What a law has learned; none if the library says that there is nothing to store. The law's pointer to its memory must be set.
template <auto map_of, class CState>
std::optional<Stored> stored_map(const CState& law) {
    Stored stored;
    if (map_of(&law, &stored.about) != CGL_MAP_OK) return {};
    for (std::uint32_t c = 0; c < stored.about.channels; ++c) {
        const cgl_real* first = stored.about.entry + std::size_t{c} * stored.about.stride;
        stored.entries.insert(stored.entries.end(), first, first + stored.about.cells);
    }
    return stored;
}

// Replaces a law's learned map by values, channel by channel, as a load from flash does. Throws std::invalid_argument if the law has
// no map, or a map of another shape.
template <auto map_of, class CState>
void put_map(const CState& law, const std::vector<std::vector<double>>& values) {
    cgl_map map;
    if (map_of(&law, &map) != CGL_MAP_OK) throw std::invalid_argument("this law has no map");
    const auto fits = [&map](const auto& channel) { return channel.size() == map.cells; };
    if (values.size() != map.channels || !std::all_of(values.begin(), values.end(), fits)) {
        throw std::invalid_argument("the map has " + std::to_string(map.channels) + " channels of " + std::to_string(map.cells) +
                                    " entries");
    }
    for (std::uint32_t c = 0; c < map.channels; ++c) {
        std::transform(values[c].begin(), values[c].end(), map.entry + std::size_t{c} * map.stride,
                       [](double x) { return static_cast<cgl_real>(x); });
    }
    cgl_map_centre(&map);
}

// Throws std::invalid_argument if a law's init returned an error. field: name of the field that init refuses, or null.
inline void require(cgl_error error, const char* law, const char* field = nullptr) {
    if (error == CGL_ERROR_MEMORY) throw std::invalid_argument(std::string(law) + ": memory too small");
    if (error != CGL_OK) {
        throw std::invalid_argument(std::string(law) + ": " + (field != nullptr ? field : "a gain") + " is outside its range");
    }
}

}  // namespace cogless
