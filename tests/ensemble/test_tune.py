"""Tuning finds what is known to be best, holds what must hold, goes on after a kill, never makes worse."""

import os
import random
import signal
import time
import tomllib
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import ensembles
import numpy as np
import pytest
from commands import cogless, forked
from test_sweep import Here

import studies
from cogless.design.verdict import verdict
from cogless.ensemble import search as searching
from cogless.ensemble import tune as tuning
from cogless.ensemble.sweep_table import Sweep
from cogless.ensemble.variants import draw
from cogless.ensemble.workers import executor_workers
from cogless.errors import StudyError
from cogless.run.simulate import run_study
from cogless.study import changed, load

pytest.importorskip("optuna", reason="needs the extra cogless[tune]")

TUNE = """
[tune]
minimise = "ripple"
variants = 4
budget = 25
[tune.keys]
controller.pi.kp = ["0.005 A/rpm", "0.06 A/rpm"]
controller.pi.ki = ["0.05 A/rpm/s", "2 A/rpm/s"]
"""


def study(folder: Path, tune: str = TUNE, changes: dict[str, Any] | None = None) -> Any:
    return studies.study(folder, changes, ensembles.TEXT + tune)


def tuned(folder: Path, tune: str = TUNE, executor: Executor | None = None, **changes: Any) -> tuning.Tuned:
    (found,) = tuning.tune(study(folder, tune, changes), folder, executor_workers(executor or Here()))
    return found


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuning.Tuned:
    return tuned(tmp_path_factory.mktemp("usual"))


def test_a_metric_is_named_as_in_the_study_or_as_in_its_results(tmp_path: Path) -> None:
    found = study(tmp_path)
    by_name = tuning.column_of(found, "ripple", "minimise")
    assert tuning.column_of(found, by_name.name, "minimise") == by_name
    assert by_name.name != "ripple"


def test_the_search_finds_the_bottom_of_a_bowl(tmp_path: Path) -> None:
    def bowl(many: Any) -> list[float]:
        return [(one["a"] - 0.7) ** 2 + 4 * (one["b"] - 0.2) ** 2 for one in many]

    told: list[tuple[int, float]] = []
    with searching.opened(tmp_path / "s", {}, {"a": 0.1, "b": 0.9}, seed=1) as search:
        best = search.run(bowl, 120, lambda n, v: told.append((n, v)))
        assert best == pytest.approx({"a": 0.7, "b": 0.2}, abs=0.03)
        assert told[0] == (1, pytest.approx(0.36 + 4 * 0.49)) and told[-1][0] == 120  # the start comes first


def test_a_killed_search_goes_on(tmp_path: Path) -> None:
    tried: list[dict[str, float]] = []

    def score(many: Any, most: int) -> list[float]:
        if len(tried) >= most:
            raise KeyboardInterrupt
        tried.extend(many)
        return [one["a"] for one in many]

    start = {"a": 0.5, "b": 0.5}
    with pytest.raises(KeyboardInterrupt), searching.opened(tmp_path / "s", {}, start, 1) as search:
        search.run(lambda many: score(many, 10), 40, lambda n, v: None)
    before = len(tried)
    with searching.opened(tmp_path / "s", {}, start, 1) as search:
        search.run(lambda many: score(many, 99), 40, lambda n, v: None)
    assert 10 <= before < 20 and len(tried) == 40
    assert tried.count(start) == 1
    wrong = "study: None: expected the same study, or another directory$"
    with pytest.raises(StudyError, match=wrong), searching.opened(tmp_path / "s", {"study": "x"}, start, 1):
        pass


