"""The plain drive in motulator (Python); prints one JSON line with its CPU time per tick."""

import json
import time

import motulator.drive.control.sm as control
import plain_drive as d
from motulator.common.model import SolverCfg
from motulator.drive import model


def build() -> tuple[model.Drive, control.VectorControlSystem]:
    """Model and control, also used for motulator-export. Averaged inverter (pwm=False), sensored control."""
    par = model.SynchronousMachinePars(n_p=d.POLE_PAIRS, R_s=d.R_S, L_d=d.L_D, L_q=d.L_Q, psi_f=d.PSI_F)
    mechanics = model.MechanicalSystem(J=d.INERTIA)
    mechanics.set_external_load_torque(d.LOAD_TORQUE)
    drive = model.Drive(
        model.SynchronousMachine(par), mechanics, model.VoltageSourceConverter(u_dc=d.BUS_VOLTAGE)
    )
    cfg = control.CurrentVectorControllerCfg(
        i_s_max=d.CURRENT_LIMIT,
        alpha_c=d.CURRENT_BANDWIDTH,
        sensorless=False,
        J=d.INERTIA,
        T_s=1 / d.TICK_RATE,
    )
    speed_controller = control.PIController(
        d.SPEED_KP * d.K_T, d.SPEED_KI * d.K_T, u_max=d.CURRENT_LIMIT * d.K_T
    )
    system = control.VectorControlSystem(control.CurrentVectorController(par, cfg), speed_controller)
    system.set_speed_ref(d.SPEED_REFERENCE)
    return drive, system


def main() -> None:
    # RK23 is its fastest solver for this drive, and agrees with its default RK45 to 1e-7
    simulation = model.Simulation(*build(), show_progress=False, cfg=SolverCfg(method="RK23"))
    start = time.process_time()
    result = simulation.simulate(t_stop=d.DURATION)
    elapsed = time.process_time() - start
    d.check("motulator", result.mdl.mechanics.w_M[-1], result.ctrl.fbk.i_s[-1].imag)
    print(json.dumps({"ns_per_tick": elapsed / d.TICKS * 1e9}))


if __name__ == "__main__":
    main()
