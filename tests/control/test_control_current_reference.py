"""Most torque per current, and field weakening: against a numerical optimum, and any input."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference.current_reference import CurrentReference
from scipy.optimize import minimize

TS = 1e-4
PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
MONITOR = {"omega_max": 0.0, "speed_window": 2e-3, "bridge": 5e-3, "hold": 1e-2, "phases": 3}
QUALITY = {"span": 2 * math.pi, "longest": 60.0}


def motor_of(rng: np.random.Generator, kind: str) -> dict[str, float]:
    """A random motor whose characteristic numbers are spread over what is built."""
    limit, psi_f = 10 ** rng.uniform(0, 3), 10 ** rng.uniform(-3, 0)
    x_d = psi_f / limit * 10 ** rng.uniform(-1, 0.3)  # L_d i_max is .1 to 2 times the magnets' flux
    ratio = {"salient": rng.uniform(1.2, 6), "inverse": rng.uniform(0.3, 0.9), "surface": 1.0}.get(kind)
    if kind == "weak magnets":
        x_d, ratio = 3 * psi_f / limit, rng.uniform(3, 8)
    return {
        "L_d": x_d, "L_q": x_d * ratio, "psi_f": psi_f, "current_limit": limit,
        "R_s": psi_f / limit * 10 ** rng.uniform(-1, 2.5),
    }  # fmt: skip


class Block:
    """The drive with its current reference, stepped by hand."""

    def __init__(self, precision, mtpa=True, weaken=True, phases=3, share=0.0, **motor):
        self.library = control_library(precision)
        self.lib = self.library.lib
        foc = {"kp_d": 1.0, "kp_q": 1.0, "current_limit": motor["current_limit"], "phases": phases}
        config = self.library.new(
            "cgl_drive_config", pole_pairs=4, divider=10, foc=foc, monitor=MONITOR | {"phases": phases},
            quality=QUALITY, unguarded=True,
        )  # fmt: skip
        self.drive = self.library.new("cgl_drive")
        assert self.lib.cgl_drive_init(self.drive, config, TS) == self.lib.CGL_OK
        numbers = {key: motor[key] for key in ("L_d", "L_q", "psi_f", "R_s")}
        given = self.library.new(
            "cgl_current_reference_config", mtpa=mtpa, field_weakening=weaken, voltage_share=share, **numbers
        )
        self.block = self.library.new("cgl_current_reference")
        self.error = self.lib.cgl_current_reference_init(self.block, given, self.drive)

    def step(self, i_q_ref, omega_e, u_dc):
        self.drive.command.i_q_ref, self.drive.command.status = i_q_ref, 0
        self.drive.saturated = False
        self.drive.currents.omega_e, self.drive.currents.u_dc = omega_e, u_dc
        self.lib.cgl_current_reference_step(self.block, self.drive)
        assert bool(self.drive.command.status) == self.drive.saturated
        return complex(self.drive.currents.i_d_ref, self.drive.command.i_q_ref), self.drive.saturated


def speed_of(rng, motor, u_max):
    """A speed, electrical, from a fifth of to six times the one at which the magnets take all voltage."""
    return rng.choice([-1, 1]) * u_max / motor["psi_f"] * 10 ** rng.uniform(-0.7, 0.8)


def scaled(motor, u_max):
    """The motor with a bus that fits: resistive drop at most a fifth of the voltage."""
    return motor | {"R_s": min(motor["R_s"], 0.2 * u_max / motor["current_limit"])}


def largest_torque(model, side, omega, u_max):
    """The optimum by SLSQP from several starts: largest equivalent current within both limits, or None."""
    limit, best = model.current_limit, None

    def volts(x):
        return 1 - (model.voltage(limit * complex(x[0], side * x[1]), omega) / u_max) ** 2

    within = [{"type": "ineq", "fun": volts}, {"type": "ineq", "fun": lambda x: 1 - x[0] ** 2 - x[1] ** 2}]
    for d in (-0.95, -0.7, -0.4, -0.1, 0.3):
        found = minimize(
            lambda x: -model.torque(limit * complex(x[0], x[1])) / limit, [d, 0.3], method="SLSQP",
            bounds=[(-1, 1), (0, 1)], constraints=within, options={"ftol": 1e-12, "maxiter": 300},
        )  # fmt: skip
        if volts(found.x) > -1e-6 and (best is None or -found.fun > best):
            best = -found.fun
    return None if best is None else best * limit


def shortest(model, torque, side, omega, u_max):
    """The shortest current of a torque within the voltage, over a fine grid of i_d."""
    limit = model.current_limit
    c = (model.L_q - model.L_d) / model.psi_f
    d = np.linspace(-limit, limit, 400_001)
    with np.errstate(divide="ignore"):
        q = torque / (1 - c * d)
    i = d + 1j * side * q
    volts = np.abs(model.R_s * i + 1j * omega * (model.L_d * i.real + model.psi_f + 1j * model.L_q * i.imag))
    fits = (1 - c * d > 0) & (np.abs(i) <= limit) & (volts <= u_max)
    return np.abs(i[fits]).min() if fits.any() else None


@pytest.mark.parametrize("kind", ["salient", "inverse", "weak magnets", "surface"])
@PRECISIONS
def test_torque_and_current_are_those_of_a_numerical_optimum(precision, kind):
    rng = np.random.default_rng(44)
    reached = least = 0
    for _ in range(40):
        phases = int(rng.choice([2, 3]))
        u_dc = 10 ** rng.uniform(1, 3)
        u_max = 0.95 * u_dc * (1 if phases == 2 else 1 / math.sqrt(3))
        motor = scaled(motor_of(rng, kind), u_max)
        model = CurrentReference(True, True, **motor, phases=phases)
        block = Block(precision, phases=phases, **motor)
        omega, side = speed_of(rng, motor, u_max), rng.choice([-1, 1])
        most = largest_torque(model, side, omega, u_max)
        i, saturated = block.step(side * 2 * model.reach, omega, u_dc)
        assert saturated
        if most is None:
            continue
        assert side * model.torque(i) == pytest.approx(most, rel=1e-3)
        assert model.voltage(i, omega) < u_max * (1 + 1e-4) and abs(i) < motor["current_limit"] * (1 + 1e-5)
        reached += 1
        torque = most * rng.uniform(0.05, 0.98)
        i, saturated = block.step(side * torque, omega, u_dc)
        assert not saturated
        assert side * model.torque(i) == pytest.approx(torque, rel=1e-4)
        best = shortest(model, torque, side, omega, u_max)
        assert abs(i) <= best + 1e-3 * motor["current_limit"]
        assert model.voltage(i, omega) < u_max * (1 + 1e-4)
        least += 1
    assert reached > 25 and least > 25


@pytest.mark.parametrize("kind", ["salient", "inverse", "weak magnets", "surface"])
@PRECISIONS
def test_c_agrees_with_the_transcription(precision, kind):
    rng = np.random.default_rng(7)
    library = control_library(precision)
    for _ in range(150):
        u_dc = 10 ** rng.uniform(1, 3)
        motor = scaled(motor_of(rng, kind), 0.95 * u_dc / math.sqrt(3))
        rules = {"mtpa": bool(rng.integers(2)), "field_weakening": bool(rng.integers(2))}
        model = CurrentReference(**rules, **motor)
        block = Block(precision, mtpa=rules["mtpa"], weaken=rules["field_weakening"], **motor)
        asked = rng.uniform(-1.2, 1.2) * model.reach
        omega = speed_of(rng, motor, 0.95 * u_dc / math.sqrt(3))
        want, short = model.step(asked, omega, u_dc)
        have, saturated = block.step(asked, omega, u_dc)
        tolerance = 2e-3 if precision == "float" else 1e-4
        assert abs(model.torque(have) - model.torque(want)) < 1e-3 * model.reach
        assert abs(have) == pytest.approx(abs(want), abs=tolerance * motor["current_limit"])
        if abs(abs(model.torque(want)) - abs(asked)) > 1e-3 * model.reach:
            assert saturated == short
        assert block.block.reach * motor["current_limit"] == pytest.approx(model.reach, rel=100 * library.eps)
        assert block.drive.loop.current_limit == pytest.approx(model.reach, rel=100 * library.eps)


@PRECISIONS
def test_a_surface_motor_below_its_base_speed_gets_what_the_law_asks_for(precision):
    motor = {"L_d": 1e-3, "L_q": 1e-3, "psi_f": 0.1, "R_s": 0.1, "current_limit": 8.0}
    block = Block(precision, **motor)
    for asked in (-8.0, -3.0, 0.0, 0.25, 8.0):
        assert block.step(asked, 50.0, 48.0) == (complex(0, asked), False)
    assert block.step(9.0, 50.0, 48.0) == (8j, True)


@PRECISIONS
def test_the_law_is_told_the_equivalent_of_the_measured_current(precision):
    motor = {"L_d": 1e-3, "L_q": 3e-3, "psi_f": 0.1, "R_s": 0.1, "current_limit": 8.0}
    block = Block(precision, **motor)
    library, lib = block.library, block.lib
    now = library.new("cgl_measurement", i_abc=[-2.0, 3.0, -1.0], theta_m=0.3, omega_m=20.0, u_dc=48.0)
    reference = library.new("cgl_reference", omega_ref=20.0, learn=True)
    out = library.new("cgl_drive_output")
    assert lib.cgl_drive_measure(block.drive, now, reference)
    lib.cgl_current_reference_actuate(block.block, block.drive, out)
    model = CurrentReference(True, True, **motor)
    assert block.drive.i_q == pytest.approx(model.torque(complex(out.i_d, out.i_q)), rel=20 * library.eps)
    assert abs(block.drive.i_q - out.i_q) > 0.05


@PRECISIONS
def test_no_input_makes_a_reference_that_is_not_finite_or_beyond_the_limit(precision):
    rng = np.random.default_rng(3)
    odd = [math.nan, math.inf, -math.inf, 0.0, 1e-38, -1e30, 1e38, 3.0, 1e4]
    for _ in range(60):
        motor = {key: abs(float(rng.choice(odd[3:]))) for key in ("L_d", "L_q", "psi_f", "R_s")}
        motor["current_limit"] = 10 ** rng.uniform(-3, 5)
        block = Block(precision, mtpa=bool(rng.integers(2)), **motor)
        if block.error != block.lib.CGL_OK:
            motor |= {"L_d": 1e-3, "L_q": 2e-3, "psi_f": 10 ** rng.uniform(-2, 3), "current_limit": 3.0}
            block = Block(precision, **motor)
        assert block.error == block.lib.CGL_OK
        for _ in range(60):
            i, _ = block.step(*(float(rng.choice(odd)) for _ in range(3)))
            assert abs(i) <= motor["current_limit"] * (1 + 1e-4)


@pytest.mark.parametrize(
    "change", [{"psi_f": 0.0}, {"psi_f": math.nan}, {"L_d": -1.0}, {"L_q": math.inf}, {"psi_f": 1e-9}]
)
def test_init_refuses(change):
    motor = {"L_d": 1e-3, "L_q": 3e-3, "psi_f": 0.1, "R_s": 0.1, "current_limit": 8.0} | change
    assert Block("float", **motor).error == control_library("float").lib.CGL_ERROR_CONFIG
