#include "drive.h"

#include "drive_parts.h"

#define POLE_PAIRS_MAX 10000U /* with more, the electrical angle could reach CGL_ANGLE_MAX */
#define DIVIDER_MAX 65535U
#define FULL_SHARE CGL_R(0.95) /* a current of at least this share of its limit counts as full */

static uint32_t phases_of(const cgl_drive_config *config)
{
    return config->foc.phases == 0U ? 3U : config->foc.phases;
}

/* Returns the monitor's config. Unless the current loop is foreign, monitor.phases = 0 is replaced by the current loop's number of
 * phases. */
CGL_SELDOM static cgl_monitor_config monitor_config(const cgl_drive_config *config)
{
    cgl_monitor_config full = config->monitor;
    if (!config->foreign && full.phases == 0U) {
        full.phases = phases_of(config);
    }
    return full;
}

/* Returns the first field of the drive itself that is out of range, or in which two parts disagree; NULL: none. */
CGL_SELDOM static const char *own_bad_field(const cgl_drive_config *config)
{
    if (config->pole_pairs < 1U || config->pole_pairs > POLE_PAIRS_MAX) {
        return CGL_FIELD("drive.pole_pairs");
    }
    if (config->divider < 1U || config->divider > DIVIDER_MAX) {
        return CGL_FIELD("drive.divider");
    }
    if (config->feed_forward && !config->foreign) {
        return CGL_FIELD("drive.feed_forward");
    }
#ifdef COGLESS_NO_GUARD
    if (!config->unguarded) {
        return CGL_FIELD("drive.unguarded");
    }
#endif
    if (config->foreign) {
        const cgl_real limit = config->foc.current_limit;
        return limit >= CGL_R(0.0) && limit <= CGL_CURRENT_MAX ? 0 : CGL_FIELD("foc.current_limit");
    }
    return config->monitor.phases == 0U || config->monitor.phases == phases_of(config) ? 0 : CGL_FIELD("monitor.phases");
}

CGL_SELDOM const char *cgl_drive_bad_field(const cgl_drive_config *config, cgl_real ts)
{
    const char *field = own_bad_field(config);
    if (field == 0 && !config->foreign) {
        field = cgl_foc_bad_field(&config->foc, ts);
    }
    field = field != 0 ? field : cgl_monitor_bad_field(&config->monitor, ts);
    return field != 0 ? field : cgl_quality_bad_field(&config->quality, (cgl_real)config->divider * ts);
}

/* Returns the loop for the init of a law of this drive. */
CGL_SELDOM static cgl_loop loop_of(const cgl_drive_config *config, cgl_real law_period)
{
    const cgl_real limit = config->foc.current_limit;
    const cgl_loop loop = {law_period, limit > CGL_R(0.0) ? limit : CGL_CURRENT_MAX, config->feed_forward, !config->unguarded};
    return loop;
}

