/* Current references from any output of a law: finite and within the current limit. */
#include "cogless/current_reference.h"

#include "proof.h"

int main(void)
{
    const cgl_current_reference_config config = {any_bool(), any_bool(), any_real(), any_real(), any_real(), any_real(), any_real()};
    static cgl_drive drive;
    cgl_current_reference currents;
    const cgl_real any = ANY_LIMIT;
    drive.ready = CGL_READY;
    /* the drive's own init has checked its limit */
    drive.foc.config.current_limit = any == any && any > CGL_R(0.0) && any <= CGL_REAL_MAX ? any : CGL_R(1.0);
    drive.foc.config.phases = any_bits();
    if (cgl_current_reference_init(&currents, &config, &drive) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        drive.command.i_q_ref = any_real();
        drive.command.status = any_bits();
        drive.currents.u_dc = any_real();
        drive.currents.omega_e = any_real();
        cgl_current_reference_step(&currents, &drive);
        PROVE_OUTPUT(drive.command.i_q_ref);
        PROVE_OUTPUT(drive.currents.i_d_ref);
    }
    return 0;
}
