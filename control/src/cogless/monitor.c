#include "monitor.h"

#include "angle.h"
#include "range.h"

/* A stuck rotor gets current again after this many times the length of the last attempt. That is soon enough for a sensor that works
 * again, and seldom enough for a winding that heats. */
#define TRY_AGAIN 11U
#define PERIODS_MAX CGL_R(1.0e9)

/* The square of a bound, or the largest number where it is not watched. Never infinite: infinity is not plausible. */
CGL_SELDOM static cgl_real square(cgl_real bound)
{
    return bound > CGL_R(0.0) ? cgl_clamped(bound * bound, CGL_REAL_MAX) : CGL_REAL_MAX;
}

CGL_SELDOM static bool is_time(cgl_real time, cgl_real ts)
{
    return cgl_is_not_negative(time) && time / ts <= PERIODS_MAX;
}

/* Whole periods that are no shorter. */
CGL_SELDOM static uint32_t periods(cgl_real time, cgl_real ts)
{
    const cgl_real exact = cgl_clamped(time / ts, PERIODS_MAX);
    const uint32_t whole = (uint32_t)exact;
    /* a thousandth less is rounding */
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
    if (!is_time((cgl_real)TRY_AGAIN * config->stuck_time, ts)) {
        return CGL_FIELD("monitor.stuck_time");
    }
    return config->phases == 0U || config->phases == 2U || config->phases == 3U ? 0 : CGL_FIELD("monitor.phases");
}

