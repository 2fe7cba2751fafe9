/* Plausibility of a drive's measurements, looked at once per current-loop period before anything uses them.
 *
 * Jump: a step of the angle beyond omega_max ts + angle_step. No rotor turns so fast, so the sensor has jumped. The jump is
 * taken out of the angle, and torque and commutation go on. Learning waits, since a map belongs to its angle, until the
 * angle has jumped back or cgl_monitor_trust() says that the new one is right.
 *
 * Gap: angles that are missing, which means not finite, or jumping all the time. They are bridged by the last speed. With
 * more of them than `bridge` has periods, or a speed that has not been believed for as long, the output is safe: no voltage.
 * Two angles that agree end the gap. The sensor is then off by as much as before it or right again, whichever is nearer to
 * where the rotor should be; if the rotor can be at neither, the sensor has jumped. After a gap longer than `bridge` of a
 * sensor that was off before it nobody can tell: the output stays safe until cgl_monitor_trust().
 *
 * Stuck: an angle that stands still while the reference turns. First the angle is doubted, and learning stops. The feedback has all
 * the time that it needs to raise the current. The output becomes safe once the reference has turned by stuck_angle and full current
 * has not moved the angle for stuck_time. It stays safe until the angle moves or the reference stands still. After a rest of ten
 * times the length of that attempt, the next attempt follows.
 *
 * An implausible current or bus voltage gives a safe output, too. The output stays safe for `hold` after the last cause.
 *
 * At no voltage the current of a turning motor is that of a short circuit, up to psi_f / L_d. Open the bridge where the
 * output is safe (CGL_STATUS_OFF), if the hardware can. */
#ifndef COGLESS_MONITOR_H
#define COGLESS_MONITOR_H

#include <stdint.h>

#include "real.h"
#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A bound of 0 is not watched. What is not finite is never plausible. No time is longer than 1e9 ts. */
typedef struct {
    cgl_real omega_max;    /* bound on the true speed, and on the measured one with a count more in its window,
                              mechanical [rad/s], >= 0; default 0 */
    cgl_real angle_step;   /* resolution of the angle sensor, mechanical [rad], >= 0; default 0 */
    cgl_real speed_window; /* window of a measured speed; the speed stays implausible for as long after a jump [s], >= 0 */
    cgl_real stuck_angle;  /* the angle counts as stuck if the reference turns by this while it stands still [rad], >= 0;
                              learning stops at a quarter of this; default 0 */
    cgl_real stuck_time;   /* and if full current has pushed in the reference's direction for this time since that quarter
                              [s], 0 to 9e7 ts; default 0 */
    cgl_real current_max;  /* the current vector is never longer, in a short circuit neither [A], >= 0; default 0 */
    cgl_real current_sum;  /* three measured phases: |i_a + i_b + i_c| is not larger [A], >= 0; default 0 */
    cgl_real bridge;       /* a missing angle is bridged so long [s], >= 0; default 0 */
    cgl_real hold;         /* a safe output is held so long after its cause [s], >= 0; default 0 */
    uint32_t phases;       /* measured currents that are looked at: 3, 2, or 0; default 0 */
} cgl_monitor_config;

typedef struct {
    cgl_real i_abc[3]; /* measured phase currents [A]; those beyond config.phases are not looked at */
    cgl_real theta_m;  /* measured mechanical angle [rad], any revolution below CGL_ANGLE_MAX; fastest in [0, 2 pi) */
    cgl_real omega_m;  /* measured mechanical speed [rad/s] */
    cgl_real u_dc;     /* bus voltage [V]; not looked at if config.phases is 0 */
} cgl_measurement;

/* Bounds that init derives from a config, so that a step neither divides nor multiplies constants. */
typedef struct {
    cgl_real reach;          /* of the rotor in a period [rad] */
    cgl_real reach_square;   /* [rad^2] */
    cgl_real speed_square;   /* [rad^2/s^2] */
    cgl_real stuck_square;   /* [rad^2] */
    cgl_real doubt_square;   /* [rad^2] */
    cgl_real current_square; /* of all measured phases together [A^2] */
    cgl_real sum_square;     /* [A^2] */
    uint32_t window, bridge, hold, stuck; /* periods */
} cgl_monitor_limits;

typedef struct {
    bool was_stuck;      /* said so since the angle moved: it comes back anywhere */
    bool unsure;         /* lost for long while it was shifted: nothing but trust tells where the rotor is */
    bool started;        /* theta_m is valid */
    bool known;          /* raw is of the last period */
    bool safe;           /* the output must be zero: no torque is possible that one could trust */
    bool trusted;        /* nothing stands against learning */
    uint32_t gap;        /* angles that are missing: one more with each, one less with each that agrees with the last */
    uint32_t lost;       /* periods without an angle since there was no gap */
    uint32_t blind;      /* periods for which the measured speed is not believed yet */
    uint32_t dark;       /* periods for which it has not been believed */
    uint32_t standing;   /* periods in which the angle stood still and was doubted */
    uint32_t pushing;    /* number of them with full current in the reference's direction, less those with less current */
    uint32_t attempt;    /* number of them up to the one in which the rotor counted as stuck; 0: it does not */
    uint32_t holding;    /* periods for which the output still is safe */
    uint32_t jumps;      /* since init or reset, there, back and for one period only; stays at its largest value */
    unsigned status;     /* CGL_STATUS_ bits of the last step */
    cgl_real theta_m;    /* to be used: plausible, without the jumps, in [0, 2 pi) [rad] */
    cgl_real omega_m;    /* to be used [rad/s] */
    cgl_real shift;      /* of the sensor by its jumps, in [-pi, pi] [rad] */
    cgl_real slip;       /* the shift when no angle was missing last [rad] */
    cgl_real raw;        /* the last measured angle, in [0, 2 pi) [rad] */
    cgl_real still;      /* the reference has turned so far since the angle moved [rad] */
    cgl_monitor_limits limits;
    cgl_monitor_config config;
    cgl_real ts;        /* period of the calls [s] */
} cgl_monitor;

/* The first field that init refuses, as CGL_FIELD; NULL: none. */
const char *cgl_monitor_bad_field(const cgl_monitor_config *config, cgl_real ts);

cgl_error cgl_monitor_init(cgl_monitor *monitor, const cgl_monitor_config *config, cgl_real ts);

/* Takes other bounds while it runs; the angle and its jumps stay, and what is held is held as long as before. */
cgl_error cgl_monitor_retune(cgl_monitor *monitor, const cgl_monitor_config *config);

/* Forgets the past: the next angle is right, and the output safe until there is one. */
void cgl_monitor_reset(cgl_monitor *monitor);

/* Checks the measurements of this period. omega_ref: the speed's reference [rad/s]. full: the drive pushes in the reference's
 * direction at the limit of its current or voltage. Fills theta_m, omega_m, safe, trusted and status for any input. While `standing`
 * is 0, full has no effect and may be false. */
void cgl_monitor_step(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full);

/* Does what step does, the long way: step takes a short one where nothing was, and nothing is, amiss. */
void cgl_monitor_look(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full);

/* The measured angle is right as it is now, after a homing run say: jumps are forgotten. False where there is none now:
 * call it again. */
bool cgl_monitor_trust(cgl_monitor *monitor);

#ifdef __cplusplus
}
#endif

#endif
