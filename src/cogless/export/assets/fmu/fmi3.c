/* FMI 3.0 for co-simulation. What belongs to the other kinds of FMU, or to what this FMU does not do, is refused. */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "fmu.h"

typedef struct {
    fmu_instance base;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log_message;
} instance3;

static void write_log(fmu_instance *instance, const char *message)
{
    const instance3 *i = (const instance3 *)(const void *)instance;
    if (i->log_message != NULL) i->log_message(i->environment, fmi3Error, "logStatusError", message);
}

static fmi3Status status(bool done)
{
    return done ? fmi3OK : fmi3Error;
}

static fmi3Status refuse(fmi3Instance instance, const char *function)
{
    return status(instance != NULL && fmu_refuse(instance, "%s: not supported by this FMU for co-simulation", function));
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Errors are always logged; there is nothing else to say. */
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean logging_on, size_t count, const fmi3String categories[])
{
    (void)logging_on;
    if (instance == NULL) return fmi3Error;
    for (size_t n = 0; n < count; ++n) {
        if (strcmp(categories[n], "logStatusError") != 0) {
            return status(fmu_refuse(instance, "%s: unknown log category", categories[n]));
        }
    }
    return fmi3OK;
}

static instance3 *make(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message)
{
    instance3 *i = calloc(1, sizeof *i);
    if (i == NULL) return NULL;
    i->base.log = write_log;
    i->environment = environment;
    i->log_message = log_message;
    return i;
}

