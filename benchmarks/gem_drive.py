"""The plain drive in gym-electric-motor; prints one JSON line with its CPU time per tick.

GEM has only the plant. The controller is this file's, in plain Python floats, the fastest way in Python.
"""

import json
import math
import time
import warnings

import gym_electric_motor as gem
import plain_drive as d
from gym_electric_motor import reference_generators
from gym_electric_motor.physical_systems.mechanical_loads import PolynomialStaticLoad
from gym_electric_motor.physical_systems.solvers import EulerSolver, OdeSolver, ScipyOdeSolver

SQRT3 = math.sqrt(3)


class Controller:
    """Speed PI, dq current PI with decoupling and anti-windup, SVPWM with voltage limit; one sample late."""

    def __init__(self) -> None:
        self.speed_integral = self.u_d_integral = self.u_q_integral = 0.0
        self.action = (0.0, 0.0, 0.0)

    def step(self, omega_m: float, theta_e: float, i_d: float, i_q: float) -> tuple[float, float, float]:
        """Compute the next action, and return the one of the tick before."""
        period = 1 / d.TICK_RATE
        error = d.SPEED_REFERENCE - omega_m
        i_q_ref = d.SPEED_KP * error + self.speed_integral
        limited = max(-d.CURRENT_LIMIT, min(d.CURRENT_LIMIT, i_q_ref))
        if limited == i_q_ref:
            self.speed_integral += d.SPEED_KI * error * period

        omega_e = d.POLE_PAIRS * omega_m
        error_d, error_q = -i_d, limited - i_q
        kp = d.CURRENT_BANDWIDTH * d.L_D
        u_d = kp * error_d + self.u_d_integral - omega_e * d.L_Q * i_q
        u_q = kp * error_q + self.u_q_integral + omega_e * (d.L_D * i_d + d.PSI_F)
        u_max = d.BUS_VOLTAGE / SQRT3
        size = math.hypot(u_d, u_q)
        if size > u_max:
            u_d *= u_max / size
            u_q *= u_max / size
        else:
            ki = d.CURRENT_BANDWIDTH * d.R_S
            self.u_d_integral += ki * error_d * period
            self.u_q_integral += ki * error_q * period

        angle = theta_e + 1.5 * omega_e * period
        cos, sin = math.cos(angle), math.sin(angle)
        alpha, beta = cos * u_d - sin * u_q, sin * u_d + cos * u_q
        u_a, u_b, u_c = alpha, -0.5 * alpha + 0.5 * SQRT3 * beta, -0.5 * alpha - 0.5 * SQRT3 * beta
        common = 0.5 * (max(u_a, u_b, u_c) + min(u_a, u_b, u_c))
        scale = 2 / d.BUS_VOLTAGE
        action = self.action
        self.action = ((u_a - common) * scale, (u_b - common) * scale, (u_c - common) * scale)
        return action


def build(solver: OdeSolver) -> gem.PhysicalSystem:
    """The plant without the environment around it (no reward, constraints or plots): GEM's fastest use."""
    motor = {
        "p": d.POLE_PAIRS,
        "r_s": d.R_S,
        "l_d": d.L_D,
        "l_q": d.L_Q,
        "psi_p": d.PSI_F,
        "j_rotor": d.INERTIA / 2,
    }
    load = {"a": d.LOAD_TORQUE, "b": 0.0, "c": 0.0, "j_load": d.INERTIA / 2}
    environment = gem.make(
        "Cont-SC-PMSM-v0",
        tau=1 / d.TICK_RATE,
        supply={"u_nominal": d.BUS_VOLTAGE},
        motor={"motor_parameter": motor},
        load=PolynomialStaticLoad(load_parameter=load),
        ode_solver=solver,
        reference_generator=reference_generators.ConstReferenceGenerator("omega", 0.5),
        visualization=(),
        constraints=(),
    )
    return environment.unwrapped.physical_system


def ns_per_tick(solver: OdeSolver) -> float:
    plant = build(solver)
    controller = Controller()
    names = ("omega", "epsilon", "i_sd", "i_sq")
    omega, epsilon, i_d, i_q = (plant.state_names.index(name) for name in names)
    limits = [float(x) for x in plant.limits]
    state = plant.reset().tolist()
    trace = []
    start = time.process_time()
    for _ in range(d.TICKS):
        action = controller.step(
            state[omega] * limits[omega],
            state[epsilon] * limits[epsilon],
            state[i_d] * limits[i_d],
            state[i_q] * limits[i_q],
        )
        state = plant.simulate(action).tolist()
        trace.append(state)
    elapsed = time.process_time() - start
    d.check("gym-electric-motor", state[omega] * limits[omega], state[i_q] * limits[i_q])
    return elapsed / d.TICKS * 1e9


def main() -> None:
    warnings.simplefilter("ignore")  # gymnasium's remarks on GEM's spaces
    fastest = ns_per_tick(EulerSolver())
    default = ns_per_tick(ScipyOdeSolver())  # Dormand-Prince, of RK4's accuracy
    print(json.dumps({"ns_per_tick": fastest, "default_ns_per_tick": default}))


if __name__ == "__main__":
    main()
