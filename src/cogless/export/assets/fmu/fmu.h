/* Code of both versions of the FMI standard and both kinds of model: an instance with its variables, modes and time.
 *
 * A variable's value reference is its place in fmu_variables. Every value is held as a double. */
#ifndef FMU_H
#define FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { FMU_REAL, FMU_INTEGER, FMU_BOOLEAN } fmu_type;
typedef enum { FMU_TIME, FMU_PARAMETER, FMU_INPUT, FMU_OUTPUT } fmu_causality;

typedef struct {
    const char *name;
    fmu_type type;
    fmu_causality causality;
    double start;
} fmu_variable;

/* Variables of this FMU; generated. The first one is the time. */
extern const char fmu_token[];
extern const uint32_t fmu_rate; /* periods a second */
extern const uint32_t fmu_variable_count;
extern const fmu_variable fmu_variables[];

enum { FMU_WHY = 320 }; /* bytes of a reason */

/* A model: the controller, or the drive. Where one of its functions returns false or null, `why` says so. */
typedef struct fmu_model fmu_model;
fmu_model *fmu_model_new(char why[FMU_WHY]);
void fmu_model_free(fmu_model *model);
/* Starts at time zero: takes parameters and inputs from `value`, puts the outputs there. May be called again. */
bool fmu_model_start(fmu_model *model, double value[], char why[FMU_WHY]);
/* One period, with the inputs in `value`, and the outputs at its end. */
bool fmu_model_step(fmu_model *model, double value[], char why[FMU_WHY]);
/* Its state as bytes; returns how many, and writes none to a null pointer. */
size_t fmu_model_save(const fmu_model *model, unsigned char *to);
/* The state of another or the same model of this FMU that was started with the same parameters, which `value` has. */
bool fmu_model_load(fmu_model *model, double value[], const unsigned char *from, size_t size, char why[FMU_WHY]);

typedef enum { FMU_INSTANTIATED, FMU_INITIALISATION, FMU_STEPPING, FMU_TERMINATED, FMU_FAILED } fmu_mode;

typedef struct fmu_instance {
    void (*log)(struct fmu_instance *instance, const char *message); /* set by the version of the standard */
    fmu_model *model;
    double *value;
    double start_time; /* s */
    int64_t tick;      /* periods since the start */
    fmu_mode mode;
    bool stale; /* something was set since the outputs were calculated, before the first step */
} fmu_instance;

/* An instance in a block of `size` bytes that starts with it, or null. The log must be set before it is opened. */
bool fmu_open(fmu_instance *instance, const char *token);
void fmu_close(fmu_instance *instance);

/* All of these: false where it's not possible, which the log then says. */
bool fmu_refuse(fmu_instance *instance, const char *why, ...);
bool fmu_start_at(fmu_instance *instance, double start_time);
bool fmu_enter_initialisation(fmu_instance *instance);
bool fmu_exit_initialisation(fmu_instance *instance);
bool fmu_step(fmu_instance *instance, double point, double size);
bool fmu_terminate(fmu_instance *instance);
bool fmu_reset(fmu_instance *instance);
double fmu_time(const fmu_instance *instance);

/* Address of a variable's value, to be read or to be set. Null where that's not possible. */
const double *fmu_get(fmu_instance *instance, uint32_t reference, fmu_type type);
double *fmu_set(fmu_instance *instance, uint32_t reference, fmu_type type);

/* All of an instance as bytes. */
typedef struct {
    size_t size;
    unsigned char *bytes;
} fmu_state;

fmu_state *fmu_state_new(fmu_instance *instance, size_t size);
void fmu_state_free(fmu_state *state);
/* Saves an instance into a state that is there, or, where that's null, a new one. */
bool fmu_save(fmu_instance *instance, fmu_state **state);
bool fmu_load(fmu_instance *instance, const fmu_state *state);

#ifdef __cplusplus
}
#endif

#endif
