#include "monitor.h"

#include "angle.h"
#include "monitor_parts.h"
#include "range.h"

/* The next attempt to turn a stuck rotor begins 11 attempt lengths after the last one began: the attempt itself, and a rest of ten
 * lengths. So a sensor that works again is noticed soon, and the winding can cool. */
#define ATTEMPT_SPACING 11U
#define PERIODS_MAX CGL_R(1.0e9)

/* Returns the square of a bound; for a bound of 0 the largest number. The square is never infinite, so an infinite value is never
 * plausible. */
CGL_SELDOM static cgl_real squared_bound(cgl_real bound)
{
    return bound > CGL_R(0.0) ? cgl_clamped(bound * bound, CGL_REAL_MAX) : CGL_REAL_MAX;
}

CGL_SELDOM static bool is_time(cgl_real time, cgl_real ts)
{
    return cgl_is_not_negative(time) && time / ts <= PERIODS_MAX;
}

/* The number of periods in a time, rounded up. */
CGL_SELDOM static uint32_t periods(cgl_real time, cgl_real ts)
{
    const cgl_real exact = cgl_clamped(time / ts, PERIODS_MAX);
    const uint32_t whole = (uint32_t)exact;
    /* Rounds up, unless time / ts is above `whole` by less than a thousandth of itself: such a rest is rounding error. */
    return (cgl_real)whole < exact * CGL_R(0.999) ? whole + 1U : whole;
}

