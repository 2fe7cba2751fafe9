// The Python module. Built twice: the control laws in float (_simulator_f32) and in double (_simulator_f64).
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <tuple>
#include <type_traits>
#include <variant>

#include "config.hpp"
#include "linear_filter.hpp"
#include "python_value.hpp"
#include "trial_config.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace cogless {

namespace {

using Array = nb::ndarray<nb::numpy, double, nb::ndim<2>>;
using Reals = nb::ndarray<nb::numpy, cgl_real, nb::ndim<1>>;

// An array that owns its numbers.
template <class Made, class Numbers>
Made array_of(Numbers values, std::initializer_list<std::size_t> shape) {
    auto* kept = new Numbers(std::move(values));
    const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<Numbers*>(p); });
    return Made(kept->data(), shape, owner);
}

template <class Numbers>
Array rows_of(Numbers values, std::size_t columns) {
    const std::size_t rows = values.size() / columns;
    return array_of<Array>(std::move(values), {rows, columns});
}

// A Python object that replaces the drive's controller; it gets and returns C structs as bytes: step(measurement, reference)
// -> output, and in trials begin(trajectory), end(). Over a bus, in place of step: measure(measurement, reference) -> due, theta_m,
// omega_m; law(theta_m, omega_m) -> i_q_ref; actuate(i_q_ref or None) -> output.
class PythonController : public Controller {
public:
    explicit PythonController(const nb::object& object) : object_(object), step_(object.attr("step")) {}

    cgl_drive_output step(const cgl_measurement& now, const cgl_reference& reference) override {
        const nb::gil_scoped_acquire gil;
        return output_of(step_(nb::bytes(&now, sizeof now), nb::bytes(&reference, sizeof reference)));
    }
    std::pair<bool, Measurement> measure(const cgl_measurement& now, const cgl_reference& reference) override {
        const nb::gil_scoped_acquire gil;
        const auto [due, theta_m, omega_m] = nb::cast<std::tuple<bool, double, double>>(
            object_.attr("measure")(nb::bytes(&now, sizeof now), nb::bytes(&reference, sizeof reference)));
        return {due, {theta_m, omega_m}};
    }
    BusCommand law(const Measurement& then) override {
        const nb::gil_scoped_acquire gil;
        return {nb::cast<double>(object_.attr("law")(then.theta_m, then.omega_m)), 0.0};
    }
    cgl_drive_output actuate(const BusCommand* received) override {
        const nb::gil_scoped_acquire gil;
        return output_of(object_.attr("actuate")(received == nullptr ? nb::none() : nb::object(nb::float_(received->i_q_ref))));
    }
    void begin(const std::vector<cgl_real>& trajectory) override {
        const nb::gil_scoped_acquire gil;
        object_.attr("begin")(nb::bytes(trajectory.data(), trajectory.size() * sizeof(cgl_real)));
    }
    void end() override {
        const nb::gil_scoped_acquire gil;
        object_.attr("end")();
    }

private:
    static cgl_drive_output output_of(const nb::object& result) {
        nb::bytes bytes;
        cgl_drive_output out;
        if (!nb::try_cast(result, bytes) || bytes.size() != sizeof out) {
            const std::string what = nb::isinstance<nb::bytes>(result)
                                         ? std::to_string(nb::len(result)) + " bytes"
                                         : nb::cast<std::string>(nb::str(result.type().attr("__name__")));
            const std::string expected = "expected " + std::to_string(sizeof out) + " bytes of a cgl_drive_output";
            throw nb::value_error(("controller.step() returned " + what + ": " + expected).c_str());
        }
        std::memcpy(&out, bytes.c_str(), sizeof out);
        return out;
    }

    nb::object object_, step_;
};

void advance_drive(const Drive& drive, DriveState& state, Recorder& recorder, std::int64_t ticks,
                   const nb::object& controller) {
    if (controller.is_none()) {
        const nb::gil_scoped_release release;
        drive.advance(state, recorder, ticks);
    } else {
        PythonController other(controller);
        const nb::gil_scoped_release release;
        drive.advance(state, recorder, ticks, &other);
    }
}

