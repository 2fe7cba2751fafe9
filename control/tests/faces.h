/* Misuse of the interface: what init refuses and how it names it, defaults, and states that no init made. */
#ifndef FACES_H
#define FACES_H

void faces(void);

#endif
