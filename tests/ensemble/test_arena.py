"""The arena: who meets where, what is counted, and a law of one's own by one line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commands import cogless

from cogless import load, run_study
from cogless.ensemble import arena as room
from cogless.ensemble import arena_scores
from cogless.ensemble.arena import HOUR, LATE, TOLD_CASE, UNTOLD, ArenaResults, prepared, run_arena
from cogless.ensemble.arena_file import Arena, arena_of
from cogless.ensemble.arena_scores import SCORE_COLUMNS, Scores
from cogless.errors import StudyError
from cogless.files import shipped
from cogless.run.simulate import rollout
from cogless.study import Study, changed
from cogless.study.laws.anti_cogging import AntiCogging
from cogless.study.reading import read

PLANT = {
    "study": "uomodri",
    "scenario": "fast",
    "begin": "0.5 s",
    "learn": "3 s",
    "window": "0.25 s",
    "hold": "0.5 s",
    "load": "4 mN*m",
    "smooth": "13.9 ms",
    "band": "4 rpm",
    "target": "2 rpm",
}
AUTO = {"rule": "auto"}
LAWS = {"bar": {"law": "pi", "tuning": AUTO, "baseline": True}, "pi-ilc": {"law": "pi-ilc", "tuning": AUTO}}


def arena(folder: Path, **more: Any) -> Arena:
    tables: dict[str, Any] = {"title": "T", "seeds": [0, 1], "plant": {"drone": PLANT}, "law": LAWS, **more}
    return arena_of(folder / "mine.toml", tables)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> ArenaResults:
    folder = tmp_path_factory.mktemp("arena")
    (folder / "own.py").write_text(
        "class P:\n    def step(self, inputs):\n        return 0.1 * (inputs.omega_ref - inputs.omega_m)\n"
    )
    mine = {"law": "python", "object": "own.py:P", "learning": False}
    return run_arena(arena(folder, law={**LAWS, "mine": mine}))


def test_every_law_meets_every_case_with_every_seed(results: ArenaResults) -> None:
    assert results.absent == {}
    assert len(results.runs) == 3 * 4 * 2
    scores = Scores(arena_scores.to_dict(results))
    assert [scores.met(law) for law in scores.laws] == [1, 1, 1]
    everywhere = {column for column in SCORE_COLUMNS if scores.score(column, "bar") == pytest.approx(1)}
    assert everywhere == {*SCORE_COLUMNS} - {"after_hour"}


def test_learning_beats_the_bar_and_a_law_of_ones_own_is_judged_too(results: ArenaResults) -> None:
    scores = Scores(arena_scores.to_dict(results))
    learned, own = scores.score("ripple", "pi-ilc"), scores.score("ripple", "mine")
    assert learned is not None and learned < 0.3
    assert own is not None and own > 1  # no integral
    assert scores.winners("ripple") == ["pi-ilc"]


def test_learning_takes_the_plants_torque_orders_away(results: ArenaResults) -> None:
    scores = Scores(arena_scores.to_dict(results))
    found = {law: scores.value("orders", "drone", law) for law in ("bar", "pi-ilc")}
    ripple = scores.value("ripple", "drone", "bar")
    assert found["bar"] is not None and found["pi-ilc"] is not None and ripple is not None
    assert 0.9 * ripple < found["bar"] < 1.01 * ripple  # cogging is what there is, as an rms
    assert found["pi-ilc"] < 0.3 * found["bar"]


def test_orders_need_a_whole_turn(tmp_path: Path) -> None:
    short = arena(tmp_path, plant={"drone": {**PLANT, "scenario": "slow"}})
    names = [
        [m.name for m in prepared(fight, "drone", ["bar"])[0].metric] for fight in (arena(tmp_path), short)
    ]
    assert ["orders" in each for each in names] == [
        True,
        False,
    ]  # 3 s are 12 turns, and three quarters of one


def test_an_hour_is_run_once_and_shows_the_ripple_at_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "HOUR_TIME", 6.0)
    monkeypatch.setattr(room, "HOUR_END", 2.0)
    monkeypatch.setattr(room, "HOUR_TRACE_RATE", 200.0)
    found = run_arena(arena(tmp_path, plant={"drone": {**PLANT, "hour": True}, "brief": PLANT}))
    assert {(run.plant, run.seed) for run in found.runs if run.case == HOUR} == {("drone", 0)}
    scores = Scores(json.loads(json.dumps(arena_scores.to_dict(found))))
    for law in scores.laws:
        early, late = scores.value("ripple", "drone", law, [0]), scores.value("after_hour", "drone", law)
        assert early is not None and late is not None
        assert 0.3 * early < late < 1.1 * early  # the bar stays as it was, and learning goes on
        assert scores.value("after_hour", "brief", law) is None
    assert scores.winners("after_hour") == ["pi-ilc"]


def test_a_law_that_fails_in_one_case_is_absent_by_name(tmp_path: Path) -> None:
    """The load steps at 0.4 s, where all cases but the first end."""
    brief = {**PLANT, "begin": "0.1 s", "learn": "0.3 s", "hold": "0.1 s"}
    (tmp_path / "own.py").write_text(
        "class P:\n    def step(self, inputs):\n        return 0.0 if inputs.time < 0.45 else float('nan')\n"
    )
    mine = {"law": "python", "object": "own.py:P", "learning": False}
    small = arena(tmp_path, seeds=[0], plant={"drone": brief}, law={**LAWS, "mine": mine})
    found = run_arena(small, ["drone/mine"])
    assert found.absent == {("drone", "mine"): "fails on the way"}
    assert {run.case for run in found.runs} == {*UNTOLD}


def test_a_law_that_fails_within_the_hour_does_not_win_it() -> None:
    found = content({"bar": [1.0, 1.0], "law": [0.5, 0.5]}, "copper_loss_W")
    hour = {"plant": "a", "case": HOUR, "seed": 0, "metrics": {"after_hour_rad_s": 2.0}}
    found["runs"].append({**hour, "law": "bar"})
    assert Scores(found).winners("after_hour") == ["bar"]
    assert Scores(found).winners("copper_loss") == ["law"]


def test_seeds_are_other_noise_and_another_angle(results: ArenaResults) -> None:
    ripple = {
        r.seed: r.metrics["ripple_rad_s"] for r in results.runs if (r.case, r.law) == (TOLD_CASE, "bar")
    }
    assert ripple[0] != ripple[1]


def test_the_run_in_which_a_table_was_learned_counts_as_time_to_learn(tmp_path: Path) -> None:
    easy, laws = {**PLANT, "target": "20 rpm"}, {**LAWS, "table": {"law": "anti-cogging", "tuning": AUTO}}
    fight = arena(tmp_path, seeds=[0], plant={"drone": easy}, law=laws)
    study, _ = prepared(fight, "drone", ["table"])
    law = study.controller["table"]
    assert isinstance(law, AntiCogging) and law.calibration is not None
    found = run_arena(fight, ["drone/table"])
    assert found.before == {("drone", "table"): law.calibration.duration}
    alone = next(run.metrics["time_to_learn_s"] for run in found.runs if run.case == TOLD_CASE)
    scores = Scores(arena_scores.to_dict(found))
    took = scores.of_seed("time_to_learn", "drone", "table", 0)
    assert took == pytest.approx(law.calibration.duration + alone) and took > 5


def test_an_interrupted_arena_keeps_the_plants_that_are_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What isn't finished is not said to fail."""
    count = 0

    def stopped(studies: Sequence[Any], **options: Any) -> list[Any]:
        nonlocal count
        count += 1
        found = rollout(studies, **options)
        return found if count < 2 else [replace(each, runs=[], interrupted=True) for each in found]

    def text(plants: Iterable[str]) -> str:
        keys = "\n".join(f"{key} = {json.dumps(value)}" for key, value in PLANT.items())
        laws = '[law.bar]\nlaw = "pi"\ntuning.rule = "auto"\nbaseline = true\n'
        return 'title = "T"\n' + "".join(f"[plant.{name}]\n{keys}\n" for name in plants) + laws

    monkeypatch.setattr("cogless.ensemble.arena.rollout", stopped)
    file, folder = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(text(["drone", "second", "third"]))
    code, out, err = cogless(capsys, "run", file, "-o", folder, "-j", 1)
    assert (code, err) == (130, f"Interrupted: kept 1 of 3 plants (drone), written to {folder}.\n")
    assert count == 2 and f"Results: {folder / 'results.json'}" in out
    found = json.loads((folder / "results.json").read_text())
    assert found["interrupted"] is True and found["absent"] == []
    assert {run["plant"] for run in found["runs"]} == {"drone"}
    count = 1
    code, out, err = cogless(capsys, "run", file, "-o", tmp_path / "none", "-j", 1)
    assert (code, out, err) == (130, "", "Interrupted: kept 0 of 3 plants, nothing written.\n")
    assert not (tmp_path / "none").exists()


