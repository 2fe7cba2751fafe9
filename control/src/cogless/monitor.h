/* Checks once per current-loop period whether the measurements of a drive are plausible, before anything uses them.
 *
 * Jump: the angle steps by more than omega_max ts + angle_step. No rotor turns so fast, so the sensor has jumped. The jump is subtracted
 * from the angle, and torque and commutation go on. A learned map belongs to the true angle. So learning waits until the sensor jumps back,
 * or until cgl_monitor_trust() says that the new angle is right.
 *
 * Gap: angles are missing, because they are not finite or jump in every period. The last speed bridges a gap of up to `bridge`. If the gap
 * is longer, or the speed is implausible for longer, the output becomes safe: zero voltage. As soon as two successive angles agree, the
 * sensor gives the angle again. Learning waits until as many angles agree as were missing, at most bridge / ts + 1. After a gap the
 * sensor's offset, which is the sum of its jumps, is 0 or the same as before the gap, whichever puts the rotor nearer to its expected
 * place. If the rotor can be at neither place, the sensor has jumped. If a sensor that already has an offset has a gap longer than
 * `bridge`, the rotor's place is unknown. The output then stays safe until cgl_monitor_trust().
 *
 * Stuck: the angle stands still while the reference turns. Once the reference has turned by a quarter of stuck_angle, learning stops, and
 * the feedback gets time to raise the current. The output becomes safe once the reference has turned by stuck_angle and full current has
 * not moved the angle for stuck_time. This is a failed attempt to turn the rotor. The output stays safe until the angle moves or the
 * reference stands still. The next attempt follows after a rest of ten times the length of the failed attempt.
 *
 * An implausible current or bus voltage makes the output safe too. The output stays safe for the time `hold` after the last cause.
 *
 * At zero voltage a turning motor carries its short-circuit current, up to psi_f / L_d. If the hardware can, open the bridge while the
 * output is safe (CGL_STATUS_OFF). */
#ifndef COGLESS_MONITOR_H
#define COGLESS_MONITOR_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A bound of 0 checks nothing. A value that is not finite is never plausible. Each time is 1e9 ts at most. */
typedef struct {
    cgl_real omega_max;    /* largest plausible mechanical speed [rad/s], >= 0; default 0. Use the rotor's largest speed, plus the speed
                              that one more count of the sensor in speed_window adds to the measured speed */
    cgl_real angle_step;   /* mechanical resolution of the angle sensor [rad], >= 0; default 0 */
    cgl_real speed_window; /* time over which the speed is measured [s], >= 0. For this time after a jump of the angle the speed is not
                              plausible */
    cgl_real stuck_angle;  /* angle by which the reference must turn, while the measured angle stands still, before the measured angle
                              counts as stuck [rad], >= 0; default 0. Learning stops at a quarter of this angle */
    cgl_real stuck_time;   /* time for which full current must also push in the reference's direction before the angle counts as stuck
                              [s], 0 to 9e7 ts; default 0. The count begins when the reference has turned by a quarter of stuck_angle. Each
                              period without full current takes one period off the count */
    cgl_real current_max;  /* largest length of the current vector, even in a short circuit [A], >= 0; default 0 */
    cgl_real current_sum;  /* largest |i_a + i_b + i_c| if three phases are measured [A], >= 0; default 0 */
    cgl_real bridge;       /* longest gap of the angle that the last speed bridges [s], >= 0; default 0 */
    cgl_real hold;         /* time for which the output stays safe after the last cause [s], >= 0; default 0 */
    uint32_t phases;       /* number of measured phase currents that are checked: 3, 2, or 0; default 0 */
} cgl_monitor_config;

typedef struct {
    cgl_real i_abc[3]; /* measured phase currents [A]; the first config.phases are checked */
    cgl_real theta_m;  /* measured mechanical angle [rad], over any number of turns; its magnitude is below CGL_ANGLE_MAX. In [0, 2 pi) the
                          checks take the least time */
    cgl_real omega_m;  /* measured mechanical speed [rad/s] */
    cgl_real u_dc;     /* bus voltage [V]; it is not checked if config.phases is 0 */
} cgl_measurement;

