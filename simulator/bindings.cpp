// The Python module. Built twice: the control laws in float (_simulator_f32) and in double (_simulator_f64).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "config.hpp"
#include "trial_config.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace cogless {

namespace {

using Array = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

// What has been learned, under the names that say over what.
template <class Engine, class State>
nb::dict memory_of(const Engine& engine, const State& state) {
    const Learned learned = engine.learned(state);
    nb::dict result;
    if (learned.values.empty()) return result;
    if (learned.over == Over::trial) {
        result["learned"] = learned.values;
    } else {
        result["frame"] = learned.over == Over::electrical ? "electrical" : "mechanical";
        result["current"] = learned.values;
        if (learned.period) result["period"] = *learned.period;
        if (!learned.beta.empty()) result["beta"] = learned.beta;
        if (!learned.h.empty()) result["h"] = learned.h;
    }
    return result;
}

// The constructor of a recorder of an engine's signals.
template <class Engine>
void make_recorder(Recorder* self, const Engine& engine, std::int64_t decimation, std::size_t rows) {
    if (decimation < 1) throw std::invalid_argument("decimation: expected 1 or more");
    new (self) Recorder(engine.signals().size(), decimation, rows);
}

// What every engine offers.
template <class Engine, class State>
void bind_engine(nb::class_<Engine>& c, const char* memory) {
    c.def_prop_ro("signals",
                  [](const Engine& engine) {
                      std::vector<std::pair<std::string, std::string>> all;
                      for (const Signal& s : engine.signals()) all.emplace_back(s.name, s.unit);
                      return all;
                  },
                  "(name, unit) of each recorded signal")
        .def("start", &Engine::start, "The state at time zero.")
        .def("advance", &Engine::advance, "state"_a, "recorder"_a, "ticks"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Runs so many ticks.")
        .def("memory", &memory_of<Engine, State>, "state"_a, memory);
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
        .def_ro("learn", &LawInput::learn)
        .def_ro("theta_ref", &LawInput::theta_ref)
        .def_ro("alpha_ref", &LawInput::alpha_ref);

    nb::class_<DriveState>(m, "State", "All that changes while a drive runs; a value.")
        .def_ro("tick", &DriveState::tick, "current-loop periods since the start")
        .def("copy", [](const DriveState& s) { return DriveState(s); });

    nb::class_<LinearTrialsState>(m, "LinearTrialsState", "All that changes in trials of a linear plant; a value.")
        .def_ro("tick", &LinearTrialsState::tick, "samples since the start")
        .def("copy", [](const LinearTrialsState& s) { return LinearTrialsState(s); });

    nb::class_<Recorder>(m, "Recorder", "Rows of an engine's signals, one every `decimation` ticks.")
        .def("__init__", &make_recorder<Drive>, "drive"_a, "decimation"_a, "rows"_a = 0,
             "rows: how many are expected; more are taken too.")
        .def("__init__", &make_recorder<LinearTrials>, "trials"_a, "decimation"_a, "rows"_a = 0)
        .def(
            "take",
            [](Recorder& recorder) {
                auto* rows = new std::vector<double>(recorder.take());
                const nb::capsule owner(rows, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
                const std::size_t columns = recorder.columns();
                return Array(rows->data(), {rows->size() / columns, columns}, owner);
            },
            "Hands over the rows so far, (rows, signals) in float64, and starts anew.");

    nb::class_<Drive> drive(m, "Drive", "An immutable description of a drive with its controller.");
    drive.def("__init__",
              [](Drive* self, const nb::dict& config, const nb::object& controller) {
                  new (self) Drive(read_config(config, controller));
              },
              "config"_a, "controller"_a.none() = nb::none());
    bind_engine<Drive, DriveState>(
        drive, "What is learned: {'frame', 'current'} over an angle, with {'period', 'beta', 'h'} by a space law as far as it"
        " learns them, {'learned'} over a trial's samples, or {}.");
    drive.def("load_memory", &Drive::teach, "state"_a, "table"_a, "Puts a learned table in.");

    nb::class_<LinearTrials> linear(m, "LinearTrials", "An immutable description of a linear plant with the trial law.");
    linear.def("__init__",
               [](LinearTrials* self, const nb::dict& config) { new (self) LinearTrials(read_linear_trials(config)); },
               "config"_a);
    bind_engine<LinearTrials, LinearTrialsState>(linear, "What is learned: {'learned'}, a trial's samples.");
}