def test_results_are_plain_json(results: ArenaResults, tmp_path: Path) -> None:
    arena_scores.write(results, tmp_path / "results.json")
    content = json.loads((tmp_path / "results.json").read_text())
    assert content == json.loads(json.dumps(arena_scores.to_dict(results)))
    gain = next(each["controller"] for each in content["settings"] if each["law"] == "pi-ilc")
    assert gain["gain"] > 0  # what the rule gave stands in the results


def test_a_plant_is_met_as_told_with_a_step_and_a_fault_and_three_times_otherwise(tmp_path: Path) -> None:
    """It begins at 0.5 s and learns for 3 s; then the load steps, goes back, and the angle is missing."""
    fight = arena(tmp_path)
    base = load("uomodri")
    assert isinstance(base, Study)
    found = room.scenarios(base, fight.plant["drone"])
    own = base.source.tables["scenario"]["fast"]
    taken = {key: own[key] for key in ("reference", "initial_speed", "load") if key in own}
    before = (base.scenario["fast"].load or base.mechanics.load).torque
    told = {
        **taken,
        "initial_speed": own["reference"],
        "override": {},
        "duration": "5.0 s",
        "events": [
            {"time": "3.5 s", "load": f"{before + 4e-3!r} N*m"},
            {"time": "4.0 s", "load": f"{before!r} N*m"},
        ],
        "faults": [{"kind": "angle-missing", "time": "4.5 s", "duration": "50 ms"}],
    }
    assert list(found) == [TOLD_CASE, *UNTOLD] and found[TOLD_CASE] == told
    for case in UNTOLD:
        rest = {key: value for key, value in found[case].items() if key != "override"}
        assert rest == {**taken, "initial_speed": own["reference"], "duration": "3.5 s"}
    period, inertia = 1 / base.drive.rates.outer_loop, base.mechanics.inertia
    assert [found[case]["override"] for case in UNTOLD] == [
        {"drive.bus.delay_command": f"{period!r} s"},
        {"mechanics.inertia": f"{1.5 * inertia!r} kg*m^2"},
        {"mechanics.inertia": f"{0.5 * inertia!r} kg*m^2"},
    ]


