#include "config.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <map>
#include <stdexcept>
#include <string>

#include "plugin_library.hpp"

namespace cogless {

namespace nb = nanobind;

namespace {

// A table of the configuration, whose errors name the whole key.
class Section {
public:
    Section(nb::dict values, std::string name) : values_(std::move(values)), name_(std::move(name)) {}

    bool has(const char* key) const { return values_.contains(key) && !values_[key].is_none(); }

    template <class T>
    T get(const char* key) const {
        if (!values_.contains(key)) throw std::invalid_argument(name_ + key + ": missing");
        T value;
        if (!nb::try_cast<T>(values_[key], value)) throw std::invalid_argument(name_ + key + ": wrong type");
        return value;
    }

    double number(const char* key) const { return get<double>(key); }
    int integer(const char* key) const { return get<int>(key); }
    cgl_real real(const char* key) const { return static_cast<cgl_real>(number(key)); }

    template <class Choice>
    Choice choice(const char* key, const std::map<std::string, Choice>& choices) const {
        const auto found = choices.find(get<std::string>(key));
        if (found == choices.end()) throw std::invalid_argument(name_ + key + ": unknown");
        return found->second;
    }

    Section section(const char* key) const { return {get<nb::dict>(key), name_ + key + "."}; }

    std::vector<Section> sections(const char* key) const {
        std::vector<Section> all;
        for (const nb::handle item : get<nb::list>(key)) {
            all.emplace_back(nb::cast<nb::dict>(item), name_ + key + "." + std::to_string(all.size()) + ".");
        }
        return all;
    }

    Table table(const char* key, const char* axis, const char* value) const {
        if (!has(key)) return {};
        const Section s = section(key);
        return {s.get<std::vector<double>>(axis), s.get<std::vector<double>>(value)};
    }

