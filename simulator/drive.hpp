// A drive: plant, inverter, sensors, current loop and control law in one multirate loop on an integer tick.
//
// One tick is one current-loop period. In tick n, at t = n / current_rate, the drive samples, runs its controller, records a row
// if one is due, and advances the plant to the next tick. The controller is the control library's cgl_drive, with a law at every
// speed_divider-th tick. Any other code that takes the same measurements and references can replace it. An ideal current loop has
// no inverter and no electrical states: from each step of the law on, the current equals the law's reference.
//
// In trials the drive is reset to its initial state at the start of each trial, after a fixed number of the law's samples. The law
// and the noise go on, as do an encoder table, an added load and drifting temperatures. The law learns between trials.
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

// A new target of the load's constant part from a tick on. Ticks count from the start, or from the start of each trial.
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
    std::vector<LoadStep> load_steps;       // in the order of their ticks
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
    bool sensor_on_load = false;  // true: the drive's angle is the sensor's times the gear's ratio, a whole number
    ReferenceConfig reference;  // without trials
    cgl_drive_config control;
    std::optional<cgl_current_reference_config> current_reference;  // none: i_q is the law's, i_d is zero
    std::optional<cgl_dead_time_config> dead_time;  // none: not compensated
    std::optional<cgl_encoder_table_config> encoder_table;  // none: the sensor's angle is not corrected
    std::optional<cgl_low_pass_config> speed_filter;        // none: the measured speed as it is
    std::optional<BusConfig> bus;                           // none: the law runs in the drive
    std::optional<TorqueMode> torque_mode;  // not in trials
    std::vector<Fault> faults;  // their ticks count from the start of the run
    Law law;
    bool holds_position = false;  // whether the law holds a position; needless for a law that learns over its reference's angle
    std::int64_t current_rate;   // Hz
    std::int64_t speed_divider;  // current-loop periods in a period of the law
    int integration_steps;       // steps in a current-loop period
    double learning_start;       // s, the law learns from this time on
    std::uint64_t seed;
    bool energy;                 // integrate and record the energies
    int rows_per_period = 1;     // rows of the trace in each period in which one is due; more than 1 only if switched
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
    double seen = 0.0;  // rad, true angle that the position sensor sees, with faults
    Measurement measured{0.0, 0.0};
    Reference::State reference_filter;
    Motion reference;  // in trials only angle and speed
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
    // With a bus between drive and law, these three replace step(). measure(): the part before the law; returns whether the law is
    // due, and angle and speed as the drive believes them. law(): the law's step, with the measurement that has reached it.
    // actuate(): the part after the law, with the command that has reached the drive, or null.
    virtual std::pair<bool, Measurement> measure(const cgl_measurement& now, const cgl_reference& reference) = 0;
    virtual BusCommand law(const Measurement& then) = 0;
    virtual cgl_drive_output actuate(const BusCommand* received) = 0;
    virtual void begin(const std::vector<cgl_real>& trajectory) = 0;  // begins a trial; trajectory: rad
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
    // states stop being finite; the state is then that of the failing period. Throws std::invalid_argument, and runs nothing, if
    // the ticks exceed the number of trials.
    void advance(DriveState& state, Recorder& recorder, std::int64_t ticks, Controller* other = nullptr) const;

    // Whether both can be lanes of one LanePlants. Neither may have trials, pulses, a load from tables, saturation, a drive train,
    // a law in Python or drifting temperatures; motors, rates and details must be alike.
    bool alike(const Drive& other) const;

    // A drive that advances together with others. error: the message of the exception that advance() would throw; empty: none.
    struct Lane {
        const Drive* drive;
        DriveState* state;
        Recorder* recorder;
        std::string error = {};
    };

    // Advances each drive by `ticks` periods, as advance() does. The drives must be alike and at the same tick.
    static void advance_lanes(std::vector<Lane>& lanes, const LaneKernel& kernel, std::int64_t ticks);

    // Adds a torque, N m, to the described load from now on.
    void add_load(DriveState& state, double torque) const;

    // Runs one step of the drive's own controller, without the plant. Plant and tick stay as they are. The law must be one of the
    // control library.
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
    // A phase's configuration, and what the constructor computes from it.
    struct Phase {
        PhaseConfig config;
        Plant plant;                // at the temperatures of the start
        std::optional<Plant> cold;  // at the reference temperature, if the motor's temperatures drift
        PlantState<> plant_start;
        PositionSensor::State position_start;
    };

    // Runs a controller's three parts (see Controller) with the bus between them: the law gets the measurement that has reached it,
    // and the drive the command that has reached it.
    template <class Parts>
    void over_bus(DriveState& state, Parts& controller) const;
    // Angle and speed as the controller believes them.
    static Measurement believed(const DriveState& state);
    // Steps the law with the measurement that has reached it, and returns the law's command. The drive's command stays as it is.
    template <std::size_t legs>
    BusCommand far_law(DriveState& state, const Measurement& then) const;
    // Takes over the command that has reached the drive, if it is not null.
    void receive(DriveState& state, const BusCommand* received) const;
    // The controller's part of a tick after the law.
    void actuate(DriveState& state) const;
    void begin_law(DriveState& state, const std::vector<cgl_real>& trajectory) const;
    // Resets the drive to the initial state of a trial in its phase; see the head of this file for what goes on. trial: counted
    // from 0 over the run.
    void restart(DriveState& state, const Phase& phase, std::int64_t trial) const;
    void advance_trials(DriveState& state, Recorder& recorder, std::int64_t end, Controller* other) const;
    void advance_within(DriveState& state, Recorder& recorder, const Phase& phase, std::int64_t origin, std::int64_t end,
                        Controller* other) const;

    // Calls f() with the template parameters legs and detail that this drive has.
    template <class F>
    void specialised(const F& f) const;

    // Functions that run in every tick are forced inline where they are defined. They are used in two loops, so gcc would call
    // them, which is 1 % slower.
    //
    // origin in all of these: the tick at which the phase's time is zero. legs: number of the inverter's legs; 0 with an
    // ideal current loop. here: what depends on the rotor's angle.
    // warm: null, or the address of `phase`, whose motor then changes with the temperatures.
    template <std::size_t legs, Detail detail>
    void run(DriveState& state, Recorder& recorder, const Phase& phase, Phase* warm, std::int64_t origin, std::int64_t end,
             Controller* other) const;
    // Sets the motor's resistance and flux to those at the present temperatures.
    static void warm_up(const DriveState& state, Phase& phase);
    template <std::size_t legs, Detail detail>
    static void run_lanes(std::vector<Lane>& lanes, const LaneKernel& kernel, LanePlants& plants, std::int64_t end);
    struct Running;
    // Whether the drive can be a lane of one LaneLoops with the other.
    bool joins(const Drive& other) const;
    // Whether the drive can have quiet periods: see step_quietly().
    bool rests() const;
    // The drive's settings and state in a LaneLoops.
    void join(LaneLoops& loops, std::size_t lane, DriveState& state) const;
    void put(LaneLoops& loops, std::size_t lane, const DriveState& state) const;
    static void get(const LaneLoops& loops, std::size_t lane, DriveState& state);
    // Sine and cosine of an electrical angle, rad, and of where the rotor is when the voltage acts; omega_e: rad/s.
    static void turn(LaneLoops& loops, std::size_t lane, const cgl_foc& foc, cgl_real theta_e, cgl_real omega_e);
    // The sum of each lane.
    using OrderSums = std::array<OrderSum, LaneLoops::most>;
    // Computes the sums of these lanes, lane n as bit n, and writes them to `of`. The lanes with the same ranges of orders as the lowest
    // one are computed together if they are at least half of the kernel's lanes, all others one by one.
    static void sum_orders(const LaneKernel& kernel, LaneOrders& all, OrderSums& of, std::uint32_t lanes);
    // The output of the current loop's last step, which a LaneLoops has made.
    static void take_output(const LaneLoops& loops, std::size_t lane, DriveState& state);
    // The angle that the position sensor of a lane in quiet periods shows.
    static void show_angle(LaneLoops& loops, const Running& lane);
    // Begins quiet periods if this tick allows it, and ends them.
    static bool sleep(LaneLoops& loops, Running& lane);
    static void wake(const LaneLoops& loops, Running& lane, std::int64_t tick);

    // Sets the load's torque and the target that it approaches, N m, where a step of the load is due.
    static void step_load(DriveState& state, const Phase& phase, std::int64_t origin, double& torque, double& target);
    Faults faults_at(std::int64_t tick) const { return {config_.faults, tick, config_.inverter.bus_voltage}; }
    // What the inverter applies in this period.
    struct Acting {
        Phases duty;
        bool open;
    };
    void next_duties(DriveState& state, Acting& acting) const;
    // Lets the position sensor time the edges of a step of length h from the time `from`, s, on; the rotor is at theta_m now.
    void watch(DriveState& state, double from, double h, double theta_m, const Faults& faults) const;
    // i_q, A, from the phase currents and the angle that were sampled last.
    cgl_real measured_i_q(const DriveState& state) const;
    AngleCorrection correction(DriveState& state, const Faults& faults) const;
    // The motor's angle and speed from a position sensor on the load side. Not inlined into the loop, which hardly ever needs it.
    [[gnu::noinline]] Measurement measure_load(DriveState& state, const Phase& phase, std::int64_t origin, bool law_due,
                                               const Faults& faults) const;
    template <std::size_t legs>
    Voltage<> averaged(DriveState& state, const Phases& duty, const Phases& current, const Faults& faults) const;
    // Keeps the duty cycles of this period for the next one.
    void remember(DriveState& state, const Phases& applied) const;
    // alone: false in a lane. `current` is then what the sensors show, and actuate() must follow. If the law needs a sum of orders,
    // control() writes `orders` and returns true; the caller then computes orders->sum and calls end_law(). Else, and always alone, it
    // returns false.
    template <std::size_t legs, bool alone = true>
    bool control(DriveState& state, const Phase& phase, std::int64_t origin, bool law_due, const Phases& current,
                 const Faults& faults, Controller* other, OrderSum* orders = nullptr) const;
    // The parts of the law's step before and after a sum of orders. begin_law() returns false, and does nothing, if there is no sum.
    bool begin_law(DriveState& state, OrderSum& orders) const;
    template <std::size_t legs>
    void end_law(DriveState& state, const OrderSum& orders) const;
    void sample_reference(DriveState& state, const Phase& phase, std::int64_t origin) const;
    template <std::size_t legs>
    LawInput law_input(const DriveState& state, const Measurement& measured) const;
    template <std::size_t legs>
    void step_law(DriveState& state) const;
    template <std::size_t legs>
    void step_current(DriveState& state) const;
    template <std::size_t legs>
    void obey(DriveState& state, const Command& command) const;
    // before_step(u, from, h, after) is called before each step with pulses or an open bridge. The step begins `from` s after the
    // period's start and takes h s. after(plant, here) is what must be done to the plant after the step.
    template <std::size_t legs, Detail detail, class BeforeStep>
    void advance_plant(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase, std::int64_t origin,
                       const Acting& acting, const Phases& current, const Faults& faults, const BeforeStep& before_step) const;
    // advance_plant() with pulses. Not inlined, so that a period without pulses keeps its registers.
    template <std::size_t legs, Detail detail, class BeforeStep>
    [[gnu::noinline]] void advance_pulses(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase,
                                          std::int64_t origin, const Acting& acting, const Phases& current, const Faults& faults,
                                          const BeforeStep& before_step) const;
    // advance_plant() that also records the period's rows. Each row takes an extra step from the last state of the run, so that
    // the run itself does not change.
    template <std::size_t legs, Detail detail>
    [[gnu::noinline]] void advance_with_rows(DriveState& state, AtAngle<double>& here, AnglePatch& patch, const Phase& phase,
                                             std::int64_t origin, const Acting& acting, const Phases& current,
                                             const Faults& faults, Recorder& recorder) const;
    // within: time since the tick, s. u: the inverter's voltage at that time, for rows within periods.
    // Not inlined into run(), whose loop is 4 % faster without record().
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
    double dead_share_;    // share of the period that the inverter's dead time takes
    double least_duty_;    // the smallest duty cycle that is not dropped
    bool follows_angle_;   // whether the law follows its reference's angle
    bool steps_currents_;  // whether the law acts in each period of the current loop, too
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
