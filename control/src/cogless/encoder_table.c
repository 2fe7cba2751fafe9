#include "encoder_table.h"

#include "angle.h"
#include "range.h"
#include "sine.h"
#include "turns.h"

#define ORDER_MAX 1000U
#define SETTLED CGL_R(10.0)    /* number of time constants, 1 / bandwidth, after which the observer has settled */
#define FAR CGL_R(0.2)         /* largest difference of sensor and observer that is learned [rad]; a larger one is no error of the sensor */
#define LOST CGL_R(1.5)        /* largest difference of sensor and observer with which the observer goes on [rad]. After a larger one it
                                  restarts at the sensor's angle and speed, and keeps its acceleration */
#define SETTLE_MAX CGL_R(1.0e9) /* largest number of steps in which the observer settles */

static bool is_valid(const cgl_encoder_table_config *config)
{
    static const cgl_range range[] = {CGL_RANGE(encoder_table, gain, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(encoder_table, omega_min, CGL_POSITIVE),
                                      CGL_RANGE(encoder_table, bandwidth, CGL_POSITIVE),
                                      CGL_RANGE(encoder_table, b, CGL_NOT_NEGATIVE),
                                      CGL_RANGE(encoder_table, limit, CGL_POSITIVE)};
    if (!(CGL_IS_IN_RANGE(config, range) && config->orders >= 1U && config->orders <= CGL_ENCODER_TABLE_ORDERS)) {
        return false;
    }
    uint32_t before = 0U;
    for (uint32_t k = 0; k < config->orders; ++k) {
        if (config->order[k] <= before || config->order[k] > ORDER_MAX
            || !(config->limit * (cgl_real)config->order[k] <= CGL_R(1.0))) {
            return false;
        }
        before = config->order[k];
    }
    return CGL_R(3.0) * config->bandwidth <= config->omega_min * (cgl_real)config->order[0];
}

static cgl_error take(cgl_encoder_table *table, const cgl_encoder_table_config *config, cgl_real ts)
{
    const cgl_angle_observer_config observer = {config->bandwidth};
    const cgl_real settle = SETTLED / (config->bandwidth * ts);
    if (!(config->gain * ts <= CGL_R(0.1) && settle <= SETTLE_MAX)
        || cgl_angle_observer_init(&table->observer, &observer, ts) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    table->config = *config;
    table->wait = table->settle = (uint32_t)settle + 1U;
    return CGL_OK;
}

CGL_SELDOM cgl_error cgl_encoder_table_init(cgl_encoder_table *table, const cgl_encoder_table_config *config, cgl_real ts)
{
    if (!(is_valid(config) && cgl_is_positive(ts)) || take(table, config, ts) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    cgl_encoder_table_reset(table);
    return CGL_OK;
}

CGL_SELDOM void cgl_encoder_table_reset(cgl_encoder_table *table)
{
    for (uint32_t k = 0; k < CGL_ENCODER_TABLE_ORDERS; ++k) {
        table->a[k] = table->c[k] = CGL_R(0.0);
    }
    table->theta = table->error = CGL_R(0.0);
    table->wait = table->settle;
    table->learning = false;
}

CGL_SELDOM cgl_error cgl_encoder_table_retune(cgl_encoder_table *table, const cgl_encoder_table_config *config)
{
    if (!is_valid(config) || config->orders != table->config.orders) {
        return CGL_ERROR_CONFIG;
    }
    for (uint32_t k = 0; k < config->orders; ++k) {
        if (config->order[k] != table->config.order[k]) {
            return CGL_ERROR_CONFIG;
        }
    }
    cgl_encoder_table retuned = *table;
    if (take(&retuned, config, table->observer.ts) != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
    for (uint32_t k = 0; k < config->orders; ++k) {
        retuned.a[k] = cgl_clamped(retuned.a[k], config->limit);
        retuned.c[k] = cgl_clamped(retuned.c[k], config->limit);
    }
    *table = retuned;
    return CGL_OK;
}

/* Steps the observer. Returns the angle theta less the observer's angle [rad]. If this difference is beyond LOST, the observer restarts. */
static cgl_real residual(cgl_encoder_table *table, cgl_real theta, cgl_real omega, cgl_real i_q)
{
    cgl_angle_observer *const observer = &table->observer;
    const uint32_t turns = (uint32_t)(cgl_fraction(theta * (CGL_R(1.0) / CGL_TWO_PI)) * CGL_TURN_BITS);
    const cgl_real known = table->config.b * i_q * observer->ts;
    observer->omega = cgl_clamp(observer->omega + (cgl_is_finite(known) ? known : CGL_R(0.0)), observer->omega_max);
    cgl_angle_observer_step(observer, turns);
    const cgl_real left = cgl_steps(observer->theta, turns) * (CGL_TWO_PI / CGL_TURN_BITS);
    if (!cgl_is_within(left, LOST)) {
        const cgl_real alpha = observer->alpha;
        cgl_angle_observer_reset(observer, turns, omega);
        observer->alpha = alpha;
        table->wait = table->settle;
    }
    return left;
}

typedef struct {
    cgl_real sine, cosine;
} wave;

/* Returns sine and cosine of an order at an angle. */
static wave wave_at(cgl_real theta, uint32_t order)
{
    wave at;
    cgl_sincos(cgl_fraction(theta * (CGL_R(1.0) / CGL_TWO_PI)) * CGL_TWO_PI * (cgl_real)order, &at.sine, &at.cosine);
    return at;
}

void cgl_encoder_table_step(cgl_encoder_table *table, cgl_measurement *now, cgl_real i_q, bool learn)
{
    const cgl_encoder_table_config *const config = &table->config;
    const cgl_real theta = now->theta_m, omega = now->omega_m;
    table->learning = false;
    if (!(cgl_is_angle(theta) && cgl_is_finite(omega))) {
        table->wait = table->settle;
        return;
    }
    wave at[CGL_ENCODER_TABLE_ORDERS];
    cgl_real error = CGL_R(0.0);
    for (uint32_t k = 0; k < config->orders; ++k) {
        at[k] = wave_at(theta, config->order[k]);
        error += table->a[k] * at[k].cosine + table->c[k] * at[k].sine;
    }
    const cgl_real corrected = theta - error;
    table->theta = theta;
    table->error = error;
    now->theta_m = corrected < CGL_R(0.0) ? corrected + CGL_TWO_PI
                                          : (corrected >= CGL_TWO_PI && theta < CGL_TWO_PI ? corrected - CGL_TWO_PI : corrected);
    const cgl_real left = residual(table, corrected, omega, i_q);
    if (table->wait > 0U) {
        --table->wait;
        return;
    }
    if (!(learn && cgl_abs(omega) >= config->omega_min && cgl_is_within(left, FAR))) {
        return;
    }
    table->learning = true;
    const cgl_real step = CGL_R(2.0) * config->gain * table->observer.ts * left;
    for (uint32_t k = 0; k < config->orders; ++k) {
        table->a[k] = cgl_clamp(table->a[k] + step * at[k].cosine, config->limit);
        table->c[k] = cgl_clamp(table->c[k] + step * at[k].sine, config->limit);
    }
}

cgl_real cgl_encoder_table_speed(const cgl_encoder_table *table, cgl_real omega_m, cgl_real time)
{
    const cgl_real before = table->theta - omega_m * time;
    if (!(time > CGL_R(0.0) && cgl_is_angle(before))) {
        return omega_m;
    }
    cgl_real error = table->error;
    for (uint32_t k = 0; k < table->config.orders; ++k) {
        const wave then = wave_at(before, table->config.order[k]);
        error -= table->a[k] * then.cosine + table->c[k] * then.sine;
    }
    const cgl_real wrong = error / time;
    return cgl_is_finite(wrong) ? cgl_clamp(omega_m - wrong, CGL_REAL_MAX) : omega_m;
}

uint32_t cgl_encoder_table_turns(const cgl_encoder_table *table, uint32_t turns)
{
    return cgl_turned(turns, -table->error * (CGL_R(1.0) / CGL_TWO_PI));
}
