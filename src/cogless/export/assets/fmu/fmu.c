#include "fmu.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Tolerance of communication points and steps, in periods: importers add up times. */
static const double point_slack = 1e-2, step_slack = 1e-3;

static void set_start_values(fmu_instance *instance)
{
    for (uint32_t n = 0; n < fmu_variable_count; ++n) instance->value[n] = fmu_variables[n].start;
    instance->start_time = 0.0;
    instance->tick = 0;
    instance->mode = FMU_INSTANTIATED;
    instance->stale = true;
}

bool fmu_refuse(fmu_instance *instance, const char *why, ...)
{
    char message[2 * FMU_WHY];
    va_list arguments;
    va_start(arguments, why);
    (void)vsnprintf(message, sizeof message, why, arguments);
    va_end(arguments);
    instance->log(instance, message);
    return false;
}

static bool fail(fmu_instance *instance, const char *why)
{
    instance->mode = FMU_FAILED;
    return fmu_refuse(instance, "%s", why);
}

bool fmu_open(fmu_instance *instance, const char *token)
{
    char why[FMU_WHY] = "";
    if (token == NULL || strcmp(token, fmu_token) != 0) {
        return fmu_refuse(instance, "the token is not that of this FMU: expected %s", fmu_token);
    }
    instance->value = malloc(fmu_variable_count * sizeof *instance->value);
    if (instance->value == NULL) return fmu_refuse(instance, "out of memory");
    set_start_values(instance);
    instance->model = fmu_model_new(why);
    return instance->model != NULL || fail(instance, why);
}

void fmu_close(fmu_instance *instance)
{
    if (instance->model != NULL) fmu_model_free(instance->model);
    free(instance->value);
}

double fmu_time(const fmu_instance *instance)
{
    return instance->start_time + (double)instance->tick / (double)fmu_rate;
}

bool fmu_start_at(fmu_instance *instance, double start_time)
{
    if (instance->mode != FMU_INSTANTIATED) return fmu_refuse(instance, "the experiment is set up before initialisation");
    if (!isfinite(start_time)) return fmu_refuse(instance, "start time: expected a finite number");
    instance->start_time = start_time;
    return true;
}

bool fmu_enter_initialisation(fmu_instance *instance)
{
    if (instance->mode != FMU_INSTANTIATED) return fmu_refuse(instance, "initialisation only follows instantiation or reset");
    instance->mode = FMU_INITIALISATION;
    return true;
}

/* The outputs at time zero. */
static bool bring_up_to_date(fmu_instance *instance)
{
    char why[FMU_WHY] = "";
    if (!instance->stale) return true;
    if (!fmu_model_start(instance->model, instance->value, why)) return fail(instance, why);
    instance->stale = false;
    return true;
}

bool fmu_exit_initialisation(fmu_instance *instance)
{
    if (instance->mode != FMU_INITIALISATION) return fmu_refuse(instance, "initialisation was not entered");
    if (!bring_up_to_date(instance)) return false;
    instance->mode = FMU_STEPPING;
    instance->value[0] = fmu_time(instance);
    return true;
}

bool fmu_step(fmu_instance *instance, double point, double size)
{
    char why[FMU_WHY] = "";
    const double rate = (double)fmu_rate, periods = size * rate;
    if (instance->mode != FMU_STEPPING) return fmu_refuse(instance, "a step only follows initialisation");
    if (!(fabs((point - instance->start_time) * rate - (double)instance->tick) <= point_slack)) {
        return fmu_refuse(instance, "communication point %.12g s: expected %.12g s", point, fmu_time(instance));
    }
    if (!(periods >= 0.5 && periods < 1e15 && fabs(periods - floor(periods + 0.5)) <= step_slack)) {
        return fmu_refuse(instance, "communication step %.12g s: expected a whole number of periods of %.12g s", size,
                          1.0 / rate);
    }
    for (const int64_t end = instance->tick + (int64_t)floor(periods + 0.5); instance->tick < end;) {
        if (!fmu_model_step(instance->model, instance->value, why)) return fail(instance, why);
        ++instance->tick;
        instance->value[0] = fmu_time(instance);
    }
    return true;
}

bool fmu_terminate(fmu_instance *instance)
{
    if (instance->mode != FMU_STEPPING && instance->mode != FMU_INITIALISATION) {
        return fmu_refuse(instance, "only what was initialised can be terminated");
    }
    instance->mode = FMU_TERMINATED;
    return true;
}

