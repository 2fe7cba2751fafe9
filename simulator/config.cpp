#include "config.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "plugin_library.hpp"
#include "section.hpp"
#include "trial_config.hpp"

namespace cogless {

namespace {

// A number that may be left out.
cgl_real real_or(const Section& s, const char* key, cgl_real otherwise) { return s.has(key) ? s.real(key) : otherwise; }

std::vector<Harmonic> harmonics(const std::vector<Section>& sections) {
    std::vector<Harmonic> all;
    for (const Section& s : sections) all.push_back({s.integer("order"), s.number("torque"), s.number("phase")});
    return all;
}

PmsmConfig motor(const Section& s) {
    PmsmConfig m{s.integer("pole_pairs"), s.number("R_s"), s.number("L_d"), s.number("L_q"), s.number("psi_f"), {},
                 harmonics(s.sections("cogging")), s.has("phases") ? s.integer("phases") : 3};
    if (m.phases != 2 && m.phases != 3) s.refuse("phases", "expected 2 or 3");
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
    return {.kind = s.choice<cgl_memory_kind>("memory", {{"angle", CGL_MEMORY_ANGLE}, {"time", CGL_MEMORY_TIME}}),
            .cells = s.get<std::uint32_t>("cells"),
            .periods_per_rev = electrical ? static_cast<std::uint32_t>(pole_pairs) : 1U,
            .q_half_width = s.get<std::uint32_t>("q_half_width"),
            .lead = s.get<std::uint32_t>("lead"),
            .forgetting = s.real("forgetting"),
            .limit = static_cast<cgl_real>(limit),
            .ts = static_cast<cgl_real>(ts)};
}

// The memory of a space-learning law: a map or the paper's delay line, one channel for each limit.
cgl_space_memory_config space_memory(const Section& s, double ts) {
    const auto limits = reals(s.get<std::vector<double>>("limits"));
    if (limits.empty() || limits.size() > CGL_SPACE_CHANNELS) s.refuse("limits", "expected one to three");
    cgl_space_memory_config m{};
    m.kind = s.choice<cgl_space_kind>("memory", {{"map", CGL_SPACE_MAP}, {"delay", CGL_SPACE_DELAY}});
    m.channels = static_cast<std::uint32_t>(limits.size());
    m.cells = s.get<std::uint32_t>("cells");
    m.turns = s.get<std::uint32_t>("turns");
    if (m.turns < 1) s.refuse("turns", "expected 1 or more");
    m.parts = s.get<std::uint32_t>("parts");
    m.q_half_width = s.get<std::uint32_t>("q_half_width");
    std::copy(limits.begin(), limits.end(), m.limit);
    if (m.kind == CGL_SPACE_DELAY) {
        m.method = s.choice<cgl_delay_method>("method", {{"ode", CGL_DELAY_ODE}, {"inversion", CGL_DELAY_INVERSION}});
        m.k_pp = s.real("k_pp");
    }
    m.ts = static_cast<cgl_real>(ts);
    return m;
}

// A measured angle is within one revolution of the rotor.
template <class SpaceLaw>
SpaceLaw by_rotor(const Section& s, SpaceLaw law) {
    if (law.turns() != 1) s.refuse("turns", "expected whole periods in a revolution, to count by the rotor's angle");
    return law;
}

SpacePositionLaw space_position(const Section& s, int pole_pairs, double ts, double limit) {
    cgl_space_position_config c{};
    c.ratio = s.get<std::uint32_t>("ratio");
    c.k_theta = s.real("k_theta");
    c.k_omega = s.real("k_omega");
    c.k_v = s.real("k_v");
    c.v_0 = s.real("v_0");
    c.v_2 = s.real("v_2");
    c.k_i = s.real("k_i");
    c.mu_alpha = s.real("mu_alpha");
    c.mu_beta = s.real("mu_beta");
    c.mu_h = s.real("mu_h");
    c.hand_over = s.get<bool>("hand_over");
    c.ramp = s.real("ramp");
    c.omega_min = s.real("omega_min");
    c.index = s.choice<cgl_space_index>("index",
                                        {{"reference", CGL_SPACE_BY_REFERENCE}, {"rotor", CGL_SPACE_BY_ROTOR}});
    c.ts = static_cast<cgl_real>(ts);
    c.limit = static_cast<cgl_real>(limit);
    c.memory = space_memory(s, ts);
    const SpacePositionLaw law{c, pole_pairs};
    return c.index == CGL_SPACE_BY_ROTOR ? by_rotor(s, law) : law;
}

SpaceSpeedLaw space_speed(const Section& s, int pole_pairs, double ts, double limit) {
    cgl_space_speed_config c{};
    c.k = s.real("k");
    c.mu_alpha = s.real("mu_alpha");
    c.mu_beta = s.real("mu_beta");
    c.mu_h = s.real("mu_h");
    c.eta_bar = s.real("eta_bar");
    c.omega_min = s.real("omega_min");
    c.limit = static_cast<cgl_real>(limit);
    c.ratio = s.get<std::uint32_t>("ratio");
    c.memory = space_memory(s, ts);
    return by_rotor(s, SpaceSpeedLaw{c, pole_pairs});
}

// samples: of a trial, 0 without trials.
Law law(const Section& s, const CallbackLaw& own, int pole_pairs, double ts, double limit, std::uint32_t samples) {
    const auto name = s.get<std::string>("law");
    const auto pi = [&] {
        return cgl_pi_config{.kp = s.real("kp"), .ki = s.real("ki"), .ts = static_cast<cgl_real>(ts),
                             .limit = static_cast<cgl_real>(limit)};
    };
    if (name == "pi") return PiLaw{pi(), pole_pairs};
    if (name == "pi-ilc") {
        return PiIlcLaw{{.pi = pi(), .gain = s.real("gain"), .memory = memory(s, pole_pairs, s.number("limit"), ts)},
                        pole_pairs};
    }
    if (name == "robust-ilc") {
        const double b = s.number("b");
        return RobustIlcLaw{{.b = s.real("b"), .c = s.real("c"), .g = s.real("g"), .eta = s.real("eta"), .q = s.real("q"),
                             .beta_1 = s.real("beta_1"), .beta_2 = s.real("beta_2"), .gamma = s.real("gamma"),
                             .viscous = s.real("viscous"), .coulomb = s.real("coulomb"),
                             .ts = static_cast<cgl_real>(ts), .limit = static_cast<cgl_real>(limit),
                             .memory = memory(s, pole_pairs, b * s.number("limit"), ts)},
                            pole_pairs};
    }
    if (name == "anti-cogging") {
        const Section run = s.section("calibration");
        return AntiCoggingLaw{{.pi = pi(), .cells = s.get<std::uint32_t>("cells"), .speed = run.real("speed"),
                               .revolutions = run.get<std::uint32_t>("revolutions"),
                               .position_gain = run.real("position_gain"), .lead = s.real("lead")},
                              pole_pairs, s.get<std::string>("mode") == "learn"};
    }
    if (name == "space-position") return space_position(s, pole_pairs, ts, limit);
    if (name == "space-speed") return space_speed(s, pole_pairs, ts, limit);
    if (name == "library") {
        return open_plugin(s.get<std::string>("library"), s.get<std::vector<double>>("params"), ts);
    }
    if (name == "python") {
        if (!own.function) s.refuse("law", "expected an object with step(), for \"python\"");
        return own;
    }
    if (name == "trial") {
        if (samples == 0) throw std::invalid_argument("trials: missing");
        return trial_law(s, 2, samples);
    }
    throw std::invalid_argument("controller.law: unknown law " + name);
}

// Motor, mechanics and load, and where they start; the rest differs with and without trials.
PhaseConfig phase(const Section& s) {
    const Section mechanics = s.section("mechanics");
    const Section load = s.section("load");
    return {
        .motor = motor(s.section("motor")),
        .mechanics = {mechanics.number("inertia"), mechanics.number("viscous_friction"),
                      mechanics.number("coulomb_friction"), mechanics.number("breakaway_friction")},
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
        all.push_back(std::move(p));
    }
    if (all.empty()) s.refuse("phases", "expected one or more");
    return all;
}

std::vector<Fault> faults(const Section& top, std::int64_t current_rate) {
    std::vector<Fault> all;
    // What lasts beyond any run still has a tick.
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

// What the current loop is made of, which an ideal one does not need.
void read_current_loop(const Section& drive, DriveConfig& config) {
    const Section inverter = drive.section("inverter");
    const Section sensors = drive.section("current_sensors");
    const Section belief = drive.section("belief");
    const bool delay = inverter.integer("computation_delay") != 0;
    config.inverter = {inverter.get<std::string>("kind") == "switched", inverter.number("bus_voltage"),
                       inverter.number("dead_time"), delay};
    config.current_sensors = {sensors.phases("offset"), sensors.phases("gain_error"), sensors.number("noise"),
                              sensors.integer("bits"), sensors.number("range"),
                              config.phases.front().motor.phases == 2 ? 2 : sensors.integer("sensors")};
    config.control.foc = {drive.real("kp_d"), drive.real("ki_d"), drive.real("kp_q"), drive.real("ki_q"),
                          config.control.foc.ts, config.control.foc.current_limit,
                          delay ? CGL_R(1.5) : CGL_R(0.5), drive.get<bool>("decoupling"), belief.real("L_d"),
                          belief.real("L_q"), belief.real("psi_f"),
                          static_cast<std::uint32_t>(config.phases.front().motor.phases)};
}

// What watches the measurements, and how well it goes; each value may be left out.
void read_guards(const Section& drive, DriveConfig& config, double law_period) {
    cgl_monitor_config& m = config.control.monitor;
    m.ts = config.control.foc.ts;
    m.phases = config.ideal_current ? 0U : config.control.foc.phases;
    if (drive.has("monitor")) {
        const Section s = drive.section("monitor");
        m.omega_max = real_or(s, "omega_max", m.omega_max);
        m.angle_step = real_or(s, "angle_step", m.angle_step);
        m.speed_window = real_or(s, "speed_window", m.speed_window);
        m.stuck_angle = real_or(s, "stuck_angle", m.stuck_angle);
        m.stuck_time = real_or(s, "stuck_time", m.stuck_time);
        m.current_max = real_or(s, "current_max", m.current_max);
        m.current_sum = real_or(s, "current_sum", m.current_sum);
        m.bridge = real_or(s, "bridge", m.bridge);
        m.hold = real_or(s, "hold", m.hold);
    }
    cgl_quality_config& q = config.control.quality;
    q = {CGL_TWO_PI, CGL_R(60.0), CGL_R(0.0), CGL_R(0.0), static_cast<cgl_real>(law_period)};
    if (drive.has("quality")) {
        const Section s = drive.section("quality");
        q.span = real_or(s, "span", q.span);
        q.longest = real_or(s, "longest", q.longest);
        q.outlier = real_or(s, "outlier", q.outlier);
        q.floor = real_or(s, "floor", q.floor);
    }
}

}  // namespace

DriveConfig read_config(const Value& description, const CallbackLaw& own) {
    const Section top(description, "");
    const Section drive = top.section("drive");
    const Section controller_section = top.section("controller");
    const auto current_rate = drive.get<std::int64_t>("current_rate");
    const auto speed_divider = drive.get<std::int64_t>("speed_divider");
    const double period = 1.0 / static_cast<double>(current_rate);
    const double limit = drive.number("current_limit");

    DriveConfig result{};
    if (top.has("trials")) {
        const Section trials = top.section("trials");
        result.trials = read_trials(trials);
        result.phases = trial_phases(trials, *result.trials, speed_divider);
    } else {
        result.phases = {single_phase(top, current_rate)};
        result.reference = reference(top.section("reference"));
    }
    if (top.has("faults")) result.faults = faults(top, current_rate);
    result.ideal_current = drive.has("ideal_current") && drive.get<bool>("ideal_current");
    result.control.pole_pairs = static_cast<std::uint32_t>(result.phases.front().motor.pole_pairs);
    result.control.divider = static_cast<std::uint32_t>(speed_divider);
    result.control.foreign = result.ideal_current;
    result.control.learn_saturated = result.trials.has_value();
    result.control.foc.ts = static_cast<cgl_real>(period);
    result.control.foc.current_limit = static_cast<cgl_real>(limit);
    if (!result.ideal_current) read_current_loop(drive, result);
    read_guards(drive, result, period * static_cast<double>(speed_divider));
    result.position_sensor = position_sensor(drive.section("position_sensor"));
    result.law = law(controller_section, own, result.phases.front().motor.pole_pairs,
                     period * static_cast<double>(speed_divider), limit,
                     result.trials ? static_cast<std::uint32_t>(result.trials->samples) : 0U);
    result.current_rate = current_rate;
    result.speed_divider = speed_divider;
    result.integration_steps = drive.integer("integration_steps");
    result.learning_start = controller_section.has("learning_start") ? controller_section.number("learning_start") : 0.0;
    result.seed = top.get<std::uint64_t>("seed");
    result.energy = top.get<bool>("energy");
    return result;
}

}  // namespace cogless
