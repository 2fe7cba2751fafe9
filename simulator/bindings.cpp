// The Python module. Built twice: the control laws in float (_simulator_f32) and in double (_simulator_f64).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "config.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace cogless {

namespace {

using Array = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

nb::dict memory_of(const Drive& drive, const DriveState& state) {
    const LearnedMap map = drive.learned(state);
    nb::dict result;
    if (map.current.empty()) return result;
    result["frame"] = map.electrical ? "electrical" : "mechanical";
    result["current"] = map.current;
    return result;
}

}  // namespace

}  // namespace cogless

NB_MODULE(COGLESS_MODULE, m) {
    using namespace cogless;
    m.attr("real_bits") = 8 * sizeof(cgl_real);

    nb::class_<LawInput>(m, "LawInput", "What a speed law sees, once per speed-loop period; SI units.")
        .def_ro("time", &LawInput::time)
        .def_ro("omega_ref", &LawInput::omega_ref)
        .def_ro("omega_m", &LawInput::omega_m)
        .def_ro("theta_m", &LawInput::theta_m)
        .def_ro("i_d", &LawInput::i_d)
        .def_ro("i_q", &LawInput::i_q)
        .def_ro("i_limit", &LawInput::i_limit)
        .def_ro("ts", &LawInput::ts)
        .def_ro("learn", &LawInput::learn);

    nb::class_<DriveState>(m, "State", "All that changes while a drive runs; a value.")
        .def_ro("tick", &DriveState::tick, "current-loop periods since the start")
        .def("copy", [](const DriveState& s) { return DriveState(s); });

    nb::class_<Recorder>(m, "Recorder", "Rows of signals, one every `decimation` current-loop periods.")
        .def("__init__",
             [](Recorder* self, const Drive& drive, std::int64_t decimation, std::size_t rows) {
                 if (decimation < 1) throw std::invalid_argument("decimation: expected 1 or more");
                 new (self) Recorder(drive.signals().size(), decimation, rows);
             },
             "drive"_a, "decimation"_a, "rows"_a = 0, "rows: how many are expected; more are taken too.")
        .def(
            "take",
            [](Recorder& recorder) {
                auto* rows = new std::vector<double>(recorder.take());
                const nb::capsule owner(rows, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
                const std::size_t columns = recorder.columns();
                return Array(rows->data(), {rows->size() / columns, columns}, owner);
            },
            "Hands over the rows so far, (rows, signals) in float64, and starts anew.");

    nb::class_<Drive>(m, "Drive", "An immutable description of a drive with its controller.")
        .def("__init__",
             [](Drive* self, const nb::dict& config, const nb::object& controller) {
                 new (self) Drive(read_config(config, controller));
             },
             "config"_a, "controller"_a.none() = nb::none())
        .def_prop_ro("signals",
                     [](const Drive& drive) {
                         std::vector<std::pair<std::string, std::string>> all;
                         for (const Signal& s : drive.signals()) all.emplace_back(s.name, s.unit);
                         return all;
                     },
                     "(name, unit) of each recorded signal")
        .def("start", &Drive::start, "The state at time zero.")
        .def("advance", &Drive::advance, "state"_a, "recorder"_a, "ticks"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Runs so many current-loop periods.")
        .def("memory", &memory_of, "state"_a, "The learned map: {'frame', 'current'}, or {}.")
        .def("load_memory", &Drive::teach, "state"_a, "table"_a, "Puts a learned table in.");
}
