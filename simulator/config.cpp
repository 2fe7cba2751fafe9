#include "config.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>

#include "plugin_library.hpp"
#include "section.hpp"
#include "trial_config.hpp"

namespace cogless {

namespace {

std::vector<Harmonic> harmonics(const std::vector<Section>& sections) {
    std::vector<Harmonic> all;
    for (const Section& s : sections) all.push_back({s.integer("order"), s.number("torque"), s.number("phase")});
    return all;
}

ThermalConfig thermal(const Section& s) {
    const bool drifts = s.get<bool>("drifts");
    const auto of_drift = [&](const char* key) { return drifts ? s.number(key) : 0.0; };
    return {s.number("reference"), s.number("resistance_coefficient"), s.number("flux_coefficient"),
            {s.number("winding"), s.number("magnet")}, drifts, of_drift("ambient"), of_drift("winding_capacity"),
            of_drift("magnet_capacity"), of_drift("winding_to_ambient"), of_drift("winding_to_magnet"),
            of_drift("magnet_to_ambient")};
}

// A curve of flux over current. If it is not given, its inductance is constant.
Curve curve(const Section& curves, const char* name, double inductance) {
    if (!curves.has(name)) return {{0.0, 1.0}, {0.0, inductance}, {inductance, inductance}};
    const Section s = curves.section(name);
    return {s.get<std::vector<double>>("current"), s.get<std::vector<double>>("flux"), s.get<std::vector<double>>("slope")};
}

PmsmConfig motor(const Section& s) {
    PmsmConfig m{s.integer("pole_pairs"), s.number("R_s"), s.number("L_d"), s.number("L_q"), s.number("psi_f"), {},
                 harmonics(s.sections("cogging")), s.has("phases") ? s.integer("phases") : 3};
    if (m.phases != 2 && m.phases != 3) s.refuse("phases", "expected 2 or 3");
    for (const Section& h : s.sections("flux_harmonics")) {
        m.flux_harmonics.push_back({h.integer("order") * m.pole_pairs, h.number("d"), h.number("q"), h.number("d_phase"),
                                    h.number("q_phase")});
    }
    if (s.has("torque_ripple")) {  // by orders of the mechanical revolution, in psi_d alone
        for (const Section& h : s.sections("torque_ripple")) {
            m.flux_harmonics.push_back({h.integer("order"), h.number("share") * m.psi_f, 0.0,
                                        h.number("phase") - 0.5 * std::numbers::pi, 0.0});
        }
    }
    if (s.has("saturation")) {
        const Section curves = s.section("saturation");
        m.saturation = std::make_shared<Saturation>(Saturation{curve(curves, "d", m.L_d), curve(curves, "q", m.L_q),
                                                               curve(curves, "cross", 0.0)});
    }
    if (s.has("temperature")) m.thermal = thermal(s.section("temperature"));
    return m;
}

ReferenceConfig reference(const Section& s) {
    ReferenceConfig r;
    r.kind = s.choice<ReferenceKind>("kind", {{"constant", ReferenceKind::constant},
                                              {"ramp", ReferenceKind::ramp},
                                              {"profile", ReferenceKind::profile},
                                              {"sine", ReferenceKind::sine},
                                              {"fm", ReferenceKind::fm},
                                              {"sines", ReferenceKind::sines},
                                              {"moves", ReferenceKind::moves}});
    if (s.has("smoothing")) r.smoothing = s.number("smoothing");
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
        case ReferenceKind::fm:
            r.depth = s.number("depth");
            r.modulation = s.number("modulation");
            [[fallthrough]];
        case ReferenceKind::sine:
            r.offset = s.number("offset");
            r.amplitude = s.number("amplitude");
            r.frequency = s.number("frequency");
            break;
        case ReferenceKind::sines:
            r.offset = s.number("offset");
            for (const Section& sine : s.sections("sines")) {
                r.sines.push_back({sine.number("amplitude"), sine.number("frequency"), sine.number("phase")});
            }
            break;
        case ReferenceKind::moves:
            r.moves = {s.get<std::vector<double>>("times"), s.get<std::vector<double>>("angles")};
            if (r.moves.at.empty() || r.moves.at.size() != r.moves.value.size() ||
                std::adjacent_find(r.moves.at.begin(), r.moves.at.end(), std::greater_equal<>()) != r.moves.at.end()) {
                s.refuse("times", "expected rising times, one for each angle");
            }
            break;
    }
    return r;
}

PositionSensorConfig position_sensor(const Section& s) {
    PositionSensorConfig p;
    p.kind = s.choice<PositionSensorKind>("kind", {{"ideal", PositionSensorKind::ideal},
                                                   {"encoder", PositionSensorKind::encoder},
                                                   {"absolute", PositionSensorKind::absolute},
                                                   {"resolver", PositionSensorKind::resolver},
                                                   {"hall", PositionSensorKind::hall}});
    if (p.kind == PositionSensorKind::ideal) return p;
    p.counts = s.number("counts");
    if (s.has("window")) p.window = s.integer("window");
    if (s.has("timer")) p.timer = s.number("timer");
    if (p.kind == PositionSensorKind::hall) {
        const std::vector<double> placement = s.numbers("placement", p.placement.size());
        std::copy(placement.begin(), placement.end(), p.placement.begin());
        return p;
    }
    p.speed_method = s.choice<SpeedMethod>("speed_method", {{"M", SpeedMethod::M},
                                                            {"average", SpeedMethod::average},
                                                            {"T", SpeedMethod::T},
                                                            {"MT", SpeedMethod::MT},
                                                            {"observer", SpeedMethod::observer}});
    if (p.speed_method == SpeedMethod::observer) p.bandwidth = s.number("bandwidth");
    if (s.has("error")) {
        for (const Section& e : s.sections("error")) {
            p.error.push_back({e.integer("order"), e.number("amplitude"), e.number("phase")});
        }
    }
    p.error_table = s.table("error_table", "angle", "error");
    if (s.has("latency")) p.latency = s.number("latency");
    return p;
}

// The control library's law of that name.
Law c_law(const std::string& name, const Section& s, const cgl_loop& loop) {
#define CGL_LAW_WITHOUT_MEMORY(law, stem, header, step_function) \
    if (name == law) return LawOf<stem##_row>::of(s, loop);
#include "cogless/laws.def"
    s.refuse("law", "unknown law " + name);
}

cogless_plugin_drive plugin_drive(const Section& s) {
    return {s.number("pole_pairs"), s.number("phases"), s.number("slots"), s.number("R_s"), s.number("L_d"), s.number("L_q"),
            s.number("psi_f"), s.number("torque_constant"), s.number("inertia"), s.number("current_limit"),
            s.number("current_bandwidth"), s.number("current_period"), s.number("delay")};
}

// What a law's init gets to know of its drive. period: of the current loop, s. Throws std::invalid_argument if the control library
// refuses the configuration of the drive or of its current reference.
cgl_loop loop_of(const cgl_drive_config& control, const std::optional<cgl_current_reference_config>& currents, cgl_real period) {
    cgl_drive drive;
    const cgl_error error = cgl_drive_init(&drive, &control, period);
    if (error != CGL_OK) require(error, "drive.control", cgl_drive_bad_field(&control, period));
    if (currents) {
        cgl_current_reference unused;
        require(cgl_current_reference_init(&unused, &*currents, &drive), "drive.current_reference",
                cgl_current_reference_bad_field(&*currents, control.foc.current_limit));
    }
    return drive.loop;
}

// The law that the section names. own: the user's law, for "python". period: of the current loop, s.
Law law(const Section& s, CallbackLaw own, double period, const cgl_drive_config& control,
        const std::optional<cgl_current_reference_config>& currents, const std::optional<Trials>& trials) {
    const auto ts = static_cast<cgl_real>(period);
    const auto current_limit = static_cast<double>(currents ? loop_of(control, currents, ts).current_limit : control.foc.current_limit);
    const auto name = s.get<std::string>("law");
    if (name == "library") {
        return open_plugin(s.get<std::string>("library"), s.get<std::vector<double>>("params"), plugin_drive(s.section("drive")),
                           period * static_cast<double>(control.divider), current_limit);
    }
    if (name == "python") {
        if (!own.function) s.refuse("law", "expected an object with step(), for \"python\"");
        own.current_limit = current_limit;
        return own;
    }
    if (name == MicrosteppingLaw::name) return MicrosteppingLaw::of(s);
    return trials && name == TrialLaw::name ? trial_law(s, 2, *trials) : c_law(name, s, loop_of(control, currents, ts));
}

FrictionConfig friction(const Section& s) {
    FrictionConfig f{s.number("viscous_friction"), s.number("coulomb_friction"), s.number("breakaway_friction")};
    if (s.has("stribeck_speed")) f.stribeck_speed = s.number("stribeck_speed");
    if (s.has("friction_harmonics")) f.harmonics = harmonics(s.sections("friction_harmonics"));
    f.table = s.table("friction_table", "angle", "torque");
    return f;
}

MechanicsConfig mechanics(const Section& s) {
    MechanicsConfig m{s.number("inertia"), friction(s)};
    if (!s.has("load_side")) return m;
    const Section side = s.section("load_side");
    m.load_side = {side.number("inertia"), friction(side), side.number("stiffness"), side.number("damping"),
                   side.number("backlash"), side.number("ratio")};
    for (const Section& e : side.sections("gear_errors")) {
        const bool input = e.choice<bool>("side", {{"input", true}, {"output", false}});
        (input ? m.load_side->input_errors : m.load_side->output_errors)
            .push_back({e.integer("order"), e.number("angle"), e.number("phase")});
    }
    return m;
}

// Reads motor, mechanics, load and their initial state. The other keys of a phase differ with and without trials.
PhaseConfig phase(const Section& s) {
    const Section load = s.section("load");
    return {
        .motor = motor(s.section("motor")),
        .mechanics = mechanics(s.section("mechanics")),
        .load = {load.number("torque"), load.number("lag"), harmonics(load.sections("harmonics")),
                 load.table("angle_table", "angle", "torque"), load.table("time_table", "time", "torque")},
        .load_steps = {},
        .initial_speed = s.number("initial_speed"),
        .initial_angle = s.number("initial_angle"),
    };
}

PhaseConfig single_phase(const Section& top, std::int64_t current_rate) {
    PhaseConfig p = phase(top);
    for (const Section& event : top.sections("events")) {
        p.load_steps.push_back({std::llround(event.number("time") * static_cast<double>(current_rate)),
                                event.number("load")});
    }
    return p;
}

std::vector<PhaseConfig> trial_phases(const Section& s, const Trials& trials, std::int64_t speed_divider) {
    std::vector<PhaseConfig> all;
    std::int64_t before = -1;
    for (const Section& section : s.sections("phases")) {
        PhaseConfig p = phase(section);
        p.from = before = first_trial(section, before, trials);
        p.trajectory = reals(section.numbers("reference", static_cast<std::size_t>(trials.samples)));
        std::int64_t last = 0;
        for (const Section& step : section.sections("load_steps")) {
            const auto sample = step.get<std::int64_t>("sample");
            if (sample < last || sample >= trials.samples) step.refuse("sample", "expected samples of the trial in order");
            last = sample;
            p.load_steps.push_back({sample * speed_divider, step.number("torque")});
        }
        if (section.has("each_trial")) {
            const Section spread = section.section("each_trial");
            p.each_trial = {deviation(spread.section("initial_angle")), deviation(spread.section("initial_speed")),
                            deviation(spread.section("load"))};
        }
        all.push_back(std::move(p));
    }
    if (all.empty()) s.refuse("phases", "expected one or more");
    return all;
}

std::vector<Fault> faults(const Section& top, std::int64_t current_rate) {
    std::vector<Fault> all;
    // A time beyond any run still needs a tick that an integer can hold.
    const auto tick = [&](double time) { return std::llround(std::min(time * static_cast<double>(current_rate), 0x1p62)); };
    for (const Section& s : top.sections("faults")) {
        Fault f{s.choice<FaultKind>("kind", {{"angle-missing", FaultKind::angle_missing},
                                             {"angle-jump", FaultKind::angle_jump},
                                             {"angle-stuck", FaultKind::angle_stuck},
                                             {"current-missing", FaultKind::current_missing},
                                             {"current-zero", FaultKind::current_zero},
                                             {"bus-voltage", FaultKind::bus_voltage}}),
                tick(s.number("time")), tick(s.number("time") + s.number("duration")), 0.0, 0};
        if (f.kind == FaultKind::angle_jump) f.size = s.number("angle");
        if (f.kind == FaultKind::bus_voltage) f.size = s.number("voltage");
        if (f.kind == FaultKind::current_missing || f.kind == FaultKind::current_zero) {
            f.phase = s.choice<std::size_t>("phase", {{"a", 0}, {"b", 1}, {"c", 2}});
        }
        all.push_back(f);
    }
    return all;
}

// Inverter and current sensors, which an ideal current loop does not need.
void read_bridge(const Section& drive, DriveConfig& config) {
    const Section inverter = drive.section("inverter");
    const Section sensors = drive.section("current_sensors");
    const auto pwm = inverter.choice<Pwm>("pwm", {{"centre", Pwm::centre}, {"edge", Pwm::edge}, {"two-updates", Pwm::two_updates}});
    config.inverter = {inverter.get<std::string>("kind") == "switched", pwm, inverter.number("bus_voltage"),
                       inverter.number("dead_time"), inverter.number("minimum_pulse"), inverter.number("device_drop"),
                       inverter.integer("computation_delay") != 0};
    config.current_sensors = {sensors.phases("offset"), sensors.phases("gain_error"), sensors.number("noise"),
                              sensors.integer("bits"), sensors.number("range"),
                              config.phases.front().motor.phases == 2 ? 2 : sensors.integer("sensors")};
}

}  // namespace

