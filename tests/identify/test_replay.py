"""What the logs are simulated with: a dead time as they tell it, where a drive can have it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.commissioned import MOTORS
from identify.fits import MODEL, fit_of, of_motor, turning

from cogless.errors import StudyError
from cogless.identify import replay
from cogless.identify.advice import Advice
from cogless.identify.config import LogRule
from cogless.identify.lateness import Lateness
from cogless.identify.log import Log
from cogless.identify.replay import (
    _bandwidth,
    _likely,
    _more,
    _rate,
    _said_of_dead_time,
    _with_dead_time,
    simulated_log,
)
from cogless.identify.result import Estimate, Value, Wave
from cogless.results.trace import Trace
from cogless.study import Study
from cogless.study.drive import Drive
from cogless.study.motor import Motor

OWN = 1e-7  # s, that the file of columns says


def drive_tables() -> dict[str, Any]:
    inverter = {"bus_voltage": "24 V", "dead_time": f"{OWN} s"}
    return {**MOTORS["gimbal"]["drive"], "inverter": inverter}


@pytest.fixture
def drive() -> Drive:
    return Drive.model_validate(drive_tables())


@pytest.mark.parametrize("told", [2e-7, -0.5e-7])
def test_a_dead_time_that_stands_out_is_simulated(drive, told):
    assert _likely(Value(told, 1e-8), drive) == told


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (2e-7, 1.1e-7),  # within its error
        (-1.5e-7, 1e-8),  # less than none
        (1e-5, 1e-8),  # a tenth of the current loop's period
    ],
)
def test_a_dead_time_that_no_drive_has_is_not(drive, told, error):
    assert _likely(Value(told, error), drive) == 0


def test_a_dead_time_is_told_where_it_stands_out():
    """As the voltage that it loses, of 24 V at 10 kHz, which a drop of transistors loses as well."""
    drive = Drive.model_validate(drive_tables())
    said = _said_of_dead_time(Value(2e-7, 0.9e-7), drive)
    assert said.startswith(
        "The currents follow their references as if the bridge had 200 +- 90 ns more dead time than is "
        f"described. This takes {2e-7 * 10e3 * drive.inverter.bus_voltage:.2g} V from the voltage that drives"
    )
    for value in (Value(2e-7, 1.1e-7), Value(0.0, 0.0)):
        assert _said_of_dead_time(value, drive) == ""


def known(**more: Any) -> Any:
    """As much of an estimate as a replay asks for."""
    motor, rates = SimpleNamespace(pole_pairs=4), SimpleNamespace(current_loop=10e3)
    given = {"motor": motor, "step": 2e-3, "angle_offset": None, "drive": SimpleNamespace(rates=rates)}
    return SimpleNamespace(identification=SimpleNamespace(**{**given, **more}))


@pytest.mark.parametrize(
    ("dt", "rate"),
    [
        (1e-3, 10e3),  # ten rows of the trace for each of the log
        (1.2e-3, 5e3),  # six, since ten do not divide the twelve periods of the current loop
        (1.3e-3, 10e3 / 13),
        (1e-4, 10e3),
        (1.009e-3, 10e3),  # a clock that is off by less than a hundredth
        (1.011e-3, None),
        (0.991e-3, 10e3),
        (0.989e-3, None),
        (0.4e-4, None),  # faster than the current loop
    ],
)
def test_rows_of_a_trace_are_those_of_the_log_and_some_between(dt, rate):
    found = _rate(known(), SimpleNamespace(dt=dt))
    assert found is None if rate is None else found == pytest.approx(rate)


def test_a_drive_s_current_loop_has_its_bandwidth():
    study = MOTORS["gimbal"]
    made = SimpleNamespace(identification=SimpleNamespace(
        motor=Motor.model_validate(study["motor"]), drive=Drive.model_validate(study["drive"])
    ))  # fmt: skip
    assert _bandwidth(made) == pytest.approx(2 * np.pi * 500)


def test_more_dead_time_is_not_known_to_the_compensation(drive):
    """Which keeps what it believed, whether that was given or the inverter's."""
    table = {"inverter": {"bus_voltage": "24 V", "dead_time": "1e-7 s"}, "seed": 1}
    made = _with_dead_time(table, drive, 2e-7)
    assert made == {"inverter": {"bus_voltage": "24 V", "dead_time": "3e-07 s"}, "seed": 1}
    for given, believed in (({}, {"time": "1e-07 s"}), ({"time": "5e-8 s"}, {"time": "5e-8 s"})):
        compensation = {"band": "10 mA", **given}
        compensated = Drive.model_validate({**drive_tables(), "dead_time_compensation": compensation})
        found = _with_dead_time({**table, "dead_time_compensation": compensation}, compensated, 2e-7)
        assert found["dead_time_compensation"] == {"band": "10 mA", **believed}
    assert _more(drive) == pytest.approx(0.002 / drive.rates.current_loop)