// Advances the drives together. Returns a text for each: why it failed, or nothing. kernel: index into lane_kernels().
std::vector<std::string> advance_lanes(const std::vector<const Drive*>& drives, const std::vector<DriveState*>& states,
                                       const std::vector<Recorder*>& recorders, std::int64_t ticks, std::size_t kernel) {
    const std::vector<LaneKernel> kernels = lane_kernels();
    if (drives.empty() || states.size() != drives.size() || recorders.size() != drives.size() || kernel >= kernels.size()) {
        throw std::invalid_argument("advance_lanes: expected a state and a recorder for each drive");
    }
    std::vector<Drive::Lane> lanes;
    for (std::size_t n = 0; n < drives.size(); ++n) lanes.push_back({drives[n], states[n], recorders[n]});
    {
        const nb::gil_scoped_release release;
        Drive::advance_lanes(lanes, kernels[kernel], ticks);
    }
    std::vector<std::string> errors;
    for (const Drive::Lane& lane : lanes) errors.push_back(lane.error);
    return errors;
}

std::vector<std::pair<std::string, std::size_t>> kernels() {
    std::vector<std::pair<std::string, std::size_t>> all;
    for (const LaneKernel& kernel : lane_kernels()) all.emplace_back(kernel.name, kernel.lanes);
    return all;
}

std::string_view view(const nb::bytes& bytes) { return {bytes.c_str(), bytes.size()}; }

nb::bytes step_controller(const Drive& drive, DriveState& state, const nb::bytes& measurement, const nb::bytes& reference) {
    const cgl_drive_output out = drive.step_controller(state, struct_of<cgl_measurement>(view(measurement), "measurement"),
                                                       struct_of<cgl_reference>(view(reference), "reference"));
    return nb::bytes(&out, sizeof out);
}

std::tuple<bool, double, double> measure_controller(const Drive& drive, DriveState& state, const nb::bytes& measurement,
                                                   const nb::bytes& reference) {
    const auto [due, seen] = drive.measure_controller(state, struct_of<cgl_measurement>(view(measurement), "measurement"),
                                                      struct_of<cgl_reference>(view(reference), "reference"));
    return {due, seen.theta_m, seen.omega_m};
}

nb::bytes actuate_controller(const Drive& drive, DriveState& state, std::optional<double> i_q_ref) {
    const BusCommand received{i_q_ref.value_or(0.0), 0.0};
    const cgl_drive_output out = drive.actuate_controller(state, i_q_ref ? &received : nullptr);
    return nb::bytes(&out, sizeof out);
}

void begin_trial(const Drive& drive, DriveState& state, const nb::bytes& trajectory) {
    std::vector<cgl_real> samples(trajectory.size() / sizeof(cgl_real));
    std::memcpy(samples.data(), trajectory.c_str(), samples.size() * sizeof(cgl_real));
    drive.begin_trial(state, samples);
}

Reals law_memory(const Drive& drive, DriveState& state) {
    const std::vector<cgl_real>* cells = drive.cells(state);
    if (cells == nullptr) return array_of<Reals>(std::vector<cgl_real>(), {0});
    return array_of<Reals>(*cells, {cells->size()});
}

nb::bytes microstepping_output(const Drive&, const DriveState& state) {
    const cgl_microstepping_output& output = std::get<MicrosteppingLaw::State>(state.law).output;
    return nb::bytes(&output, sizeof output);
}

// Replaces the law's learned map. Throws std::invalid_argument for a law without a map, or values of another shape.
void load_map(const Drive& drive, DriveState& state, const std::vector<std::vector<double>>& values) {
    std::visit(
        [&](const auto& law) {
            using State = typename std::decay_t<decltype(law)>::State;
            if constexpr (requires(State s) { law.load(s, values); }) {
                law.load(std::get<State>(state.law), values);
            } else {
                throw std::invalid_argument("this law has no map");
            }
        },
        drive.config().law);
}

nb::dict quality_of(const Drive&, const DriveState& state) {
    const cgl_quality_report report = cgl_quality_read(&state.control.quality);
    nb::dict result;
    result["known"] = report.known;
    result["residual"] = report.residual;
    result["progress"] = report.progress;
    result["improving"] = report.improving;
    result["worsening"] = report.worsening;
    return result;
}