CGL_SELDOM cgl_error cgl_drive_init(cgl_drive *drive, const cgl_drive_config *config, cgl_real ts)
{
    drive->ready = 0U;
    if (cgl_drive_bad_field(config, ts) != 0) {
        return CGL_ERROR_CONFIG;
    }
    const cgl_monitor_config monitor = monitor_config(config);
    const cgl_real law_period = (cgl_real)config->divider * ts;
    if (!config->foreign) {
        (void)cgl_foc_init(&drive->foc, &config->foc, ts);
    }
    (void)cgl_monitor_init(&drive->monitor, &monitor, ts);
    (void)cgl_quality_init(&drive->quality, &config->quality, law_period);
#ifndef COGLESS_NO_GUARD
    const cgl_error error = cgl_guard_init(&drive->guard, law_period);
    if (error != CGL_OK) {
        return error;
    }
#endif
    drive->pole_pairs = (cgl_real)config->pole_pairs;
    drive->divider = config->divider;
    drive->foreign = config->foreign;
    drive->learn_saturated = config->learn_saturated;
    drive->unguarded = config->unguarded;
    drive->loop = loop_of(config, law_period);
    cgl_drive_reset(drive);
    drive->ready = CGL_READY;
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_drive_retune(cgl_drive *drive, const cgl_drive_config *config)
{
    const cgl_monitor_config monitor = monitor_config(config);
    const cgl_foc last_foc = drive->foc;
    if (cgl_drive_bad_field(config, drive->monitor.ts) != 0 || (uint32_t)drive->pole_pairs != config->pole_pairs
        || config->divider != drive->divider || config->foreign != drive->foreign
        || config->feed_forward != drive->loop.feed_forward) {
        return CGL_ERROR_CONFIG;
    }
    if (!config->foreign && cgl_foc_retune(&drive->foc, &config->foc) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    if (cgl_quality_retune(&drive->quality, &config->quality) != CGL_OK) {
        drive->foc = last_foc;
        return CGL_ERROR_CONFIG;
    }
    (void)cgl_monitor_retune(&drive->monitor, &monitor);
    drive->learn_saturated = config->learn_saturated;
    drive->loop.current_limit = loop_of(config, drive->loop.ts).current_limit;
    return CGL_OK;
}

CGL_SELDOM void cgl_drive_reset(cgl_drive *drive)
{
    static const cgl_law_input no_input = {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0),
                                           false,      false, false, CGL_R(0.0), 0U, false, CGL_R(0.0)};
    static const cgl_foc_input no_currents = {{CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)}, CGL_R(0.0), CGL_R(0.0), CGL_R(0.0),
                                              CGL_R(0.0), CGL_R(0.0)};
    drive->in = no_input;
    drive->command.i_q_ref = CGL_R(0.0);
    drive->command.status = 0U;
    cgl_monitor_reset(&drive->monitor);
    cgl_quality_reset(&drive->quality);
#ifndef COGLESS_NO_GUARD
    cgl_guard_reset(&drive->guard);
#endif
    cgl_foc_reset(&drive->foc);
    drive->currents = no_currents;
    drive->i_q = CGL_R(0.0);
    drive->countdown = 0U;
    drive->saturated = drive->off = false;
    drive->status = drive->held = 0U;
}

#ifndef COGLESS_NO_GUARD
/* Steps the guard, and puts its decisions into the law's input. Returns whether the law may learn. */
static bool is_allowed(cgl_drive *drive, cgl_real error, bool wanted, bool learned)
{
    cgl_guard *const guard = &drive->guard;
    const cgl_monitor *const monitor = &drive->monitor;
    /* After a jump of the angle the guard still judges: the speed is right, but the learned current is applied at wrong angles. */
    const bool plausible = monitor->trusted || (monitor->status & (unsigned)CGL_STATUS_ANGLE_SHIFTED) != 0U;
    const cgl_guard_input in = {error,  drive->in.omega_ref, plausible && !drive->off, drive->saturated,
                                wanted, learned};
    cgl_guard_step(guard, &in);
    drive->in.muted = CGL_R(1.0) - guard->share;
    drive->in.gentle = guard->gentle;
    drive->in.forget = cgl_guard_forgets(guard);
    drive->held = cgl_guard_acts(guard) ? (unsigned)CGL_STATUS_GUARDED : 0U;
    return cgl_guard_may_learn(guard);
}
#endif

/* In torque mode the references follow the rotor, and nothing is learned. */
CGL_SELDOM static void follow_rotor(cgl_law_input *in)
{
    in->theta_ref = in->theta_m;
    in->omega_ref = in->omega_m;
    in->alpha_ref = CGL_R(0.0);
    in->learn = false;
}

/* Fills in the law's input. Clears the flags `saturated` and `off`, which remember what happened since the law's last step. */
CGL_APART static void prepare_law(cgl_drive *drive, const cgl_reference *reference)
{
    const cgl_monitor *const monitor = &drive->monitor;
    cgl_law_input *const in = &drive->in;
    const cgl_real error = reference->omega_ref - monitor->omega_m;
    const bool learned = in->learn && (drive->command.status & (unsigned)CGL_STATUS_FROZEN) == 0U;
    drive->currents.i_d_ref = cgl_is_finite(reference->i_d_ref) ? reference->i_d_ref : CGL_R(0.0);
    in->torque = reference->torque;
    in->i_q_ref = reference->i_q_ref;
    in->theta_ref = reference->theta_ref;
    in->omega_ref = reference->omega_ref;
    in->alpha_ref = reference->alpha_ref;
    in->theta_m = monitor->theta_m;
    in->omega_m = monitor->omega_m;
    in->i_q = drive->i_q;
    in->off = drive->off;
    in->learn = reference->learn && monitor->trusted && !drive->off && (!drive->saturated || drive->learn_saturated);
    if (reference->torque) {
        follow_rotor(in);
    } else if (!cgl_drive_is_busy(drive)) {
        if (cgl_quality_step(&drive->quality, error, monitor->omega_m, in->learn && learned)) {
            drive->status |= (unsigned)CGL_STATUS_OUTLIER;
            in->learn = false;
        }
#ifndef COGLESS_NO_GUARD
        if (!drive->unguarded && !is_allowed(drive, error, reference->learn, learned)) {
            in->learn = false;
        }
#endif
    } else { /* The speed error of a busy law says nothing about what is learned. */
    }
    drive->saturated = drive->off = false;
    drive->countdown = drive->divider - 1U;
}

