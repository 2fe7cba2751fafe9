// A drive: plant, inverter, sensors, current loop and control law in one multirate loop on an integer tick.
//
// One tick is one current-loop period. In tick n the drive samples at t = n / current_rate, runs its controller, which is
// the control library's cgl_drive with a law at every speed_divider-th tick, records, and lets the plant go on to the next
// tick. An ideal current loop has no inverter and no electrical states: from each step of the law on, the current equals the
// law's reference. Any other code that takes the same measurements and references can replace the controller.
//
// In trials everything but the law and the noise is reset to its initial state at the start of each trial, after a fixed
// number of the law's samples. The law learns between trials.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "angle_patch.hpp"
#include "bus.hpp"
#include "cogless/current_reference.h"
#include "cogless/dead_time.h"
#include "cogless/drive.h"
#include "cogless/encoder_table.h"
#include "cogless/low_pass.h"
#include "current_sensors.hpp"
#include "every.hpp"
#include "fault.hpp"
#include "inverter.hpp"
#include "lane_plants.hpp"
#include "laws.hpp"
#include "plant.hpp"
#include "position_sensor.hpp"
#include "random.hpp"
#include "recorder.hpp"
#include "reference.hpp"
#include "table.hpp"
#include "trials.hpp"

namespace cogless {

// A new target of the load's constant part, at a tick; with trials, at that tick of each.
struct LoadStep {
    std::int64_t tick;
    double torque;  // N m
};

// Torque mode for a time: a current from outside instead of the speed reference.
struct TorqueMode {
    double from, until;  // s
    Table current;       // A over s
};

// What differs from trial to trial at random: deviations of the start, and of the load's constant part.
struct Spread {
    Deviation initial_angle, initial_speed, load;  // rad, rad/s, N m
};

// A phase of trials: the plant from the trial `from` on, and its initial state at each trial's start.
struct PhaseConfig {
    PmsmConfig motor;
    MechanicsConfig mechanics;
    LoadConfig load;
    std::vector<LoadStep> load_steps;       // by tick
    double initial_speed, initial_angle;    // mechanical, rad/s, rad
    std::int64_t from = 0;                  // the first trial of this phase
    std::vector<cgl_real> trajectory = {};  // rad, the reference at each sample of a trial
    std::optional<Spread> each_trial = {};
};

struct DriveConfig {
    std::vector<PhaseConfig> phases;  // one without trials; with trials one for each phase, ordered by `from`
    std::optional<Trials> trials;     // only with a law that can begin and end trials; the trial law always needs it
    bool ideal_current;               // if true, inverter, current sensors and all of control.foc but its limit are not used
    InverterConfig inverter;
    CurrentSensorsConfig current_sensors;
    PositionSensorConfig position_sensor;
    bool sensor_on_load = false;  // its angle times the gear's ratio, which is whole, is the drive's angle
    ReferenceConfig reference;  // without trials
    cgl_drive_config control;
    std::optional<cgl_current_reference_config> current_reference;  // none: i_q is the law's, i_d is zero
    std::optional<cgl_dead_time_config> dead_time;  // none: not compensated
    std::optional<cgl_encoder_table_config> encoder_table;  // none: the sensor is believed
    std::optional<cgl_low_pass_config> speed_filter;        // none: the measured speed as it is
    std::optional<BusConfig> bus;                           // none: the law runs in the drive
    std::optional<TorqueMode> torque_mode;  // not in trials
    std::vector<Fault> faults;  // by the tick since the start
    Law law;
    bool holds_position = false;  // the law does; one that learns over its reference's angle need not say so
    std::int64_t current_rate;   // Hz
    std::int64_t speed_divider;  // current-loop periods in a period of the law
    int integration_steps;       // steps in a current-loop period
    double learning_start;       // s
    std::uint64_t seed;
    bool energy;                 // integrate and record the energies
    int rows_per_period = 1;     // of the trace, in each period in which a row is due; more than 1 only if switched
};

struct DriveState {
    std::int64_t tick = 0;
    PlantState<> plant;
    PositionSensor::State position;
    Random random{0};
    cgl_drive control;
    cgl_dead_time dead_time{};
    cgl_encoder_table encoder_table{};
    cgl_low_pass speed_filter{};
    Bus::State bus{};
    LawState law;
    double seen = 0.0;  // rad, the angle by the position sensor
    Measurement measured{0.0, 0.0};
    Reference::State reference_filter;
    Motion reference;  // in trials angle and speed
    cgl_measurement sampled{};  // the measurements that the controller got
    cgl_reference asked{};
    cgl_drive_output output{};
    Phases duty{0.5, 0.5, 0.5};  // duty cycles that the inverter applies in this period
    Phases applied = duty;       // with edge-aligned pulses: duty cycles of the last period, after short pulses were dropped
    bool open = false;           // true: the inverter's transistors are off instead
    std::size_t next_load_step = 0;
    double added_load = 0.0;                     // N m, by add_load()
    double load_deviation = 0.0;                 // N m, of this trial
    Temperatures temperature{};                  // of a motor with temperatures; goes on from trial to trial
    std::optional<Motion> given_reference = {};  // replaces the described reference; not in trials
};

// A controller that replaces the drive's own, such as the same code on another processor.
class Controller {
public:
    virtual ~Controller() = default;
    virtual cgl_drive_output step(const cgl_measurement& now, const cgl_reference& reference) = 0;  // every tick
    // Where a bus is between drive and law, in place of step(): what comes before the law, with angle and speed as the drive
    // believes them, and whether the law is due; the law, with what has reached it; what follows, with the command that has
    // reached the drive, or null.
    virtual std::pair<bool, Measurement> measure(const cgl_measurement& now, const cgl_reference& reference) = 0;
    virtual BusCommand law(const Measurement& then) = 0;
    virtual cgl_drive_output actuate(const BusCommand* received) = 0;
    virtual void begin(const std::vector<cgl_real>& trajectory) = 0;                                // of a trial, rad
    virtual void end() = 0;
};

class Drive {
public:
    // Throws std::invalid_argument for a configuration that a control law refuses or that contradicts itself.
    explicit Drive(const DriveConfig& config);

