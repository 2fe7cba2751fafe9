/* The laws against their transcriptions in NumPy: vectors/NAME.txt. */
#ifndef VECTORS_H
#define VECTORS_H

void golden_vectors(void);

#endif