def test_a_search_goes_on_from_any_part_of_its_journal(tmp_path: Path) -> None:
    """Cut where a kill may cut it, or with a flipped bit: what is damaged is tried again."""

    def run(path: Path) -> tuple[int, dict[str, float]]:
        count = 0

        def score(many: Any) -> list[float]:
            nonlocal count
            count += len(many)
            return [(one["a"] - 0.3) ** 2 + (one["b"] - 0.6) ** 2 for one in many]

        with searching.opened(path, {"study": "x"}, {"a": 0.1, "b": 0.9}, 1) as search:
            best = search.run(score, 25, lambda n, v: None)
        return count, dict(best)

    whole_count, whole_best = run(tmp_path / "whole")
    assert whole_count == 25
    whole, chance = (tmp_path / "whole").read_bytes(), random.Random(36)
    lines = whole.count(b"\n")
    assert lines == 26 and run(tmp_path / "whole") == (0, whole_best)
    for number in range(8):
        path, place = tmp_path / str(number), chance.randrange(whole.index(b"\n") + 1, len(whole) - 1)
        path.write_bytes(whole[:place])
        assert run(path)[0] == lines - whole[:place].count(b"\n")
        damaged = bytearray(whole)
        damaged[place] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        assert run(path)[0] in (1, 2)  # two, where the end of a line is damaged


def test_one_tuning_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "pi.tune"
    search = partial(searching.opened, path, {}, {"a": 0.5}, 1)
    with search(), pytest.raises(StudyError) as error, search():
        pass
    assert str(error.value) == f"{path}: in use: expected no other command that writes here"


@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
def test_a_killed_tuning_goes_on_by_the_same_command(tmp_path: Path) -> None:
    text = ensembles.TEXT + TUNE.replace("budget = 25", "budget = 12")
    study, out = studies.write(tmp_path, text), tmp_path / "out"
    command = ("tune", study, "-o", out, "-j", 1)
    file, tries = out / "pi.tune", 0
    for least in (2, 8):
        running, until = forked(tmp_path, *command), time.monotonic() + 60
        while time.monotonic() < until and not (file.is_file() and file.read_bytes().count(b"\n") >= least):
            time.sleep(0.01)
        os.killpg(running.pid, signal.SIGKILL)
        assert running.end() == -signal.SIGKILL, running.err
        with suppress(ProcessLookupError):
            while time.monotonic() < until:  # a worker that still ends holds the folder's lock
                os.killpg(running.pid, 0)
                time.sleep(0.01)
        assert file.read_bytes().count(b"\n") >= max(least, tries)  # nothing is lost
        tries = file.read_bytes().count(b"\n")
    last = forked(tmp_path, *command)
    assert (last.end(), last.err.count("Traceback")) == (0, 0)
    assert file.read_bytes().count(b"\n") == 13
    assert load(out / "study-tuned.toml").name == "study-tuned"


def test_gains_become_better_on_variants_that_the_search_has_not_seen(
    tmp_path: Path, usual: tuning.Tuned
) -> None:
    found = usual
    assert found.adopted and found.after.value < 0.8 and found.before.value == pytest.approx(1, abs=0.1)
    assert [one.ensemble.count for one in (found.sweep_before, found.sweep_after)] == [16, 16]
    # what the score says is what the runs give
    better = changed(study(tmp_path), dict(found.values))
    variant = found.sweep_after.ensemble.changes(3)
    alone = run_study(changed(better, variant), ["low/pi"]).runs[0].metrics["ripple_rad_s"]
    assert found.sweep_after.values[3, 0, 0] == alone
    before, after = found.sweep_before.values[:, 0, 0], found.sweep_after.values[:, 0, 0]
    assert found.after.value / found.before.value == pytest.approx(np.mean(after) / np.mean(before))


def test_what_must_hold_holds(tmp_path: Path, usual: tuning.Tuned) -> None:
    """The least ripple and the least current are two settings; a limit on the one moves the other."""
    effort = '[[metric]]\nname = "effort"\nkind = "ripple-rms"\nsignal = "i_q"\nlast = "0.2 s"\n'
    calm = effort + TUNE.replace('minimise = "ripple"', 'minimise = "effort"')

    def worst(tune: str) -> tuple[float, float]:
        (tmp_path / "pi.tune").unlink(missing_ok=True)
        found = tuned(tmp_path, tune).sweep_after.values[:, 0]
        return float(np.max(found[:, 0])), float(np.mean(found[:, 3]))

    least, (free, little) = float(np.max(usual.sweep_after.values[:, 0, 0])), worst(calm)
    limit = (least + free) / 2
    held, more = worst(calm + f'[[tune.hold]]\nmetric = "ripple"\nlimit = "{limit!r} rad/s"\n')
    assert least < 0.9 * free
    assert held <= 1.02 * limit  # on fresh variants, so nearly
    assert more > 1.02 * little