def trace_with(error: float) -> Trace:
    """40 rows of 0.1 ms; the angle is measured so much further, rad."""
    t = 1e-4 * np.arange(40)
    columns = {
        "time": ("s", t),
        "theta_m": ("rad", 30 * t),
        "theta_measured": ("rad", (30 * t + error) % (2 * np.pi)),
        "i_d": ("A", 0.5 + 0 * t),
        "i_q": ("A", 100 * t),
        "omega_measured": ("rad/s", 7 + t),
        "tau_e": ("N*m", t),
    }
    units, data = zip(*columns.values(), strict=True)
    return Trace(tuple(columns), units, np.column_stack(data))


@pytest.mark.parametrize(("offset", "added"), [(None, 1e-3), (0.3, 0.3)])
def test_a_simulated_log_has_the_drive_s_angle_and_its_currents_late(offset, added):
    """The drive sees the current's vector turned back by the electrical angle that its sensor is ahead."""
    error, late = 0.1, 0.25e-3
    log = Log("a", LogRule(file="*"), 1e-3, {"theta": np.zeros(4), "i_d": np.zeros(4)}, (slice(0, 4),))
    made = simulated_log(known(angle_offset=offset), log, trace_with(error), late)
    t = 1e-3 * np.arange(4)
    assert (made.name, made.dt, made.stretches) == ("a", pytest.approx(1e-3), (slice(0, 4),))
    assert made["theta"] == pytest.approx(30 * t + error + added)
    assert made["omega"] == pytest.approx(7 + t)
    seen = (0.5 + 100j * np.maximum(t - late, 0)) * np.exp(-4j * error)
    assert made["i_q"] == pytest.approx(seen.imag) and made["i_d"] == pytest.approx(seen.real)
    assert "i_d" not in simulated_log(
        known(), replace(log, signals={"theta": np.zeros(4)}), trace_with(error)
    )


# --- the way from an estimate to one without the bias of its loop

LATE = Value(1e-3, 1e-5)


def first_estimate(*logs: Log, **more: Any) -> Estimate:
    known: Any = of_motor().identification
    known.drive = Drive.model_validate(drive_tables())
    empty = Estimate(known, logs, {}, (), (), (), {}, (), (), MODEL, (), fit_of({("j",): 1e-3}))
    return replace(empty, **{"values": {"j": Value(1e-3, 1e-5)}, **more})


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What is simulated, by the dead time added, and what the law's answers then tell."""
    seen: dict[str, Any] = {"dead times": [], "traces": {"a": "trace"}, "told": [], "inertia": 1e-3}

    def played(made, progress, dead_time, more):
        seen["dead times"] += [dead_time, dead_time + more]
        progress(0.5)
        if isinstance(seen["traces"], StudyError):
            raise seen["traces"]
        return seen["traces"], {}

    def at_delay(first, delay, simulated, truth):
        return replace(first, values={**first.values, "j": Value(seen["inertia"], 1e-5), "delay": delay})

    monkeypatch.setattr(replay, "played", played)
    monkeypatch.setattr(replay, "lateness", lambda *of: seen["told"].pop(0))
    monkeypatch.setattr(replay, "at_delay", at_delay)
    monkeypatch.setattr(replay, "simulated_log", lambda made, log, trace, late: log)
    return seen


