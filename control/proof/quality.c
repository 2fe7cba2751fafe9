/* Quality of learning: no undefined behaviour, whatever the errors. */
#include "cogless/quality.h"

#include "proof.h"

int main(void)
{
    cgl_quality_config config = {any_real(), any_real(), any_real(), any_real()};
    cgl_quality quality;
    if (cgl_quality_init(&quality, &config, any_real()) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        if (any_bool()) {
            cgl_quality_reset(&quality);
        } else if (any_bool()) {
            (void)cgl_quality_read(&quality);
        } else {
            (void)cgl_quality_step(&quality, any_real(), any_real(), any_bool());
        }
    }
    return 0;
}
