// The engine as a WebAssembly module: one drive or linear plant at a time, in numbers and bytes that lie in the module's
// memory.
//
// The target has no exceptions. The message of what is thrown goes to the host, which then gives this instance up.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "config.hpp"
#include "drive.hpp"
#include "packed_value.hpp"
#include "trial_config.hpp"

#define CGL_WEB(name) __attribute__((export_name(#name), used))

// Hands the host a message and ends the host's call: this function never returns.
extern "C" [[noreturn]] __attribute__((import_module("host"), import_name("failed"))) void host_failed(const char* text,
                                                                                                       std::size_t size);

namespace {

using namespace cogless;

template <class System, class State>
struct Run {
    System system;
    State state;
};
using DriveRun = Run<Drive, DriveState>;
using LinearRun = Run<LinearTrials, LinearTrialsState>;

struct Engine {
    std::variant<DriveRun, LinearRun> run;
    Recorder recorder;
};

std::optional<Engine> engine;
std::vector<double> room;  // memory that the host fills
Rows rows;                 // recorded rows that the host reads
std::string names;         // a line for each signal, its name and unit
std::optional<Stored> kept;

std::optional<Stored> stored_in(const DriveRun& run) {
    return std::visit(
        [&](const auto& law) -> std::optional<Stored> {
            using State = typename std::decay_t<decltype(law)>::State;
            if constexpr (requires(State s) { law.stored(s); }) return law.stored(std::get<State>(run.state.law));
            else return {};
        },
        run.system.config().law);
}
std::optional<Stored> stored_in(const LinearRun& run) { return run.system.config().law.stored(run.state.law); }

}  // namespace

extern "C" {

// Room for so many bytes from the host, aligned for a double.
CGL_WEB(room) double* cogless_room(std::size_t bytes) {
    room.assign(bytes / sizeof(double) + 1, 0.0);
    return room.data();
}

// Makes what the first `bytes` bytes in the room describe, at time zero: a drive, or a linear plant if they have an output C.
CGL_WEB(open) void cogless_open(std::size_t bytes, double decimation, double count) {
    const Value description = PackedValue::read({reinterpret_cast<const char*>(room.data()), bytes});
    const auto start = [&](const auto& system) {
        names.clear();
        for (const Signal& signal : system.signals()) names += signal.name + " " + signal.unit + "\n";
        const auto every = static_cast<std::int64_t>(decimation);
        engine.emplace(Run{system, system.start()},
                       Recorder(system.signals().size(), every, static_cast<std::size_t>(count)));
    };
    if (Section(description, "").has("C")) start(LinearTrials(read_linear_trials(description)));
    else start(Drive(read_config(description)));
}

// Loads the map in the room: channels of cells.
CGL_WEB(load) void cogless_load(std::size_t channels, std::size_t cells) {
    std::vector<std::vector<double>> values;
    for (std::size_t c = 0; c < channels; ++c) values.emplace_back(&room[c * cells], &room[c * cells] + cells);
    auto& [drive, state] = std::get<DriveRun>(engine->run);
    std::visit(
        [&](const auto& law) {
            using State = typename std::decay_t<decltype(law)>::State;
            if constexpr (requires(State s) { law.load(s, values); }) law.load(std::get<State>(state.law), values);
        },
        drive.config().law);
}

CGL_WEB(advance) void cogless_advance(double ticks) {
    std::visit([&](auto& run) { run.system.advance(run.state, engine->recorder, static_cast<std::int64_t>(ticks)); },
               engine->run);
}

// The rows recorded since the last call, as row_numbers() doubles.
CGL_WEB(rows) const double* cogless_rows() {
    rows = engine->recorder.take();
    return rows.data();
}
CGL_WEB(row_numbers) std::size_t cogless_row_numbers() { return rows.size(); }

CGL_WEB(signals) const char* cogless_signals() { return names.c_str(); }

// Entries of the learned map, channel by channel; null if the law learns nothing.
CGL_WEB(stored) const double* cogless_stored() {
    kept = std::visit([](const auto& run) { return stored_in(run); }, engine->run);
    return kept ? kept->entries.data() : nullptr;
}
CGL_WEB(stored_channels) std::size_t cogless_stored_channels() { return kept ? kept->about.channels : 0; }
CGL_WEB(stored_cells) std::size_t cogless_stored_cells() { return kept ? kept->about.cells : 0; }

// What the compiler calls for a throw. All that this code throws is a std::exception.
void* __cxa_allocate_exception(std::size_t size) noexcept { return std::malloc(size); }
[[noreturn]] void __cxa_throw(void* thrown, void*, void (*)(void*)) {
    const std::string_view why = static_cast<std::exception*>(thrown)->what();
    host_failed(why.data(), why.size());
}

}  // extern "C"