@pytest.mark.parametrize(
    ("gain", "lead", "kind"),
    [("0.1 A/rpm", "2 ms", "grows"), ("0.03 A/rpm", "2 ms", "may grow"), ("0.003 A/rpm", "2 ms", "settles")],
)
def test_growth_is_what_design_is_sure_of(tmp_path: Path, gain: str, lead: str, kind: str) -> None:
    changes = {"controller.pi-ilc.gain": gain, "controller.pi-ilc.lead": lead}
    changed_study = study(tmp_path, changes=changes)
    said = verdict(changed_study, "pi-ilc")
    assert said is not None and said.worst is not None and said.kind == kind
    expected = said.worst.factor - 1 if kind == "grows" else 0.0
    assert tuning.growth(changed_study, ["pi", "pi-ilc"]) == expected


def test_gains_with_which_learning_grows_are_not_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, usual: tuning.Tuned
) -> None:
    """The best ki is where a forecast is made to say that learning grows."""

    def ki(values: Mapping[str, Any]) -> float:
        return float(changed(study(tmp_path), dict(values)).controller["pi"].ki)

    most = ki({"controller.pi.ki": "0.4 A/rpm/s"})
    assert ki(usual.values) > most
    monkeypatch.setattr(tuning, "growth", lambda of, names: 0.2 * (of.controller["pi"].ki > most))
    found = tuned(tmp_path)
    assert found.adopted and found.after.growth == 0
    assert ki(found.values) <= most


def test_never_worse_than_where_it_began(tmp_path: Path, usual: tuning.Tuned) -> None:
    again = tuned(tmp_path, TUNE.replace("budget = 25", "budget = 2"), **dict(usual.values))
    assert not again.adopted or again.after.order < again.before.order
    assert again.adopted or again.chosen == {}


def test_over_the_nominal_plant(tmp_path: Path) -> None:
    found = tuned(tmp_path, TUNE.replace("variants = 4", 'over = "nominal"'))
    assert found.adopted and found.sweep_after.ensemble.count == tuning.NOMINAL_SEEDS
    assert list(found.sweep_after.ensemble.drawn) == ["seed"]


def test_keys_of_the_drive_are_tuned_for_all_controllers_at_once(tmp_path: Path) -> None:
    tune = TUNE + 'drive.current_loop.current_limit = ["1 A", "4 A"]\n'
    (found,) = tuning.subjects(study(tmp_path, tune))
    assert [knob.key for knob in found.knobs][-1] == "drive.current_loop.current_limit"
    assert found.pairs == [("low", "pi")]  # the controllers that are named


