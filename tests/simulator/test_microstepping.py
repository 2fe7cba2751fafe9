"""A printer's axis in microsteps, against closed forms of a two-phase step motor and an independent plant."""

from __future__ import annotations

import cmath
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "printer"))
from printer_plant import closed_form, ripple_rms, study_axes

from cogless.results.trace import Trace
from cogless.run.simulate import simulate
from cogless.study import load

TEETH, INERTIA, RADIUS = 50, 8.2e-6, 0.04 / math.tau
CURRENT = 0.8 * math.sqrt(2)  # A, amplitude
K_T = 0.59 / (math.sqrt(2) * 2.0)  # N m/A
HOLDING = K_T * CURRENT  # N m, at this current
FAST: dict[str, Any] = {
    "drive.rates": {"current_loop": "80 kHz", "speed_loop": "80 kHz"},
    "drive.current_loop.bandwidth": "8 kHz",
}
EXACT = {"drive.current_sensors.offset": ["0 A", "0 A", "0 A"], "drive.current_sensors.gain_error": [0, 0, 0]}
RIGID: dict[str, Any] = {  # the rotor alone, without friction and detent
    "mechanics": {"inertia": f"{INERTIA} kg*m^2", "viscous_friction": "1e-4 N*m*s/rad"},
    "motor.detent_torque": "0 N*m",
    "metric": [],
}


def trace(changes: dict[str, Any], controller: str = "plain", scenario: str = "20-mm-s") -> Trace:
    return simulate(load("printer", changes), scenario, controller).trace


def test_a_load_turns_the_rotor_off_the_command_by_the_arc_sine_of_its_torque() -> None:
    for share in (0.1, 0.5, 0.9):
        rest = trace(
            {
                **EXACT,
                **RIGID,
                "mechanics.viscous_friction": "2e-2 N*m*s/rad",
                "scenario.20-mm-s": {
                    "duration": "0.3 s",
                    "reference": "0 rpm",
                    "load": f"{share * HOLDING} N*m",
                },
            }
        )
        assert rest["theta_m"][-1] == pytest.approx(-math.asin(share) / TEETH, rel=1e-4)


def test_a_rotor_swings_on_its_magnetic_spring() -> None:
    """f = sqrt(N T_h / J) / 2 pi, 191 Hz, in small swings."""
    step = {
        "duration": "0.2 s",
        "reference": "0 rpm",
        "events": [{"time": "0.01 s", "load": f"{0.02 * HOLDING} N*m"}],
    }
    swing = trace({**EXACT, **RIGID, **FAST, "scenario.20-mm-s": step, "trace.rate": "20 kHz"})
    angle = swing["theta_m"] + math.asin(0.02) / TEETH
    time = swing["time"]
    up = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0) & (time[1:] > 0.012))
    crossing = time[up] - angle[up] * (time[up + 1] - time[up]) / (angle[up + 1] - angle[up])
    frequency = (len(crossing) - 1) / (crossing[-1] - crossing[0])
    assert frequency == pytest.approx(math.sqrt(TEETH * HOLDING / INERTIA) / math.tau, rel=0.01)


def test_slow_orders_are_those_of_the_closed_form() -> None:
    """Of the rotor's electrical angle less the command's, within 0.003 rad, in both directions."""
    for direction in (1, -1):
        # slower than any resonance by far, and so overdamped
        slow = trace(
            {
                "scenario.20-mm-s": {"duration": "1.3 s", "reference": f"{direction} rpm"},
                "mechanics.viscous_friction": "0.02 N*m*s/rad",
                "trace.rate": "4 kHz",
                "metric": [],
            }
        )
        rows = slice(-4801, None)  # one electrical revolution at 1 rpm takes 1.2 s
        u = TEETH * slow["theta_ref"][rows]
        off = TEETH * slow["theta_m"][rows] - u
        whole = u[:-1]
        assert abs(u[-1] - u[0]) == pytest.approx(math.tau, rel=1e-6)
        plant = study_axes(1)
        plant.viscous[:] = 0.02
        expected = closed_form(plant, direction, RADIUS * math.tau / 60)
        for order, psi in expected.items():
            found = 2j * np.mean(off[:-1] * np.exp(-1j * order * whole))
            assert abs(found - complex(psi[0])) < 3e-3, (direction, order)


@pytest.mark.parametrize(("scenario", "speed"), [("20-mm-s", 0.02), ("100-mm-s", 0.1)])
def test_a_carriage_s_ripple_is_that_of_an_independent_plant(scenario: str, speed: float) -> None:
    """With a current loop so fast that it is ideal, as that plant has it; 50 mm/s is a resonance, whose
    height is a matter of how friction is smoothed."""
    study = load("printer", {**FAST, f"scenario.{scenario}.duration": "1.5 s", "metric.0.last": "0.6 s"})
    ripple = simulate(study, scenario, "plain").metrics["carriage_ripple_m"]
    expected = ripple_rms(study_axes(1), np.array([speed]), {}, settle=0.9, length=0.6)
    assert ripple == pytest.approx(float(expected[0]), rel=0.02)


@pytest.mark.parametrize(
    ("scenario", "times"), [("20-mm-s", 10), ("50-mm-s", 50), ("100-mm-s", 10), ("50-mm-s-back", 50)]
)
def test_the_study_s_correction_takes_the_ripple_out(scenario: str, times: float) -> None:
    study = load("printer")
    plain, table = (
        simulate(study, scenario, name).metrics["carriage_ripple_m"] for name in ("plain", "table")
    )
    assert isinstance(plain, float) and isinstance(table, float) and plain > times * table


def test_the_study_s_table_is_that_of_the_closed_form() -> None:
    law: Any = load("printer").controller["table"]
    for direction, sign in (("forward", 1), ("backward", -1)):
        expected = closed_form(study_axes(1), sign, 0.05)
        for wave in getattr(law.correction, direction):
            c = cmath.rect(wave.magnitude, wave.phase)
            assert abs(c + complex(expected[wave.order][0])) < 1e-4
