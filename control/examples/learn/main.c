/* Runs the controller on the simulated motor: a turn to get to speed, one to measure without much learned, then ten
 * to learn. Prints the ripple before and after; ends with 0 if nine tenths of it are gone. */
#include <stdio.h>

#include "board.h"
#include "control.h"

static long in_thousandths(cgl_real x)
{
    return (long)(CGL_R(1000.0) * x + CGL_R(0.5)); /* so that no printf for floats is needed */
}

int main(void)
{
    if (!control_start()) {
        printf("the config was refused\n");
        return 2;
    }
    cgl_real first = CGL_R(0.0);
    for (int second = 1; second <= 12; ++second) { /* the reference is a turn a second */
        for (int n = 0; n < BOARD_RATE; ++n) {
            current_loop_interrupt();
        }
        const cgl_quality_report quality = control_quality();
        printf("turn %2d: ripple %4ld mrad/s%s\n", second, in_thousandths(quality.residual),
               quality.improving ? ", still improving" : "");
        first = second == 2 ? quality.residual : first;
    }
    return control_quality().residual < CGL_R(0.1) * first ? 0 : 1;
}