def test_an_estimate_is_simulated_twice_the_second_time_with_the_dead_time_that_is_told(steps):
    """It is told as a multiple of what is added for that, 0.002 periods of the current loop."""
    added, progress = 0.002 / 10e3, []
    made = first_estimate(turning(1.0))
    steps["told"] = [Lateness(LATE, Value(2.0, 0.1)), Lateness(LATE, Value(-0.5, 0.1))]
    found, traces = replay.refined(made, lambda *of: progress.append(of))
    assert steps["dead times"] == pytest.approx([0.0, added, 2 * added, 3 * added])
    assert traces == {"a": "trace"}
    (said,) = found.remarks
    assert said.startswith(
        "The currents follow their references as if the bridge had 300 +- 20 ns more dead time than is"
    )
    assert not isinstance(said, Advice)  # a drop of its transistors looks alike
    assert progress == [("simulation 1 of 2", 0.5), ("simulation 2 of 2", 0.5)]
    assert found.values["delay"] == LATE
    steps["told"] = [Lateness(None, remark="Another law.")]
    other = replay.refined(made, lambda *of: None)[0]
    assert other.remarks == ("Another law.",) and other.values == made.values  # as they were


def test_an_estimate_that_cannot_be_simulated_stays_and_says_why(steps):
    made = first_estimate(turning(1.0), replace(turning(1.0), name="b"), remarks=("First.",))
    for values in ({"values": {}}, {"fit": None}):
        untold = replace(made, **values)
        assert replay.refined(untold, lambda *of: None) == (untold, {})
    found, traces = replay.refined(made, lambda *of: None)
    assert (traces, found.values) == ({"a": "trace"}, made.values)
    assert found.remarks == (
        "First.",
        f"Not simulated: b. {replay.UNCORRECTED} To be simulated, a log needs a table [[log]] in the "
        "--config file that names its reference and controller. The rate of the current loop must be a "
        "multiple of that of the log's rows, and no cogging table may have been on. Add what is missing, "
        "or leave the log out.",
    )
    steps["traces"] = {}  # none is left that could stand alone
    found, traces = replay.refined(made, lambda *of: None)
    assert found.remarks[1].startswith(f"Not simulated: a, b. {replay.UNCORRECTED} ")
    assert found.remarks[1].endswith("no cogging table may have been on.")
    steps["traces"] = StudyError("why")
    found, traces = replay.refined(made, lambda *of: None)
    assert (found.remarks[1], traces) == (
        f"The logs could not be simulated (why). {replay.UNCORRECTED}", {}
    )  # fmt: skip


def test_a_coast_down_has_no_loop_to_correct(steps):
    """It is not simulated, and keeps no other log from being corrected."""
    down = replace(turning(1.0), name="down", rule=LogRule(file="*", kind="coast-down"))
    steps |= {"told": [Lateness(LATE), Lateness(LATE)], "inertia": 2e-3}
    found, _ = replay.refined(first_estimate(turning(1.0), down), lambda *of: None)
    assert (found.values["j"].value, found.remarks) == (2e-3, ())
    alone = first_estimate(down)
    assert replay.refined(alone, lambda *of: None) == (alone, {})