def test_a_plants_own_reference_is_met_from_its_speed(tmp_path: Path) -> None:
    base = load("uomodri")
    assert isinstance(base, Study)
    slow = arena(tmp_path, plant={"drone": {**PLANT, "reference": "61.3 rpm"}}).plant["drone"]
    for scenario in room.scenarios(base, slow).values():
        assert (scenario["reference"], scenario["initial_speed"]) == ("61.3 rpm", "61.3 rpm")


def test_what_is_measured_of_a_plant_and_when(tmp_path: Path) -> None:
    study, _ = prepared(arena(tmp_path), "drone", ["bar"])
    spans = {metric.name: metric.window or metric.event for metric in study.metric}
    turn = 1.1 * 2 * math.pi / study.scenario[TOLD_CASE].slowest
    assert {name: pytest.approx(span) for name, span in spans.items()} == {
        "ripple": (3.25, 3.5),
        "orders": (3.5 - max(0.25, turn), 3.5),
        "dip": 3.5,
        "settling": 3.5,
        "time_to_learn": (0.5, 3.5),
        "copper_loss": (3.25, 3.5),
        "chattering": (3.25, 3.5),
        "after_fault": (4.75, 5.0),
    }
    assert [metric.name for metric in study.metric if metric.scenarios is None] == ["ripple"]
    bands = {metric.name: metric.band for metric in study.metric if metric.band}
    rpm = math.pi / 30
    assert bands == pytest.approx({"settling": 4 * rpm, "time_to_learn": 2 * rpm})
    smooth = {metric.name: metric.smooth for metric in study.metric if metric.smooth}
    assert smooth == pytest.approx(dict.fromkeys(("dip", "settling", "time_to_learn"), 13.9e-3))


