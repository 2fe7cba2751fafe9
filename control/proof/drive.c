/* The whole tick around a law, whose command may be anything that a law may give: duty cycles in [0, 1]. */
#include "cogless/drive.h"

#include "proof.h"

static cgl_drive_config any_drive(void)
{
    const cgl_drive_config config = {
        any_bits(), any_bits(), any_bool(), any_bool(), any_bool(), true, /* without the guard, which Eva does not end with */
        {any_real(), any_real(), any_real(), any_real(), any_real(), any_real(),
         any_bool(), any_real(), any_real(), any_real(), any_bits()},
        {any_real(), any_real(), any_real(), any_real(), any_real(),
         any_real(), any_real(), any_real(), any_real(), any_bits()},
        {any_real(), any_real(), any_real(), any_real()}};
    return config;
}

int main(void)
{
    cgl_drive_config config = any_drive();
    static cgl_drive drive; /* zeros: Eva does not keep together what is foreign and what of the loop is not used */
    if (cgl_drive_init(&drive, &config, any_real()) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_measurement now = {{any_real(), any_real(), any_real()}, any_real(), any_real(), any_real()};
        const cgl_reference reference = {any_real(), any_real(), any_real(), any_real(), any_bool(), any_bool(), any_real()};
        cgl_drive_output out;
        if (any_bool()) {
            cgl_drive_reset(&drive);
        } else {
            if (cgl_drive_measure(&drive, &now, &reference)) {
                drive.command.i_q_ref = any_real();
                drive.command.status = any_bits();
            }
            cgl_drive_actuate(&drive, &out);
            for (int x = 0; x < 3; ++x) {
                Frama_C_show_each_output(out.duty[x]);
                PROVE(out.duty[x] >= CGL_R(0.0) && out.duty[x] <= CGL_R(1.0));
            }
        }
    }
    return 0;
}
