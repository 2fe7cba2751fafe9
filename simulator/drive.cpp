#include "drive.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <stdexcept>
#include <string>

#include "angle_patch.hpp"
#include "cogless/angle.h"
#include "cogless/transform.h"
#include "open_bridge.hpp"

namespace cogless {

namespace {

constexpr double brief_share = 0.25;  // longest brief step per nominal step: of order 3, it errs by at most 1/256 of what it would over a whole one
constexpr int open_steps = 32;  // steps in a period with an open bridge, small enough for the diodes to switch in time

// advance_plant()'s before_step for a period without rows of the trace within it.
constexpr auto no_rows = [](const auto&...) {};

int motor_phases(const DriveConfig& config) { return config.phases.front().motor.phases; }
bool has_load_side(const DriveConfig& config) { return config.phases.front().mechanics.load_side.has_value(); }

// A law that follows its reference's angle; its turns() is the number of revolutions after which that angle wraps.
template <class One>
concept FollowsAngle = requires(const One& law) { law.turns(); };

bool follows_angle(const DriveConfig& config) {
    return config.holds_position || std::visit([]<class One>(const One&) { return FollowsAngle<One>; }, config.law);
}

// Whether the law is a user's that acts in each period of the current loop, too.
bool steps_currents(const Law& law) {
    return std::visit(
        [](const auto& l) {
            if constexpr (requires { l.has_current_step(); }) return l.has_current_step();
            return false;
        },
        law);
}

// A law that may learn from one trial to the next.
template <class One>
concept TakesTrials = requires(const One& law, typename One::State& s) { law.end(s); };

bool takes_trials(const Law& law) {
    return std::visit([]<class One>(const One&) { return TakesTrials<One>; }, law);
}

// Appends the signals of the terms of a law's output, if it has any.
void append_terms(std::vector<Signal>& all, const Law& law) {
    std::visit(
        [&all](const auto& l) {
            if constexpr (requires { l.terms(); }) {
                for (const Term& term : l.terms()) all.push_back({term.name, term.unit});
            } else if constexpr (requires { l.has_learned(); }) {
                if (l.has_learned()) all.push_back({"term_learned", "A"});
            }
        },
        law);
}

std::vector<Signal> signals_of(const DriveConfig& config) {
    const bool trials = config.trials.has_value(), trial_law = std::holds_alternative<TrialLaw>(config.law);
    const bool electrical = !config.ideal_current, energy = config.energy;
    const bool three_phases = motor_phases(config) == 3, path = follows_angle(config);
    const bool load_side = has_load_side(config), within_periods = config.rows_per_period > 1;
    const bool thermal = config.phases.front().motor.thermal.has_value();
    std::vector<Signal> all;
#define CGL_SIGNAL(name, unit, about, when, value) \
    if (when) all.push_back({name, unit});
#define CGL_TERMS append_terms(all, config.law);
#include "signals.def"
#undef CGL_SIGNAL
#undef CGL_TERMS
    return all;
}

int turns_of(const Law& law) {
    return std::visit(
        []<class One>(const One& l) {
            if constexpr (FollowsAngle<One>) {
                return l.turns();
            } else {
                return 1;
            }
        },
        law);
}

// Limits a duty cycle from outside to [0, 1]. NaN becomes one half, which is zero voltage.
cgl_real possible(cgl_real duty) {
    return duty >= CGL_R(0.0) && duty <= CGL_R(1.0) ? duty : CGL_R(0.5) + cgl_clamp(duty - CGL_R(0.5), CGL_R(0.5));
}

// The angle theta, shifted by whole revolutions to be nearest to `other`.
double near(double theta, double other) {
    constexpr double turn = 2.0 * std::numbers::pi;
    return theta + turn * std::round((other - theta) / turn);
}

LawState start_of(const Law& law) {
    return std::visit([](const auto& l) { return LawState(l.start()); }, law);
}

template <class One>
auto& state_of(LawState& state, const One&) {
    return *std::get_if<typename One::State>(&state);
}

template <class One>
const auto& state_of(const LawState& state, const One&) {
    return *std::get_if<typename One::State>(&state);
}

// Writes the terms of the last step to `row`, and returns the position after them.
double* put_terms(const Law& law, const LawState& state, double* row) {
    return std::visit(
        [&](const auto& l) {
            if constexpr (requires { l.terms(); }) {
                return l.put_terms(state_of(state, l), row);
            } else if constexpr (requires { l.has_learned(); }) {
                if (!l.has_learned()) return row;
                *row = l.learned(state_of(state, l));
                if (!std::isfinite(*row)) {
                    throw std::runtime_error("i_q_learned: " + std::to_string(*row) + ": expected a finite current");
                }
                return row + 1;
            } else {
                return row;
            }
        },
        law);
}

}  // namespace

Drive::Drive(const DriveConfig& config)
    : config_(config),
      current_rate_(static_cast<double>(config.current_rate)),
      period_(1.0 / current_rate_),
      step_(period_ / config.integration_steps),
      dead_share_(config.inverter.dead_time / period_),
      least_duty_(least_duty(config.inverter, period_)),
      follows_angle_(follows_angle(config)),
      steps_currents_(steps_currents(config.law)),
      turns_(2.0 * std::numbers::pi * turns_of(config.law)),
      reference_(config.reference, config.phases.front().initial_angle, config.phases.front().initial_speed,
                 period_ * static_cast<double>(config.speed_divider)),
      position_sensor_(config.position_sensor, period_, period_ * static_cast<double>(config.speed_divider)),
      current_sensors_(config.current_sensors),
      signals_(signals_of(config)) {
    if (config_.ideal_current) {
        if (config_.energy) throw std::invalid_argument("energy: not with an ideal current loop, which has no voltage");
        if (!(config_.control.foc.current_limit > CGL_R(0.0))) {
            throw std::invalid_argument("drive.current_limit: expected more than 0");
        }
    } else {
        cgl_foc unused;
        require(cgl_foc_init(&unused, &config_.control.foc, static_cast<cgl_real>(period_)), "current loop");
        if (static_cast<int>(config_.control.foc.phases) != motor_phases(config_)) {
            throw std::invalid_argument("drive.control: expected as many phases as the motor has");
        }
    }
    if (config_.rows_per_period != 1 && (config_.rows_per_period < 1 || config_.ideal_current || !config_.inverter.switched)) {
        throw std::invalid_argument("rows_per_period: expected 1, or more with a switched inverter");
    }
    if (!(least_duty_ < 0.5)) {
        throw std::invalid_argument("drive.inverter.minimum_pulse: expected a shorter one, so that there are pulses");
    }
    if (config_.dead_time) {
        require(cgl_dead_time_init(&dead_time_start_, &*config_.dead_time, static_cast<cgl_real>(period_)),
                "dead-time compensation");
    }
    if (config_.encoder_table) {
        require(cgl_encoder_table_init(&encoder_table_start_, &*config_.encoder_table, static_cast<cgl_real>(period_)),
                "encoder table");
    }
    if (config_.speed_filter) {
        require(cgl_low_pass_init(&speed_filter_start_, &*config_.speed_filter, static_cast<cgl_real>(period_)), "speed filter");
    }
    if (config_.bus) bus_.emplace(*config_.bus, period_, law_period());
    cgl_drive unused;
    const auto period = static_cast<cgl_real>(period_);
    require(cgl_drive_init(&unused, &config_.control, period), "drive.control", cgl_drive_bad_field(&config_.control, period));
    if (config_.trials ? !takes_trials(config_.law) : std::holds_alternative<TrialLaw>(config_.law)) {
        throw std::invalid_argument("controller.law: expected \"trial\" or a law of your own with trials, \"trial\" only with them");
    }
    if (config_.bus && steps_currents_) {
        throw std::invalid_argument("bus: expected a law without current_step(), which runs in the drive");
    }
    if (config_.torque_mode && (std::holds_alternative<MicrosteppingLaw>(config_.law) ||
                                std::holds_alternative<CallbackLaw>(config_.law) || std::holds_alternative<PluginLaw>(config_.law))) {
        throw std::invalid_argument("torque_mode: expected a law of the control library");
    }
    if (config_.current_reference) {
        if (config_.bus || steps_currents_) {
            throw std::invalid_argument("current_reference: expected a law in the drive, without current_step()");
        }
        require(cgl_current_reference_init(&current_reference_, &*config_.current_reference, &unused), "drive.current_reference",
                cgl_current_reference_bad_field(&*config_.current_reference, config_.control.foc.current_limit));
    }
    start_of(config_.law);
    for (const PhaseConfig& p : config_.phases) {
        if (p.motor.phases != motor_phases(config_)) {
            throw std::invalid_argument("motor.phases: expected the same in every phase of the trials");
        }
        if (p.mechanics.load_side.has_value() != has_load_side(config_)) {
            throw std::invalid_argument("mechanics.load_side: expected in every phase of the trials, or in none");
        }
        const Plant cold(p.motor, p.mechanics, p.load, step_);
        if (config_.sensor_on_load && !has_load_side(config_)) {
            throw std::invalid_argument("drive.position_sensor.side: expected a load side in the mechanics");
        }
        Plant plant = cold;
        if (p.motor.thermal) plant.warm(cold, p.motor.thermal->warmth(p.motor.thermal->start));
        const bool drifts = p.motor.thermal && p.motor.thermal->drifts;
        const PlantState<> begin = plant.start(p.initial_angle, p.initial_speed);
        phases_.push_back({p, plant, drifts ? std::optional(cold) : std::nullopt, begin,
                           config_.sensor_on_load ? position_sensor_.start(begin.side.theta, begin.side.omega)
                                                  : position_sensor_.start(p.initial_angle, p.initial_speed)});
    }
}

DriveState Drive::start() const {
    DriveState s{};
    cgl_drive_init(&s.control, &config_.control, static_cast<cgl_real>(period_));
    if (config_.current_reference) {
        cgl_current_reference unused;
        cgl_current_reference_init(&unused, &*config_.current_reference, &s.control);
    }
    s.encoder_table = encoder_table_start_;
    s.bus.random = Random(~config_.seed);  // a stream of its own, so that a bus does not change the sensors' noise
    if (const auto& thermal = phases_.front().config.motor.thermal) s.temperature = thermal->start;
    restart(s, phases_.front(), 0);
    s.random = Random(config_.seed);
    s.law = start_of(config_.law);
    s.reference_filter = reference_.start();
    return s;
}

void Drive::restart(DriveState& s, const Phase& phase, std::int64_t trial) const {
    double angle = phase.config.initial_angle, speed = phase.config.initial_speed;
    s.plant = phase.plant_start;
    s.position = phase.position_start;
    s.load_deviation = 0.0;
    if (const auto& spread = phase.config.each_trial) {
        Random random = random_of_trial(config_.seed, trial);
        angle += spread->initial_angle.draw(random);
        speed += spread->initial_speed.draw(random);
        s.load_deviation = spread->load.draw(random);
        s.plant = phase.plant.start(angle, speed);
        if (config_.sensor_on_load) {
            position_sensor_.restart(s.position, s.plant.side.theta, s.plant.side.omega);
        } else {
            position_sensor_.restart(s.position, angle, speed);
        }
    }
    const double more = s.added_load + s.load_deviation;
    s.plant.load.torque += more;
    s.plant.load.target += more;
    if (const auto& thermal = phase.config.motor.thermal; thermal && !thermal->drifts) s.temperature = thermal->start;
    cgl_drive_reset(&s.control);
    s.dead_time = dead_time_start_;
    s.speed_filter = speed_filter_start_;
    cgl_low_pass_reset(&s.speed_filter, static_cast<cgl_real>(speed));
    if (bus_) bus_->restart(s.bus, angle, speed);
    s.asked = {};
    s.output = {};
    s.duty = s.applied = {0.5, 0.5, 0.5};
    s.open = false;
    s.next_load_step = 0;
}

void Drive::add_load(DriveState& s, double torque) const {
    const double more = torque - s.added_load;
    if (more == 0.0) return;
    s.plant.load.torque += more;
    s.plant.load.target += more;
    s.added_load = torque;
}

void Drive::advance(DriveState& s, Recorder& recorder, std::int64_t ticks, Controller* other) const {
    recorder.reserve(s.tick, ticks, config_.rows_per_period);
    if (config_.trials) {
        advance_trials(s, recorder, s.tick + ticks, other);
    } else {
        advance_within(s, recorder, phases_.front(), 0, s.tick + ticks, other);
    }
}

void Drive::advance_trials(DriveState& s, Recorder& recorder, std::int64_t end, Controller* other) const {
    const std::int64_t length = config_.trials->samples * config_.speed_divider;
    require_trials(*config_.trials, (end + config_.speed_divider - 1) / config_.speed_divider);
    while (s.tick < end) {
        const std::int64_t trial = s.tick / length, origin = trial * length;
        const Phase& phase = phases_[phase_of(config_.phases, trial)];
        if (s.tick == origin) {
            restart(s, phase, trial);
            begin_law(s, phase.config.trajectory);
            if (other != nullptr) other->begin(phase.config.trajectory);
        }
        try {
            advance_within(s, recorder, phase, origin, std::min(end, origin + length), other);
        } catch (const std::runtime_error& error) {
            fail_in_trial(trial, error.what());
        }
        if (s.tick == origin + length) {
            end_trial(s);  // learns nothing if another controller made the trial's steps
            if (other != nullptr) other->end();
        }
    }
}

cgl_drive_output Drive::step_controller(DriveState& s, const cgl_measurement& now, const cgl_reference& reference) const {
    s.asked = reference;
    s.sampled = now;
    if (cgl_drive_measure(&s.control, &s.sampled, &s.asked)) step_law<star_legs>(s);
    actuate(s);
    return s.output;
}

std::pair<bool, Measurement> Drive::measure_controller(DriveState& s, const cgl_measurement& now,
                                                       const cgl_reference& reference) const {
    s.asked = reference;
    s.sampled = now;
    const bool due = cgl_drive_measure(&s.control, &s.sampled, &s.asked);
    return {due, believed(s)};
}

BusCommand Drive::law_controller(DriveState& s, const Measurement& then) const { return far_law<star_legs>(s, then); }

cgl_drive_output Drive::actuate_controller(DriveState& s, const BusCommand* received) const {
    receive(s, received);
    actuate(s);
    return s.output;
}

void Drive::begin_trial(DriveState& s, const std::vector<cgl_real>& trajectory) const {
    const std::size_t samples = config_.trials ? static_cast<std::size_t>(config_.trials->samples) : 0U;
    if (trajectory.size() != samples) throw std::invalid_argument("trajectory: expected a number for each sample");
    cgl_drive_reset(&s.control);
    begin_law(s, trajectory);
}

void Drive::begin_law(DriveState& s, const std::vector<cgl_real>& trajectory) const {
    std::visit(
        [&]<class One>(const One& law) {
            if constexpr (TakesTrials<One>) law.begin(state_of(s.law, law), trajectory);
        },
        config_.law);
}

void Drive::end_trial(DriveState& s) const {
    std::visit(
        [&]<class One>(const One& law) {
            if constexpr (TakesTrials<One>) law.end(state_of(s.law, law));
        },
        config_.law);
}

template <class F>
void Drive::specialised(const F& f) const {
    const auto electrical = [&]<std::size_t legs> {
        if (config_.energy) {
            f.template operator()<legs, Detail::energies>();
        } else {
            f.template operator()<legs, Detail::currents>();
        }
    };
    if (config_.ideal_current) {
        f.template operator()<0, Detail::mechanics>();
    } else if (motor_phases(config_) == 2) {
        electrical.template operator()<bridge_legs>();
    } else {
        electrical.template operator()<star_legs>();
    }
}

void Drive::advance_within(DriveState& s, Recorder& recorder, const Phase& phase, std::int64_t origin, std::int64_t end,
                           Controller* other) const {
    std::optional<Phase> warm;
    if (phase.cold) warm_up(s, warm.emplace(phase));
    specialised([&]<std::size_t legs, Detail detail> {
        run<legs, detail>(s, recorder, warm ? *warm : phase, warm ? &*warm : nullptr, origin, end, other);
    });
}

void Drive::warm_up(const DriveState& s, Phase& phase) {
    phase.plant.warm(*phase.cold, phase.config.motor.thermal->warmth(s.temperature));
}

template <std::size_t legs, Detail detail>
void Drive::run(DriveState& s, Recorder& recorder, const Phase& phase, Phase* warm, std::int64_t origin, std::int64_t end,
                Controller* other) const {
    const Plant::Exact<detail> exact(phase.plant);
    AnglePatch patch(phase.plant.angle());
    const bool switched = legs != 0 && config_.inverter.switched, within_periods = config_.rows_per_period > 1;
    AtAngle<double> here{};
    if (!switched) here = exact(s.plant.theta_m);
    Every law(config_.speed_divider, s.tick), row = recorder.rows(s.tick);
    Faults faults = faults_at(s.tick);
    for (; s.tick < end; ++s.tick) {
        if (switched) {
            patch.move_to(s.plant.theta_m, 0.5 * period_ * s.plant.omega_m);
            here = patch(s.plant.theta_m);
        }
        step_load(s, phase, origin, s.plant.load.torque, s.plant.load.target);
        Phases current{};
        if constexpr (legs != 0) current = phase_currents<legs>(s.plant.i, here.axis);
        if (s.tick >= faults.until) faults = faults_at(s.tick);
        control<legs>(s, phase, origin, law.next(), current, faults, other);
        const bool row_due = row.next();
        if (row_due && !within_periods) record<legs>(s, here, phase, origin, current, recorder.next_row());
        Acting acting{};
        if constexpr (legs != 0) next_duties(s, acting);
        const Currents<> before = s.plant.i;
        if (row_due && within_periods) {
            advance_with_rows<legs, detail>(s, here, patch, phase, origin, acting, current, faults, recorder);
        } else {
            advance_plant<legs, detail>(s, here, patch, phase, origin, acting, current, faults, no_rows);
        }
        if (warm != nullptr) {
            const Pmsm<>& cold = phase.cold->motor();
            s.temperature = phase.config.motor.thermal->after(s.temperature, cold.copper_loss(before), cold.copper_loss(s.plant.i),
                                                              period_);
            warm_up(s, *warm);
            if (!switched) here = exact(s.plant.theta_m);
        }
    }
}

[[gnu::always_inline]] inline void Drive::step_load(DriveState& s, const Phase& phase, std::int64_t origin, double& torque,
                                                    double& target) {
    const std::vector<LoadStep>& steps = phase.config.load_steps;
    while (s.next_load_step < steps.size() && steps[s.next_load_step].tick <= s.tick - origin) {
        target = steps[s.next_load_step++].torque + (s.added_load + s.load_deviation);
        if (phase.config.load.lag <= 0.0) torque = target;
    }
}

[[gnu::always_inline]] inline void Drive::next_duties(DriveState& s, Acting& acting) const {
    // number by number: wider moves would wait for the narrow stores before them
    const bool delay = config_.inverter.computation_delay;
    for (std::size_t n = 0; n < acting.duty.size(); ++n) {
        const auto computed = static_cast<double>(s.output.duty[n]);
        const double duty = delay ? s.duty[n] : computed;
        acting.duty[n] = least_duty_ > 0.0 ? without_short_pulses(duty, least_duty_) : duty;
        s.duty[n] = computed;
    }
    const bool off = (s.output.status & static_cast<unsigned>(CGL_STATUS_OFF)) != 0U;
    acting.open = delay ? s.open : off;
    s.open = off;
}

template <std::size_t legs>
[[gnu::always_inline]] inline Voltage<> Drive::averaged(DriveState& s, const Phases& duty, const Phases& current,
                                                        const Faults& faults) const {
    const InverterConfig& inverter = config_.inverter;
    const Voltage<> u = cogless::averaged(faults.bus_voltage, dead_share_, inverter.device_drop, leg_duties<legs>(duty),
                                          leg_duties<legs>(s.applied), leg_currents<legs>(current), carrier(inverter.pwm, s.tick));
    remember(s, duty);
    return u;
}

[[gnu::always_inline]] inline void Drive::remember(DriveState& s, const Phases& applied) const {
    if (config_.inverter.pwm == Pwm::edge) s.applied = applied;
}

[[gnu::always_inline]] inline void Drive::watch(DriveState& s, double from, double h, double theta_m,
                                                const Faults& faults) const {
    if (position_sensor_.watches()) {
        const double theta = config_.sensor_on_load ? s.plant.side.theta : theta_m;
        position_sensor_.watch(s.position, from, from + h, faults.stuck ? s.seen : theta + faults.jump);
    }
}

cgl_real Drive::measured_i_q(const DriveState& s) const {
    cgl_real sine, cosine, i_d, i_q, alpha = s.sampled.i_abc[0], beta = s.sampled.i_abc[1];
    if (config_.control.foc.phases != 2U) cgl_clarke(s.sampled.i_abc, &alpha, &beta);
    cgl_sincos(static_cast<cgl_real>(config_.control.pole_pairs) * s.sampled.theta_m, &sine, &cosine);
    cgl_park(alpha, beta, sine, cosine, &i_d, &i_q);
    return i_q;
}

[[gnu::always_inline]] inline AngleCorrection Drive::correction(DriveState& s, const Faults& faults) const {
    if (!config_.encoder_table) return {};
    return {&s.encoder_table, config_.control.foreign ? static_cast<cgl_real>(s.plant.i.q) : measured_i_q(s), faults.missing};
}

Measurement Drive::measure_load(DriveState& s, const Phase& phase, std::int64_t origin, bool law_due, const Faults& faults) const {
    if (!faults.stuck) s.seen = s.plant.side.theta + faults.jump;
    const Measurement at = position_sensor_.sample(s.position, time(s.tick - origin), s.seen,
                                                   faults.stuck ? 0.0 : s.plant.side.omega, law_due, correction(s, faults));
    constexpr double turn = 2.0 * std::numbers::pi;
    const double ratio = phase.plant.equations().load_side()->ratio(), theta = ratio * at.theta_m;
    return {theta - turn * round_down(theta / turn), ratio * at.omega_m};
}

[[gnu::always_inline]] inline void Drive::actuate(DriveState& s) const {
    if (config_.current_reference) {
        cgl_current_reference_actuate(&current_reference_, &s.control, &s.output);
    } else {
        cgl_drive_actuate(&s.control, &s.output);
    }
    const bool off = (s.output.status & static_cast<unsigned>(CGL_STATUS_OFF)) != 0U;
    if (config_.dead_time && !off) cgl_dead_time_step(&s.dead_time, &s.control.currents, s.output.duty);
}

// Samples the sensors and runs the controller.
template <std::size_t legs, bool alone>
bool Drive::control(DriveState& s, const Phase& phase, std::int64_t origin, bool law_due, const Phases& current,
                    const Faults& faults, Controller* other, OrderSum* orders) const {
    if (!std::isfinite(s.plant.theta_m + s.plant.omega_m + s.plant.i.d + s.plant.i.q)) {
        throw std::runtime_error("the motor's current or speed grew beyond all numbers: expected smaller gains or steps");
    }
    if (config_.sensor_on_load) {
        s.measured = faults.spoilt(measure_load(s, phase, origin, law_due, faults));
    } else {
        if (!faults.stuck) s.seen = s.plant.theta_m + faults.jump;
        s.measured = faults.spoilt(position_sensor_.sample(s.position, time(s.tick - origin), s.seen,
                                                           faults.stuck ? 0.0 : s.plant.omega_m, law_due, correction(s, faults)));
    }
    if (config_.speed_filter) {
        s.measured.omega_m =
            static_cast<double>(cgl_low_pass_step(&s.speed_filter, static_cast<cgl_real>(s.measured.omega_m)));
    }
    Phases i{};
    if constexpr (legs != 0) {
        i = faults.spoilt(alone ? current_sensors_.measure(current, s.random) : current, config_.current_sensors.sensors,
                          legs == star_legs);
    }
    if (law_due) sample_reference(s, phase, origin);

    s.sampled = {{static_cast<cgl_real>(i[0]), static_cast<cgl_real>(i[1]), static_cast<cgl_real>(i[2])},
                 static_cast<cgl_real>(s.measured.theta_m),
                 static_cast<cgl_real>(s.measured.omega_m),
                 static_cast<cgl_real>(faults.bus_voltage)};
    if (other != nullptr) {
        if (bus_) {
            over_bus(s, *other);
        } else {
            s.output = other->step(s.sampled, s.asked);
        }
        for (cgl_real& duty : s.output.duty) duty = possible(duty);
    } else if (bus_) {
        struct {
            const Drive& drive;
            DriveState& s;
            std::pair<bool, Measurement> measure(const cgl_measurement&, const cgl_reference&) {
                const bool due = cgl_drive_measure(&s.control, &s.sampled, &s.asked);
                return {due, believed(s)};
            }
            BusCommand law(const Measurement& then) { return drive.far_law<legs>(s, then); }
            cgl_drive_output actuate(const BusCommand* received) {
                drive.receive(s, received);
                drive.actuate(s);
                return s.output;
            }
        } own{*this, s};
        over_bus(s, own);
    } else {
        if (cgl_drive_measure(&s.control, &s.sampled, &s.asked)) {
            if constexpr (!alone) {
                if (begin_law(s, *orders)) return true;
            }
            step_law<legs>(s);
        }
        if (steps_currents_) step_current<legs>(s);
        if constexpr (alone) actuate(s);
    }
    if constexpr (legs == 0) {
        const cgl_real limit = config_.control.foc.current_limit;
        if (!cgl_is_within(s.output.i_q_ref, limit)) {  // reported as cgl_foc_step reports it
            s.output.i_q_ref = s.control.i_q = cgl_clamp(s.output.i_q_ref, limit);
            s.output.status |= CGL_STATUS_SATURATED;
            s.control.saturated = true;
        }
        s.plant.i.q = static_cast<double>(s.output.i_q_ref);
    }
    return false;
}

template <class Parts>
void Drive::over_bus(DriveState& s, Parts& controller) const {
    const auto [due, seen] = controller.measure(s.sampled, s.asked);
    bus_->measure(s.bus, seen);
    if (due) bus_->send(s.bus, s.tick, controller.law(bus_->arrived(s.bus)));
    s.output = controller.actuate(bus_->received(s.bus, s.tick));
}

Measurement Drive::believed(const DriveState& s) {
    return {static_cast<double>(s.control.monitor.theta_m), static_cast<double>(s.control.monitor.omega_m)};
}

template <std::size_t legs>
BusCommand Drive::far_law(DriveState& s, const Measurement& then) const {
    cgl_drive& drive = s.control;
    drive.in.theta_m = static_cast<cgl_real>(then.theta_m);
    drive.in.omega_m = static_cast<cgl_real>(then.omega_m);
    const cgl_real i_q_ref = drive.command.i_q_ref, i_d_ref = drive.currents.i_d_ref;
    step_law<legs>(s);
    const BusCommand sent{static_cast<double>(drive.command.i_q_ref), static_cast<double>(drive.currents.i_d_ref)};
    drive.command.i_q_ref = i_q_ref;
    drive.currents.i_d_ref = s.asked.i_d_ref = i_d_ref;
    return sent;
}

void Drive::receive(DriveState& s, const BusCommand* received) const {
    if (received == nullptr) return;
    s.control.command.i_q_ref = static_cast<cgl_real>(received->i_q_ref);
    s.control.currents.i_d_ref = s.asked.i_d_ref = static_cast<cgl_real>(received->i_d_ref);
}

void Drive::sample_reference(DriveState& s, const Phase& phase, std::int64_t origin) const {
    const double t = time(s.tick);
    double theta_ref;
    if (config_.trials) {
        const std::vector<cgl_real>& all = phase.config.trajectory;
        const auto sample = static_cast<std::size_t>((s.tick - origin) / config_.speed_divider);
        const auto before = sample > 0 ? all[sample - 1] : all[sample];
        theta_ref = s.reference.theta = static_cast<double>(all[sample]);
        s.reference.omega = static_cast<double>(all[sample] - before) / law_period();
    } else {
        s.reference = s.given_reference ? *s.given_reference : reference_.sample(s.reference_filter, t);
        theta_ref = s.reference.theta - turns_ * round_down(s.reference.theta / turns_);
    }
    s.asked = {static_cast<cgl_real>(theta_ref), static_cast<cgl_real>(s.reference.omega),
               static_cast<cgl_real>(s.reference.alpha), s.asked.i_d_ref, t >= config_.learning_start, false, CGL_R(0.0)};
    if (config_.torque_mode) {
        s.asked.torque = t >= config_.torque_mode->from && t < config_.torque_mode->until;
        s.asked.i_q_ref = static_cast<cgl_real>(config_.torque_mode->current.held(t));
    }
}

template <std::size_t legs>
LawInput Drive::law_input(const DriveState& s, const Measurement& measured) const {
    const cgl_law_input& c = s.control.in;
    return {time(s.tick),
            s.reference.omega,
            config_.trials ? s.reference.theta : s.reference.theta - turns_ * round_down(s.reference.theta / turns_),
            s.reference.alpha,
            measured.omega_m,
            measured.theta_m,
            legs == 0 ? s.plant.i.d : static_cast<double>(s.output.i_d),
            legs == 0 ? s.plant.i.q : static_cast<double>(s.output.i_q),
            static_cast<double>(s.control.loop.current_limit),
            law_period(),
            c.learn,
            c.off};
}

template <std::size_t legs>
void Drive::step_law(DriveState& s) const {
    const cgl_law_input& c = s.control.in;
    const auto step = [&](const auto& law) {
        auto& state = state_of(s.law, law);
        if constexpr (requires { law.step(state, c); }) {
            return law.step(state, c);
        } else {
            return law.step(state, law_input<legs>(s, {static_cast<double>(c.theta_m), static_cast<double>(c.omega_m)}));
        }
    };
    obey<legs>(s, std::visit(step, config_.law));
}

template <std::size_t legs>
void Drive::step_current(DriveState& s) const {
    const LawInput in = law_input<legs>(s, believed(s));
    const Command last{static_cast<double>(s.control.currents.i_d_ref), static_cast<double>(s.control.command.i_q_ref),
                       s.control.command.status};
    std::visit(
        [&](const auto& law) {
            if constexpr (requires { law.has_current_step(); }) obey<legs>(s, law.current_step(state_of(s.law, law), in, last));
        },
        config_.law);
}

template <std::size_t legs>
void Drive::obey(DriveState& s, const Command& command) const {
    if (!std::isfinite(command.i_q_ref) || !std::isfinite(command.i_d_ref)) {
        const double wrong = std::isfinite(command.i_q_ref) ? command.i_d_ref : command.i_q_ref;
        throw std::runtime_error("returned " + std::to_string(wrong));
    }
    if (legs == 0 && command.i_d_ref != 0.0) {
        throw std::runtime_error("asked for i_d_ref: expected only i_q_ref, with an ideal current loop");
    }
    s.control.command = {static_cast<cgl_real>(command.i_q_ref), command.status};
    s.control.currents.i_d_ref = s.asked.i_d_ref = static_cast<cgl_real>(command.i_d_ref);
    if (config_.current_reference) {
        if (command.i_d_ref != 0.0) {
            throw std::runtime_error("asked for i_d_ref: expected only i_q_ref, with drive.current_reference");
        }
        cgl_current_reference_step(&current_reference_, &s.control);
    }
}

template <std::size_t legs, Detail detail, class BeforeStep>
void Drive::advance_plant(DriveState& s, AtAngle<double>& here, AnglePatch& patch, const Phase& phase,
                          std::int64_t origin, const Acting& acting, const Phases& current, const Faults& faults,
                          const BeforeStep& before_step) const {
    const double start = time(s.tick - origin);
    const double longest = step_;
    const auto step = [&](Voltage<> u, double from, double h, auto& angle) __attribute__((always_inline)) {
        phase.plant.step<detail>(s.plant, here, u, start + from, h, angle);
        watch(s, start + from, h, s.plant.theta_m, faults);
    };
    const Plant::Exact<detail> exact(phase.plant);
    const auto hold = [&](Voltage<> u) {
        for (int k = 0; k < config_.integration_steps; ++k) step(u, k * longest, longest, exact);
    };
    const InverterConfig& inverter = config_.inverter;
    if constexpr (legs == 0) {
        hold({0.0, 0.0});
    } else if (acting.open) {
        if (!inverter.switched) patch.move_to(s.plant.theta_m, 0.5 * period_ * s.plant.omega_m);
        const int steps = std::max(config_.integration_steps, open_steps);
        for (int k = 0; k < steps; ++k) {
            const OpenBridge<legs> bridge =
                open_bridge(faults.bus_voltage, phase_currents<legs>(s.plant.i, here.axis),
                            induced(phase.plant.motor(), here, s.plant.omega_m), OpenBridge<legs>{});
            const auto block = [&bridge](PlantState<>& x, const AtAngle<double>& at) {
                x.i = rotor_frame<legs>(let_through(bridge, phase_currents<legs>(x.i, at.axis)), at.axis);
            };
            before_step(bridge.u, k * period_ / steps, period_ / steps, block);
            step(bridge.u, k * period_ / steps, period_ / steps, patch);
            block(s.plant, here);
        }
        if (!inverter.switched) here = exact(s.plant.theta_m);
    } else if (inverter.switched) {
        advance_pulses<legs, detail>(s, here, patch, phase, origin, acting, current, faults, before_step);
    } else {
        hold(averaged<legs>(s, acting.duty, current, faults));
    }
}

template <std::size_t legs, Detail detail, class BeforeStep>
void Drive::advance_pulses(DriveState& s, AtAngle<double>& here, AnglePatch& patch, const Phase& phase, std::int64_t origin,
                           const Acting& acting, const Phases& current, const Faults& faults,
                           const BeforeStep& before_step) const {
    const double start = time(s.tick - origin);
    const auto step = [&](Voltage<> u, double from, double h, auto& angle) __attribute__((always_inline)) {
        before_step(u, from, h, [](PlantState<>&, const AtAngle<double>&) {});
        phase.plant.step<detail>(s.plant, here, u, start + from, h, angle);
        watch(s, start + from, h, s.plant.theta_m, faults);
    };
    const Pulses<legs> p =
        pulses(faults.bus_voltage, config_.inverter.dead_time, config_.inverter.device_drop, leg_duties<legs>(acting.duty),
               leg_duties<legs>(s.applied), leg_currents<legs>(current), carrier(config_.inverter.pwm, s.tick), period_);
    remember(s, acting.duty);
    AnglePatch::Brief brief{patch};
    double from = 0.0;
    for (std::size_t n = 0; n < p.count; ++n) {
        const double length = p.stretch[n].until - from;
        if (length <= brief_share * step_) {
            step(p.stretch[n].u, from, length, brief);
        } else {
            const int steps = length <= step_ ? 1 : static_cast<int>(std::ceil(length / step_ - 1e-9));
            const double h = length / steps;
            for (int k = 0; k < steps; ++k) step(p.stretch[n].u, from + k * h, h, patch);
        }
        from = p.stretch[n].until;
    }
}

template <std::size_t legs, Detail detail>
void Drive::advance_with_rows(DriveState& s, AtAngle<double>& here, AnglePatch& patch, const Phase& phase, std::int64_t origin,
                              const Acting& acting, const Phases& current, const Faults& faults, Recorder& recorder) const {
    const double start = time(s.tick - origin);
    int rows = 0;
    const auto record_rows = [&](Voltage<> u, double from, double h, const auto& after) {
        for (; rows < config_.rows_per_period; ++rows) {
            const double within = rows * period_ / config_.rows_per_period;
            if (!(within < from + h)) return;
            const PlantState<> before = s.plant;
            AtAngle<double> there = here;
            if (within > from) {
                AnglePatch aside = patch;
                phase.plant.step<detail>(s.plant, there, u, start + from, within - from, aside);
                after(s.plant, there);
            }
            record<legs>(s, there, phase, origin, phase_currents<legs>(s.plant.i, there.axis), recorder.next_row(), within, u);
            s.plant = before;
        }
    };
    advance_plant<legs, detail>(s, here, patch, phase, origin, acting, current, faults, record_rows);
}

template <std::size_t legs>
void Drive::record(const DriveState& s, const AtAngle<double>& here, const Phase& phase, std::int64_t origin,
                   const Phases& current, double* row, double within, Voltage<> u) const {
    const auto* learning = std::get_if<TrialLaw>(&config_.law);
    const bool trials = config_.trials.has_value(), trial_law = learning != nullptr;
    const bool path = follows_angle_, energy = config_.energy, load_side = has_load_side(config_);
    const bool thermal = config_.phases.front().motor.thermal.has_value(), within_periods = config_.rows_per_period > 1;
    constexpr bool electrical = legs != 0, three_phases = legs == star_legs;
    const Torques<> torques = phase.plant.equations().torques(s.plant, here, time(s.tick - origin) + within);
    // The law uses the reference of its last sample until the next one; recorded errors use the reference at this instant.
    const std::int64_t since = s.tick % config_.speed_divider;
    const bool held = (since == 0 && within == 0.0) || trials;
    const Motion reference = held ? s.reference : reference_.after(s.reference, time(s.tick - since), time(since) + within);
    Phases voltage{};
    if constexpr (electrical) voltage = in_phases<legs>(u.alpha, u.beta);
    const std::int64_t trial = trials ? s.tick / (config_.trials->samples * config_.speed_divider) + 1 : 0;
    double theta_measured = 0.0, learned = 0.0;
    if (trial_law) {
        const cgl_trial& law = state_of(s.law, *learning).law;
        theta_measured = static_cast<double>(law.theta);
        learned = static_cast<double>(law.v);
    } else {
        theta_measured = near(s.measured.theta_m, s.plant.theta_m);
    }
#define CGL_SIGNAL(name, unit, about, when, value) \
    if (when) *row++ = static_cast<double>(value);
#define CGL_TERMS row = put_terms(config_.law, s.law, row);
#include "signals.def"
#undef CGL_SIGNAL
#undef CGL_TERMS
}

std::vector<cgl_real>* Drive::cells(DriveState& state) const {
    return std::visit(
        [&state](const auto& law) -> std::vector<cgl_real>* {
            if constexpr (requires { law.cells(state_of(state.law, law)); }) {
                return &law.cells(state_of(state.law, law));
            } else {
                return nullptr;
            }
        },
        config_.law);
}

}  // namespace cogless

#ifdef COGLESS_WITH_LANES
#include "drive_lanes.hpp"
#endif
