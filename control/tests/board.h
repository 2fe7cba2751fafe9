/* The board of the README's example, as the tests play it. */
#ifndef BOARD_H
#define BOARD_H

#include "cogless/real.h"

typedef struct {
    cgl_real i_abc[3];        /* [A] */
    cgl_real theta_m;         /* mechanical, within a revolution [rad] */
    cgl_real omega_m;         /* mechanical [rad/s] */
    cgl_real u_dc;            /* [V] */
} board_sample;

board_sample board_measure(void);
void board_set_duty(const cgl_real duty[3]);

#endif
