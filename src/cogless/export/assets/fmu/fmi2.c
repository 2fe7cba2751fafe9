/* FMI 2.0 for co-simulation. What belongs to model exchange, or to what this FMU does not do, is refused. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu.h"

typedef struct {
    fmu_instance base;
    fmi2CallbackFunctions callbacks;
    char *name;
} instance2;

/* The message is a format, in which % and # have a meaning of their own. */
static void write_log(fmu_instance *instance, const char *message)
{
    const instance2 *i = (const instance2 *)(const void *)instance;
    char format[4 * FMU_WHY];
    size_t length = 0;
    if (i->callbacks.logger == NULL) return;
    for (; *message != '\0' && length + 3 < sizeof format; ++message) {
        if (*message == '%' || *message == '#') format[length++] = *message;
        format[length++] = *message;
    }
    format[length] = '\0';
    i->callbacks.logger(i->callbacks.componentEnvironment, i->name, fmi2Error, "logStatusError", format);
}

static fmi2Status status(bool done)
{
    return done ? fmi2OK : fmi2Error;
}

static fmi2Status refuse(fmi2Component c, const char *function)
{
    return c == NULL ? fmi2Error : status(fmu_refuse(c, "%s: not supported by this FMU for co-simulation", function));
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Errors are always logged; there is nothing else to say. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean logging_on, size_t count, const fmi2String categories[])
{
    (void)logging_on;
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < count; ++n) {
        if (strcmp(categories[n], "logStatusError") != 0) return status(fmu_refuse(c, "%s: unknown log category", categories[n]));
    }
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging_on)
{
    instance2 *i;
    (void)resources;
    (void)visible;
    (void)logging_on;
    if (functions == NULL || name == NULL) return NULL;
    i = calloc(1, sizeof *i);
    if (i == NULL) return NULL;
    i->base.log = write_log;
    i->callbacks = *functions;
    i->name = malloc(strlen(name) + 1);
    if (i->name != NULL) {
        strcpy(i->name, name);
        if (type != fmi2CoSimulation) {
            (void)refuse(i, "model exchange");
        } else if (fmu_open(&i->base, guid)) {
            return i;
        }
    }
    fmi2FreeInstance(i);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    instance2 *i = c;
    if (i == NULL) return;
    fmu_close(&i->base);
    free(i->name);
    free(i);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start_time,
                               fmi2Boolean stop_time_defined, fmi2Real stop_time)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_time_defined;
    (void)stop_time;
    return status(c != NULL && fmu_start_at(c, start_time));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return status(c != NULL && fmu_enter_initialisation(c));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return status(c != NULL && fmu_exit_initialisation(c));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return status(c != NULL && fmu_terminate(c));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    return status(c != NULL && fmu_reset(c));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        const double *from = fmu_get(c, vr[n], FMU_REAL);
        if (from == NULL) return fmi2Error;
        value[n] = *from;
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        const double *from = fmu_get(c, vr[n], FMU_INTEGER);
        if (from == NULL) return fmi2Error;
        value[n] = (fmi2Integer)*from;
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        const double *from = fmu_get(c, vr[n], FMU_BOOLEAN);
        if (from == NULL) return fmi2Error;
        value[n] = *from != 0.0 ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : refuse(c, "fmi2GetString");
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        double *to = fmu_set(c, vr[n], FMU_REAL);
        if (to == NULL) return fmi2Error;
        *to = value[n];
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        double *to = fmu_set(c, vr[n], FMU_INTEGER);
        if (to == NULL) return fmi2Error;
        *to = (double)value[n];
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    if (c == NULL) return fmi2Error;
    for (size_t n = 0; n < nvr; ++n) {
        double *to = fmu_set(c, vr[n], FMU_BOOLEAN);
        if (to == NULL) return fmi2Error;
        *to = value[n] != fmi2False ? 1.0 : 0.0;
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : refuse(c, "fmi2SetString");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    fmu_state *saved;
    if (c == NULL || state == NULL) return fmi2Error;
    saved = *state;
    if (!fmu_save(c, &saved)) return fmi2Error;
    *state = saved;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return status(c != NULL && fmu_load(c, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    if (state != NULL) {
        fmu_state_free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    if (state == NULL || size == NULL) return fmi2Error;
    *size = ((const fmu_state *)state)->size;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    const fmu_state *saved = state;
    if (c == NULL) return fmi2Error;
    if (saved == NULL || size < saved->size) return status(fmu_refuse(c, "too little room for the state"));
    memcpy(bytes, saved->bytes, saved->size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    fmu_state *fresh;
    if (c == NULL || state == NULL) return fmi2Error;
    fresh = fmu_state_new(c, size);
    if (fresh == NULL) return fmi2Error;
    memcpy(fresh->bytes, bytes, size);
    fmu_state_free(*state);
    *state = fresh;
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real dv_known[],
                                        fmi2Real dv_unknown[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)dv_known;
    (void)dv_unknown;
    return refuse(c, "fmi2GetDirectionalDerivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : refuse(c, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : refuse(c, "fmi2GetRealOutputDerivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_before)
{
    (void)no_set_state_before;
    return status(c != NULL && fmu_step(c, point, size));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refuse(c, "fmi2CancelStep");
}

/* A step is done when fmi2DoStep returns: nothing is ever pending. */
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (c == NULL || value == NULL || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = fmu_time(c);
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (c == NULL || value == NULL || kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    return refuse(c, "fmi2EnterEventMode");
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)info;
    return refuse(c, "fmi2NewDiscreteStates");
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    return refuse(c, "fmi2EnterContinuousTimeMode");
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state_before, fmi2Boolean *enter_event_mode,
                                       fmi2Boolean *terminate)
{
    (void)no_set_state_before;
    (void)enter_event_mode;
    (void)terminate;
    return refuse(c, "fmi2CompletedIntegratorStep");
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    (void)time;
    return refuse(c, "fmi2SetTime");
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    (void)x;
    (void)nx;
    return refuse(c, "fmi2SetContinuousStates");
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    (void)derivatives;
    (void)nx;
    return refuse(c, "fmi2GetDerivatives");
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t ni)
{
    (void)indicators;
    (void)ni;
    return refuse(c, "fmi2GetEventIndicators");
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    (void)x;
    (void)nx;
    return refuse(c, "fmi2GetContinuousStates");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t nx)
{
    (void)nominals;
    (void)nx;
    return refuse(c, "fmi2GetNominalsOfContinuousStates");
}