CGL_SELDOM static void take(cgl_monitor *monitor, const cgl_monitor_config *config, cgl_real ts)
{
    monitor->config = *config;
    monitor->ts = ts;
    cgl_monitor_limits *limits = &monitor->limits;
    /* two angles are at most half a revolution apart */
    limits->reach = config->omega_max > CGL_R(0.0)
                        ? cgl_clamped(config->omega_max * ts + config->angle_step, CGL_TWO_PI)
                        : CGL_TWO_PI;
    limits->reach_square = limits->reach * limits->reach;
    limits->speed_square = square(config->omega_max);
    limits->stuck_square = square(config->stuck_angle);
    limits->doubt_square = square(CGL_R(0.25) * config->stuck_angle);
    /* three phases: the vector's length is sqrt(2/3) of the root of the squares' sum */
    limits->current_square = square(config->current_max);
    if (config->phases == 3U) {
        limits->current_square = cgl_clamped(CGL_R(1.5) * limits->current_square, CGL_REAL_MAX);
    }
    limits->sum_square = square(config->current_sum);
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
    take(monitor, config, ts);
    cgl_monitor_reset(monitor);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_monitor_retune(cgl_monitor *monitor, const cgl_monitor_config *config)
{
    if (cgl_monitor_bad_field(config, monitor->ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    take(monitor, config, monitor->ts);
    return CGL_OK;
}

CGL_SELDOM void cgl_monitor_reset(cgl_monitor *monitor)
{
    monitor->theta_m = monitor->omega_m = monitor->shift = monitor->slip = monitor->raw = monitor->still = CGL_R(0.0);
    monitor->gap = monitor->lost = monitor->blind = monitor->dark = 0U;
    monitor->standing = monitor->pushing = monitor->attempt = monitor->holding = monitor->jumps = 0U;
    monitor->status = 0U;
    monitor->started = monitor->known = monitor->trusted = monitor->was_stuck = monitor->unsure = false;
    monitor->safe = true;
}

CGL_SELDOM bool cgl_monitor_trust(cgl_monitor *monitor)
{
    if (monitor->known) {
        monitor->shift = monitor->slip = CGL_R(0.0);
        monitor->theta_m = monitor->raw;
        monitor->gap = monitor->lost = 0U;
        monitor->unsure = false;
    }
    return monitor->known;
}

/* Adds 1 to a count, which stays at its largest value. */
CGL_SELDOM static void count_up(uint32_t *count)
{
    *count += *count < UINT32_MAX ? 1U : 0U;
}

/* Takes 1 from a count, which stays at 0. */
CGL_SELDOM static void count_down(uint32_t *count)
{
    *count -= *count > 0U ? 1U : 0U;
}

/* Whether x is a number other than 0. */
static bool is_not_zero(cgl_real x)
{
    return cgl_abs(x) > CGL_R(0.0);
}

CGL_SELDOM static cgl_real in_turn(cgl_real theta)
{
    if (cgl_is_in_turn(theta)) {
        return theta;
    }
    return CGL_TWO_PI * cgl_fraction(theta * (CGL_R(1.0) / CGL_TWO_PI));
}

/* The short way between two angles within a turn. */
CGL_SELDOM static cgl_real difference(cgl_real to, cgl_real from)
{
    const cgl_real d = to - from;
    return d > CGL_PI ? d - CGL_TWO_PI : (d < -CGL_PI ? d + CGL_TWO_PI : d);
}

/* Sum of the squares of the currents that are looked at. */
static inline cgl_real squares_of(const cgl_monitor_config *config, const cgl_real i[3])
{
    const cgl_real two = i[0] * i[0] + i[1] * i[1];
    return config->phases == 3U ? two + i[2] * i[2] : two;
}

/* Three phases in a star add up to zero. */
static inline bool is_sum(const cgl_monitor *monitor, const cgl_real i[3])
{
    const cgl_real sum = i[0] + i[1] + i[2];
    return monitor->config.phases != 3U || sum * sum <= monitor->limits.sum_square;
}

/* An ordinary period, in few instructions: nothing was amiss, and nothing is. */
static inline bool is_ordinary(cgl_monitor *monitor, const cgl_measurement *now,
                               cgl_real omega_ref)
{
    const cgl_monitor_config *const config = &monitor->config;
    const cgl_monitor_limits *limits = &monitor->limits;
    const cgl_real theta = now->theta_m, omega = now->omega_m;
    const cgl_real d = theta - monitor->raw;
    if (!(monitor->trusted && d * d <= limits->reach_square && omega * omega <= limits->speed_square
          && cgl_is_in_turn(theta))) {
        return false;
    }
    if (config->phases != 0U) {
        const cgl_real nothing = now->u_dc - now->u_dc; /* or NaN */
        if (!(now->u_dc > CGL_R(0.0) && is_sum(monitor, now->i_abc)
              && squares_of(config, now->i_abc) + nothing <= limits->current_square)) {
            return false;
        }
    }
    cgl_real still = CGL_R(0.0);
    if (d == CGL_R(0.0)) {
        still = monitor->still + omega_ref * monitor->ts;
        if (!(still * still <= limits->doubt_square)) {
            return false;
        }
    }
    monitor->still = still;
    monitor->theta_m = monitor->raw = theta;
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

/* The angles of two periods agree, and the rotor has turned by d between them: where is it, after those that were missing?
 * Beyond what it can have turned in them, it can be anywhere where its angle was stuck, and where it stood still while the
 * reference turned, further that way by about as much, since the sensor may have been what stood. */
CGL_SELDOM static void settle(cgl_monitor *monitor, cgl_real theta, cgl_real d)
{
    const cgl_monitor_config *const config = &monitor->config;
    const cgl_real shift = difference(theta, in_turn(monitor->theta_m + d)), still = monitor->still;
    const cgl_real reach = monitor->limits.reach * ((cgl_real)monitor->lost + CGL_R(1.0)); /* the one before may be wrong, too */
    const bool unseen = config->stuck_angle > CGL_R(0.0) && shift * still > CGL_R(0.0);
    const cgl_real from_last = cgl_abs(difference(shift, monitor->slip)), from_none = cgl_abs(shift);
    const bool can_be_none =
        monitor->was_stuck || from_none <= reach + (unseen ? CGL_R(2.0) * cgl_abs(still) : CGL_R(0.0));
    const bool slipped = is_not_zero(monitor->slip);
    monitor->unsure = monitor->unsure || (slipped && monitor->lost > monitor->limits.bridge);
    if (from_none <= from_last || !slipped) {
        monitor->shift = can_be_none ? CGL_R(0.0) : shift;
    } else {
        monitor->shift = from_last <= reach ? monitor->slip : shift;
    }
}

/* Ends the attempt to turn the rotor, and clears its counters. */
CGL_SELDOM static void try_again(cgl_monitor *monitor)
{
    monitor->still = CGL_R(0.0);
    monitor->standing = monitor->pushing = monitor->attempt = 0U;
}

/* Counts the periods of an attempt, and those of them with full current. True if the rotor is stuck: then the attempt is over. A
 * period with less current takes back one with full current, since a limit may flicker. */
CGL_SELDOM static bool is_given_up(cgl_monitor *monitor, cgl_real far, bool full)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    count_up(&monitor->standing);
    if (monitor->attempt == 0U) {
        if (full) {
            ++monitor->pushing;
        } else {
            count_down(&monitor->pushing);
        }
        if (far > limits->stuck_square && monitor->pushing > 0U && monitor->pushing >= limits->stuck) {
            monitor->attempt = monitor->standing / TRY_AGAIN < UINT32_MAX / TRY_AGAIN ? monitor->standing : UINT32_MAX / TRY_AGAIN;
            monitor->pushing = 0U;
        }
    }
    return monitor->attempt > 0U;
}

/* Whether full current has not turned the rotor while the reference has turned. A reference at rest ends this state. A reference that
 * goes on gets another attempt after a rest that is ten times as long as the last attempt. */
CGL_SELDOM static bool is_stuck(cgl_monitor *monitor, cgl_real d, cgl_real omega_ref, bool full)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    const cgl_real turned = omega_ref * monitor->ts;
    const cgl_real most = cgl_clamped((cgl_real)TRY_AGAIN * monitor->config.stuck_angle, CGL_REAL_MAX);
    if (is_not_zero(d)) {
        try_again(monitor);
        return false;
    }
    if (cgl_is_finite(turned)) {
        monitor->still = cgl_clamped(monitor->still + turned, most);
    }
    const cgl_real far = monitor->still * monitor->still;
    if (far <= limits->doubt_square) {
        monitor->standing = monitor->pushing = monitor->attempt = 0U;
        return false;
    }
    if (!is_given_up(monitor, far, full)) {
        return false;
    }
    const bool again = cgl_abs(monitor->still) >= most && monitor->standing / TRY_AGAIN >= monitor->attempt - 1U;
    if (!again && is_not_zero(omega_ref)) {
        return true;
    }
    monitor->holding = again ? 0U : monitor->holding; /* the new attempt begins at once: `hold` may be longer than it */
    try_again(monitor);
    return false;
}

/* Whether the angle has jumped so often that no speed was plausible for longer than `bridge`. The law then gets no speed. */
static bool is_dark(const cgl_monitor *monitor)
{
    return monitor->dark > monitor->limits.window + monitor->limits.bridge;
}

/* Looks at angle and speed; returns their status bits. */
CGL_SELDOM static unsigned look_at_rotor(cgl_monitor *monitor, const cgl_measurement *now,
                              cgl_real omega_ref, bool full)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    const bool is_angle = cgl_is_angle(now->theta_m), is_speed = now->omega_m * now->omega_m <= limits->speed_square;
    const cgl_real theta = is_angle ? in_turn(now->theta_m) : monitor->raw;
    const cgl_real d = difference(theta, monitor->raw);
    const bool two = is_angle && monitor->known, agree = two && cgl_abs(d) <= limits->reach;
    bool missing = !is_angle, stuck = false;
    monitor->raw = theta;
    monitor->known = is_angle;

    if (!monitor->started) {
        monitor->started = is_angle;
        monitor->theta_m = theta;
    } else if (!agree) {
        missing = true;
        monitor->theta_m = in_turn(monitor->theta_m + monitor->omega_m * monitor->ts); /* the rotor turns on */
        monitor->blind = limits->window + 1U;
        if (two) {
            count_up(&monitor->jumps);
        }
    } else {
        if (monitor->gap > 0U) {
            settle(monitor, theta, d);
        }
        monitor->theta_m = in_turn(theta - monitor->shift);
        count_down(&monitor->blind);
        stuck = is_stuck(monitor, d, omega_ref, full);
        monitor->was_stuck = stuck || (monitor->was_stuck && d * d <= CGL_R(0.0));
    }
    if (monitor->blind == 0U) {
        missing = missing || !is_speed;
        monitor->omega_m = is_speed ? now->omega_m : monitor->omega_m;
    }
    if (monitor->blind > 0U) {
        count_up(&monitor->dark);
    } else {
        monitor->dark = 0U;
    }
    if (missing) {
        monitor->gap += monitor->gap <= limits->bridge ? 1U : 0U;
        count_up(&monitor->lost);
    } else if (monitor->gap > 0U) {
        --monitor->gap;
        monitor->lost = monitor->gap > 0U ? monitor->lost : 0U;
    }
    monitor->slip = monitor->gap == 0U ? monitor->shift : monitor->slip;
    return (missing || is_dark(monitor) ? (unsigned)CGL_STATUS_ANGLE_LOST : 0U) | (stuck ? (unsigned)CGL_STATUS_ANGLE_STUCK : 0U)
           | (is_not_zero(monitor->shift) ? (unsigned)CGL_STATUS_ANGLE_SHIFTED : 0U);
}

CGL_SELDOM void cgl_monitor_look(cgl_monitor *monitor, const cgl_measurement *now,
                      cgl_real omega_ref, bool full)
{
    const cgl_monitor_config *const config = &monitor->config;
    const cgl_monitor_limits *limits = &monitor->limits;
    unsigned status = look_at_rotor(monitor, now, omega_ref, full);
    bool safe = !monitor->started || monitor->unsure || monitor->gap > limits->bridge || is_dark(monitor)
                || (status & (unsigned)CGL_STATUS_ANGLE_STUCK) != 0U;
    if (config->phases != 0U) {
        const bool are_currents =
            squares_of(config, now->i_abc) <= limits->current_square && is_sum(monitor, now->i_abc);
        const bool is_bus = now->u_dc > CGL_R(0.0) && now->u_dc <= CGL_REAL_MAX;
        status |= (are_currents ? 0U : (unsigned)CGL_STATUS_CURRENT) | (is_bus ? 0U : (unsigned)CGL_STATUS_BUS);
        safe = safe || !are_currents || !is_bus;
    }
    if (safe) {
        monitor->holding = limits->hold + 1U;
    } else {
        count_down(&monitor->holding);
    }
    monitor->safe = monitor->holding > 0U;
    monitor->status = status | (monitor->safe ? (unsigned)CGL_STATUS_FAULT : 0U);
    /* after a stuck sensor, a period counts as ordinary only once the sensor has shown the rotor turn */
    monitor->trusted = monitor->status == 0U && monitor->gap == 0U && monitor->blind == 0U && monitor->standing == 0U
                       && !monitor->was_stuck;
}
