/* Checks of an ordinary period of the monitor; several drives can take them together: see choice.h. */
#ifndef COGLESS_MONITOR_PARTS_H
#define COGLESS_MONITOR_PARTS_H

#include "choice.h"
#include "monitor.h"
#include "real.h"

/* Sum of the squares of the phase currents that are checked. */
static inline cgl_real cgl_sum_of_squares(const cgl_monitor_config *config, const cgl_real i[3])
{
    const cgl_real two = i[0] * i[0] + i[1] * i[1];
    return config->phases == 3U ? two + i[2] * i[2] : two;
}

/* Whether the currents of three phases in a star add up to zero. */
static inline cgl_truth cgl_is_sum_zero(const cgl_monitor *monitor, const cgl_real i[3])
{
    const cgl_real sum = i[0] + i[1] + i[2];
    return monitor->config.phases != 3U || sum * sum <= monitor->limits.sum_square;
}

/* Whether angle and speed are plausible. `d` is the change of the sensor's angle in this period. */
static inline cgl_truth cgl_is_rotor_ordinary(const cgl_monitor *monitor, cgl_real theta, cgl_real d, cgl_real omega)
{
    const cgl_monitor_limits *limits = &monitor->limits;
    return d * d <= limits->travel_square && omega * omega <= limits->speed_square && cgl_is_in_turn(theta);
}

/* Whether currents and bus voltage are plausible. */
static inline cgl_truth cgl_are_currents_ordinary(const cgl_monitor *monitor, const cgl_real i[3], cgl_real u_dc)
{
    const cgl_real zero_or_nan = u_dc - u_dc; /* 0, or NaN if u_dc is infinite; with NaN the comparison below fails */
    return u_dc > CGL_R(0.0) && cgl_is_sum_zero(monitor, i)
           && cgl_sum_of_squares(&monitor->config, i) + zero_or_nan <= monitor->limits.current_square;
}

#endif
