#include "anti_cogging.h"

#include "angle.h"
#include "range.h"

CGL_SELDOM const char *cgl_anti_cogging_bad_field(const cgl_anti_cogging_config *config, const cgl_loop *loop)
{
    static const cgl_range range[] = {CGL_RANGE(anti_cogging, cells, CGL_COUNT),
                                      CGL_RANGE(anti_cogging, speed, CGL_POSITIVE),
                                      CGL_RANGE(anti_cogging, revolutions, CGL_COUNT),
                                      CGL_RANGE(anti_cogging, position_gain, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(anti_cogging, lead, CGL_NOT_NEGATIVE)};
    const char *field = cgl_pi_bad_field(&config->pi, loop);
    field = field != 0 ? field : CGL_OUT_OF_RANGE(config, range);
    if (field != 0) {
        return field;
    }
    if (config->cells < 4U) {
        return CGL_FIELD("anti_cogging.cells");
    }
    return config->revolutions <= 100U ? 0 : CGL_FIELD("anti_cogging.revolutions");
}

CGL_SELDOM cgl_error cgl_anti_cogging_init(cgl_anti_cogging *law, const cgl_anti_cogging_config *config, const cgl_loop *loop, cgl_real *table,
                                uint32_t length)
{
    law->pi.ready = 0U;
    if (cgl_anti_cogging_bad_field(config, loop) != 0) {
        return CGL_ERROR_CONFIG;
    }
    if (cgl_check_memory(table, length, config->cells) != CGL_OK) {
        return CGL_ERROR_MEMORY;
    }
    law->config = *config;
    law->table = table;
    law->stage = CGL_ANTI_COGGING_RUN;
    law->friction = CGL_R(0.0);
    for (uint32_t n = 0; n < config->cells; ++n) {
        table[n] = CGL_R(0.0);
    }
    (void)cgl_pi_init(&law->pi, &config->pi, loop);
    cgl_anti_cogging_reset(law);
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_anti_cogging_retune(cgl_anti_cogging *law, const cgl_anti_cogging_config *config)
{
    const bool same_run = law->stage == CGL_ANTI_COGGING_RUN || config->revolutions == law->config.revolutions;
    if (cgl_anti_cogging_bad_field(config, &law->pi.loop) != 0 || config->cells != law->config.cells || !same_run) {
        return CGL_ERROR_CONFIG;
    }
    (void)cgl_pi_retune(&law->pi, &config->pi);
    law->config = *config;
    for (uint32_t n = 0; n < config->cells; ++n) {
        law->table[n] = cgl_clamped(law->table[n], config->pi.limit);
    }
    law->friction = cgl_clamped(law->friction, config->pi.limit);
    return CGL_OK;
}

CGL_SELDOM void cgl_anti_cogging_reset(cgl_anti_cogging *law)
{
    const cgl_anti_cogging_config *const config = &law->config;
    if (law->stage != CGL_ANTI_COGGING_RUN) { /* half a table is worse than an empty one */
        for (uint32_t n = 0; n < config->cells; ++n) {
            law->table[n] = CGL_R(0.0);
        }
    }
    cgl_pi_reset(&law->pi);
    law->stage = CGL_ANTI_COGGING_RUN;
    law->looked_up = law->place = law->behind = law->sum = CGL_R(0.0);
    law->means[0] = law->means[1] = CGL_R(0.0);
    law->turns = law->cell = law->end_cell = 0;
    law->samples = 0U;
    law->started = false;
}

CGL_SELDOM void cgl_anti_cogging_calibrate(cgl_anti_cogging *law)
{
    if (law->pi.loop.feed_forward) {
        return;
    }
    law->stage = CGL_ANTI_COGGING_FORWARD; /* this stage makes the reset clear the table */
    cgl_anti_cogging_reset(law);
    law->stage = CGL_ANTI_COGGING_FORWARD;
}

/* Bound of law->turns, which no calibration run reaches. */
#define TURNS_MAX 1000

static void count_turn(cgl_anti_cogging *law, bool up)
{
    if (up && law->turns < TURNS_MAX) {
        ++law->turns;
    } else if (!up && law->turns > -TURNS_MAX) {
        --law->turns;
    }
}

/* Follows the rotor over whole revolutions. The rotor must turn by less than half a revolution between two calls. */
CGL_SELDOM static void follow(cgl_anti_cogging *law, cgl_real theta_m)
{
    const cgl_anti_cogging_config *const config = &law->config;
    const cgl_real cells = (cgl_real)config->cells;
    const cgl_real place = cgl_fraction(theta_m * (CGL_R(1.0) / CGL_TWO_PI)) * cells;
    cgl_real moved = law->started ? place - law->place : CGL_R(0.0);
    if (moved > CGL_R(0.5) * cells) {
        moved -= cells;
        count_turn(law, false);
    } else if (moved < CGL_R(-0.5) * cells) {
        moved += cells;
        count_turn(law, true);
    }
    law->behind -= moved * (CGL_TWO_PI / cells);
    law->place = place;
    law->started = true;
}

static cgl_real direction(const cgl_anti_cogging *law)
{
    return law->stage == CGL_ANTI_COGGING_BACKWARD ? CGL_R(-1.0) : CGL_R(1.0);
}

/* Begins one direction of the calibration run. The first entry to be recorded is an eighth of a revolution ahead. */
CGL_SELDOM static void start_direction(cgl_anti_cogging *law, cgl_anti_cogging_stage stage)
{
    const cgl_anti_cogging_config *const config = &law->config;
    law->stage = stage;
    law->turns = 0;
    law->behind = CGL_R(0.0);
    law->cell = (int32_t)(direction(law) * law->place) + (int32_t)(config->cells / 8U) + 1;
    law->end_cell = law->cell + (int32_t)(config->cells * config->revolutions);
    law->sum = CGL_R(0.0);
    law->samples = 0U;
}

/* Ends the calibration. Subtracts the mean of the table, which is load and not cogging. */
CGL_SELDOM static void finish(cgl_anti_cogging *law)
{
    const cgl_anti_cogging_config *const config = &law->config;
    cgl_real mean = CGL_R(0.0);
    for (uint32_t n = 0; n < config->cells; ++n) {
        mean += law->table[n] / (cgl_real)config->cells;
    }
    /* A retune during the recording may have lowered the limit, so table and friction are limited again. */
    for (uint32_t n = 0; n < config->cells; ++n) {
        law->table[n] = cgl_clamped(law->table[n] - mean, config->pi.limit);
    }
    law->friction = cgl_clamped(CGL_R(0.5) * law->means[0] - CGL_R(0.5) * law->means[1], config->pi.limit);
    law->stage = CGL_ANTI_COGGING_RUN;
    cgl_pi_reset(&law->pi);
}

/* Records a sample. An entry covers half a cell on either side of its angle. When the rotor leaves an entry, half the mean of the entry's
 * samples, divided by `revolutions`, is added to the table. For an entry that the rotor jumped over, the present sample takes the place of
 * that mean. A rotor that rocks back records nothing twice. If a sample must not be learned, its entry is recorded one revolution later. */
CGL_SELDOM static void record(cgl_anti_cogging *law, cgl_real i_q, bool learn)
{
    const cgl_anti_cogging_config *const config = &law->config;
    const bool backward = law->stage == CGL_ANTI_COGGING_BACKWARD;
    const int32_t cells = (int32_t)config->cells;
    const int32_t nearest = law->turns * cells + (int32_t)(law->place + CGL_R(0.5));
    const int32_t reached = backward ? -nearest : nearest;
    if (reached < law->cell) {
        return;
    }
    if (!learn) {
        count_turn(law, backward); /* counts one revolution less, so that the entry is still ahead */
        law->sum = CGL_R(0.0);
        law->samples = 0U;
        return;
    }
    while (law->cell < law->end_cell && reached > law->cell) {
        const cgl_real mean = cgl_clamped(law->samples > 0U ? law->sum / (cgl_real)law->samples : i_q, config->pi.limit);
        const int32_t entry = (backward ? -law->cell : law->cell) % cells;
        law->table[entry < 0 ? entry + cells : entry] += CGL_R(0.5) * mean / (cgl_real)config->revolutions;
        law->means[backward ? 1 : 0] += mean / (cgl_real)(config->cells * config->revolutions);
        law->sum = CGL_R(0.0);
        law->samples = 0U;
        ++law->cell;
    }
    law->sum += i_q;
    ++law->samples;
}

static cgl_real look_up(const cgl_anti_cogging *law, cgl_real theta_m)
{
    const cgl_anti_cogging_config *const config = &law->config;
    const cgl_real x = cgl_fraction(theta_m * (CGL_R(1.0) / CGL_TWO_PI)) * (cgl_real)config->cells;
    const uint32_t n = (uint32_t)x;
    const cgl_real here = law->table[n];
    const cgl_real next = law->table[n + 1U < config->cells ? n + 1U : 0U];
    return cgl_clamp(here + (x - (cgl_real)n) * (next - here), config->pi.limit);
}

/* Looks the current up in the table. theta_m and omega_m must be plausible. */
static void look(cgl_anti_cogging *law, const cgl_law_input *in)
{
    law->looked_up = cgl_law_share(in) * look_up(law, in->theta_m + law->config.lead * in->omega_m);
}

/* Sets the output while the law is off or in torque mode. A calibration that this interrupts begins anew afterwards. */
CGL_SELDOM static void stand_by(cgl_anti_cogging *law, const cgl_law_input *in, cgl_law_output *out)
{
    law->looked_up = CGL_R(0.0);
    if (law->stage != CGL_ANTI_COGGING_RUN && law->started) {
        cgl_anti_cogging_calibrate(law);
    } else if (!in->off && cgl_is_finite(in->omega_m) && cgl_is_angle(in->theta_m)) {
        look(law, in);
    }
    cgl_pi_start(&law->pi, cgl_law_stand_by(in, law->looked_up, law->config.pi.limit, out));
    out->status |= law->stage != CGL_ANTI_COGGING_RUN ? (unsigned)CGL_STATUS_BUSY : 0U;
}

void cgl_anti_cogging_step(cgl_anti_cogging *law, const cgl_law_input *in,
                           cgl_law_output *out)
{
    const cgl_anti_cogging_config *const config = &law->config;
    if (!CGL_OFTEN(law->pi.ready == CGL_READY)) {
        cgl_law_refuse(out);
        return;
    }
    if (cgl_law_stands_by(in)) {
        stand_by(law, in, out);
        return;
    }
    const bool recording = law->stage != CGL_ANTI_COGGING_RUN;
    const bool plausible = cgl_is_finite(in->omega_m) && cgl_is_angle(in->theta_m)
                           && (!recording || cgl_is_finite(in->i_q));
    cgl_real error = in->omega_ref - in->omega_m;
    law->looked_up = CGL_R(0.0);

    if (recording && plausible) {
        follow(law, in->theta_m);
        if (law->end_cell == law->cell) {
            start_direction(law, CGL_ANTI_COGGING_FORWARD);
        }
        law->behind += direction(law) * config->speed * law->pi.loop.ts;
        record(law, in->i_q, in->learn);
        error = direction(law) * config->speed + config->position_gain * law->behind - in->omega_m;
        if (law->cell >= law->end_cell) {
            if (law->stage == CGL_ANTI_COGGING_FORWARD) {
                start_direction(law, CGL_ANTI_COGGING_BACKWARD);
            } else {
                finish(law);
            }
        }
    } else if (recording) {
        error = CGL_R(0.0);
    } else if (plausible) {
        look(law, in);
    }

    out->i_q_ref = cgl_pi_step(&law->pi, error, law->looked_up);
    out->status = (law->pi.saturated ? (unsigned)CGL_STATUS_SATURATED : 0U)
                  | (plausible && cgl_is_finite(error) ? 0U : (unsigned)CGL_STATUS_FAULT)
                  | (law->stage != CGL_ANTI_COGGING_RUN ? (unsigned)CGL_STATUS_BUSY : 0U)
                  | (!recording || !in->learn ? (unsigned)CGL_STATUS_FROZEN : 0U);
}
