/* Foreign loops on a plant, with a learner beside them. */
#ifndef FOREIGN_H
#define FOREIGN_H

void foreign_loops(void);

#endif
