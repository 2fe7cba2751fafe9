/* The documented ends of every config field that is bounded by more than its sign. */
#ifndef BOUNDS_H
#define BOUNDS_H

void bounds(void);

#endif
