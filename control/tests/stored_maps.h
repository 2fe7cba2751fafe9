#ifndef STORED_MAPS_H
#define STORED_MAPS_H

/* Saves and loads: power lost at every byte, every bit flipped, every reason of a refusal. */
void stored_maps(void);

/* Flash full of anything, and maps with anything in their headers: refused, or entries within their limits. */
void random_flash(long tries);

#endif
