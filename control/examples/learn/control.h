/* The controller of the examples, one text with the README's. */
#ifndef CONTROL_H
#define CONTROL_H

#include <stdbool.h>

#include "cogless/quality.h"

bool control_start(void);
void current_loop_interrupt(void);
cgl_quality_report control_quality(void);

#endif
