#include "control.h"

#include <stddef.h>

#include "board.h"
#include "cogless/drive.h"
#include "cogless/pi_ilc.h"

enum { CELLS = 256, POLE_PAIRS = 4, Q_HALF_WIDTH = 2, SPEED_DIVIDER = 15 };
static const cgl_drive_config drive_config = {
    .pole_pairs = POLE_PAIRS, .divider = SPEED_DIVIDER,
    .foc = {.kp_d = 30.0f, .ki_d = 15000.0f, .kp_q = 30.0f, .ki_q = 15000.0f, .current_limit = 3.0f,
            .advance = 1.5f, .decoupling = true, .L_d = 0.01f, .L_q = 0.01f, .psi_f = 0.068f},
    .monitor = {.omega_max = 400.0f, .angle_step = 0.001f, .speed_window = 0.001f, .stuck_angle = 0.5f, .stuck_time = 0.1f,
                .current_max = 6.0f, .current_sum = 1.0f, .bridge = 0.005f, .hold = 0.01f, .phases = 3},
    .quality = {.span = 6.2831853f, .longest = 60.0f}};
static const cgl_pi_ilc_config law_config = {
    .pi = {.kp = 0.14f, .ki = 2.9f, .limit = 3.0f}, .gain = 0.038f,
    .memory = {.channels = 1, .cells = CELLS, .turns = 1, .parts = POLE_PAIRS, .q_half_width = Q_HALF_WIDTH, .forgetting = 1.0f,
               .limit = {1.0f}}};
CGL_MAP(map, CELLS, Q_HALF_WIDTH); /* the learned current over the angle */
static cgl_pi_ilc law;
static cgl_drive drive;

bool control_start(void) /* call it once, before you enable the interrupt. If it returns false, do not run the motor */
{
    return cgl_drive_init(&drive, &drive_config, 1.0f / BOARD_RATE) == CGL_OK
           && cgl_pi_ilc_init(&law, &law_config, &drive.loop, map, CGL_ENTRIES(map)) == CGL_OK;
}

void current_loop_interrupt(void)
{
    const cgl_measurement now = board_measure();
    const cgl_reference reference = {.omega_ref = 6.28f, .learn = true};
    cgl_drive_output out;
    if (cgl_drive_measure(&drive, &now, &reference)) { /* true in every 15th period */
        cgl_pi_ilc_step(&law, &drive.in, &drive.command);
    }
    cgl_drive_actuate(&drive, &out);
    if ((out.status & (unsigned)CGL_STATUS_OFF) != 0U) { /* all duty cycles are 0.5, which would short-circuit the motor */
        board_open_bridge();
    } else {
        board_set_duty(out.duty);
    }
}

static uint32_t windows_of_quality(void)
{
    return *(const volatile uint32_t *)&drive.quality.windows;
}

cgl_quality_report control_quality(void) /* ripple and progress of learning, for a display; call it in the background */
{
    cgl_quality copy;
    uint32_t windows;
    do { /* if a window of `quality` ended meanwhile, its results have changed: copy again */
        windows = windows_of_quality();
        for (size_t n = 0; n < sizeof copy; ++n) {
            ((unsigned char *)&copy)[n] = ((const volatile unsigned char *)&drive.quality)[n];
        }
    } while (windows_of_quality() != windows);
    return cgl_quality_read(&copy);
}