def test_laws_are_not_told_of_the_delay_nor_of_the_inertia(tmp_path: Path) -> None:
    study, absent = prepared(arena(tmp_path), "drone", ["bar", "pi-ilc"])
    assert absent == {}
    assert study.drive.bus is None
    assert study.scenario[LATE].override["drive.bus.delay_command"] == "0.0002 s"
    assert study.scenario["heavy"].override["mechanics.inertia"] == "9e-06 kg*m^2"


def test_laws_learn_from_when_the_plant_says_unless_they_say_otherwise(tmp_path: Path) -> None:
    laws = {**LAWS, "later": {**LAWS["pi-ilc"], "learning_start": "1 s"}}
    study, _ = prepared(arena(tmp_path, law=laws), "drone", list(laws))
    starts = {name: getattr(law, "learning_start", None) for name, law in study.controller.items()}
    assert starts == {"bar": None, "pi-ilc": 0.5, "later": 1.0}


def test_a_feedback_by_hand_keeps_laws_without_a_pi_away(tmp_path: Path) -> None:
    laws = {**LAWS, "robust": {"law": "robust-ilc", "tuning": AUTO}}
    plant = {**PLANT, "feedback": {"kp": 0.05, "ki": 2.0}}
    study, absent = prepared(arena(tmp_path, law=laws, plant={"drone": plant}), "drone", list(laws))
    assert absent == {
        "robust": "the arena's gains for this plant are for another kind of feedback than this law's"
    }
    assert study.controller["bar"].kp == 0.05
    with pytest.raises(
        StudyError, match=r"plant\.drone: expected a law that can use the gains given for this plant$"
    ):
        prepared(arena(tmp_path, law=laws, plant={"drone": plant}), "drone", ["robust"])


def test_a_law_with_a_margin_of_its_own_stays_away_from_a_feedback_by_hand(tmp_path: Path) -> None:
    """On such a plant the law would be the one without a margin, under another name."""
    calm = {"law": "pi-ilc", "tuning": {"rule": "auto", "phase_margin": "60 deg"}}
    plant = {**PLANT, "feedback": {"kp": 0.05, "ki": 2.0}}
    fight = arena(tmp_path, law={**LAWS, "calm": calm}, plant={"drone": plant})
    study, absent = prepared(fight, "drone", ["bar", "pi-ilc", "calm"])
    assert list(study.controller) == ["bar", "pi-ilc"] and list(absent) == ["calm"]


def test_what_limits_the_best_law_is_found_by_trying(tmp_path: Path) -> None:
    """Dead time limits the best law, and the limits name its compensation as the change that helps."""
    laws = {"bar": LAWS["bar"], "harmonic": {"law": "harmonic", "tuning": AUTO}}
    fight = arena(tmp_path, seeds=[0], law=laws)
    found = run_arena(fight, ["drone/*"], find_limits=True)
    (told,) = json.loads(json.dumps(arena_scores.to_dict(found)))["limits"]
    assert (told["plant"], told["law"], told["named"][0]) == ("drone", "harmonic", "dead-time")
    assert found.limits["drone"].controller == "harmonic"
    study, _ = prepared(fight, "drone", ["harmonic"])
    alone = room.learning(study, "harmonic")
    assert alone.scenario[TOLD_CASE].duration == 3.5 and not alone.scenario[TOLD_CASE].events
    helps = told["helps"]["setting"]
    left = [run_study(changed(alone, each)).runs[0].metrics["ripple_rad_s"] for each in ({}, helps["set"])]
    assert left == pytest.approx([told["value"], helps["value"]]) and left[1] < 0.8 * left[0]
    assert run_arena(fight, ["drone/bar"]).limits == {}