DriveConfig read_config(const Value& description, const CallbackLaw& own) {
    const Section top(description, "");
    const Section drive = top.section("drive");
    const Section controller_section = top.section("controller");
    const auto current_rate = drive.get<std::int64_t>("current_rate");

    DriveConfig result{};
    result.control = drive.packed<cgl_drive_config>("control");
    result.ideal_current = result.control.foreign;
    result.speed_divider = result.control.divider;
    result.current_rate = current_rate;
    if (top.has("trials")) {
        const Section trials = top.section("trials");
        result.trials = read_trials(trials);
        result.phases = trial_phases(trials, *result.trials, result.speed_divider);
    } else {
        result.phases = {single_phase(top, current_rate)};
        result.reference = reference(top.section("reference"));
    }
    if (top.has("torque_mode")) {
        const Section mode = top.section("torque_mode");
        result.torque_mode = {mode.number("from"), mode.number("until"), mode.table("current", "time", "value")};
        if (result.torque_mode->current.empty()) mode.refuse("current", "expected one or more points");
    }
    if (top.has("faults")) result.faults = faults(top, current_rate);
    if (!result.ideal_current) read_bridge(drive, result);
    if (drive.has("encoder_table")) result.encoder_table = drive.packed<cgl_encoder_table_config>("encoder_table");
    if (drive.has("speed_filter")) result.speed_filter = {static_cast<cgl_real>(drive.number("speed_filter"))};
    if (drive.has("bus")) {
        const Section bus = drive.section("bus");
        result.bus = {bus.number("delay_measured"), bus.number("delay_command"), bus.number("jitter"), bus.number("quantum")};
    }
    if (drive.has("current_reference")) {
        result.current_reference = drive.packed<cgl_current_reference_config>("current_reference");
    }
    if (drive.has("dead_time")) {
        result.dead_time = drive.packed<cgl_dead_time_config>("dead_time");
    }
    result.position_sensor = position_sensor(drive.section("position_sensor"));
    result.sensor_on_load =
        drive.section("position_sensor").has("side") &&
        drive.section("position_sensor").choice<bool>("side", {{"motor", false}, {"load", true}});
    result.law = law(controller_section, own, 1.0 / static_cast<double>(current_rate), result.control, result.current_reference,
                     result.trials);
    result.integration_steps = drive.integer("integration_steps");
    result.holds_position = controller_section.has("holds_position") && controller_section.get<bool>("holds_position");
    result.learning_start = controller_section.has("learning_start") ? controller_section.number("learning_start") : 0.0;
    result.seed = top.get<std::uint64_t>("seed");
    result.energy = top.get<bool>("energy");
    if (top.has("rows_per_period")) result.rows_per_period = top.integer("rows_per_period");
    return result;
}

}  // namespace cogless