    const std::vector<Signal>& signals() const { return signals_; }

    DriveState start() const;

    // Runs `ticks` current-loop periods, with the other controller if one is given; the state of the drive's own controller
    // then stays as it is. Throws std::runtime_error if a user's law returns a value that is not finite, or if the motor's
    // states become so; the state is then that of the failing period. Throws std::invalid_argument, and runs nothing, if the
    // ticks exceed the number of trials.
    void advance(DriveState& state, Recorder& recorder, std::int64_t ticks, Controller* other = nullptr) const;

    // Whether both can be lanes of one LanePlants: no trials, no pulses, no load from tables, no law in another language, no
    // drift of temperatures, and
    // motors, rates and details alike.
    bool alike(const Drive& other) const;

    // A drive that goes on beside others. error: why it failed, as advance() would throw it.
    struct Lane {
        const Drive* drive;
        DriveState* state;
        Recorder* recorder;
        std::string error = {};
    };

    // Runs `ticks` periods of drives that are alike and are at the same tick, as advance() does for each.
    static void advance_lanes(std::vector<Lane>& lanes, const LaneKernel& kernel, std::int64_t ticks);

    // Adds a torque, N m, to the described load from now on.
    void add_load(DriveState& state, double torque) const;

    // Runs one step of the drive's own controller without the plant, as advance() does without another controller. Plant and
    // tick stay as they are. The law must be one of the control library.
    cgl_drive_output step_controller(DriveState& state, const cgl_measurement& now, const cgl_reference& reference) const;
    // step_controller() in three parts, for a bus between drive and law: see measure(), law() and actuate() of Controller.
    std::pair<bool, Measurement> measure_controller(DriveState& state, const cgl_measurement& now,
                                                    const cgl_reference& reference) const;
    BusCommand law_controller(DriveState& state, const Measurement& then) const;
    cgl_drive_output actuate_controller(DriveState& state, const BusCommand* received) const;
    void begin_trial(DriveState& state, const std::vector<cgl_real>& trajectory) const;
    void end_trial(DriveState& state) const;

    const DriveConfig& config() const { return config_; }
    // The law's memory, which in C is the caller's; null if the law has none.
    std::vector<cgl_real>* cells(DriveState& state) const;

private:
    // A phase with all that follows from it.
    struct Phase {
        PhaseConfig config;
        Plant plant;                // at the temperatures of the start
        std::optional<Plant> cold;  // at the reference temperature, if the motor's temperatures drift
        PlantState<> plant_start;
        PositionSensor::State position_start;
    };

    // The controller's part of a tick before the law; whether the law is due.
    // A period of a controller whose law has what reached it over the bus, and whose drive has the command that did.
    template <class Parts>
    void over_bus(DriveState& state, Parts& controller) const;
    // Angle and speed as the controller believes them.
    static Measurement believed(const DriveState& state);
    // The law at what has reached it. The drive's command stays as it is.
    template <std::size_t legs>
    BusCommand far_law(DriveState& state, const Measurement& then) const;
    void receive(DriveState& state, const BusCommand* received) const;
    // And after it.
    void actuate(DriveState& state) const;
    void begin_law(DriveState& state, const std::vector<cgl_real>& trajectory) const;
    // Resets everything but the law and the noise to the initial state of this trial, from 0, of this phase of the run.
    void restart(DriveState& state, const Phase& phase, std::int64_t trial) const;
    void advance_trials(DriveState& state, Recorder& recorder, std::int64_t end, Controller* other) const;
    void advance_within(DriveState& state, Recorder& recorder, const Phase& phase, std::int64_t origin, std::int64_t end,
                        Controller* other) const;

    // Calls f() with the template parameters legs and detail that this drive has.
    template <class F>
    void specialised(const F& f) const;

