/* The controller as a model: the exported C, one call of its step in a step. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "controller_variables.h"
#include "fmu.h"

/* Everything in one block. The controller points into itself, so its bytes only fit where they were: see load. */
struct fmu_model {
    CONTROLLER controller;
    uint64_t tick;
};

fmu_model *fmu_model_new(char why[FMU_WHY])
{
    fmu_model *model = calloc(1, sizeof *model);
    if (model == NULL) (void)snprintf(why, FMU_WHY, "out of memory");
    return model;
}

void fmu_model_free(fmu_model *model)
{
    free(model);
}

static void put_outputs(const cgl_drive_output *out, double value[])
{
    const double all[] = {
        (double)out->duty[0], (double)out->duty[1], (double)out->duty[2],  (double)out->i_d,    (double)out->i_q,
        (double)out->u_d,     (double)out->u_q,     (double)out->i_d_ref, (double)out->i_q_ref, (double)out->status,
    };
    for (size_t n = 0; n < sizeof all / sizeof *all; ++n) {
        if (output_place[n] != 0) value[output_place[n]] = all[n];
    }
}

bool fmu_model_start(fmu_model *model, double value[], char why[FMU_WHY])
{
    cgl_drive_output out = {{CGL_R(0.5), CGL_R(0.5), CGL_R(0.5)}, 0, 0, 0, 0, 0, 0, 0};
    memset(model, 0, sizeof *model);
    if (CONTROLLER_INIT(&model->controller) != CGL_OK) {
        (void)snprintf(why, FMU_WHY, "the controller refuses its configuration");
        return false;
    }
    controller_teach(&model->controller);
    put_outputs(&out, value);
    return true;
}

/* A value of the table as the controller's number; 0 where there is no such variable. */
static cgl_real in(const double value[], uint32_t place)
{
    return place == 0 ? CGL_R(0.0) : (cgl_real)value[place];
}

bool fmu_model_step(fmu_model *model, double value[], char why[FMU_WHY])
{
    const cgl_measurement now = {
        {in(value, FMU_I_A), in(value, FMU_I_B), in(value, FMU_I_C)},
        in(value, FMU_THETA_M),
        in(value, FMU_OMEGA_M),
        in(value, FMU_U_DC),
    };
    const cgl_reference reference = {
        in(value, FMU_THETA_REF), in(value, FMU_OMEGA_REF), in(value, FMU_ALPHA_REF), in(value, FMU_I_D_REF),
        value[FMU_LEARN] != 0.0,
    };
    cgl_drive_output out;
    (void)why;
    controller_before_step(&model->controller, model->tick);
    CONTROLLER_STEP(&model->controller, &now, &reference, &out);
    ++model->tick;
    controller_after_step(&model->controller, model->tick);
    put_outputs(&out, value);
    return true;
}

size_t fmu_model_save(const fmu_model *model, unsigned char *to)
{
    if (to != NULL) memcpy(to, model, sizeof *model);
    return sizeof *model;
}

bool fmu_model_load(fmu_model *model, double value[], const unsigned char *from, size_t size, char why[FMU_WHY])
{
    (void)value;
    if (size != sizeof *model) {
        (void)snprintf(why, FMU_WHY, "this is no state of this FMU");
        return false;
    }
    memcpy(model, from, size);
    controller_relink(&model->controller, model->tick);
    return true;
}
