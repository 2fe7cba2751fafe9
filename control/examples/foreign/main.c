/* Ripple of three foreign loops, without what the learner adds and with it; ends with 0 if each is left with less than a third. */
#include <stdio.h>

#include "loops.h"

int main(void)
{
    const double measured = simplefoc_measured_kp();
    const struct {
        const char *name;
        loop_result result;
    } loops[] = {{"as SimpleFOC", simplefoc_like(0.0)},
                 {"  kp measured", simplefoc_like(measured)},
                 {"as ODrive", odrive_like()},
                 {"as moteus", moteus_like()}};
    int failed = 0;
    for (unsigned n = 0; n < sizeof loops / sizeof loops[0]; ++n) {
        const loop_result r = loops[n].result;
        if (r.refused != NULL) {
            printf("%-14s refused: %s\n", loops[n].name, r.refused);
        } else {
            printf("%-14s ripple %.4f -> %.4f rad/s, at %.3f rad/s\n", loops[n].name, r.before, r.after, r.mean);
        }
        failed += r.refused != NULL || !(3.0 * r.after < r.before);
    }
    printf("kp of the first as its response tells it: %.4f A s/rad\n", measured);
    return failed;
}