std::optional<Stored> stored(const Drive& drive, const DriveState& state) {
    return std::visit(
        [&state](const auto& law) -> std::optional<Stored> {
            using State = typename std::decay_t<decltype(law)>::State;
            if constexpr (requires(State s) { law.stored(s); }) {
                return law.stored(std::get<State>(state.law));
            } else {
                return {};
            }
        },
        drive.config().law);
}

std::optional<Stored> stored(const LinearTrials& trials, const LinearTrialsState& state) {
    return trials.config().law.stored(state.law);
}

// What a law has learned, as a dict, or None. The drive to which it belongs is not in it.
template <class Engine, class State>
nb::object stored_of(const Engine& engine, const State& state) {
    const std::optional<Stored> found = stored(engine, state);
    if (!found) return nb::none();
    const cgl_map& map = found->about;
    nb::dict result;
    result["values"] = rows_of(found->entries, map.cells);
    result["units"] = std::vector<std::uint32_t>(map.unit, map.unit + map.channels);
    result["limits"] = std::vector<double>(map.limit, map.limit + map.channels);
    result["law"] = map.law;
    result["turns"] = map.turns;
    result["parts"] = map.parts;
    result["ratio"] = map.ratio;
    return result;
}

// The constructor of a recorder of an engine's signals: constructs it in place, at `self`.
template <class Engine>
void make_recorder(Recorder* self, const Engine& engine, std::int64_t decimation, std::size_t rows,
                   const std::vector<std::size_t>& selected) {
    const std::size_t columns = engine.signals().size();
    if (decimation < 1) throw std::invalid_argument("decimation: expected 1 or more");
    if (std::any_of(selected.begin(), selected.end(), [columns](std::size_t column) { return column >= columns; })) {
        throw std::invalid_argument("selected: expected places of signals");
    }
    new (self) Recorder(columns, decimation, rows, selected);
}

// Converts what a user's step() returned: i_q_ref or (i_d_ref, i_q_ref).
Command command_of(const nb::object& result) {
    if (!nb::isinstance<nb::tuple>(result)) return {0.0, nb::cast<double>(result)};
    const auto both = nb::cast<nb::tuple>(result);
    if (both.size() != 2) throw nb::type_error("step() returns i_q_ref or (i_d_ref, i_q_ref)");
    return {nb::cast<double>(both[0]), nb::cast<double>(both[1])};
}

// A whole number that a user's object may have as its attribute `name`; else `otherwise`.
std::uint32_t whole(const nb::object& controller, const char* name, std::uint32_t otherwise) {
    std::uint32_t value = otherwise;
    if (nb::hasattr(controller, name) && !nb::try_cast(nb::object(controller.attr(name)), value)) {
        throw std::runtime_error(std::string(name) + ": expected a whole number");
    }
    return value;
}

// Calls a user's learned_map(), and converts what it returns: currents over the angle, {order: (cosine, sine)}, or None.
std::optional<Stored> learned_map(const nb::object& controller, double limit) {
    const nb::object result = controller.attr("learned_map")();
    std::vector<double> first, sine, order;
    cogless_plugin_map map = empty_map();
    map.law = whole(controller, "map_law", map.law);
    map.parts = whole(controller, "map_parts", map.parts);
    bool known = true;
    if (nb::isinstance<nb::dict>(result)) {
        for (const auto& [key, value] : nb::cast<nb::dict>(result)) {
            std::pair<double, double> amplitudes;
            order.emplace_back();
            known = known && nb::try_cast(nb::object(nb::borrow(key)), order.back()) && nb::try_cast(nb::object(nb::borrow(value)), amplitudes);
            first.push_back(amplitudes.first);
            sine.push_back(amplitudes.second);
        }
        map.cosine = first.data();
        map.sine = sine.data();
        map.order = order.data();
    } else if (!result.is_none()) {
        known = nb::try_cast(result, first);
        map.current = first.data();
    }
    if (!known) throw std::runtime_error("learned_map() returns currents over the angle, {order: (cosine, sine)}, or None");
    map.entries = first.size();
    return own_stored(map, limit);
}

// Calls load_map() of a user's law with channels of entries, in the form that learned_map() returns.
void call_load_map(const nb::object& load, const std::vector<std::vector<double>>& values) {
    if (values.size() == 1) {
        load(values[0]);
        return;
    }
    nb::dict learned;
    for (std::size_t n = 0; n < values.at(2).size(); ++n) {
        learned[nb::int_(static_cast<long>(values[2][n]))] = nb::make_tuple(values[0].at(n), values[1].at(n));
    }
    load(learned);
}

