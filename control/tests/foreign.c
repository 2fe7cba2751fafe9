#include "foreign.h"

#include <stddef.h>

#include "check.h"
#include "loops.h"

void foreign_loops(void)
{
    const double measured = simplefoc_measured_kp();
    const loop_result results[] = {simplefoc_like(0.0), simplefoc_like(measured), odrive_like(), moteus_like()};
    CHECK(measured > 0.5 * 0.04 && measured < 1.5 * 0.04); /* a loop of that P */
    for (unsigned n = 0; n < sizeof results / sizeof results[0]; ++n) {
        const loop_result r = results[n];
        CHECK(r.refused == NULL);
        CHECK(r.before > 1.0 && r.after < 0.1 * r.before);
        CHECK(r.mean > 5.9 && r.mean < 6.1);
    }
}
