"""Trials of any linear plant in discrete time, against a transcription."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from engine import law_of, signals
from reference.trial import Trial

from cogless import _simulator_f32, _simulator_f64
from cogless.c_layout import control_layout

SAMPLES = 150
TIME = np.arange(SAMPLES) / SAMPLES
RISE = 1.0 - np.cos(2.0 * np.pi * TIME)
SHORT = np.minimum(TIME, 0.3)
LOAD = 0.4 * (TIME > 0.5)
NO_FILTER: dict[str, Any] = {"order": 0, "b": [], "a": []}
SMOOTH: dict[str, Any] = {"order": 1, "b": [0.3, 0.3], "a": [1.0, -0.4]}

# one state, relative degree 1; two with a zero at -1.2, outside the unit circle; four, relative degree 2
FIRST = {"A": [[0.9]], "B": [0.2], "C": [1.0], "K_1": [-2.0], "shift": 1, "q_filter": NO_FILTER}
ZERO = {
    "A": [[1.5, -0.56], [1.0, 0.0]],
    "B": [0.1, 0.0],
    "C": [1.0, 1.2],
    "K_1": [-4.0, 2.0],
    "shift": 1,
    "q_filter": SMOOTH,
}
FOURTH = {
    "A": [[0.8, 0.2, 0.0, 0.0], [0.0, 0.7, 0.3, 0.0], [-0.1, 0.0, 0.6, 0.1], [0.0, 0.1, 0.0, 0.5]],
    "B": [0.0, 0.5, 0.1, 0.2],
    "C": [1.0, 0.0, 0.0, 0.0],
    "K_1": [-0.2, -0.3, 0.1, 0.0],
    "shift": 2,
    "q_filter": SMOOTH,
}


def description(plant: dict[str, Any], matrix: Any = None, **law: Any) -> dict[str, Any]:
    """Seven trials with a change of load, of plant and of reference; for trials_of."""
    A, B = np.array(plant["A"]), np.array(plant["B"])
    start, other = [0.1] * len(B), [-0.2] * len(B)
    return {
        "C": plant["C"],
        "period": 0.02,
        "samples": SAMPLES,
        "count": 7,
        "noise": [0.0] * len(B),
        "load_noise": 0.0,
        "seed": 0,
        "phases": [
            {"from": 0, "reference": RISE, "A": A, "B": B, "load": 0 * LOAD, "initial_state": start},
            {"from": 3, "reference": RISE, "A": 0.98 * A, "B": 1.1 * B, "load": LOAD, "initial_state": start},
            {"from": 5, "reference": SHORT, "A": A, "B": B, "load": LOAD, "initial_state": other},
        ],
        "controller": {
            "law": "trial",
            "learning_matrix": matrix,
            "config": {
                "samples": SAMPLES,
                "states": len(B),
                "k_1": plant["K_1"],
                "k_2": 0.1,
                "n": 1.5,
                "c": plant["C"],
                "through_integrator": True,
                "k_3": 0.3,
                "shift": plant["shift"],
                "feedforward": {
                    "numerator": 2,
                    "denominator": 2,
                    "preview": 1,
                    "num": [2.0, -1.0],
                    "den": [1.0, -0.5],
                },
                "q_filter": plant["q_filter"],
                "limit": 50.0,
                "learned_limit": 10.0,
                **law,
            },
        },
    }


def trials_of(settings: dict[str, Any], module: ModuleType = _simulator_f64) -> Any:
    layout = control_layout("double" if module is _simulator_f64 else "single")
    law = law_of(settings["controller"], layout, limit=0.0)
    return module.LinearTrials({**settings, "controller": law})


def expected(
    settings: dict[str, Any], noise: Any = 0.0, load_noise: Any = 0.0
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Signals and the last v. `noise`, `load_noise`: (samples of all trials, states) and (samples,)."""
    c = settings["controller"]["config"]
    same = ("samples", "k_1", "k_2", "n", "c", "k_3", "through_integrator", "shift", "limit", "learned_limit")
    law = Trial(
        **{key: c[key] for key in same},
        **{key: c["feedforward"][key] for key in ("num", "den", "preview")},
        **({key: c["q_filter"][key] for key in ("b", "a")} if c["q_filter"]["b"] else {}),
        learning_matrix=settings["controller"]["learning_matrix"],
    )
    ticks, states = settings["count"] * SAMPLES, len(c["k_1"])
    noise = np.broadcast_to(noise, (ticks, states))
    load_noise = np.broadcast_to(load_noise, ticks)
    names = ["y_ref", "y", "u", "load", *(f"x_{n + 1}" for n in range(len(c["k_1"]))), "status", "learned"]
    rows = []
    for trial in range(settings["count"]):
        phase = [p for p in settings["phases"] if p["from"] <= trial][-1]
        x = np.array(phase["initial_state"])
        law.begin(phase["reference"])
        for p in range(SAMPLES):
            tick = trial * SAMPLES + p
            v, y, load = law.v[p], np.dot(settings["C"], x), phase["load"][p] + load_noise[tick]
            u = law.step(x + noise[tick])
            status = 5 * law.saturated
            rows.append([phase["reference"][p], y, u, load, *x, status, v])
            x = phase["A"] @ x + phase["B"] * (u - load)
        law.end()
    return dict(zip(names, np.array(rows).T, strict=True)), law.v