// The user's law: an object with step(input), and optionally begin_trial(theta_ref), end_trial(), current_step(input, i_d_ref,
// i_q_ref), a number `i_q_learned`, learned_map() and load_map(learned). For None, an empty law.
CallbackLaw callback(const nb::object& controller) {
    if (controller.is_none()) return {};
    CallbackLaw law{[step = nb::object(controller.attr("step"))](const LawInput& in) {
        const nb::gil_scoped_acquire gil;
        return command_of(step(in));
    }};
    if (nb::hasattr(controller, "i_q_learned")) {
        law.learned_function = [controller] {
            const nb::gil_scoped_acquire gil;
            double current = 0.0;
            if (!nb::try_cast(nb::object(controller.attr("i_q_learned")), current)) {
                throw std::runtime_error("i_q_learned: expected a number");
            }
            return current;
        };
    }
    if (nb::hasattr(controller, "current_step")) {
        law.current_function = [step = nb::object(controller.attr("current_step"))](const LawInput& in, const Command& last) {
            const nb::gil_scoped_acquire gil;
            return command_of(step(in, last.i_d_ref, last.i_q_ref));
        };
    }
    if (nb::hasattr(controller, "learned_map")) {
        law.map_function = [controller](double limit) {
            const nb::gil_scoped_acquire gil;
            return learned_map(controller, limit);
        };
    }
    if (nb::hasattr(controller, "load_map")) {
        law.load_function = [load = nb::object(controller.attr("load_map"))](const std::vector<std::vector<double>>& values) {
            const nb::gil_scoped_acquire gil;
            call_load_map(load, values);
        };
    }
    if (nb::hasattr(controller, "begin_trial")) {
        law.begin_function = [begin = nb::object(controller.attr("begin_trial"))](const std::vector<cgl_real>& theta_ref) {
            const nb::gil_scoped_acquire gil;
            begin(std::vector<double>(theta_ref.begin(), theta_ref.end()));
        };
    }
    if (nb::hasattr(controller, "end_trial")) {
        law.end_function = [end = nb::object(controller.attr("end_trial"))] {
            const nb::gil_scoped_acquire gil;
            end();
        };
    }
    return law;
}