CGL_SELDOM const char *cgl_monitor_bad_field(const cgl_monitor_config *config, cgl_real ts)
{
    static const cgl_range range[] = {CGL_RANGE(monitor, omega_max, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(monitor, angle_step, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(monitor, stuck_angle, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(monitor, current_max, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(monitor, current_sum, CGL_NOT_NEGATIVE)};
    const char *const field = CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (!cgl_is_positive(ts)) {
        return CGL_FIELD("ts");
    }
    if (!is_time(config->speed_window, ts)) {
        return CGL_FIELD("monitor.speed_window");
    }
    if (!is_time(config->bridge, ts)) {
        return CGL_FIELD("monitor.bridge");
    }
    if (!is_time(config->hold, ts)) {
        return CGL_FIELD("monitor.hold");
    }
    if (!(is_time(config->stuck_time, ts) && is_time((cgl_real)ATTEMPT_SPACING * config->stuck_time, ts))) {
        return CGL_FIELD("monitor.stuck_time");
    }
    return config->phases == 0U || config->phases == 2U || config->phases == 3U ? 0 : CGL_FIELD("monitor.phases");
}

CGL_SELDOM static void apply_config(cgl_monitor *monitor, const cgl_monitor_config *config, cgl_real ts)
{
    monitor->config = *config;
    monitor->ts = ts;
    cgl_monitor_limits *limits = &monitor->limits;
    /* a bound of 2 pi checks nothing: two angles are at most half a revolution apart */
    limits->travel = config->omega_max > CGL_R(0.0)
                        ? cgl_clamped(config->omega_max * ts + config->angle_step, CGL_TWO_PI)
                        : CGL_TWO_PI;
    limits->travel_square = limits->travel * limits->travel;
    limits->speed_square = squared_bound(config->omega_max);
    limits->stuck_square = squared_bound(config->stuck_angle);
    limits->doubt_square = squared_bound(CGL_R(0.25) * config->stuck_angle);
    /* with three phases, the sum of the squares is 3/2 of the squared length of the vector */
    limits->current_square = squared_bound(config->current_max);
    if (config->phases == 3U) {
        limits->current_square = cgl_clamped(CGL_R(1.5) * limits->current_square, CGL_REAL_MAX);
    }
    limits->sum_square = squared_bound(config->current_sum);
    limits->window = periods(config->speed_window, ts);
    limits->bridge = periods(config->bridge, ts);
    limits->hold = periods(config->hold, ts);
    limits->stuck = periods(config->stuck_time, ts);
}

CGL_SELDOM cgl_error cgl_monitor_init(cgl_monitor *monitor, const cgl_monitor_config *config, cgl_real ts)
{
    if (cgl_monitor_bad_field(config, ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    apply_config(monitor, config, ts);
    cgl_monitor_reset(monitor);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_monitor_retune(cgl_monitor *monitor, const cgl_monitor_config *config)
{
    if (cgl_monitor_bad_field(config, monitor->ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    apply_config(monitor, config, monitor->ts);
    return CGL_OK;
}

CGL_SELDOM void cgl_monitor_reset(cgl_monitor *monitor)
{
    monitor->theta_m = monitor->omega_m = monitor->sensor_offset = monitor->offset_before_gap = monitor->theta_sensor = monitor->ref_turned = CGL_R(0.0);
    monitor->missing_angles = monitor->gap_periods = monitor->speed_wait = monitor->speed_lost = 0U;
    monitor->standstill = monitor->full_current = monitor->stuck_after = monitor->hold_wait = monitor->jumps = 0U;
    monitor->status = 0U;
    monitor->started = monitor->has_angle = monitor->trusted = monitor->stuck_since_moved = monitor->position_unknown = false;
    monitor->safe = true;
}

CGL_SELDOM bool cgl_monitor_trust(cgl_monitor *monitor)
{
    if (monitor->has_angle) {
        monitor->sensor_offset = monitor->offset_before_gap = CGL_R(0.0);
        monitor->theta_m = monitor->theta_sensor;
        monitor->missing_angles = monitor->gap_periods = 0U;
        monitor->position_unknown = false;
    }
    return monitor->has_angle;
}

/* Adds 1 to a count. A count at its largest value stays. */
CGL_SELDOM static void count_up(uint32_t *count)
{
    *count += *count < UINT32_MAX ? 1U : 0U;
}

/* Takes 1 from a count. A count of 0 stays. */
CGL_SELDOM static void count_down(uint32_t *count)
{
    *count -= *count > 0U ? 1U : 0U;
}

/* Whether x is a number and not 0. */
static bool is_not_zero(cgl_real x)
{
    return cgl_abs(x) > CGL_R(0.0);
}

/* Returns the same angle in [0, 2 pi). */
CGL_SELDOM static cgl_real in_turn(cgl_real theta)
{
    if (cgl_is_in_turn(theta)) {
        return theta;
    }
    return CGL_TWO_PI * cgl_fraction(theta * (CGL_R(1.0) / CGL_TWO_PI));
}

/* Returns the angle from `from` to `to`, the shorter way round [rad]. Both angles are in [0, 2 pi). */
CGL_SELDOM static cgl_real difference(cgl_real to, cgl_real from)
{
    const cgl_real d = to - from;
    return d > CGL_PI ? d - CGL_TWO_PI : (d < -CGL_PI ? d + CGL_TWO_PI : d);
}

/* Handles an ordinary period in few instructions. A period is ordinary if the last one was trusted and this one is plausible. In any
 * other period it returns false and leaves the state untouched. */
static inline bool is_ordinary(cgl_monitor *monitor, const cgl_measurement *now,
                               cgl_real omega_ref)
{
    const cgl_real theta = now->theta_m, omega = now->omega_m;
    const cgl_real d = theta - monitor->theta_sensor;
    if (!(monitor->trusted && cgl_is_rotor_ordinary(monitor, theta, d, omega))) {
        return false;
    }
    if (monitor->config.phases != 0U && !cgl_are_currents_ordinary(monitor, now->i_abc, now->u_dc)) {
        return false;
    }
    cgl_real ref_turned = CGL_R(0.0);
    if (d == CGL_R(0.0)) {
        ref_turned = monitor->ref_turned + omega_ref * monitor->ts;
        if (!(ref_turned * ref_turned <= monitor->limits.doubt_square)) {
            return false;
        }
    }
    monitor->ref_turned = ref_turned;
    monitor->theta_m = monitor->theta_sensor = theta;
    monitor->omega_m = omega;
    return true;
}

void cgl_monitor_step(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full)
{
    if (!is_ordinary(monitor, now, omega_ref)) {
        cgl_monitor_look(monitor, now, omega_ref, full);
    }
}

/* Decides after a gap which offset the sensor has: 0, the offset before the gap, or a new one. `theta` is the sensor's angle, which agrees
 * with the sensor's last angle, and `d` is the change between these two angles.
 *
 * An offset of 0 is possible if it puts the rotor within reach of its expected place. A rotor that counted as stuck may be anywhere. If the
 * angle stood still while the reference turned, the sensor may have stood still and not the rotor. The rotor may then have turned by about
 * as much as the reference. */
CGL_SELDOM static void end_gap(cgl_monitor *monitor, cgl_real theta, cgl_real d)
{
    const cgl_monitor_config *const config = &monitor->config;
    const cgl_real offset = difference(theta, in_turn(monitor->theta_m + d)), ref_turned = monitor->ref_turned;
    /* The rotor's reach counts one period more than the gap has, because the angle before the gap may be wrong too. */
    const cgl_real reach = monitor->limits.travel * ((cgl_real)monitor->gap_periods + CGL_R(1.0));
    const bool moved_unseen = config->stuck_angle > CGL_R(0.0) && offset * ref_turned > CGL_R(0.0);
    const cgl_real from_old = cgl_abs(difference(offset, monitor->offset_before_gap)), from_none = cgl_abs(offset);
    const bool can_be_none = monitor->stuck_since_moved
                             || from_none <= reach + (moved_unseen ? CGL_R(2.0) * cgl_abs(ref_turned) : CGL_R(0.0));
    const bool had_offset = is_not_zero(monitor->offset_before_gap);
    monitor->position_unknown = monitor->position_unknown || (had_offset && monitor->gap_periods > monitor->limits.bridge);
    if (from_none <= from_old || !had_offset) {
        monitor->sensor_offset = can_be_none ? CGL_R(0.0) : offset;
    } else {
        monitor->sensor_offset = from_old <= reach ? monitor->offset_before_gap : offset;
    }
}

/* Ends the attempt to turn a rotor that stands still, and clears the counters of the attempt. */
CGL_SELDOM static void end_attempt(cgl_monitor *monitor)
{
    monitor->ref_turned = CGL_R(0.0);
    monitor->standstill = monitor->full_current = monitor->stuck_after = 0U;
}

/* Counts the periods of an attempt to turn the rotor, and the periods with full current among them. A period with less current takes 1 off
 * the second count, because the report of full current may flicker. Returns whether the attempt has failed, so that the rotor counts as
 * stuck. */
CGL_SELDOM static bool has_attempt_failed(cgl_monitor *monitor, cgl_real ref_turned_square, bool full)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    count_up(&monitor->standstill);
    if (monitor->stuck_after == 0U) {
        if (full) {
            ++monitor->full_current;
        } else {
            count_down(&monitor->full_current);
        }
        if (ref_turned_square > limits->stuck_square && monitor->full_current > 0U && monitor->full_current >= limits->stuck) {
            const uint32_t most = UINT32_MAX / ATTEMPT_SPACING; /* largest value that standstill / ATTEMPT_SPACING can reach */
            monitor->stuck_after = monitor->standstill < most ? monitor->standstill : most;
            monitor->full_current = 0U;
        }
    }
    return monitor->stuck_after > 0U;
}

/* Whether the rotor counts as stuck: the reference has turned, and full current has not moved the angle. `d` is the change of the angle
 * in this period. The stuck state ends when the angle moves or the reference stands still. While the reference turns, the result is
 * false for one period whenever the next attempt is due. */
CGL_SELDOM static bool is_stuck(cgl_monitor *monitor, cgl_real d, cgl_real omega_ref, bool full)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    const cgl_real turned = omega_ref * monitor->ts;
    const cgl_real most = cgl_clamped((cgl_real)ATTEMPT_SPACING * monitor->config.stuck_angle, CGL_REAL_MAX);
    if (is_not_zero(d)) {
        end_attempt(monitor);
        return false;
    }
    if (cgl_is_finite(turned)) {
        monitor->ref_turned = cgl_clamped(monitor->ref_turned + turned, most);
    }
    const cgl_real ref_turned_square = monitor->ref_turned * monitor->ref_turned;
    if (ref_turned_square <= limits->doubt_square) {
        monitor->standstill = monitor->full_current = monitor->stuck_after = 0U;
        return false;
    }
    if (!has_attempt_failed(monitor, ref_turned_square, full)) {
        return false;
    }
    const bool is_next_due = cgl_abs(monitor->ref_turned) >= most
                             && monitor->standstill / ATTEMPT_SPACING >= monitor->stuck_after - 1U;
    if (!is_next_due && is_not_zero(omega_ref)) {
        return true;
    }
    monitor->hold_wait = is_next_due ? 0U : monitor->hold_wait; /* without this, `hold` could outlast the new attempt */
    end_attempt(monitor);
    return false;
}

/* Whether repeated jumps of the angle have left no plausible speed for longer than `bridge`. */
static bool is_speed_lost(const cgl_monitor *monitor)
{
    return monitor->speed_lost > monitor->limits.window + monitor->limits.bridge;
}

/* Follows the angle theta, which agrees with the sensor's last angle. `d` is the change between the two. Returns whether the rotor is
 * stuck. */
static bool follow_angle(cgl_monitor *monitor, cgl_real theta, cgl_real d, cgl_real omega_ref, bool full)
{
    if (monitor->missing_angles > 0U) {
        end_gap(monitor, theta, d);
    }
    monitor->theta_m = in_turn(theta - monitor->sensor_offset);
    count_down(&monitor->speed_wait);
    const bool stuck = is_stuck(monitor, d, omega_ref, full);
    monitor->stuck_since_moved = stuck || (monitor->stuck_since_moved && d * d <= CGL_R(0.0));
    return stuck;
}

/* Moves theta_m on at the last speed, because the angle is missing or has jumped. */
static void bridge_angle(cgl_monitor *monitor, bool jumped)
{
    monitor->theta_m = in_turn(monitor->theta_m + monitor->omega_m * monitor->ts);
    monitor->speed_wait = monitor->limits.window + 1U;
    if (jumped) {
        count_up(&monitor->jumps);
    }
}

/* Takes the measured speed if it is plausible. Returns false if it is implausible and no jump of the angle explains that. */
static bool follow_speed(cgl_monitor *monitor, cgl_real omega_m)
{
    if (monitor->speed_wait > 0U) {
        count_up(&monitor->speed_lost);
        return true;
    }
    monitor->speed_lost = 0U;
    if (!(omega_m * omega_m <= monitor->limits.speed_square)) {
        return false;
    }
    monitor->omega_m = omega_m;
    return true;
}

/* Counts the missing angles of a gap. A period with an angle that agrees with the last one takes one off the count. */
static void count_gap(cgl_monitor *monitor, bool missing)
{
    if (missing) {
        monitor->missing_angles += monitor->missing_angles <= monitor->limits.bridge ? 1U : 0U;
        count_up(&monitor->gap_periods);
    } else if (monitor->missing_angles > 0U) {
        --monitor->missing_angles;
        monitor->gap_periods = monitor->missing_angles > 0U ? monitor->gap_periods : 0U;
    }
    if (monitor->missing_angles == 0U) {
        monitor->offset_before_gap = monitor->sensor_offset;
    }
}

/* Checks angle and speed, and returns their status bits. */
CGL_SELDOM static unsigned check_rotor(cgl_monitor *monitor, const cgl_measurement *now,
                              cgl_real omega_ref, bool full)
{
    const bool is_angle = cgl_is_angle(now->theta_m);
    const cgl_real theta = is_angle ? in_turn(now->theta_m) : monitor->theta_sensor;
    const cgl_real d = difference(theta, monitor->theta_sensor);
    const bool has_two = is_angle && monitor->has_angle, agree = has_two && cgl_abs(d) <= monitor->limits.travel;
    bool missing = !is_angle, stuck = false;
    monitor->theta_sensor = theta;
    monitor->has_angle = is_angle;

    if (!monitor->started) {
        monitor->started = is_angle;
        monitor->theta_m = theta;
    } else if (agree) {
        stuck = follow_angle(monitor, theta, d, omega_ref, full);
    } else {
        missing = true;
        bridge_angle(monitor, has_two);
    }
    missing = !follow_speed(monitor, now->omega_m) || missing;
    count_gap(monitor, missing);
    return (missing || is_speed_lost(monitor) ? (unsigned)CGL_STATUS_ANGLE_LOST : 0U)
           | (stuck ? (unsigned)CGL_STATUS_ANGLE_STUCK : 0U)
           | (is_not_zero(monitor->sensor_offset) ? (unsigned)CGL_STATUS_ANGLE_SHIFTED : 0U);
}

/* Checks currents and bus voltage, and returns their status bits. */
static unsigned check_currents(const cgl_monitor *monitor, const cgl_measurement *now)
{
    const cgl_monitor_config *const config = &monitor->config;
    if (config->phases == 0U) {
        return 0U;
    }
    const bool are_currents =
        cgl_sum_of_squares(config, now->i_abc) <= monitor->limits.current_square && cgl_is_sum_zero(monitor, now->i_abc);
    const bool is_bus = now->u_dc > CGL_R(0.0) && now->u_dc <= CGL_REAL_MAX;
    return (are_currents ? 0U : (unsigned)CGL_STATUS_CURRENT) | (is_bus ? 0U : (unsigned)CGL_STATUS_BUS);
}

CGL_SELDOM void cgl_monitor_look(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full)
{
    const unsigned unsafe_bits = (unsigned)CGL_STATUS_ANGLE_STUCK | (unsigned)CGL_STATUS_CURRENT | (unsigned)CGL_STATUS_BUS;
    const cgl_monitor_limits *limits = &monitor->limits;
    const unsigned status = check_rotor(monitor, now, omega_ref, full) | check_currents(monitor, now);
    if (!monitor->started || monitor->position_unknown || monitor->missing_angles > limits->bridge || is_speed_lost(monitor)
        || (status & unsafe_bits) != 0U) {
        monitor->hold_wait = limits->hold + 1U;
    } else {
        count_down(&monitor->hold_wait);
    }
    monitor->safe = monitor->hold_wait > 0U;
    monitor->status = status | (monitor->safe ? (unsigned)CGL_STATUS_FAULT : 0U);
    /* After the rotor has counted as stuck, no period is trusted until the sensor has shown that the rotor turns. */
    monitor->trusted = monitor->status == 0U && monitor->missing_angles == 0U && monitor->speed_wait == 0U
                       && monitor->standstill == 0U && !monitor->stuck_since_moved;
}