def test_the_shipped_arena_can_be_prepared_everywhere() -> None:
    path = shipped("studies")["arena"]
    found = arena_of(path, read(path))
    for plant in found.plant:
        study, absent = prepared(found, plant, [found.bar])
        assert list(study.controller) == [found.bar] and absent == {}


def test_a_mistake_is_told_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r'plant\.drone\.scenario: "nowhere": expected 1-rev-s, slow, fast'):
        prepared(arena(tmp_path, plant={"drone": {**PLANT, "scenario": "nowhere"}}), "drone", ["bar"])
    with pytest.raises(StudyError, match=r'plant\.drone\.scenario: "fast": expected a study of speed$'):
        prepared(arena(tmp_path, plant={"drone": {**PLANT, "study": "mandra2019"}}), "drone", ["bar"])
    with pytest.raises(StudyError, match=r"law: .*baseline = true"):
        arena(tmp_path, law={"bar": {"law": "pi", "tuning": AUTO}})
    with pytest.raises(StudyError, match=r"window: \"5 s\": expected a time within learn"):
        arena(tmp_path, plant={"drone": {**PLANT, "window": "5 s"}})
    with pytest.raises(StudyError, match="expected PLANT/LAW"):
        run_arena(arena(tmp_path), ["sea/*"])
    with pytest.raises(StudyError, match="an arena: expected a study"):
        load("arena")


def test_an_empty_table_of_changes_is_a_value(tmp_path: Path) -> None:
    """`drive.bus = {}` is a bus with its defaults. Before, the empty table was ignored without a message."""
    of_bus = {**PLANT, "changes": {"drive": {"bus": {}}}}
    study, _ = prepared(arena(tmp_path, plant={"drone": of_bus}), "drone", ["bar"])
    assert study.drive.bus is not None
    for table in ({"drive": {"nonsense": {}}}, {"nonsense": {}}):
        with pytest.raises(StudyError, match="nonsense: unknown key"):
            prepared(arena(tmp_path, plant={"drone": {**PLANT, "changes": table}}), "drone", ["bar"])
        trials = {"moves": {"study": "mandra2019", "changes": table}}
        with pytest.raises(StudyError, match="nonsense: unknown key"):
            run_arena(arena(tmp_path, trials=trials), ["moves/*"])


def content(values: dict[str, list[float | None]], column: str = "time_to_learn_s") -> dict[str, Any]:
    """Results of laws on plants a, b with one seed; each law's values in the order of the plants."""
    runs = [
        {
            "plant": plant,
            "case": TOLD_CASE,
            "law": law,
            "seed": 0,
            "metrics": {"ripple_rad_s": 1.0, column: value},
        }
        for law, each in values.items()
        for plant, value in zip("ab", each, strict=False)
    ]
    plants = {name: {"learn": 8.0, "hold": 2.0} for name in "ab"}
    laws = {law: {"label": law, "law": "pi"} for law in values}
    return {
        "plants": plants,
        "laws": laws,
        "seeds": [0],
        "bar": next(iter(values)),
        "runs": runs,
        "before": [],
    }


def test_never_counts_as_the_time_that_there_was() -> None:
    scores = Scores(content({"bar": [None, 4.0], "law": [2.0, None]}))
    assert scores.value("time_to_learn", "a", "bar") == math.inf
    assert scores.score("time_to_learn", "law") == pytest.approx(math.sqrt(2 / 8 * 8 / 4))


def test_a_plant_without_the_bar_is_named() -> None:
    scores = Scores(content({"bar": [1.0], "law": [2.0, 3.0], "shy": []}))
    assert scores.barless == ["b"]
    column = "time_to_learn"
    assert scores.score(column, "shy") is None and scores.unscored(column, "shy") == "not run"
    found = content({"bar": [], "law": [2.0, 3.0]})
    assert Scores(found).barless == ["a", "b"] and Scores(found).unscored(column, "law") == "no bar"
    assert Scores(found).score("time_to_learn", "law") is None
    nowhere = Scores(content({"bar": [1.0], "law": [2.0]}))  # none was on b
    assert (
        nowhere.barless == []
        and Scores(content({"bar": [], "law": [2.0]})).unscored(column, "law") == "no bar"
    )