bool fmu_reset(fmu_instance *instance)
{
    char why[FMU_WHY] = "";
    fmu_model *fresh = fmu_model_new(why);
    if (fresh == NULL) return fail(instance, why);
    fmu_model_free(instance->model);
    instance->model = fresh;
    set_start_values(instance);
    return true;
}

static bool is_variable(fmu_instance *instance, uint32_t reference, fmu_type type)
{
    if (reference < fmu_variable_count && fmu_variables[reference].type == type) return true;
    return fmu_refuse(instance, "value reference %u: no variable of this type", (unsigned)reference);
}

const double *fmu_get(fmu_instance *instance, uint32_t reference, fmu_type type)
{
    if (!is_variable(instance, reference, type)) return NULL;
    if (instance->mode == FMU_INITIALISATION && fmu_variables[reference].causality == FMU_OUTPUT &&
        !bring_up_to_date(instance)) {
        return NULL;
    }
    return &instance->value[reference];
}

double *fmu_set(fmu_instance *instance, uint32_t reference, fmu_type type)
{
    const bool early = instance->mode == FMU_INSTANTIATED || instance->mode == FMU_INITIALISATION;
    if (!is_variable(instance, reference, type)) return NULL;
    switch (fmu_variables[reference].causality) {
    case FMU_PARAMETER:
        if (early) break;
        (void)fmu_refuse(instance, "%s: a parameter, which can only be set until initialisation ends",
                         fmu_variables[reference].name);
        return NULL;
    case FMU_INPUT:
        if (early || instance->mode == FMU_STEPPING) break;
        (void)fmu_refuse(instance, "%s: can't be set any more", fmu_variables[reference].name);
        return NULL;
    default:
        (void)fmu_refuse(instance, "%s: neither an input nor a parameter", fmu_variables[reference].name);
        return NULL;
    }
    instance->stale = true;
    return &instance->value[reference];
}

/* Head of a state's bytes; then come the values, then the model. */
typedef struct {
    char token[64];
    double start_time;
    int64_t tick;
    int32_t mode, stale;
} state_head;

fmu_state *fmu_state_new(fmu_instance *instance, size_t size)
{
    fmu_state *state = malloc(sizeof *state);
    unsigned char *bytes = malloc(size);
    if (state == NULL || bytes == NULL) {
        free(state);
        free(bytes);
        (void)fmu_refuse(instance, "out of memory");
        return NULL;
    }
    state->size = size;
    state->bytes = bytes;
    return state;
}

void fmu_state_free(fmu_state *state)
{
    if (state != NULL) free(state->bytes);
    free(state);
}

bool fmu_save(fmu_instance *instance, fmu_state **state)
{
    const size_t values = fmu_variable_count * sizeof *instance->value;
    const size_t size = sizeof(state_head) + values + fmu_model_save(instance->model, NULL);
    state_head head = {{0}, instance->start_time, instance->tick, (int32_t)instance->mode, instance->stale ? 1 : 0};
    if (*state == NULL || (*state)->size != size) {
        fmu_state *fresh = fmu_state_new(instance, size);
        if (fresh == NULL) return false;
        fmu_state_free(*state);
        *state = fresh;
    }
    (void)snprintf(head.token, sizeof head.token, "%s", fmu_token);
    memcpy((*state)->bytes, &head, sizeof head);
    memcpy((*state)->bytes + sizeof head, instance->value, values);
    (void)fmu_model_save(instance->model, (*state)->bytes + sizeof head + values);
    return true;
}

bool fmu_load(fmu_instance *instance, const fmu_state *state)
{
    const size_t values = fmu_variable_count * sizeof *instance->value;
    char why[FMU_WHY] = "";
    state_head head;
    if (state == NULL || state->size < sizeof head + values) return fmu_refuse(instance, "this is no state of this FMU");
    memcpy(&head, state->bytes, sizeof head);
    if (strncmp(head.token, fmu_token, sizeof head.token) != 0 || head.mode < FMU_INSTANTIATED || head.mode > FMU_FAILED) {
        return fmu_refuse(instance, "this is no state of this FMU");
    }
    memcpy(instance->value, state->bytes + sizeof head, values);
    if (!fmu_model_load(instance->model, instance->value, state->bytes + sizeof head + values,
                        state->size - sizeof head - values, why)) {
        return fail(instance, why);
    }
    instance->start_time = head.start_time;
    instance->tick = head.tick;
    instance->mode = (fmu_mode)head.mode;
    instance->stale = head.stale != 0;
    return true;
}