def test_the_command_writes_the_same_file_with_other_gains(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = ensembles.TEXT.replace('kp = "0.015 A/rpm"', 'kp = "0.015 A/rpm"   # by hand') + TUNE
    text = text.replace('reference = "300 rpm"', 'reference = { file = "speed.csv" }').replace("= 25", "= 6")
    (tmp_path / "speed.csv").write_text("time [s],speed [rpm]\n0,300\n1,300\n")
    path, out = studies.write(tmp_path, text), tmp_path / "out"
    code, said, err = cogless(capsys, "tune", path, "-o", out, "-j", 2)
    assert (code, err) == (0, "")
    made = (out / "study-tuned.toml").read_text()
    before, after = text.splitlines(), made.splitlines()
    assert after[0] == f"# By: cogless tune {path}"
    differ = [(old, new) for old, new in zip(before, after[1:], strict=True) if old != new]
    assert ('reference = { file = "speed.csv" }', 'reference = { file = "../speed.csv" }') in differ
    assert all("= 0.0" in new or "A/rpm" in new or "csv" in new for _, new in differ)
    assert "# by hand" in made
    assert {key: value for key, value in load(out / "study-tuned.toml").controller["pi"]} != {
        key: value for key, value in load(path).controller["pi"]
    }
    assert {p.name for p in out.iterdir()} >= {"study-tuned.toml", "sweep.parquet", "report.html", "pi.tune"}
    assert "controller.pi.kp = " in said and "over 16 fresh variants" in said
    assert tomllib.loads(made)["title"] == "A small ensemble"


MISTAKES = {
    ('"ripple"', '"riple"'): 'tune.minimise: "riple": expected one of ripple, speed.24, speed.48',
    ('"ripple"', '"speed"'): 'tune.minimise: "speed": expected one of ripple, speed.24, speed.48',
    ("pi.kp =", "po.kp ="): "tune.keys: ",
    ("pi.kp =", "pi.kq ="): "tune.keys: controller.pi.kq: ",
    ('"0.06 A/rpm"', '"0.001 A/rpm"'): (
        'tune.keys.controller.pi.kp: ["0.005 A/rpm", "0.001 A/rpm"]: '
        "expected a range whose second limit is above its first"
    ),
    ('"0.06 A/rpm"', '"0.01 A/rpm"'): (
        'tune.keys.controller.pi.kp: ["0.005 A/rpm", "0.01 A/rpm"]: '
        'expected a range that contains the study\'s own value, "0.015 A/rpm"'
    ),
    (
        '"0.06 A/rpm"',
        '"0.06 V"',
    ): 'tune.keys.controller.pi.kp: "0.06 V": expected a number with a unit like "A/rpm"',
    ('controller.pi.ki = ["0.05 A/rpm/s", "2 A/rpm/s"]', 'mechanics.coulomb_friction = ["0 N*m", "1 N*m"]'): (
        'tune.keys.mechanics.coulomb_friction: ["0 N*m", "1 N*m"]: '
        "expected a key that has a value in the study, from which tuning begins"
    ),
    ("variants = 4", 'scenarios = ["high"]'): 'tune.scenarios: "high": expected one of low',
    ("variants = 4", 'hold = [{ metric = "x", limit = 1 }]'): 'tune.hold: "x": expected one of ripple, ',
    ("variants = 4", 'hold = [{ metric = "ripple", limit = "1 A" }]'): (
        'tune.hold: ripple_rad_s: "1 A": expected an angular speed, such as "1 rpm"'
    ),
}


@pytest.mark.parametrize("change", MISTAKES)
def test_mistakes_are_one_line_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str]
) -> None:
    path = studies.write(tmp_path, ensembles.TEXT + TUNE.replace(*change, 1))
    code, said, err = cogless(capsys, "tune", path, "-o", tmp_path / "out")
    assert (code, said, len(err.splitlines())) == (2, "", 1)
    assert err.startswith(f"{path}: {MISTAKES[change]}")
    assert not (tmp_path / "out").exists()


def test_files_that_a_tuned_study_names_are_named_from_where_it_stands(tmp_path: Path) -> None:
    """Those at the keys of files; any other text stays as it is, though a file may have its name."""
    home, out = tmp_path / "home", tmp_path / "out"
    for folder in (home, out):
        folder.mkdir()
    (home / "notes").touch()
    (home / "speed.csv").write_text("time [s],speed [rpm]\n0,300\n1,300\n")
    (home / "law.py").write_text("class Law:\n    def step(self, inputs):\n        return 0.0\n")
    own = '[controller.own]\nlaw = "python"\nobject = "law.py:Law"\nlabel = "notes"\n'
    own += 'params = { table = "notes" }\n'
    text = ensembles.TEXT.replace(
        'title = "A small ensemble"', 'title = "notes"\ndescription = "../home/notes"'
    )
    text = text.replace('reference = "300 rpm"', 'reference = { file = "speed.csv" }') + own
    study = studies.study(home, None, text)
    changes = {"controller.pi.kp": "0.02 A/rpm", "scenario.low.reference.file": str(home / "speed.csv")}
    for by, reference in (({}, "../home/speed.csv"), (changes, str(home / "speed.csv"))):
        tuned = out / "tuned.toml"
        tuned.write_text(searching.study_file_text(study, by, out, "By: a test"))
        tables = load(tuned).source.tables
        assert tables["scenario"]["low"]["reference"] == {"file": reference}
        assert tables["title"] == "notes" and tables["description"] == "../home/notes"
        found = tables["controller"]["own"]
        assert found["object"] == "../home/law.py:Law"
        assert found["label"] == "notes" and found["params"] == {"table": "notes"}


