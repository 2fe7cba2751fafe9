"""Section 5 of Verrelli 2016 in the drive, end to end, and what the space-learning laws tell of themselves.

Figures of the reading that works, peak to peak and electrical: before learning (3 to 5 s) 0.805 rad/s and
0.0387 rad, in 8 to 10 s 0.0716 rad/s and 0.0105 rad; with a Q filter 0.054, 0.041, 0.033, 0.024 rad/s in the
two seconds from 20, 30, 58 and 118 s on. Nothing was fitted.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from engine import config, drive_of, merged, run, signals
from step_motor import N_R, SECTION_5

from cogless import _simulator_f32, _simulator_f64

TURN = 2.0 * np.pi
MAP: dict[str, Any] = {"kind": "CGL_MEMORY_ANGLE", "forgetting": 1.0, "cells": 256, "q_half_width": 2}


def law(memory: dict[str, Any] | None = None, **change: Any) -> dict[str, Any]:
    """Changes of the law's configuration, and of its memory's."""
    return {"config": {**change, "memory": memory or {}}}


def section_5(
    seconds: float,
    change: dict[str, Any] | None = None,
    module: ModuleType = _simulator_f64,
    decimation: int = 1,
) -> dict[str, np.ndarray]:
    engine = drive_of(module, merged(SECTION_5, change or {}))
    return signals(engine, module, round(seconds * 10000), decimation)


def peak_to_peak(x: dict[str, np.ndarray], start: float, end: float) -> tuple[float, float]:
    """Of the errors of electrical speed and angle, rad/s and rad."""
    part = (x["time"] >= start) & (x["time"] < end)
    speed, angle = x["omega_m"] - x["omega_ref"], x["theta_m"] - x["theta_ref"]
    return N_R * float(np.ptp(speed[part])), N_R * float(np.ptp(angle[part]))


@pytest.mark.parametrize("module", [_simulator_f64, _simulator_f32])
@pytest.mark.parametrize(
    "drive",
    [
        {},
        {"inverter": {"computation_delay": 1}},
        {"decoupling": True},
        {"inverter": {"kind": "switched", "dead_time": 0.0}},
    ],
)
def test_section_5_as_printed(module: ModuleType, drive: dict[str, Any]) -> None:
    x = section_5(10.0, {"drive": drive}, module)
    assert peak_to_peak(x, 3.0, 5.0) == pytest.approx((0.805, 0.0387), rel=0.03)
    assert peak_to_peak(x, 8.0, 10.0) == pytest.approx((0.0716, 0.0105), rel=0.03)
    assert np.abs(x["i_q"]).max() < 9.0


@pytest.mark.parametrize("method", ["CGL_DELAY_ODE", "CGL_DELAY_INVERSION"])
def test_delay_satisfies_its_equation(method: str) -> None:
    x = section_5(10.0, {"controller": law({"method": method})})
    t, theta = x["time"], N_R * x["theta_ref"]
    late = t > 2.0
    before = np.interp(t[late] - x["P_t"][late], t, theta)
    assert np.abs(before - (theta[late] - TURN)).max() <= 2e-3


def test_the_printed_scheme_does_not_last() -> None:
    x = section_5(30.0)
    assert peak_to_peak(x, 15.0, 17.0)[0] < 0.1
    assert peak_to_peak(x, 28.0, 30.0)[0] > 0.5


@pytest.mark.parametrize("memory", [MAP, {"q_half_width": 20}])
def test_a_q_filter_makes_it_last(memory: dict[str, Any]) -> None:
    alone = {"unguarded": True}  # the paper's law has no guard, whose tests of it are ripple too
    x = section_5(120.0, {"controller": law(memory), "drive": alone}, decimation=10)
    found = [peak_to_peak(x, t, t + 2.0)[0] for t in (20.0, 30.0, 58.0, 118.0)]
    assert found == pytest.approx([0.054, 0.041, 0.033, 0.024], rel=0.05)
    # it depends on where the arm is: over its revolution of 21 s the error stays level
    worst = [
        max(peak_to_peak(x, t, t + 2.0)[0] for t in np.arange(s, s + 21.0, 1.0)) for s in (20, 41, 62, 97)
    ]
    assert min(worst) > 0.045
    assert max(worst) < 0.06


def test_a_map_of_the_reference_by_the_rotor_serves_too() -> None:
    x = section_5(10.0, {"controller": law(MAP, index="CGL_SPACE_BY_ROTOR")})
    assert peak_to_peak(x, 8.0, 10.0) == pytest.approx((0.0716, 0.0105), rel=0.03)


def test_terms_add_up_to_the_current() -> None:
    x = section_5(8.0)
    names = ["proportional", "integral", "alpha", "beta", "h"]
    assert np.abs(sum(x[f"term_{name}"] for name in names) - x["i_q_ref"]).max() <= 1e-12
    # integral action hands over within the ramp of 1 s
    before, after = x["time"] < 5.0, x["time"] > 6.01
    assert np.all(x["term_alpha"][before] == 0.0)
    assert np.all(x["term_integral"][after] == 0.0)
    assert np.abs(x["term_alpha"][after]).max() > 1.0


def test_signals_are_those_of_what_is_learned() -> None:
    one = section_5(0.01, {"controller": law({**MAP, "channels": 1})})
    assert [name for name in one if name.startswith(("term", "P_t"))] == [
        "term_proportional",
        "term_integral",
        "term_alpha",
    ]
    assert "P_t" in section_5(0.01)


def learned(engine: Any, seconds: float) -> dict[str, Any]:
    state = engine.start()
    engine.advance(state, _simulator_f64.Recorder(engine, 100), round(seconds * 10000))
    return dict(engine.stored(state))


def test_the_map_is_the_current_that_the_ripple_needs() -> None:
    # as in Section 4, current-fed: alpha holds against the load, with the whole revolution as period
    change: dict[str, Any] = {
        "load": {"harmonics": [{"order": 3, "torque": 0.2, "phase": 0.4}]},
        "motor": {"cogging": [], "flux_harmonics": []},
        "mechanics": {"viscous_friction": 0.0},
        "drive": {"ideal_current": True},
        "reference": {"kind": "constant", "speed": 1.5},
        "controller": {**law({**MAP, "channels": 1, "turns": N_R, "cells": 600}), "learning_start": 0.0},
    }
    settings = merged(SECTION_5, change)
    settings["reference"], settings["initial_speed"] = change["reference"], 1.5
    memory = learned(drive_of(_simulator_f64, settings), 60.0)
    angle = TURN / 600 * np.arange(600)
    needed = 0.2 * np.sin(3 * angle + 0.4) / (N_R * 5e-3)
    assert np.array(memory["values"]) == pytest.approx(needed[None], abs=0.02)


def test_a_copied_state_learns_alone() -> None:
    engine = drive_of(_simulator_f64, merged(SECTION_5, {"controller": {**law(MAP), "learning_start": 0.0}}))
    state = engine.start()
    engine.advance(state, _simulator_f64.Recorder(engine, 10), 20000)
    copy = state.copy()
    before = engine.stored(copy)  # an array of its own
    rows = []
    for s in (state, copy):
        recorder = _simulator_f64.Recorder(engine, 10)
        engine.advance(s, recorder, 10000)
        rows.append(recorder.take())
        if s is state:
            assert np.array_equal(engine.stored(copy)["values"], before["values"])
    assert np.array_equal(*rows)


def test_speed_law_learns_on_the_rotors_angle() -> None:
    speed: dict[str, Any] = {
        "law": "space-speed",
        "config": {
            "k": 60.0,
            "mu_alpha": 20.0,
            "eta_bar": 0.2,
            "omega_min": 0.05,
            "ratio": N_R,
            "memory": {**MAP, "channels": 1, "cells": 1200, "turns": N_R, "parts": 1, "limit": [15.0]},
        },
    }
    settings = merged(SECTION_5, {"controller": speed, "drive": {"ideal_current": True, "unguarded": True}})
    settings["reference"] = {"kind": "sine", "offset": 1.0, "amplitude": 0.2, "frequency": 0.3}
    settings["initial_speed"] = 1.0
    engine = drive_of(_simulator_f64, settings)
    x = signals(engine, _simulator_f64, 600000, 10)
    error = x["omega_m"] - x["omega_ref"]
    first, last = (np.sqrt(np.mean(error[(x["time"] > a) & (x["time"] < a + 7)] ** 2)) for a in (0.0, 52.0))
    assert last < 0.2 * first
    parts = x["term_proportional"] + x["term_alpha"]
    assert np.abs(parts - x["i_q_ref"]).max() <= 1e-12
    assert "term_integral" not in x


def test_what_is_outside_its_range_is_refused() -> None:
    refused = {
        "memory.channels": law({"channels": 4}),
        "space_position.k_theta": law(k_theta=-1.0),
        "memory.turns": law({"turns": 65536}),
        "space_position.ratio": law(ratio=65536),
        "space_position.limit": law(limit=1e6),
    }
    for field, change in refused.items():
        with pytest.raises(ValueError, match=f"space-position: {field} is outside its range"):
            drive_of(_simulator_f64, merged(SECTION_5, {"controller": change}))


# a library made before the inputs ended with theta_ref and alpha_ref, and one that reads them
FIRST_VERSION = """
#include <stddef.h>
#include <stdint.h>
typedef struct { double time, omega_ref, omega_m, theta_m, i_d, i_q, i_limit, ts; int learn; } input;
typedef struct { double i_d_ref, i_q_ref; } output;
uint32_t cogless_plugin_version(void) { return 1U; }
size_t cogless_plugin_state_size(void) { return 1; }
int cogless_plugin_init(void *s, const double *p, size_t n, double ts)
{
    (void)s; (void)p; (void)n; (void)ts;
    return 0;
}
void cogless_plugin_step(void *s, const input *in, output *out)
{
    (void)s;
    out->i_d_ref = 0.0;
    out->i_q_ref = in->omega_ref + in->learn;
}
"""
SECOND_VERSION = """
#include "cogless/plugin.h"
uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return 1; }
int cogless_plugin_init(void *s, const double *p, size_t n, double ts)
{
    (void)s; (void)p; (void)n; (void)ts;
    return 0;
}
void cogless_plugin_step(void *s, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    (void)s;
    out->i_d_ref = in->alpha_ref;
    out->i_q_ref = in->theta_ref;
}
"""


def compiled(source: str, folder: Path) -> str:
    include = Path(_simulator_f64.__file__).parent / "include"
    (folder / "law.c").write_text(source)
    flags = ["-std=c99", "-shared", "-fPIC", "-Wall", "-Werror", f"-I{include}"]
    subprocess.run(["cc", *flags, "law.c", "-o", "law.so"], cwd=folder, check=True)
    return str(folder / "law.so")


def test_libraries_of_both_versions_are_loaded(tmp_path: Path) -> None:
    change: dict[str, Any] = {
        "reference": {"kind": "sine", "offset": 3.0, "amplitude": 2.0, "frequency": 5.0},
        # a bus that is never too low, a reference that is not cut, and no guard, since then "learn" is false
        "drive": {
            "speed_divider": 1,
            "inverter": {"bus_voltage": 1e5},
            "current_limit": 1e3,
            "unguarded": True,
        },
    }
    found = []
    for n, source in enumerate((FIRST_VERSION, SECOND_VERSION)):
        (folder := tmp_path / str(n)).mkdir()
        shared = {"law": "library", "library": compiled(source, folder), "params": []}
        found.append(run({**change, "controller": shared}, 0.5))
    first, second = found
    t, w = first["time"], TURN * 5.0
    assert first["i_q_ref"] == pytest.approx(first["omega_ref"] + 1.0)
    assert second["i_q_ref"] == pytest.approx(3.0 * t + 2.0 / w * (1.0 - np.cos(w * t)), abs=1e-12)
    assert second["i_d_ref"] == pytest.approx(2.0 * w * np.cos(w * t), abs=1e-12)
    later = compiled(SECOND_VERSION.replace("return COGLESS_PLUGIN_VERSION", "return 5U"), tmp_path)
    with pytest.raises(ValueError, match="plugin version is 5, expected 1 to 4"):
        drive_of(_simulator_f64, config({"controller": {"law": "library", "library": later, "params": []}}))


def test_integral_action_stays_until_there_is_something_to_hand_over_to() -> None:
    """A load at standstill is held, although learning is permitted: below omega_min nothing is learned."""
    change: dict[str, Any] = {
        "load": {"torque": 1.7, "harmonics": []},
        "controller": {**law(MAP), "learning_start": 0.0},
        "drive": {"unguarded": True},  # the guard would wait for two windows of 2.5 s that agree
        "initial_speed": 0.0,
    }
    settings = merged(SECTION_5, change)
    settings["reference"] = {"kind": "profile", "times": [6.0, 7.0], "speeds": [0.0, 0.3]}
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 90000, 10)
    error = N_R * (x["theta_ref"] - x["theta_m"])
    still = (x["time"] > 5.0) & (x["time"] < 6.0)
    assert np.abs(error[still]).max() < 1e-6
    # then it hands over
    assert np.all(x["term_integral"][x["time"] > 7.5] == 0.0)