def test_a_simulation_s_truth_is_what_it_is_made_of():
    """c cos + s sin of a wave's size and phase; 0 of what is looked for and was not found."""
    one, two = Wave(24, Value(0.2, 0.0), Value(0.3, 0.0)), Wave(1, Value(0.01, 0.0), Value(-1.0, 0.0))
    made = first_estimate(
        values={"j": Value(1e-3, 0.0), "c": Value(0.1, 0.0)}, loads={"x": Value(0.5, 0.0)},
        cogging=(one,), ripple=(one,), encoder=(two,),
    )  # fmt: skip
    large = {"c": 0.2 * np.sin(0.3), "s": 0.2 * np.cos(0.3)}
    small = {"c": 0.01 * np.sin(-1.0), "s": 0.01 * np.cos(-1.0)}
    expected = {("j",): 1e-3, ("b",): 0.0, ("c",): 0.1, ("delay",): 0.0, ("offset",): 0.0, ("load", "x"): 0.5,
                ("stribeck",): 0.0}  # fmt: skip
    sizes = {
        ("cogging", 6): {"c": 0.0, "s": 0.0},
        ("cogging", 24): large,
        ("ripple", 24): large,
        ("encoder", 1): small,
        ("encoder", 2): {"c": 0.0, "s": 0.0},
    }
    expected |= {(*name, part): value for name, of in sizes.items() for part, value in of.items()}
    assert replay._truth(made) == expected
    more = {"stribeck": Value(0.05, 0.0), "offset": Value(-0.02, 0.01)}
    whole = replace(
        made, values=made.values | more, friction=(two,), of_unknown_cause=(replace(two, order=6),)
    )
    parts = {
        (kind, order, part): x
        for kind, order in (("friction", 1), ("cogging", 6))
        for part, x in small.items()
    }
    assert replay._truth(whole) == expected | parts | {("stribeck",): 0.05, ("offset",): -0.02}
    made.identification.drive = Drive.model_validate({**drive_tables(), "position_sensor": {"kind": "ideal"}})
    assert replay._truth(made) == expected | {("encoder", 1, part): 0.0 for part in "cs"}


def test_a_log_is_played_by_its_own_law_with_rows_that_divide_the_loop_s(monkeypatch):
    """All logs run together, with each dead time. A log whose rows do not divide the loop's is left out."""
    logs = [turning(1.0), replace(turning(1.0), name="odd", dt=1.7e-4), replace(turning(1.0), name="b.csv")]
    logs[2] = replace(logs[2], rule=LogRule(file="*", controller="mine"))
    made = first_estimate(*logs)
    made.identification.path = "id.toml"
    scenarios = {name: {"duration": name} for name in ("a", "odd", "b")}
    laws = {"first": {}, "mine": {}}
    tables = {"drive": drive_tables(), "scenario": scenarios, "controller": laws, "metric": ["x"]}
    monkeypatch.setattr(replay.described, "replayable", lambda made: logs)
    monkeypatch.setattr(replay.described, "study", lambda made: dict(tables))

    class Checked(Study):
        def __init__(self, source):
            object.__setattr__(self, "__dict__", {"tables": source.tables})

    together, progress = [], []

    def rollout(studies, signals):
        together.append([vars(study)["tables"] for study in studies])
        assert signals == replay.TRACE_SIGNALS
        return [SimpleNamespace(runs=[SimpleNamespace(trace=n)]) for n in range(len(studies))]

    monkeypatch.setattr(replay, "checked", Checked)
    monkeypatch.setattr(replay, "rollout", rollout)
    monkeypatch.setattr(replay, "trace_filters", lambda log, trace, period: (log.name, trace, period))
    assert replay.played(made, progress.append, 0.0, 0.0) == ({"a": 0, "b.csv": 1}, {})
    changed = {"trace": {"rate": "10000.0 Hz"}, "metric": []}
    assert together == [
        [
            {**tables, **changed, "scenario": {name: {**scenarios[name], "controllers": [law]}}}
            for name, law in (("a", "first"), ("b", "mine"))
        ]
    ]
    period = 1 / made.identification.drive.rates.outer_loop
    filters = {"a": ("a", 1, period), "b.csv": ("b.csv", 3, period)}
    assert replay.played(made, progress.append, 1e-7, 2e-7) == ({"a": 0, "b.csv": 2}, filters)
    assert [study["drive"]["inverter"]["dead_time"] for study in together[1]] == 2 * ["2e-07 s", "4e-07 s"]
    monkeypatch.setattr(replay, "LOGS_TOGETHER", 1)
    progress.clear()
    replay.played(made, progress.append, 0.0, 0.0)
    assert progress == [0.0, 0.5] and [len(studies) for studies in together[2:]] == [1, 1]