def test_a_study_without_tune(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = studies.write(tmp_path, ensembles.TEXT)
    code, _, err = cogless(capsys, "tune", path, "-o", tmp_path)
    assert (code, err) == (2, f"{path}: tune: missing: expected a table with keys, minimise, ...\n")


def test_a_range_of_a_decade_is_searched_by_ratios() -> None:
    ratio = tuning.Knob("k", "", 0.01, 0.1, 0.02)
    assert ratio.by_ratio and ratio.value_at(0.5) == pytest.approx(0.01 * 10**0.5, rel=1e-4)
    assert (ratio.value_at(0.0), ratio.value_at(1.0), ratio.start_text) == (0.01, 0.1, 0.02)
    assert ratio.start_share == pytest.approx(np.log10(2))
    line = tuning.Knob("k", "A/rpm", 0.02, 0.19, 0.1)
    assert not line.by_ratio and line.value_at(0.5) == "0.105 A/rpm" and line.start_text == "0.1 A/rpm"
    assert line.start_share == pytest.approx(0.08 / 0.17)
    assert not tuning.Knob("k", "", 0.0, 1.0, 0.5).by_ratio
    for knob in (ratio, line):
        assert float(str(knob.value_at(knob.start_share)).split()[0]) == pytest.approx(knob.start)


def scores(folder: Path, lines: str, *ripples: list[float]) -> list[tuning.Score]:
    """Scores of a PI with these ripples, rad/s, in four variants; its 24th order is 0.3 rad/s in each."""
    found = study(folder, TUNE.replace("variants = 4", lines))
    (subject,), ensemble = tuning.subjects(found), draw(found, 4)
    evaluation = tuning.Evaluation(found, subject, ensemble, executor_workers(Here()))
    values = np.full((len(ripples), 4, 1, 3), 0.3)
    values[:, :, 0, 0] = ripples
    sweeps = [Sweep(found, ensemble, subject.pairs, evaluation.columns, each, {}) for each in values]
    return [evaluation.score(sweep, {}) for sweep in sweeps]


@pytest.mark.parametrize(("over", "value"), [('"mean"', 4 / 5.5), ('"worst"', 7 / 8), ("0.5", 3 / 6)])
def test_a_score_is_a_share_of_the_first(tmp_path: Path, over: str, value: float) -> None:
    first, other = scores(tmp_path, f"over = {over}", [2.0, 6.0, 6.0, 8.0], [3.0, 3.0, 3.0, 7.0])
    assert first == tuning.Score(0.0, 1.0, 0.0)
    assert other.value == pytest.approx(value)


@pytest.mark.parametrize("first", [[0.0] * 4, [1.0, 1.0, 1.0, np.nan]])
def test_a_score_beside_a_first_of_zero_or_none_is_in_si(tmp_path: Path, first: list[float]) -> None:
    assert scores(tmp_path, "", first, [3.0, 3.0, 3.0, 7.0])[1].value == 4.0


def test_limits_are_missed_by_shares_of_themselves(tmp_path: Path) -> None:
    """All variants, or as many as [tune] says; of a limit of zero there is no share."""

    def violation(*hold: str) -> float:
        of = ", ".join(f"{{ metric = {each} }}" for each in hold)
        return scores(tmp_path, f"hold = [{of}]", [1.0, 2.0, 3.0, 6.0])[0].violation

    assert violation('"ripple", limit = "4 rad/s"') == pytest.approx(0.5)
    assert violation('"ripple", limit = "4 rad/s", share = 0.75') == 0
    assert violation('"ripple", limit = "2 rad/s", share = 0.75') == pytest.approx(0.5)
    assert violation('"speed.24", limit = "0 rad/s"') == pytest.approx(0.3)
    assert violation('"speed.24", limit = "0.2 rad/s"', '"ripple", limit = "4 rad/s"') == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("limits", "low", "high"),
    [("[32, 128]", 32, 128), ("[16.5, 1024]", 17, 1024), ('["-50 %", "50 %"]', 32, 96)],
)
def test_keys_of_whole_numbers_are_tuned(tmp_path: Path, limits: str, low: int, high: int) -> None:
    tune = TUNE[: TUNE.index("[tune.keys]")].replace("25", "6") + "[tune.keys]\ncontroller.pi-ilc.cells = "
    found = tuned(tmp_path, tune + limits)
    (knob,) = found.subject.knobs
    assert (knob.value_at(0.0), knob.value_at(1.0), knob.start_text) == (low, high, 64)
    for share in np.linspace(0, 1, 41):
        value = knob.value_at(share)
        assert type(value) is int and low <= value <= high
        changed(study(tmp_path), {knob.key: value})
    (value,) = found.values.values()
    assert type(value) is int and not found.sweep_after.errors
    assert f"cells = {value}  # was 64" in tuning.outcome_lines(found)[1]