def test_the_table_has_a_row_for_each_law(results: ArenaResults) -> None:
    shown = arena_scores.table(results)
    assert str(shown.title) == "Multiples of bar, mean over plants" and shown.caption is None
    titles = ("ripple", "orders", "dip", "settling", "time to learn", "copper loss", "chattering")
    titles += ("after a fault", "wrong model", "after an hour")
    assert [str(column.header) for column in shown.columns] == ["law", *titles, "plants"]
    rows = list(zip(*(column.cells for column in shown.columns), strict=True))
    assert [row[0] for row in rows] == ["bar", "pi-ilc", "mine"] and {row[-1] for row in rows} == {"1"}
    least = Scores(arena_scores.to_dict(results)).score("ripple", "pi-ilc")
    headline = f"pi-ilc leaves the least ripple: {least:.3g} times that of bar, on one plant."
    assert arena_scores.headline(results) == headline
    ripples = [row[1] for row in rows]
    assert [str(cell).strip()[-1] == "*" for cell in ripples] == [False, True, False]
    assert ripples[0] == "1  " and {row[-2] for row in rows} == {"not run"}


def test_speeds_are_told_in_turns_a_minute_and_all_else_in_si() -> None:
    for column in SCORE_COLUMNS.values():
        si = column.metric.rpartition("_")[2]
        expected = ("r/min", pytest.approx(math.pi / 30)) if si == "s" and "rad" in column.metric else (si, 1)
        assert (column.unit, column.scale) == expected


def test_without_the_bar_the_table_says_so(tmp_path: Path) -> None:
    found = run_arena(arena(tmp_path, seeds=[0]), ["drone/pi-ilc"])
    shown = arena_scores.table(found)
    assert str(shown.caption) == "No score counts plants without bar: drone."
    assert arena_scores.headline(found) == ""
    of_hour = list(SCORE_COLUMNS).index("after_hour")
    told = ["not run" if n == of_hour else "no bar" for n in range(len(SCORE_COLUMNS))]
    assert [list(column.cells)[1] for column in shown.columns][1:-1] == told
    assert [next(iter(column.cells)) for column in shown.columns][1:-1] == ["not run"] * len(SCORE_COLUMNS)


def test_trials_meet_their_own_study_s_controllers(tmp_path: Path) -> None:
    changes = {"scenario": {"table-1": {"trials": 95}}, "trace": {"rate": "400 Hz"}}
    trials = {"moves": {"study": "mandra2019", "about": "moves", "changes": changes}}
    found = run_arena(arena(tmp_path, seeds=[3], trials=trials), ["moves/no-ilc", "moves/ilc"])
    assert not found.runs
    told = json.loads(json.dumps(arena_scores.to_dict(found)))
    assert told["arena_trials"] == {"moves": "moves"}
    needed = {run["law"]: run["metrics"]["trials_to_floor"] for run in told["trials"]}
    assert needed["no-ilc"] == [None] * 4 and len(needed["ilc"]) == 4
    assert all(
        set(r["metrics"]) == {"trials_to_floor", "first_error_rad", "final_error_rad"} for r in told["trials"]
    )
    with pytest.raises(StudyError, match=r"trials\.moves\.study: expected a study of trials"):
        run_arena(arena(tmp_path, trials={"moves": {"study": "uomodri"}}), ["moves/*"])


def test_the_run_that_fills_a_table_before_counts_as_learning() -> None:
    found = content({"bar": [4.0, 4.0], "table": [0.0, 0.0]})
    found["before"] = [{"plant": "a", "law": "table", "s": 3.0}]
    assert Scores(found).value("time_to_learn", "a", "table") == 3.0
    assert Scores(found).value("ripple", "a", "table") == 1.0


def test_a_law_that_stays_away_from_a_plant_wins_no_column() -> None:
    scores = Scores(content({"bar": [4.0, 4.0], "shy": [0.1]}))
    assert scores.met("shy") == 1
    assert scores.winners("time_to_learn") == ["bar"]