/* Bounds that init derives from a config, so that a step needs no division. */
typedef struct {
    cgl_real travel;         /* largest plausible change of the sensor's angle from one period to the next [rad] */
    cgl_real travel_square;  /* square of travel [rad^2] */
    cgl_real speed_square;   /* square of omega_max [rad^2/s^2] */
    cgl_real stuck_square;   /* square of stuck_angle [rad^2] */
    cgl_real doubt_square;   /* square of a quarter of stuck_angle [rad^2] */
    cgl_real current_square; /* largest sum of the squares of the measured phase currents [A^2] */
    cgl_real sum_square;     /* square of current_sum [A^2] */
    uint32_t window, bridge, hold, stuck; /* speed_window, bridge, hold and stuck_time [periods] */
} cgl_monitor_limits;

/* Config and bounds come last: a processor reaches the first bytes of a struct with shorter instructions. */
typedef struct {
    bool safe;                  /* the output must be zero: the measurements allow no torque */
    bool trusted;               /* the law may learn: all measurements are plausible, and no gap, jump or standstill affects them */
    bool started;               /* the sensor has shown an angle, so theta_m is valid */
    bool has_angle;             /* the last period had an angle, theta_sensor */
    bool stuck_since_moved;     /* the angle has been stuck at least once since its last change: after a gap the rotor may be anywhere */
    bool position_unknown;      /* a sensor with an offset had a long gap: only cgl_monitor_trust() can tell where the rotor is */
    uint32_t missing_angles;    /* count of a gap: a missing angle adds 1, an angle that agrees with the last one takes 1 off; 0: no gap */
    uint32_t gap_periods;       /* periods with a missing angle in this gap */
    uint32_t speed_wait;        /* periods until the speed window no longer contains a jump of the angle */
    uint32_t speed_lost;        /* successive periods in which speed_wait was not 0 */
    uint32_t standstill;        /* periods of the angle's standstill after the reference had turned by a quarter of stuck_angle */
    uint32_t full_current;      /* periods of `standstill` with full current, less the periods without full current */
    uint32_t stuck_after;       /* value of `standstill` when the rotor began to count as stuck; 0: the rotor does not count as stuck */
    uint32_t hold_wait;         /* periods for which the output stays safe */
    uint32_t jumps;             /* jumps of the angle since init or reset, a jump back included; the count stops at its largest value */
    unsigned status;            /* CGL_STATUS_ bits of the last step */
    cgl_real theta_m;           /* plausible mechanical angle for use, without the sensor's offset [rad], in [0, 2 pi) */
    cgl_real omega_m;           /* plausible mechanical speed for use [rad/s] */
    cgl_real sensor_offset;     /* offset of the sensor's angle, the sum of its jumps [rad], in [-pi, pi] */
    cgl_real offset_before_gap; /* sensor_offset of the last period without a gap [rad] */
    cgl_real theta_sensor;      /* last mechanical angle that the sensor showed [rad], in [0, 2 pi) */
    cgl_real ref_turned;        /* angle by which the reference has turned since the measured angle last moved [rad] */
    cgl_monitor_limits limits;
    cgl_monitor_config config;
    cgl_real ts;                /* period of the calls [s] */
} cgl_monitor;

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_monitor_bad_field(const cgl_monitor_config *config, cgl_real ts);

cgl_error cgl_monitor_init(cgl_monitor *monitor, const cgl_monitor_config *config, cgl_real ts);

/* Replaces the bounds at run time. Angle, jumps and all waiting times stay as they are. */
cgl_error cgl_monitor_retune(cgl_monitor *monitor, const cgl_monitor_config *config);

/* Forgets all measurements. The next angle counts as right, and the output is safe until this angle comes. */
void cgl_monitor_reset(cgl_monitor *monitor);

/* Checks the measurements of this period. omega_ref is the reference of the mechanical speed [rad/s]. `full` says that the drive pushes
 * in the reference's direction, at the limit of its current or voltage. While standstill is 0, `full` has no effect. Whatever the input,
 * theta_m, omega_m, safe, trusted and status are valid afterwards. */
void cgl_monitor_step(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full);

/* Does all checks. cgl_monitor_step() gives the same result, but leaves out most checks if the last period was trusted and this one is
 * plausible. */
void cgl_monitor_look(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full);

/* Declares the sensor's present angle right, for example after a homing run. This removes the offset. If the last period had no angle,
 * the function does nothing and returns false: call it again. */
bool cgl_monitor_trust(cgl_monitor *monitor);

#ifdef __cplusplus
}
#endif

#endif
