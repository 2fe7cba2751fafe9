"""The engine records what the table of signals says, in its order, of every kind of drive."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import studies
from cogless import load
from cogless.control_library import C_LAWS
from cogless.files import control_sources
from cogless.run.drive_config import engine_config
from cogless.run.run_plan import compiled
from cogless.run.simulate import simulate
from cogless.signals import DERIVED, RECORDED, exists
from cogless.study import AnyStudy, Study
from cogless.study.metric import SIGNAL_DIMENSIONS
from cogless.study.metric_checks import kinds, missing
from cogless.units import ANGULAR_SPEED, UnitError, dimension_of

DRIVES: list[tuple[str, dict[str, Any]]] = [
    ("uomodri", {}),
    ("liu2018", {"trace.energy": True}),
    ("liu2018", {"drive.inverter.kind": "switched", "trace.rate": "30 kHz"}),
    ("verrelli2016", {}),
    ("verrelli2016-position", {}),
    ("liu2018-varying", {}),
]


def had(study: AnyStudy) -> set[str]:
    """Signals that the study's checks take."""
    return {
        signal
        for signal, error in zip(SIGNAL_DIMENSIONS, missing(study, SIGNAL_DIMENSIONS), strict=True)
        if error is None
    }


@pytest.mark.parametrize(("name", "changes"), DRIVES)
def test_a_drive_records_what_the_table_says(name: str, changes: dict[str, Any]) -> None:
    study = load(name, changes)
    assert isinstance(study, Study)
    engine, recorded = compiled(study), set()
    for controller, law in study.controller.items():
        scenario = next(key for key in study.scenario if controller in study.controllers_in(key))
        signals = engine.Drive(engine_config(study, scenario, controller)).signals
        own = [(term.signal, term.unit) for term in C_LAWS[law.law].terms if term.signal in law.terms]
        found = kinds(study) - (set() if law.law.startswith("space") else {"path"})
        table = [(name, each.unit) for name, each in RECORDED.items() if each.exists(found)]
        place = [name for name, _ in table].index("status") + 1
        assert signals == [*table[:place], *own, *table[place:]]
        recorded |= {name for name, _ in signals}
    every = {*recorded, *(name for name, each in DERIVED.items() if recorded.issuperset(each.needs))}
    assert had(study) == every - {"time"}


def test_trials_record_what_the_table_says() -> None:
    study = load("mandra2019", {"scenario.table-1.trials": 1, "scenario.table-1.changes": [], "metric": []})
    trace = simulate(study, "table-1", "ilc").trace
    own = [term.signal for term in C_LAWS["trial"].terms]
    table = [name for name, each in RECORDED.items() if each.exists({"trials", "trial_law"})]
    assert sorted(trace.names) == sorted([*table, *own])
    every = {*trace.names, *trace.derived} - {"time"}
    assert had(study) == every


def test_every_signal_says_what_it_is() -> None:
    assert all(len(each.meaning) > 5 for each in RECORDED.values())
    assert not exists("nothing", {"electrical"})


ROW = 'CGL_SIGNAL("{name}", "{unit}", "a signal of a contributor", true, {value})\n'
NEW = {"power_shaft": "W", "jerk": "rad/s^3", "share": "1/K"}
METRICS = "".join(
    f"""
[[metric]]
name = "{name}"
kind = "rms"
signal = "{name}"
unit = "{unit}"
"""
    for name, unit in (("power_shaft", "mW"), ("jerk", "rpm/s^2"), ("share", "1/K"))
)


def test_a_row_with_another_unit_is_a_signal_for_every_command(
    tmp_path: Path,
) -> None:
    """A copy of the sources gets rows as contributing.md describes. Each command runs in its own process."""
    table = control_sources().parents[1] / "simulator" / "signals.def"
    copy = tmp_path / "sources"
    (copy / "simulator").mkdir(parents=True)
    (copy / "control").symlink_to(control_sources().parent)
    rows = "".join(ROW.format(name=name, unit=unit, value="0.0") for name, unit in NEW.items())
    (copy / "simulator" / "signals.def").write_text(table.read_text() + rows)
    start = (
        "from pathlib import Path; import cogless.files as files\n"
        f"files.control_sources = lambda: Path({str(copy / 'control' / 'src')!r})\n"
        "from cogless.__main__ import main; main()"
    )

    def command(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", start, *words], capture_output=True, text=True, cwd=tmp_path, check=False
        )
        return f"{done.returncode} {done.stderr}"

    (tmp_path / "asked.toml").write_text(studies.BASE + METRICS)
    (tmp_path / "plain.toml").write_text(studies.BASE)
    (tmp_path / "wrong.toml").write_text(studies.BASE + METRICS.replace("mW", "mA"))
    for words in (("list",), ("design", "asked.toml"), ("run", "plain.toml", "-o", "results")):
        assert command(*words).startswith("0 "), words
    refused = command("design", "wrong.toml")
    assert refused == '2 wrong.toml: metric.3.unit: "mA": expected a unit of a power, such as "W"\n'


def test_a_row_s_unit_is_one_that_studies_know() -> None:
    assert dimension_of("rad/s") is ANGULAR_SPEED and dimension_of("W").name == "a power"
    assert dimension_of("rad/s^3").sample(1) == '"1 rad/s^3"'
    with pytest.raises(UnitError, match='expected a known unit, not "furlong"'):
        dimension_of("furlong")