def test_a_ripple_that_is_not_finite_never_wins() -> None:
    scores = Scores(content({"bar": [1.0, 1.0], "law": [0.1, None]}, "copper_loss_W"))
    assert scores.score("copper_loss", "law") == math.inf
    assert scores.winners("copper_loss") == ["bar"]


def test_scores_by_hand() -> None:
    """Over the bar's, and the geometric mean over plants; up to 2 % more is as good as the best."""
    laws = {"bar": [1.0, 4.0], "law": [0.5, 8.0], "near": [0.51, 8.15], "far": [0.52, 8.1]}
    scores = Scores(content(laws, "dip_rad_s"))
    assert scores.value("dip", "b", "law") == 8.0 and scores.ratio("dip", "b", "law") == 2.0
    assert scores.score("dip", "law") == pytest.approx(1.0)
    assert scores.score("dip", "near") == pytest.approx(math.sqrt(0.51 * 8.15 / 4))
    assert scores.winners("dip") == ["bar", "law", "near"]  # far: 1.026
    assert scores.best(lambda law: {"law": 3.0, "near": 3.06}.get(law)) == ["law", "near"]
    assert scores.best(lambda law: {"law": 3.0, "near": 3.07, "far": math.inf}.get(law)) == ["law"]
    assert scores.best(lambda law: math.inf) == []


def test_a_law_without_any_is_as_good_as_a_thousand_millionth_of_the_bar() -> None:
    scores = Scores(content({"bar": [1.0, 1.0], "law": [0.0, 4.0]}, "chattering_A"))
    assert scores.ratio("chattering", "a", "law") == 0.0
    assert scores.score("chattering", "law") == pytest.approx(math.sqrt(1e-9 * 4.0))
    none = Scores(content({"bar": [0.0, 1.0], "law": [1.0, 4.0]}, "chattering_A"))
    assert none.ratio("chattering", "a", "law") is None and none.score("chattering", "law") == 4.0


def test_the_worst_of_the_untold_cases_counts_and_none_may_be_missing() -> None:
    found = content({"bar": [1.0]})
    (run,) = found["runs"]
    worse = [{**run, "case": case, "metrics": {"ripple_rad_s": 2.0 + n}} for n, case in enumerate(UNTOLD)]
    for runs in (worse, worse[::-1]):
        assert Scores({**found, "runs": runs}).value("wrong_model", "a", "bar") == 1.0 + len(UNTOLD)
    assert Scores({**found, "runs": worse[:-1]}).value("wrong_model", "a", "bar") is None


def test_amplitudes_of_orders_count_as_their_rms_together() -> None:
    """3 and 4 make 5, over sqrt 2; one that isn't there is never reached."""
    scores = Scores(content({"bar": [[3.0, 4.0], [1.0]], "law": [[3.0, None], [1.0]]}, "orders_rad_s"))
    assert scores.value("orders", "a", "bar") == pytest.approx(5 / math.sqrt(2))
    assert scores.value("orders", "a", "law") == math.inf


def test_a_time_is_no_shorter_than_a_millisecond_in_a_ratio() -> None:
    scores = Scores(content({"bar": [0.5, 0.0], "law": [0.0, 2e-3]}))
    assert scores.ratio("time_to_learn", "a", "law") == pytest.approx(1e-3 / 0.5)
    assert scores.ratio("time_to_learn", "b", "law") == pytest.approx(2.0)


def test_seeds_are_a_mean_and_a_seed_may_be_asked_for_alone() -> None:
    found = content({"bar": [1.0]}, "copper_loss_W")
    found["seeds"] = [0, 1]
    (run,) = (r for r in found["runs"] if r["plant"] == "a" and r["case"] == TOLD_CASE)
    found["runs"].append({**run, "seed": 1, "metrics": {"ripple_rad_s": 1.0, "copper_loss_W": 4.0}})
    scores = Scores(found)
    assert scores.value("copper_loss", "a", "bar") == 2.5
    assert scores.value("copper_loss", "a", "bar", [1]) == 4.0
    del found["runs"][-1]["metrics"]["copper_loss_W"]  # a seed without it
    assert Scores(found).value("copper_loss", "a", "bar") is None
