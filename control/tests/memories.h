/* The memories of the learning laws at their edges. */
#ifndef MEMORIES_H
#define MEMORIES_H

void memories(void);

#endif
