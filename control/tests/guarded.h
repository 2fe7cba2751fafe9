/* What the guard decides of a ripple that depends on what it lets act. */
#ifndef GUARDED_H
#define GUARDED_H

void guarded(long configs);

#endif
