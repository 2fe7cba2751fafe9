#ifndef PARTS_H
#define PARTS_H

/* Random inputs to the parts around a law, so many rounds of them. */
void try_parts(long rounds);

#endif