def test_a_range_without_two_whole_numbers_is_refused(tmp_path: Path) -> None:
    tune = TUNE[: TUNE.index("[tune.keys]")] + "[tune.keys]\ncontroller.pi-ilc.cells = [63.5, 64.5]"
    with pytest.raises(
        StudyError, match=r"cells: \[63.5, 64.5\]: expected a range that contains two or more whole numbers"
    ):
        tuning.subjects(study(tmp_path, tune))


def test_who_misses_a_limit_is_worse_than_all_who_do_not() -> None:
    good, slow, misses, grows = (
        tuning.Score(0.0, 0.5), tuning.Score(0.0, 1e9), tuning.Score(0.1, 0.1), tuning.Score(0.0, 0.1, 0.2)
    )  # fmt: skip
    ranked = sorted((grows, misses, slow, good), key=lambda score: score.order)
    assert ranked == [good, slow, misses, grows]
    found = [tuning._penalised(score) for score in (good, slow, misses, grows, tuning.Score(np.inf, 1.0))]
    assert found == pytest.approx([0.5, 1e6, 1.1e6, 1.2e6, 1e6 * (1 + 1e6)])


def test_the_outcome_is_told_with_what_it_was(usual: tuning.Tuned) -> None:
    knob = tuning.Knob("controller.pi.kp", "A/rpm", 0.005, 0.06, 0.015)
    subject = tuning.Subject("pi", [knob], [("low", "pi")])

    def told(before: tuning.Score, after: tuning.Score) -> list[str]:
        values = {knob.key: "0.02 A/rpm"}
        sweeps = usual.sweep_before, usual.sweep_after
        return tuning.outcome_lines(tuning.Tuned(subject, values, before, after, *sweeps))

    first = 'controller.pi.kp = "0.02 A/rpm"  # was "0.015 A/rpm"'
    worth = "of the value before, over 16 fresh variants"
    assert told(tuning.Score(0, 1.0), tuning.Score(0, 0.876)) == [f"pi: now 87.6 % {worth}", first]
    assert told(tuning.Score(0.5, 1.0), tuning.Score(0.25, 0.9))[0] == (
        f"pi: now 90.0 % {worth}; it was beyond the limits by 50.0 %, and is now by 25.0 % "
        "(sum, in % of each limit)"
    )
    assert told(tuning.Score(0, 1.0), tuning.Score(0, 1.0))[0] == (
        f"pi: now 100.0 % {worth}; this is not better, so the values stay as they were"
    )