@pytest.mark.parametrize("plant", [FIRST, ZERO, FOURTH], ids=["order-1", "zero-outside", "order-4"])
@pytest.mark.parametrize("controller", [{}, {"limit": 2.0}, {"matrix": 0.2 * np.eye(SAMPLES, k=1)}])
def test_linear_trials_are_the_equations(plant: dict[str, Any], controller: dict[str, Any]) -> None:
    settings = description(plant, **controller)
    engine = trials_of(settings)
    x = signals(engine, _simulator_f64, 7 * SAMPLES)
    wanted, learned = expected(settings)
    for name, signal in wanted.items():
        assert np.abs(x[name] - signal).max() <= 1e-12 * max(1.0, np.abs(signal).max()), name
    assert np.array_equal(x["trial"], np.repeat(np.arange(1, 8), SAMPLES))
    assert x["time"] == pytest.approx(0.02 * np.arange(7 * SAMPLES), abs=1e-12)
    state = engine.start()
    engine.advance(state, _simulator_f64.Recorder(engine, 1000), 7 * SAMPLES)
    assert engine.stored(state)["values"][0] == pytest.approx(learned, abs=1e-12)
    assert np.any(learned)


def test_in_single_precision_the_law_rounds_and_the_plant_does_not() -> None:
    settings = description(FOURTH)
    single = signals(trials_of(settings, _simulator_f32), _simulator_f32, 7 * SAMPLES)
    wanted, _ = expected(settings)
    assert single["y"] == pytest.approx(wanted["y"], abs=1e-5)
    assert not np.array_equal(single["y"], wanted["y"])


def test_signals() -> None:
    engine = trials_of(description(ZERO))
    terms = ["term_feedback", "term_integral", "term_feedforward", "term_learned", "learned"]
    names = ["time", "trial", "y_ref", "y", "u", "load", "x_1", "x_2", "status", *terms]
    assert engine.signals == [("time", "s"), *((name, "") for name in names[1:])]


def test_pieces_and_copies_are_the_same_run() -> None:
    engine = trials_of(description(ZERO))

    def rows(state: Any, ticks: int) -> np.ndarray:
        recorder = _simulator_f64.Recorder(engine, 1)
        engine.advance(state, recorder, ticks)
        return recorder.take()

    whole = rows(engine.start(), 7 * SAMPLES)
    state = engine.start()
    pieces = [rows(state, n) for n in (1, 149, 77, 0)]
    copy = state.copy()
    rest = 7 * SAMPLES - copy.tick
    assert copy.tick == 227
    last = rows(state, rest)
    assert np.array_equal(whole, np.vstack([*pieces, last]))
    assert np.array_equal(last, rows(copy, rest))
    with pytest.raises(ValueError, match="only 7 trials"):
        rows(copy, 1)


