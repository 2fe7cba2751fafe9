#include "drive.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

namespace cogless {

namespace {

std::vector<Signal> signals_of(const DriveConfig& config) {
    std::vector<Signal> all{
        {"time", "s"},       {"theta_m", "rad"},     {"omega_m", "rad/s"}, {"omega_ref", "rad/s"},
        {"omega_measured", "rad/s"},                 {"i_d", "A"},         {"i_q", "A"},
        {"i_d_ref", "A"},    {"i_q_ref", "A"},       {"i_a", "A"},         {"i_b", "A"},
        {"i_c", "A"},        {"u_d", "V"},           {"u_q", "V"},         {"tau_e", "N*m"},
        {"tau_cogging", "N*m"},                      {"tau_load", "N*m"},  {"status", ""},
    };
    std::visit(
        [&all](const auto& law) {
            if constexpr (requires { law.terms; }) {
                for (const char* name : law.terms) all.push_back({name, "A"});
            }
        },
        config.law);
    if (config.energy) {
        for (const char* name : {"electrical", "copper", "friction", "load", "stored"}) {
            all.push_back({std::string("energy_") + name, "J"});
        }
    }
    return all;
}

SpeedLawState start_of(const SpeedLaw& law) {
    return std::visit([](const auto& l) { return SpeedLawState(l.start()); }, law);
}

template <class Law>
auto& state_of(SpeedLawState& state, const Law&) {
    return *std::get_if<typename Law::State>(&state);
}

template <class Law>
const auto& state_of(const SpeedLawState& state, const Law&) {
    return *std::get_if<typename Law::State>(&state);
}

}  // namespace

Drive::Drive(const DriveConfig& config)
    : config_(config),
      period_(1.0 / static_cast<double>(config.current_rate)),
      plant_(config.motor, config.mechanics, config.load, period_ / config.integration_steps),
      position_sensor_(config.position_sensor, period_, period_ * static_cast<double>(config.speed_divider)),
      current_sensors_(config.current_sensors),
      signals_(signals_of(config)) {
    cgl_foc unused;
    require(cgl_foc_init(&config_.current_loop, &unused), "current loop");
    start_of(config_.law);
}

DriveState Drive::start() const {
    DriveState s;
    s.plant = plant_.start(config_.initial_angle, config_.initial_speed);
    s.position = position_sensor_.start(config_.initial_angle, config_.initial_speed);
    s.random = Random(config_.seed);
    s.law = start_of(config_.law);
    cgl_foc_reset(&s.current_loop);
    return s;
}

void Drive::advance(DriveState& s, Recorder& recorder, std::int64_t ticks) const {
    recorder.reserve(ticks);
    Powers::Values z;
    plant_.powers().evaluate(s.plant.theta_m, z);
    for (const std::int64_t end = s.tick + ticks; s.tick < end; ++s.tick) {
        while (s.next_load_step < config_.load_steps.size() &&
               config_.load_steps[s.next_load_step].tick <= s.tick) {
            s.plant.load.target = config_.load_steps[s.next_load_step++].torque;
            if (config_.load.lag <= 0.0) s.plant.load.torque = s.plant.load.target;
        }
        const Phases current = phase_currents(s.plant.i, plant_.motor().axis(z));
        control(s, current);
        if (recorder.wants(s.tick)) record(s, z, current, recorder.next_row());

        const Phases computed{static_cast<double>(s.output.duty[0]), static_cast<double>(s.output.duty[1]),
                              static_cast<double>(s.output.duty[2])};
        const Phases acting = config_.inverter.computation_delay ? s.duty : computed;
        s.duty = computed;
        if (config_.energy) {
            advance_plant<true>(s, z, acting, current);
        } else {
            advance_plant<false>(s, z, acting, current);
        }
    }
}

// Samples, and runs the laws that are due.
void Drive::control(DriveState& s, const Phases& current) const {
    const double t = time(s.tick);
    const bool speed_due = s.tick % config_.speed_divider == 0;
    if (!std::isfinite(s.plant.theta_m + s.plant.omega_m + s.plant.i.d + s.plant.i.q)) {
        throw std::runtime_error("the motor's current or speed grew beyond all numbers: expected smaller gains or steps");
    }
    s.measured = position_sensor_.sample(s.position, t, s.plant.theta_m, s.plant.omega_m, speed_due);
    const Phases i = current_sensors_.measure(current, s.random);

    if (speed_due) {
        s.omega_ref = reference(config_.reference, config_.initial_speed, t);
        const LawInput in{t, s.omega_ref, s.measured.omega_m, s.measured.theta_m,
                          static_cast<double>(s.output.i_d), static_cast<double>(s.output.i_q),
                          static_cast<double>(config_.current_loop.current_limit),
                          period_ * static_cast<double>(config_.speed_divider),
                          t >= config_.learning_start};
        s.command = std::visit([&](const auto& law) { return law.step(state_of(s.law, law), in); }, config_.law);
        if (!std::isfinite(s.command.i_q_ref) || !std::isfinite(s.command.i_d_ref)) {
            const double wrong = std::isfinite(s.command.i_q_ref) ? s.command.i_d_ref : s.command.i_q_ref;
            throw std::runtime_error("returned " + std::to_string(wrong));
        }
    }
    const double pole_pairs = config_.motor.pole_pairs;
    const cgl_foc_input in{
        {static_cast<cgl_real>(i[0]), static_cast<cgl_real>(i[1]), static_cast<cgl_real>(i[2])},
        static_cast<cgl_real>(pole_pairs * s.measured.theta_m),
        static_cast<cgl_real>(pole_pairs * s.measured.omega_m),
        static_cast<cgl_real>(config_.inverter.bus_voltage),
        static_cast<cgl_real>(s.command.i_d_ref),
        static_cast<cgl_real>(s.command.i_q_ref)};
    cgl_foc_step(&config_.current_loop, &s.current_loop, &in, &s.output);
}

template <bool CountEnergy>
void Drive::advance_plant(DriveState& s, Powers::Values& z, const Phases& duty, const Phases& current) const {
    const double start = time(s.tick);
    const double longest = period_ / config_.integration_steps;
    const bool watch = position_sensor_.watches();
    const auto step = [&](Voltage u, double from, double h) {
        plant_.step<CountEnergy>(s.plant, z, u, start + from, h);
        if (watch) position_sensor_.watch(s.position, start + from, start + from + h, s.plant.theta_m);
    };
    if (config_.inverter.switched) {
        const Pulses p = pulses(config_.inverter, duty, current, period_);
        double from = 0.0;
        for (std::size_t n = 0; n < p.count; ++n) {
            const double length = p.stretch[n].until - from;
            const auto steps = static_cast<int>(std::ceil(length / longest - 1e-9));
            for (int k = 0; k < steps; ++k) step(p.stretch[n].u, from + k * length / steps, length / steps);
            from = p.stretch[n].until;
        }
    } else {
        const Voltage u = averaged(config_.inverter, duty, current, period_);
        for (int k = 0; k < config_.integration_steps; ++k) step(u, k * longest, longest);
    }
}

void Drive::record(const DriveState& s, const Powers::Values& z, const Phases& current, double* row) const {
    const double t = time(s.tick);
    const Torques torques = plant_.torques(s.plant, z, t);
    const double values[] = {t,
                             s.plant.theta_m,
                             s.plant.omega_m,
                             s.omega_ref,
                             s.measured.omega_m,
                             s.plant.i.d,
                             s.plant.i.q,
                             s.command.i_d_ref,
                             s.command.i_q_ref,
                             current[0],
                             current[1],
                             current[2],
                             static_cast<double>(s.output.u_d),
                             static_cast<double>(s.output.u_q),
                             torques.electromagnetic,
                             torques.cogging,
                             torques.load,
                             static_cast<double>(s.command.status | s.output.status)};
    for (const double value : values) *row++ = value;
    std::visit(
        [&](const auto& law) {
            if constexpr (requires { law.terms; }) {
                law.read_terms(state_of(s.law, law), row);
                row += law.terms.size();
            }
        },
        config_.law);
    if (config_.energy) {
        const Energy& e = s.plant.energy;
        for (const double value : {e.electrical, e.copper, e.friction, e.load, plant_.stored_energy(s.plant, z)}) {
            *row++ = value;
        }
    }
}

LearnedMap Drive::learned(const DriveState& state) const {
    return std::visit(
        [&state](const auto& law) {
            if constexpr (requires { law.learned(state_of(state.law, law)); }) {
                return law.learned(state_of(state.law, law));
            } else {
                return LearnedMap{};
            }
        },
        config_.law);
}

void Drive::teach(DriveState& state, const std::vector<double>& table) const {
    std::visit(
        [&](const auto& law) {
            if constexpr (requires { law.teach(state_of(state.law, law), table); }) {
                law.teach(state_of(state.law, law), table);
            } else {
                throw std::invalid_argument("this law has no table");
            }
        },
        config_.law);
}

}  // namespace cogless
