// As much of SimpleFOC's interface as the example uses, so that it compiles where SimpleFOC is not.
#pragma once

enum { AS5600_I2C };
enum class TorqueControlType { estimated_current };
enum class MotionControlType { velocity };

unsigned long micros();

static struct {
    void begin(long) {}
    void println(const char *) {}
} Serial;

struct MagneticSensorI2C {
    explicit MagneticSensorI2C(int) {}
    void init() {}
    float getMechanicalAngle() { return 0.0f; }
};

struct BLDCDriver3PWM {
    BLDCDriver3PWM(int, int, int, int) {}
    void init() {}
    float voltage_power_supply = 0.0f;
};

struct BLDCMotor {
    explicit BLDCMotor(int pp, float R) : pole_pairs(pp), phase_resistance(R) {}
    void linkSensor(MagneticSensorI2C *) {}
    void linkDriver(BLDCDriver3PWM *) {}
    void init() {}
    void initFOC() {}
    void loopFOC() {}
    void move() {}
    int pole_pairs;
    float phase_resistance;
    float target = 0.0f, shaft_velocity = 0.0f, current_limit = 0.0f, voltage_limit = 0.0f, current_sp = 0.0f;
    signed char enabled = 1;
    TorqueControlType torque_controller{};
    MotionControlType controller{};
    struct { float P = 0.0f, I = 0.0f, limit = 0.0f; } PID_velocity;
    struct { float Tf = 0.0f; } LPF_velocity;
    struct { float q = 0.0f, d = 0.0f; } feed_forward_current, voltage;
};
