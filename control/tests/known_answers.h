/* What parts and laws answer to inputs that tell it. */
#ifndef KNOWN_ANSWERS_H
#define KNOWN_ANSWERS_H

void known_answers(void);

#endif