// Binds the methods that all engines have.
template <class Engine, class State>
void bind_engine(nb::class_<Engine>& c) {
    c.def_prop_ro("signals",
                  [](const Engine& engine) {
                      std::vector<std::pair<std::string, std::string>> all;
                      for (const Signal& s : engine.signals()) all.emplace_back(s.name, s.unit);
                      return all;
                  },
                  "(name, unit) of each recorded signal")
        .def("start", &Engine::start, "The state at time zero.")
        .def("stored", &stored_of<Engine, State>, "state"_a,
             "What is learned as firmware stores it: 'values' (channels, cells), 'units', 'limits', 'law', 'turns', 'parts', "
             "'ratio', as in cgl_map; None where there is nothing to store.");
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
        .def_ro("off", &LawInput::off)
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
             "selected"_a = std::vector<std::size_t>(),
             "rows: how many are expected; more are taken too. selected: places in `signals` of the only ones to record; empty: all.")
        .def("__init__", &make_recorder<LinearTrials>, "trials"_a, "decimation"_a, "rows"_a = 0,
             "selected"_a = std::vector<std::size_t>())
        .def(
            "take",
            [](Recorder& recorder) { return rows_of(recorder.take(), recorder.columns()); },
            "Hands over the rows so far, (rows, signals) in float64, and starts anew.");

    nb::class_<Drive> drive(m, "Drive", "An immutable description of a drive with its controller.");
    drive.def("__init__",
              [](Drive* self, const nb::dict& config, const nb::object& controller) {
                  new (self) Drive(read_config(value_of(config), callback(controller)));
              },
              "config"_a, "controller"_a.none() = nb::none());
    bind_engine<Drive, DriveState>(drive);
    drive.def("advance", &advance_drive, "state"_a, "recorder"_a, "ticks"_a, "controller"_a.none() = nb::none(),
              "Runs so many ticks. `controller` stands in for the drive's own: step(measurement, reference) -> output, with"
              " the C structs cgl_measurement, cgl_reference and cgl_drive_output as bytes; in trials begin(trajectory)"
              " and end(), too.");
    drive.def("step_controller", &step_controller, "state"_a, "measurement"_a, "reference"_a,
              "A period of the drive's own controller alone, of a law of the control library: what a `controller` stands in"
              " for. The plant stays as it is.")
        .def("measure_controller", &measure_controller, "state"_a, "measurement"_a, "reference"_a,
             "Of a drive with a bus: what comes before the law. (whether the law is due, angle, speed)")
        .def("law_controller",
             [](const Drive& self, DriveState& state, double theta_m, double omega_m) {
                 return self.law_controller(state, {theta_m, omega_m}).i_q_ref;
             },
             "state"_a, "theta_m"_a, "omega_m"_a, "The law, with what has reached it over the bus: its i_q_ref.")
        .def("actuate_controller", &actuate_controller, "state"_a, "i_q_ref"_a.none(),
             "What follows the law, with the i_q_ref that has reached the drive, or None: the output.")
        .def("begin_trial", &begin_trial, "state"_a, "trajectory"_a)
        .def("end_trial", &Drive::end_trial, "state"_a);
    drive.def("law_memory", &law_memory, "state"_a, "A copy of all of the law's memory, which in C is the caller's.");
    drive.def("microstepping_output", &microstepping_output, "state"_a,
              "Of a drive with the law microstepping: the output of its last step, a cgl_microstepping_output as bytes.");
    drive.def("load_map", &load_map, "state"_a, "values"_a,
              "Loads a map of the form of `stored`, (channels, cells), into the law's memory, before its first step.");
    drive.def("quality", &quality_of, "state"_a,
              "How good learning is: 'residual' rad/s, 'progress', 'improving', 'worsening'; all of it if 'known'.");

    drive.def("alike", &Drive::alike, "other"_a, "Whether both can go on together in advance_lanes().");
    m.def("lane_kernels", &kernels, "(name, lanes) of the sets of instructions that this processor has, the widest first.");
    m.def("advance_lanes", &advance_lanes, "drives"_a, "states"_a, "recorders"_a, "ticks"_a, "kernel"_a = 0,
          "Runs so many ticks of drives that are alike and at the same tick, at most as many as the kernel has lanes, with the"
          " bits of advance(). Returns why each failed, or \"\"; the others go on. kernel: an index into lane_kernels().");

    using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
    m.def("filtered",
          [](const Rows& b, const Rows& a, const Rows& state, const Rows& x) {
              const std::size_t rows = x.shape(0), count = x.shape(1), order = state.shape(1);
              const bool alike = b.shape(0) == rows && a.shape(0) == rows && state.shape(0) == rows;
              if (!alike || order < 1 || b.shape(1) != order + 1 || a.shape(1) != order + 1) {
                  throw std::invalid_argument("filtered: expected a row of b, a and state for each of x, and a state shorter by one");
              }
              std::vector<double> y(x.data(), x.data() + x.size());
              for (std::size_t row = 0; row < rows; row += FILTER_LANES) {
                  const std::size_t at = row * (order + 1);
                  filter_rows(b.data() + at, a.data() + at, state.data() + row * order, order, y.data() + row * count,
                              std::min(FILTER_LANES, rows - row), count);
              }
              return array_of<Array>(std::move(y), {rows, count});
          },
          "b"_a, "a"_a, "state"_a, "x"_a,
          "Each row of x through the digital filter of its row of b and a, whose a[:, 0] is one, from its row of state on, as "
          "scipy.signal.lfilter does it.");

    nb::class_<LinearTrials> linear(m, "LinearTrials", "An immutable description of a linear plant with the trial law.");
    linear.def("__init__",
               [](LinearTrials* self, const nb::dict& config) { new (self) LinearTrials(read_linear_trials(value_of(config))); },
               "config"_a);
    linear.def("advance", &LinearTrials::advance, "state"_a, "recorder"_a, "ticks"_a,
               nb::call_guard<nb::gil_scoped_release>(), "Runs so many ticks.");
    bind_engine<LinearTrials, LinearTrialsState>(linear);
}