static fmi3Instance refuse_kind(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message, const char *kind)
{
    instance3 *i = make(environment, log_message);
    (void)refuse(i, kind);
    fmi3FreeInstance(i);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging_on, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log_message)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging_on;
    return refuse_kind(environment, log_message, "model exchange");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging_on,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
                                               fmi3ClockUpdateCallback clock_update,
                                               fmi3LockPreemptionCallback lock_preemption,
                                               fmi3UnlockPreemptionCallback unlock_preemption)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging_on;
    (void)clock_update;
    (void)lock_preemption;
    (void)unlock_preemption;
    return refuse_kind(environment, log_message, "scheduled execution");
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging_on, fmi3Boolean event_mode_used,
                                         fmi3Boolean early_return_allowed, const fmi3ValueReference required[],
                                         size_t required_count, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log_message, fmi3IntermediateUpdateCallback intermediate_update)
{
    instance3 *i = make(environment, log_message);
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging_on;
    (void)early_return_allowed;
    (void)required;
    (void)intermediate_update;
    if (i == NULL) return NULL;
    if (event_mode_used) {
        (void)refuse(i, "event mode");
    } else if (required_count > 0) {
        (void)refuse(i, "intermediate update");
    } else if (fmu_open(&i->base, token)) {
        return i;
    }
    fmi3FreeInstance(i);
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    if (instance == NULL) return;
    fmu_close(instance);
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start_time, fmi3Boolean stop_time_defined, fmi3Float64 stop_time)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_time_defined;
    (void)stop_time;
    return status(instance != NULL && fmu_start_at(instance, start_time) && fmu_enter_initialisation(instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return status(instance != NULL && fmu_exit_initialisation(instance));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return status(instance != NULL && fmu_terminate(instance));
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    return status(instance != NULL && fmu_reset(instance));
}

/* The types that its variables have. */
#define ACCESS(Name, type, fmu, from_double, to_double)                                                                    \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count, type values[],    \
                             size_t value_count)                                                                           \
    {                                                                                                                      \
        if (instance == NULL || value_count != count) return refuse(instance, "fmi3Get" #Name " of so many values");       \
        for (size_t n = 0; n < count; ++n) {                                                                               \
            const double *x = fmu_get(instance, references[n], fmu);                                                       \
            if (x == NULL) return fmi3Error;                                                                               \
            values[n] = from_double;                                                                                       \
        }                                                                                                                  \
        return fmi3OK;                                                                                                     \
    }                                                                                                                      \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,                   \
                             const type values[], size_t value_count)                                                      \
    {                                                                                                                      \
        if (instance == NULL || value_count != count) return refuse(instance, "fmi3Set" #Name " of so many values");       \
        for (size_t n = 0; n < count; ++n) {                                                                               \
            double *x = fmu_set(instance, references[n], fmu);                                                             \
            if (x == NULL) return fmi3Error;                                                                               \
            *x = to_double;                                                                                                \
        }                                                                                                                  \
        return fmi3OK;                                                                                                     \
    }

ACCESS(Float64, fmi3Float64, FMU_REAL, *x, values[n])
ACCESS(Int32, fmi3Int32, FMU_INTEGER, (fmi3Int32)*x, (double)values[n])
ACCESS(Boolean, fmi3Boolean, FMU_BOOLEAN, *x != 0.0, values[n] ? 1.0 : 0.0)

/* The types that none has. */
static fmi3Status none(fmi3Instance instance, size_t count, const char *function)
{
    return instance != NULL && count == 0 ? fmi3OK : refuse(instance, function);
}

#define NONE(Name, type)                                                                                                   \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count, type values[],    \
                             size_t value_count)                                                                           \
    {                                                                                                                      \
        (void)references;                                                                                                  \
        (void)values;                                                                                                      \
        (void)value_count;                                                                                                 \
        return none(instance, count, "fmi3Get" #Name);                                                                     \
    }                                                                                                                      \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,                   \
                             const type values[], size_t value_count)                                                      \
    {                                                                                                                      \
        (void)references;                                                                                                  \
        (void)values;                                                                                                      \
        (void)value_count;                                                                                                 \
        return none(instance, count, "fmi3Set" #Name);                                                                     \
    }

NONE(Float32, fmi3Float32)
NONE(Int8, fmi3Int8)
NONE(UInt8, fmi3UInt8)
NONE(Int16, fmi3Int16)
NONE(UInt16, fmi3UInt16)
NONE(UInt32, fmi3UInt32)
NONE(Int64, fmi3Int64)
NONE(UInt64, fmi3UInt64)
NONE(String, fmi3String)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    fmu_state *saved;
    if (instance == NULL || state == NULL) return fmi3Error;
    saved = *state;
    if (!fmu_save(instance, &saved)) return fmi3Error;
    *state = saved;
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return status(instance != NULL && fmu_load(instance, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    if (state != NULL) {
        fmu_state_free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    (void)instance;
    if (state == NULL || size == NULL) return fmi3Error;
    *size = ((const fmu_state *)state)->size;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    const fmu_state *saved = state;
    if (instance == NULL) return fmi3Error;
    if (saved == NULL || size < saved->size) return status(fmu_refuse(instance, "too little room for the state"));
    memcpy(bytes, saved->bytes, saved->size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    fmu_state *fresh;
    if (instance == NULL || state == NULL) return fmi3Error;
    fresh = fmu_state_new(instance, size);
    if (fresh == NULL) return fmi3Error;
    memcpy(fresh->bytes, bytes, size);
    fmu_state_free(*state);
    *state = fresh;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_set_state_before,
                      fmi3Boolean *event_handling_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    bool done;
    (void)no_set_state_before;
    if (instance == NULL) return fmi3Error;
    done = fmu_step(instance, point, size);
    if (event_handling_needed != NULL) *event_handling_needed = fmi3False;
    if (terminate != NULL) *terminate = fmi3False;
    if (early_return != NULL) *early_return = fmi3False;
    if (last_successful_time != NULL) *last_successful_time = fmu_time(instance);
    return status(done);
}

/* Functions that this FMU does not have. */

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return refuse(instance, "fmi3EnterEventMode");
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference value_references[], size_t n_value_references,
                         size_t value_sizes[], fmi3Binary values[], size_t n_values)
{
    (void)value_references;
    (void)n_value_references;
    (void)value_sizes;
    (void)values;
    (void)n_values;
    return refuse(instance, "fmi3GetBinary");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference value_references[], size_t n_value_references,
                        fmi3Clock values[])
{
    (void)value_references;
    (void)n_value_references;
    (void)values;
    return refuse(instance, "fmi3GetClock");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference value_references[], size_t n_value_references,
                         const size_t value_sizes[], const fmi3Binary values[], size_t n_values)
{
    (void)value_references;
    (void)n_value_references;
    (void)value_sizes;
    (void)values;
    (void)n_values;
    return refuse(instance, "fmi3SetBinary");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference value_references[], size_t n_value_references,
                        const fmi3Clock values[])
{
    (void)value_references;
    (void)n_value_references;
    (void)values;
    return refuse(instance, "fmi3SetClock");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference value_reference,
                                               size_t *n_dependencies)
{
    (void)value_reference;
    (void)n_dependencies;
    return refuse(instance, "fmi3GetNumberOfVariableDependencies");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t element_indices_of_dependent[], fmi3ValueReference independents[],
                                       size_t element_indices_of_independents[], fmi3DependencyKind dependency_kinds[],
                                       size_t n_dependencies)
{
    (void)dependent;
    (void)element_indices_of_dependent;
    (void)independents;
    (void)element_indices_of_independents;
    (void)dependency_kinds;
    (void)n_dependencies;
    return refuse(instance, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns;
    (void)n_unknowns;
    (void)knowns;
    (void)n_knowns;
    (void)seed;
    (void)n_seed;
    (void)sensitivity;
    (void)n_sensitivity;
    return refuse(instance, "fmi3GetDirectionalDerivative");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns;
    (void)n_unknowns;
    (void)knowns;
    (void)n_knowns;
    (void)seed;
    (void)n_seed;
    (void)sensitivity;
    (void)n_sensitivity;
    return refuse(instance, "fmi3GetAdjointDerivative");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return refuse(instance, "fmi3EnterConfigurationMode");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return refuse(instance, "fmi3ExitConfigurationMode");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference value_references[],
                                  size_t n_value_references, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)value_references;
    (void)n_value_references;
    (void)intervals;
    (void)qualifiers;
    return refuse(instance, "fmi3GetIntervalDecimal");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference value_references[],
                                   size_t n_value_references, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[])
{
    (void)value_references;
    (void)n_value_references;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return refuse(instance, "fmi3GetIntervalFraction");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference value_references[],
                               size_t n_value_references, fmi3Float64 shifts[])
{
    (void)value_references;
    (void)n_value_references;
    (void)shifts;
    return refuse(instance, "fmi3GetShiftDecimal");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference value_references[],
                                size_t n_value_references, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)value_references;
    (void)n_value_references;
    (void)counters;
    (void)resolutions;
    return refuse(instance, "fmi3GetShiftFraction");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference value_references[],
                                  size_t n_value_references, const fmi3Float64 intervals[])
{
    (void)value_references;
    (void)n_value_references;
    (void)intervals;
    return refuse(instance, "fmi3SetIntervalDecimal");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference value_references[],
                                   size_t n_value_references, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)value_references;
    (void)n_value_references;
    (void)counters;
    (void)resolutions;
    return refuse(instance, "fmi3SetIntervalFraction");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference value_references[],
                               size_t n_value_references, const fmi3Float64 shifts[])
{
    (void)value_references;
    (void)n_value_references;
    (void)shifts;
    return refuse(instance, "fmi3SetShiftDecimal");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference value_references[],
                                size_t n_value_references, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)value_references;
    (void)n_value_references;
    (void)counters;
    (void)resolutions;
    return refuse(instance, "fmi3SetShiftFraction");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return refuse(instance, "fmi3EvaluateDiscreteStates");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discrete_states_need_update,
                                    fmi3Boolean *terminate_simulation,
                                    fmi3Boolean *nominals_of_continuous_states_changed,
                                    fmi3Boolean *values_of_continuous_states_changed,
                                    fmi3Boolean *next_event_time_defined, fmi3Float64 *next_event_time)
{
    (void)discrete_states_need_update;
    (void)terminate_simulation;
    (void)nominals_of_continuous_states_changed;
    (void)values_of_continuous_states_changed;
    (void)next_event_time_defined;
    (void)next_event_time;
    return refuse(instance, "fmi3UpdateDiscreteStates");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return refuse(instance, "fmi3EnterContinuousTimeMode");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_fmustate_prior_to_current_point,
                                       fmi3Boolean *enter_event_mode, fmi3Boolean *terminate_simulation)
{
    (void)no_set_fmustate_prior_to_current_point;
    (void)enter_event_mode;
    (void)terminate_simulation;
    return refuse(instance, "fmi3CompletedIntegratorStep");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    (void)time;
    return refuse(instance, "fmi3SetTime");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuous_states[],
                                   size_t n_continuous_states)
{
    (void)continuous_states;
    (void)n_continuous_states;
    return refuse(instance, "fmi3SetContinuousStates");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t n_continuous_states)
{
    (void)derivatives;
    (void)n_continuous_states;
    return refuse(instance, "fmi3GetContinuousStateDerivatives");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 event_indicators[], size_t n_event_indicators)
{
    (void)event_indicators;
    (void)n_event_indicators;
    return refuse(instance, "fmi3GetEventIndicators");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuous_states[], size_t n_continuous_states)
{
    (void)continuous_states;
    (void)n_continuous_states;
    return refuse(instance, "fmi3GetContinuousStates");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n_continuous_states)
{
    (void)nominals;
    (void)n_continuous_states;
    return refuse(instance, "fmi3GetNominalsOfContinuousStates");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n_event_indicators)
{
    (void)n_event_indicators;
    return refuse(instance, "fmi3GetNumberOfEventIndicators");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n_continuous_states)
{
    (void)n_continuous_states;
    return refuse(instance, "fmi3GetNumberOfContinuousStates");
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return refuse(instance, "fmi3EnterStepMode");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference value_references[],
                                    size_t n_value_references, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t n_values)
{
    (void)value_references;
    (void)n_value_references;
    (void)orders;
    (void)values;
    (void)n_values;
    return refuse(instance, "fmi3GetOutputDerivatives");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock_reference,
                                      fmi3Float64 activation_time)
{
    (void)clock_reference;
    (void)activation_time;
    return refuse(instance, "fmi3ActivateModelPartition");
}