    Phases phases(const char* key) const {
        const auto values = get<std::vector<double>>(key);
        if (values.size() != 3) throw std::invalid_argument(name_ + key + ": expected three values");
        return {values[0], values[1], values[2]};
    }

private:
    nb::dict values_;
    std::string name_;
};

std::vector<Harmonic> harmonics(const std::vector<Section>& sections) {
    std::vector<Harmonic> all;
    for (const Section& s : sections) all.push_back({s.integer("order"), s.number("torque"), s.number("phase")});
    return all;
}

PmsmConfig motor(const Section& s) {
    PmsmConfig m{s.integer("pole_pairs"), s.number("R_s"), s.number("L_d"), s.number("L_q"), s.number("psi_f"), {},
                 harmonics(s.sections("cogging"))};
    for (const Section& h : s.sections("flux_harmonics")) {
        m.flux_harmonics.push_back({h.integer("order"), h.number("d"), h.number("q"), h.number("d_phase"),
                                    h.number("q_phase")});
    }
    return m;
}

ReferenceConfig reference(const Section& s) {
    ReferenceConfig r;
    r.kind = s.choice<ReferenceKind>("kind", {{"constant", ReferenceKind::constant},
                                              {"ramp", ReferenceKind::ramp},
                                              {"profile", ReferenceKind::profile},
                                              {"sine", ReferenceKind::sine}});
    switch (r.kind) {
        case ReferenceKind::ramp:
            r.ramp = s.number("ramp");
            [[fallthrough]];
        case ReferenceKind::constant:
            r.speed = s.number("speed");
            break;
        case ReferenceKind::profile:
            r.profile = {s.get<std::vector<double>>("times"), s.get<std::vector<double>>("speeds")};
            break;
        case ReferenceKind::sine:
            r.offset = s.number("offset");
            r.amplitude = s.number("amplitude");
            r.frequency = s.number("frequency");
            break;
    }
    return r;
}

PositionSensorConfig position_sensor(const Section& s) {
    PositionSensorConfig p;
    p.kind = s.choice<PositionSensorKind>("kind", {{"ideal", PositionSensorKind::ideal},
                                                   {"encoder", PositionSensorKind::encoder},
                                                   {"resolver", PositionSensorKind::resolver}});
    if (p.kind == PositionSensorKind::encoder) {
        p.lines = s.integer("lines");
        p.speed_method = s.choice<SpeedMethod>(
            "speed_method", {{"M", SpeedMethod::M}, {"T", SpeedMethod::T}, {"MT", SpeedMethod::MT}});
        p.timer = s.number("timer");
        p.eccentricity = s.number("eccentricity");
        p.eccentricity_phase = s.number("eccentricity_phase");
    } else if (p.kind == PositionSensorKind::resolver) {
        p.bits = s.integer("bits");
        p.window = s.integer("window");
    }
    return p;
}

cgl_memory_config memory(const Section& s, int pole_pairs, double limit, double ts) {
    const auto electrical = s.choice<bool>("period", {{"electrical", true}, {"mechanical", false}});
    return {s.choice<cgl_memory_kind>("memory", {{"angle", CGL_MEMORY_ANGLE}, {"time", CGL_MEMORY_TIME}}),
            s.get<std::uint32_t>("cells"),
            electrical ? static_cast<std::uint32_t>(pole_pairs) : 1U,
            s.get<std::uint32_t>("q_half_width"),
            s.get<std::uint32_t>("lead"),
            s.real("forgetting"),
            static_cast<cgl_real>(limit),
            static_cast<cgl_real>(ts)};
}

CallbackLaw callback(const nb::object& controller) {
    return {[step = nb::object(controller.attr("step"))](const LawInput& in) {
        const nb::gil_scoped_acquire gil;
        const nb::object result = step(in);
        Command command;
        if (nb::isinstance<nb::tuple>(result)) {
            const auto both = nb::cast<nb::tuple>(result);
            if (both.size() != 2) throw nb::type_error("step() returns i_q_ref or (i_d_ref, i_q_ref)");
            command.i_d_ref = nb::cast<double>(both[0]);
            command.i_q_ref = nb::cast<double>(both[1]);
        } else {
            command.i_q_ref = nb::cast<double>(result);
        }
        return command;
    }};
}

SpeedLaw law(const Section& s, const nb::object& controller, int pole_pairs, double ts, double limit) {
    const auto name = s.get<std::string>("law");
    const auto pi = [&] {
        return cgl_pi_config{s.real("kp"), s.real("ki"), static_cast<cgl_real>(ts), static_cast<cgl_real>(limit)};
    };
    if (name == "pi") return PiLaw{pi()};
    if (name == "pi-ilc") {
        return PiIlcLaw{{pi(), s.real("gain"), memory(s, pole_pairs, s.number("limit"), ts)}};
    }
    if (name == "robust-ilc") {
        const double b = s.number("b");
        return RobustIlcLaw{{s.real("b"), s.real("c"), s.real("g"), s.real("eta"), s.real("q"), s.real("beta_1"),
                             s.real("beta_2"), s.real("gamma"), s.real("viscous"), s.real("coulomb"),
                             static_cast<cgl_real>(ts), static_cast<cgl_real>(limit),
                             memory(s, pole_pairs, b * s.number("limit"), ts)}};
    }
    if (name == "anti-cogging") {
        const Section run = s.section("calibration");
        return AntiCoggingLaw{{pi(), s.get<std::uint32_t>("cells"), run.real("speed"),
                               run.get<std::uint32_t>("revolutions"), run.real("position_gain"), s.real("lead")},
                              s.get<std::string>("mode") == "learn"};
    }
    if (name == "library") {
        return open_plugin(s.get<std::string>("library"), s.get<std::vector<double>>("params"), ts);
    }
    if (name == "python") return callback(controller);
    throw std::invalid_argument("controller.law: unknown law " + name);
}

}  // namespace

DriveConfig read_config(const nb::dict& config, const nb::object& controller) {
    const Section top(config, "");
    const Section drive = top.section("drive");
    const Section mechanics = top.section("mechanics");
    const Section load = top.section("load");
    const Section inverter = drive.section("inverter");
    const Section sensors = drive.section("current_sensors");
    const Section belief = drive.section("belief");
    const Section controller_section = top.section("controller");

    const auto current_rate = drive.get<std::int64_t>("current_rate");
    const auto speed_divider = drive.get<std::int64_t>("speed_divider");
    const double period = 1.0 / static_cast<double>(current_rate);
    const double limit = drive.number("current_limit");
    const bool delay = inverter.integer("computation_delay") != 0;

    std::vector<LoadStep> load_steps;
    for (const Section& event : top.sections("events")) {
        load_steps.push_back({std::llround(event.number("time") * static_cast<double>(current_rate)),
                              event.number("load")});
    }
    PmsmConfig motor_config = motor(top.section("motor"));
    const int pole_pairs = motor_config.pole_pairs;
    return {
        .motor = std::move(motor_config),
        .mechanics = {mechanics.number("inertia"), mechanics.number("viscous_friction"),
                      mechanics.number("coulomb_friction"), mechanics.number("breakaway_friction")},
        .load = {load.number("torque"), load.number("lag"), harmonics(load.sections("harmonics")),
                 load.table("angle_table", "angle", "torque"), load.table("time_table", "time", "torque")},
        .load_steps = std::move(load_steps),
        .inverter = {inverter.get<std::string>("kind") == "switched", inverter.number("bus_voltage"),
                     inverter.number("dead_time"), delay},
        .current_sensors = {sensors.phases("offset"), sensors.phases("gain_error"), sensors.number("noise"),
                            sensors.integer("bits"), sensors.number("range"), sensors.integer("sensors")},
        .position_sensor = position_sensor(drive.section("position_sensor")),
        .reference = reference(top.section("reference")),
        .current_loop = {drive.real("kp_d"), drive.real("ki_d"), drive.real("kp_q"), drive.real("ki_q"),
                         static_cast<cgl_real>(period), static_cast<cgl_real>(limit),
                         delay ? CGL_R(1.5) : CGL_R(0.5), drive.get<bool>("decoupling"), belief.real("L_d"),
                         belief.real("L_q"), belief.real("psi_f")},
        .law = law(controller_section, controller, pole_pairs, period * static_cast<double>(speed_divider), limit),
        .current_rate = current_rate,
        .speed_divider = speed_divider,
        .integration_steps = drive.integer("integration_steps"),
        .initial_speed = top.number("initial_speed"),
        .initial_angle = top.number("initial_angle"),
        .learning_start = controller_section.has("learning_start") ? controller_section.number("learning_start") : 0.0,
        .seed = top.get<std::uint64_t>("seed"),
        .energy = top.get<bool>("energy"),
    };
}

}  // namespace cogless
