"""The engine records what the table of signals says, in its order, of every kind of drive."""

from importlib import import_module
from typing import Any

import pytest

from cogless import load
from cogless.c_laws import C_LAWS
from cogless.run.advance import ENGINES
from cogless.run.drive_config import engine_config
from cogless.run.simulate import simulate
from cogless.signals import DERIVED, RECORDED, exists
from cogless.study import AnyStudy, Study
from cogless.study.metric import SIGNALS
from cogless.study.signals import kinds, missing, terms

DRIVES: list[tuple[str, dict[str, Any]]] = [
    ("uomodri", {}),
    ("liu2018", {"trace.energy": True}),
    ("verrelli2016", {}),
    ("verrelli2016-position", {}),
    ("liu2018-varying", {}),
]


def had(study: AnyStudy) -> set[str]:
    """Signals that the study's checks take."""
    return {signal for signal, error in zip(SIGNALS, missing(study, SIGNALS), strict=True) if error is None}


@pytest.mark.parametrize(("name", "changes"), DRIVES)
def test_a_drive_records_what_the_table_says(name: str, changes: dict[str, Any]) -> None:
    study = load(name, changes)
    assert isinstance(study, Study)
    engine, recorded = import_module(ENGINES[study.drive.precision]), set()
    for controller, law in study.controller.items():
        scenario = next(key for key in study.scenario if controller in study.controllers_in(key))
        signals = engine.Drive(engine_config(study, scenario, controller)).signals
        own = [(term.signal, term.unit) for term in C_LAWS[law.law].terms if term.signal in terms(law)]
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
    assert all(len(each.about) > 5 for each in RECORDED.values())
    assert not exists("nothing", {"electrical"})
