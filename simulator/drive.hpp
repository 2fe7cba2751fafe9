// A drive: plant, inverter, sensors, current loop and speed law in one multirate loop on an integer tick.
//
// One tick is one current-loop period. In tick n the drive samples at t = n / current_rate, runs the speed law where
// n % speed_divider == 0, runs the current loop, records, and lets the plant go on to the next tick.
#pragma once

#include <cstdint>
#include <vector>

#include "cogless/foc.h"
#include "current_sensors.hpp"
#include "inverter.hpp"
#include "plant.hpp"
#include "position_sensor.hpp"
#include "random.hpp"
#include "recorder.hpp"
#include "reference.hpp"
#include "speed_laws.hpp"

namespace cogless {

// At this tick the constant part of the load gets a new target.
struct LoadStep {
    std::int64_t tick;
    double torque;  // N m
};

struct DriveConfig {
    PmsmConfig motor;
    MechanicsConfig mechanics;
    LoadConfig load;
    std::vector<LoadStep> load_steps;  // by tick
    InverterConfig inverter;
    CurrentSensorsConfig current_sensors;
    PositionSensorConfig position_sensor;
    ReferenceConfig reference;
    cgl_foc_config current_loop;
    SpeedLaw law;
    std::int64_t current_rate;   // Hz
    std::int64_t speed_divider;  // current-loop periods in a speed-loop period
    int integration_steps;       // RK4 steps in a current-loop period
    double initial_speed, initial_angle;  // mechanical, rad/s, rad
    double learning_start;       // s
    std::uint64_t seed;
    bool energy;                 // integrate and record the energies
};

struct DriveState {
    std::int64_t tick = 0;
    PlantState plant;
    PositionSensor::State position;
    Random random{0};
    cgl_foc current_loop;
    SpeedLawState law;
    Measurement measured{0.0, 0.0};
    double omega_ref = 0.0;
    Command command;
    cgl_foc_output output{};
    Phases duty{0.5, 0.5, 0.5};  // that the inverter realises in this period
    std::size_t next_load_step = 0;
};

class Drive {
public:
    // Throws std::invalid_argument for a configuration that a control law refuses.
    explicit Drive(const DriveConfig& config);

    const std::vector<Signal>& signals() const { return signals_; }

    DriveState start() const;

    // Runs so many current-loop periods. Throws std::runtime_error where a user's law returns no number; the state is then
    // that of the failing period.
    void advance(DriveState& state, Recorder& recorder, std::int64_t ticks) const;

    LearnedMap learned(const DriveState& state) const;
    void teach(DriveState& state, const std::vector<double>& table) const;

private:
    // z in all of these: the values of the plant's powers at the rotor's angle
    template <bool CountEnergy>
    void advance_plant(DriveState& state, Powers::Values& z, const Phases& duty, const Phases& current) const;
    void control(DriveState& state, const Phases& current) const;
    // Kept out of advance(), whose loop is 4 % faster without it.
    [[gnu::noinline]] void record(const DriveState& state, const Powers::Values& z, const Phases& current,
                                  double* row) const;

    double time(std::int64_t tick) const {
        return static_cast<double>(tick) / static_cast<double>(config_.current_rate);
    }

    DriveConfig config_;
    double period_;  // s, of the current loop
    Plant plant_;
    PositionSensor position_sensor_;
    CurrentSensors current_sensors_;
    std::vector<Signal> signals_;
};

}  // namespace cogless
