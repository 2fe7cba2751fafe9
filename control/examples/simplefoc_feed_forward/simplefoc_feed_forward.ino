// Learns the torque ripple of a motor that SimpleFOC controls, as a feed-forward current beside its own speed control.
//
// SimpleFOC's loop stays as it is. What remains of the speed error at each angle of the rotor is learned and added to
// the current that its velocity PID asks for: motor.feed_forward_current.q. Needs SimpleFOC 2.4 or newer, torque control
// by currents (foc_current, dc_current or estimated_current). estimated_current needs the motor's phase resistance: without it
// loopFOC() gives no voltage. examples/foreign runs such a loop on a plant, with the ripple before and after.
#include <SimpleFOC.h>
#include <cogless.h>

enum { CELLS = 512, Q_HALF_WIDTH = 1, LEARN_RATE = 1000 };  // Hz

// your motor, driver and sensor
BLDCMotor motor(7, 5.6f);  // pole pairs, phase resistance [ohm]
BLDCDriver3PWM driver(9, 5, 6, 8);
MagneticSensorI2C sensor(AS5600_I2C);

static cgl_drive_config drive_config;
static cgl_pi_ilc_config law_config;
CGL_MAP(map_of_ripple, CELLS, Q_HALF_WIDTH);
static cgl_pi_ilc law;
static cgl_drive drive;
static const char *refused = "";

// nullptr, or the field that cogless refuses: the motor runs as without it then.
static const char *start_learning()
{
    drive_config.pole_pairs = motor.pole_pairs;
    drive_config.divider = 1;
    drive_config.foreign = true;                   // SimpleFOC controls the currents,
    drive_config.feed_forward = true;              // and the speed: what is learned is added to its current
    drive_config.foc.current_limit = motor.current_limit;
    drive_config.monitor.omega_max = 300.0f;       // rad/s; faster is a jump of the sensor
    drive_config.monitor.angle_step = 0.0015f;     // rad; 12 bits
    drive_config.monitor.speed_window = 0.01f;     // s; twice the time constant of SimpleFOC's speed filter
    drive_config.monitor.stuck_angle = 0.5f;       // rad
    drive_config.monitor.stuck_time = 0.1f;        // s
    drive_config.monitor.bridge = 0.005f;          // s
    drive_config.monitor.hold = 0.01f;             // s
    drive_config.quality.span = CGL_TWO_PI;        // rad; a turn
    drive_config.quality.longest = 60.0f;          // s
    drive_config.quality.outlier = 4.0f;           // a knock teaches nothing
    drive_config.quality.floor = 0.5f;             // rad/s

    law_config.pi.kp = motor.PID_velocity.P;       // A s/rad; SimpleFOC's: they bound the learning, and do not act
    law_config.pi.ki = motor.PID_velocity.I;       // A/rad
    law_config.pi.limit = 0.3f * motor.current_limit;
    law_config.gain = 0.5f * motor.PID_velocity.P; // A s/rad
    law_config.memory.cells = CELLS;               // of a turn
    law_config.memory.q_half_width = Q_HALF_WIDTH;
    law_config.memory.lead = 6;                    // ms until the speed filter, of 5 ms, has seen a current's effect
    law_config.memory.limit[0] = 0.3f * motor.current_limit;
    if (cgl_drive_init(&drive, &drive_config, 1.0f / LEARN_RATE) != CGL_OK) {
        return cgl_drive_bad_field(&drive_config, 1.0f / LEARN_RATE);
    }
    if (cgl_pi_ilc_init(&law, &law_config, &drive.loop, map_of_ripple, CGL_ENTRIES(map_of_ripple)) != CGL_OK) {
        return cgl_pi_ilc_bad_field(&law_config, &drive.loop);
    }
    return nullptr;
}

// Whether SimpleFOC gives what its velocity PID asks for, after motor.move(), which leaves the PID's output in current_sp:
// at a limit of current or voltage an error remains that is no ripple.
static bool follows()
{
    const float limit = motor.PID_velocity.limit < motor.current_limit ? motor.PID_velocity.limit : motor.current_limit;
    return cgl_abs(motor.current_sp) < limit && cgl_abs(motor.voltage.q) < motor.voltage_limit;
}

// Once per LEARN_RATE: the current to add, A.
static float learned_current()
{
    cgl_measurement now = {};
    cgl_reference reference = {};
    cgl_drive_output out;
    now.theta_m = sensor.getMechanicalAngle();
    now.omega_m = motor.shaft_velocity;
    reference.omega_ref = motor.target;
    reference.learn = motor.enabled != 0 && follows();
    if (cgl_drive_measure(&drive, &now, &reference)) {
        cgl_pi_ilc_step(&law, &drive.in, &drive.command);
    }
    cgl_drive_actuate(&drive, &out);
    return out.i_q_ref;
}

void setup()
{
    sensor.init();
    motor.linkSensor(&sensor);
    driver.voltage_power_supply = 12;
    driver.init();
    motor.linkDriver(&driver);
    motor.torque_controller = TorqueControlType::estimated_current;
    motor.controller = MotionControlType::velocity;
    motor.current_limit = 2.0f;
    motor.init();
    motor.initFOC();
    motor.target = 6.28f;  // rad/s
    motor.PID_velocity.P = 0.04f;  // A s/rad: SimpleFOC's default of 0.5 is for volts
    motor.PID_velocity.I = 0.8f;   // A/rad
    motor.LPF_velocity.Tf = 0.005f;
    Serial.begin(115200);
    refused = start_learning();
    if (refused != nullptr) {
        Serial.println(refused);
    }
}

void loop()
{
    static unsigned long next = 0;
    motor.loopFOC();
    motor.move();
    if ((long)(micros() - next) >= 0) {
        next += 1000000UL / LEARN_RATE;
        if (refused == nullptr) {
            motor.feed_forward_current.q = learned_current();
        }
    }
}
