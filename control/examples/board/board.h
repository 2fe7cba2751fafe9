/* The board of the examples: measurements in, duty cycles out. Here a simulated motor replaces the board; yours reads registers. */
#ifndef BOARD_H
#define BOARD_H

#include "cogless/monitor.h"

enum { BOARD_RATE = 15000 }; /* current-loop periods in a second */

cgl_measurement board_measure(void);
void board_set_duty(const cgl_real duty[3]);
void board_open_bridge(void); /* all transistors off, at once */

#endif