def test_the_noise_is_white_and_the_same_for_each_law() -> None:
    """A law with nothing but a gain shows the noise; the full law then does what its transcription does."""
    noisy = {"noise": [0.02], "load_noise": 0.3, "seed": 7}
    plain = {
        "k_2": 0.0,
        "n": 0.0,
        "k_3": 0.0,
        "feedforward": {"numerator": 0, "denominator": 0, "preview": 0},
    }
    bare = {**description(FIRST, **plain), **noisy}
    x = signals(trials_of(bare), _simulator_f64, 7 * SAMPLES)
    measured = x["u"] / FIRST["K_1"][0] - x["x_1"]
    loads = [np.tile(p["load"], n) for p, n in zip(bare["phases"], (3, 2, 2), strict=True)]
    load = x["load"] - np.concatenate(loads)
    for white, size in ((measured, 0.02), (load, 0.3)):
        assert np.std(white) == pytest.approx(size, rel=5 / np.sqrt(2 * len(white)))
        assert abs(np.mean(white)) < 5 * size / np.sqrt(len(white))
        for lag in (1, 2, SAMPLES):
            assert abs(np.mean(white[lag:] * white[:-lag])) < 5 * size**2 / np.sqrt(len(white) - lag)
    assert abs(np.corrcoef(measured, load)[0, 1]) < 5 / np.sqrt(len(load))

    full = {**description(FIRST), **noisy}
    found = signals(trials_of(full), _simulator_f64, 7 * SAMPLES)
    wanted, _ = expected(full, measured[:, None], load)
    for name, signal in wanted.items():
        assert np.abs(found[name] - signal).max() <= 1e-9 * max(1.0, np.abs(signal).max()), name
    other = signals(trials_of({**full, "seed": 8}), _simulator_f64, 7 * SAMPLES)
    assert not np.array_equal(other["load"], found["load"])


def test_growth_beyond_all_numbers_names_the_trial() -> None:
    settings = description(FIRST)
    settings["phases"][1]["A"] = [[1e3]]
    engine = trials_of(settings)
    with pytest.raises(RuntimeError, match=r"^trial 4: .*beyond all numbers"):
        signals(engine, _simulator_f64, 7 * SAMPLES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"C": []}, r"^C: expected 1 to 8 numbers"),
        ({"C": [1.0, 0.0, 0.0], "noise": [0.0] * 3}, r"controller.config: expected 3 states"),
        ({"count": 3}, r"phases.1.from: expected less than the number of trials"),
        ({"samples": 1}, r"controller.config: expected 1 samples"),
        ({"phases": []}, r"^phases: expected one or more"),
        ({"phases": [{"A": [[1.0]]}]}, r"phases.0.A: expected 2 rows and columns"),
        ({"phases": [{"A": [[1.0, 0.0], [np.inf, 0.0]]}]}, r"phases.0.A: expected finite numbers"),
        ({"phases": [{"B": [1.0]}]}, r"phases.0.B: expected 2 numbers"),
        ({"phases": [{"load": RISE[:-1]}]}, r"phases.0.load: expected 150 numbers"),
        ({"phases": [{"initial_state": [0.0]}]}, r"phases.0.initial_state: expected 2 numbers"),
        ({"period": 0.0}, r"^period: expected more than 0"),
        ({"noise": [0.0]}, r"^noise: expected 2 numbers"),
    ],
)
def test_a_wrong_description_is_refused(change: dict[str, Any], message: str) -> None:
    settings = description(ZERO)
    if change.get("phases"):
        change = {"phases": [{**settings["phases"][0], **change["phases"][0]}]}
    with pytest.raises(ValueError, match=message):
        trials_of({**settings, **change})