    // Functions that run in every tick are forced inline where they are defined: with two loops gcc would call them, which
    // is 1 % slower.
    //
    // origin in all of these: the tick at which the phase's time is zero. legs: number of the inverter's legs; 0 with an
    // ideal current loop. here: what depends on the rotor's angle.
    // warm: null, or the same as phase: then its motor changes with the temperatures.
    template <std::size_t legs, Detail detail>
    void run(DriveState& state, Recorder& recorder, const Phase& phase, Phase* warm, std::int64_t origin, std::int64_t end,
             Controller* other) const;
    // Puts the motor's resistance and flux where the temperatures are.
    static void warm_up(const DriveState& state, Phase& phase);
    template <std::size_t legs, Detail detail>
    static void run_lanes(std::vector<Lane>& lanes, LanePlants& plants, std::int64_t end);

    // Sets the load's torque and the target that it approaches, N m, where a step of the load is due.
    static void step_load(DriveState& state, const Phase& phase, std::int64_t origin, double& torque, double& target);
    Faults faults_at(std::int64_t tick) const { return {config_.faults, tick, config_.inverter.bus_voltage}; }
    // What the inverter applies from now on.
    struct Acting {
        Phases duty;
        bool open;
    };
    void next_duties(DriveState& state, Acting& acting) const;
    // Lets the position sensor see the rotor at theta_m, or the load side, h after the time `from`.
    void watch(DriveState& state, double from, double h, double theta_m, const Faults& faults) const;
    // What the drive makes of a position sensor on the load side. Not inlined into the loop, which hardly ever needs it.
    // i_q by the currents measured in the last tick, for our drive and for a foreign one [A].
    cgl_real measured_i_q(const DriveState& state) const;
    AngleCorrection correction(DriveState& state, const Faults& faults) const;
    [[gnu::noinline]] Measurement measure_load(DriveState& state, const Phase& phase, std::int64_t origin, bool law_due,
                                               const Faults& faults) const;
    template <std::size_t legs>
    Voltage<> averaged(DriveState& state, const Phases& duty, const Phases& current, const Faults& faults) const;
    // Keeps the duty cycles of this period for the next one.
    void remember(DriveState& state, const Phases& applied) const;
    template <std::size_t legs>
    void control(DriveState& state, const Phase& phase, std::int64_t origin, bool law_due, const Phases& current,
                 const Faults& faults, Controller* other) const;
    void sample_reference(DriveState& state, const Phase& phase, std::int64_t origin) const;
    template <std::size_t legs>
    LawInput law_input(const DriveState& state, const Measurement& measured) const;
    template <std::size_t legs>
    void step_law(DriveState& state) const;
    template <std::size_t legs>
    void step_current(DriveState& state) const;
    template <std::size_t legs>
    void obey(DriveState& state, const Command& command) const;
    // before_step(u, from, h, after): called before each step of pulses or an open bridge, of the length h, s, from a time of the
    // period on, s; after(plant, here) is what follows the step.
    template <std::size_t legs, Detail detail, class BeforeStep>
    void advance_plant(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase, std::int64_t origin,
                       const Acting& acting, const Phases& current, const Faults& faults, const BeforeStep& before_step) const;
    // The same with pulses. Not inlined, so that a period without them keeps its registers.
    template <std::size_t legs, Detail detail, class BeforeStep>
    [[gnu::noinline]] void advance_pulses(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase,
                                          std::int64_t origin, const Acting& acting, const Phases& current, const Faults& faults,
                                          const BeforeStep& before_step) const;
    // The same as advance_plant(), and records the period's rows. Each is a step of its own from the run's last, so the run stays as it is.
    template <std::size_t legs, Detail detail>
    [[gnu::noinline]] void advance_with_rows(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase,
                                             std::int64_t origin, const Acting& acting, const Phases& current,
                                             const Faults& faults, Recorder& recorder) const;
    // within: s since the tick; u: the inverter's voltage then, of rows within periods.
    // Not inlined into run(), whose loop is 4 % faster without it.
    template <std::size_t legs>
    [[gnu::noinline]] void record(const DriveState& state, const AtAngle<double>& here, const Phase& phase,
                                  std::int64_t origin, const Phases& current, double* row, double within = 0.0,
                                  Voltage<> u = {}) const;

    double time(std::int64_t tick) const { return static_cast<double>(tick) / current_rate_; }

    double law_period() const { return period_ * static_cast<double>(config_.speed_divider); }

    DriveConfig config_;
    double current_rate_;  // Hz
    double period_;        // s, of the current loop
    double step_;          // s, of the integration
    double dead_share_;    // of the period, by the inverter's dead time
    double least_duty_;    // the smallest duty cycle that is not dropped
    bool follows_angle_;   // whether the law follows its reference's angle
    bool steps_currents_;  // whether it acts in each period of the current loop, too
    double turns_;        // rad, the law gets the reference's angle modulo this
    Reference reference_;
    PositionSensor position_sensor_;
    cgl_current_reference current_reference_{};  // used if config_.current_reference is there; it has no state
    cgl_dead_time dead_time_start_{};  // used if config_.dead_time is there
    cgl_encoder_table encoder_table_start_{};
    cgl_low_pass speed_filter_start_{};
    std::optional<Bus> bus_;
    CurrentSensors current_sensors_;
    std::vector<Phase> phases_;
    std::vector<Signal> signals_;
};

}  // namespace cogless