/* Whether the output pushes with full current in the direction of omega_ref. The law or the current loop reports when the output is at
 * its limit. A law may stop just below its limit without a report, so FULL_SHARE of the limit counts as full too. */
CGL_SELDOM static bool is_full(const cgl_drive *drive, cgl_real omega_ref)
{
    const cgl_real i_d = drive->currents.i_d_ref, i_q = drive->command.i_q_ref;
    if (!((i_q > CGL_R(0.0) && omega_ref > CGL_R(0.0)) || (i_q < CGL_R(0.0) && omega_ref < CGL_R(0.0)))) {
        return false;
    }
    if (drive->saturated || (drive->command.status & (unsigned)CGL_STATUS_SATURATED) != 0U) {
        return true;
    }
    if (drive->foreign) {
        return false;
    }
    const cgl_real near = FULL_SHARE * drive->foc.config.current_limit;
    return i_d * i_d + i_q * i_q >= near * near;
}

bool cgl_drive_measure(cgl_drive *drive, const cgl_measurement *now,
                       const cgl_reference *reference)
{
    if (!CGL_OFTEN(drive->ready == CGL_READY)) {
        return false;
    }
    cgl_monitor *const monitor = &drive->monitor;
    const cgl_real omega_ref = cgl_drive_omega_ref(drive, reference);
    /* is_full matters only while the angle stands still, so an ordinary period does not compute it */
    cgl_monitor_step(monitor, now, omega_ref, monitor->standstill > 0U && is_full(drive, omega_ref));
    drive->status = monitor->status;
    if (monitor->safe) {
        drive->off = true;
    }
    if (!drive->foreign) {
        drive->currents.i_abc[0] = now->i_abc[0];
        drive->currents.i_abc[1] = now->i_abc[1];
        drive->currents.i_abc[2] = now->i_abc[2];
        drive->currents.theta_e = drive->pole_pairs * monitor->theta_m;
        drive->currents.omega_e = drive->pole_pairs * monitor->omega_m;
        drive->currents.u_dc = now->u_dc;
    }
    if (drive->countdown > 0U) {
        --drive->countdown;
        return false;
    }
    prepare_law(drive, reference);
    return true;
}

/* Fills in an output with zero voltage and zero current references. */
CGL_SELDOM static void rest(cgl_drive *drive, cgl_drive_output *out)
{
    out->duty[0] = out->duty[1] = out->duty[2] = CGL_R(0.5);
    out->i_d = out->i_q = out->u_d = out->u_q = out->i_d_ref = out->i_q_ref = CGL_R(0.0);
    drive->i_q = CGL_R(0.0);
}

void cgl_drive_actuate(cgl_drive *drive, cgl_drive_output *out)
{
    if (!CGL_OFTEN(drive->ready == CGL_READY)) {
        rest(drive, out);
        out->status = (unsigned)CGL_STATUS_FAULT | (unsigned)CGL_STATUS_FROZEN | (unsigned)CGL_STATUS_OFF;
        return;
    }
    const unsigned status = cgl_drive_status(drive);
    if (drive->monitor.safe) {
        drive->command.i_q_ref = CGL_R(0.0);
        cgl_foc_reset(&drive->foc);
        rest(drive, out);
        out->status = status | (unsigned)CGL_STATUS_OFF;
        return;
    }
    if (drive->foreign) {
        rest(drive, out);
        out->i_d_ref = drive->currents.i_d_ref;
        out->i_q_ref = drive->i_q = drive->command.i_q_ref;
        out->status = status;
        return;
    }
    drive->currents.i_q_ref = drive->command.i_q_ref;
    cgl_foc_step(&drive->foc, &drive->currents, out);
    cgl_drive_conclude(drive, out, status);
}
