"""The answer of `cogless design`, a block a controller: yes or no, and why."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
import trial_studies

import studies
from cogless import load
from cogless.design.answers import Answer, AnswerVerdict, _rounded_time, answer
from cogless.design.blocks import margin_words
from cogless.design.closed_loop import Oscillation
from cogless.design.learning_loop import Worst
from cogless.design.margins import UNSTABLE, Margins
from cogless.design.speed_blocks import speed_blocks
from cogless.design.summary import Design, design
from cogless.design.trials.trial_blocks import trial_blocks, why_not
from cogless.design.trials.trial_summary import summary
from cogless.design.verdict import Verdict
from cogless.study import Study, TrialStudy
from cogless.study.reading import Remark

FADES, RISES, SWINGS = Worst(0.9, 50.0), Worst(1.2, 50.0), Oscillation(88.0, 1.0)
LATER = r"; it may take longer \(the estimate leaves out dead time, current noise"
LATE = r" \(scenario slow lasts only 60 s\)"
YES = rf"yes, in about \d+ s at 15 rpm{LATE} and [\d.]+ s at 240 rpm{LATER}\)"
END = "$"  # 25000 rpm, up to which it would learn, are more than the voltage reaches


@pytest.fixture(scope="module")
def uomodri() -> Study:
    study = load("uomodri", studies.HARMONIC)
    assert isinstance(study, Study)
    return study


def words_of(study: Study, name: str, made: Design) -> str:
    said = answer(study, name, made)
    assert said is not None and said.verdict in get_args(AnswerVerdict)
    assert said.words.startswith((said.verdict, "it learn"))
    return said.words


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (Verdict("settles", FADES), YES + END),
        (Verdict("settles", FADES, ratio=1.9),
            f"{YES}, but leaves 1.9 times the speed ripple of its feedback alone{END}"),
        (Verdict("settles", FADES, doubts=(Remark("few counts"),)),
            f"{YES}; this is not sure: few counts{END}"),
        (Verdict("grows", RISES, remedy=Remark("learning settles with lead = 1")),
            "no, because what it learns grows by a factor of 1.2 per period at 50 Hz; learning settles with "
            "lead = 1$"),
        (Verdict("may grow", RISES),
            "no, because what it learns may grow by a factor of 1.2 per period at 50 Hz$"),
        (Verdict("unstable", unstable=SWINGS),
            "no, because it is unstable with the feedback that learning adds, at 88 Hz$"),
        (
            Verdict("may be unstable", unstable=SWINGS),
            "no, because it may be unstable with the feedback that learning adds, at 88 Hz, where K_t is "
            "largest$",
        ),
        (Verdict("feedback unstable", unstable=SWINGS, remedy=Remark("the feedback is stable with kp = 1")),
            "no, because its feedback is unstable, at 88 Hz; the feedback is stable with kp = 1$"),
        (Verdict("rests", frozen=("too few samples",)), "it learns nothing; too few samples$"),
        (Verdict("not judged", doubts=(Remark("it snaps"),)), "not judged: it snaps$"),
        (None, "not judged: the law is the study's own code$"),
    ],
)  # fmt: skip
def test_the_answer_says_yes_or_no_and_why(uomodri: Study, verdict: Verdict | None, expected: str) -> None:
    said = words_of(uomodri, "pi-ilc", replace(design(uomodri, "pi-ilc"), learning=verdict))
    assert re.match(expected, said), said


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, rf"yes, orders 6, 12, \.\.\., \d+, in about .*{LATER}, .*\)$"),
        ({"gamma": -0.1}, "no, because at 15 rpm some orders may not converge if the inertia is 50 % off"),
        (
            {"most": 0.25},
            "no, because at 15 rpm the learning rate is .* 1/s, but learning all orders together is stable "
            "only up to 0.25 1/s$",
        ),
        ({"snaps": "the rotor snaps"}, "no, because the rotor snaps$"),
    ],
)
def test_the_answer_of_harmonic_is_its_certificate_s(
    uomodri: Study, change: dict[str, Any], expected: str
) -> None:
    whole = design(uomodri, "harmonic")
    assert whole.certificate is not None
    slow, *others = whole.certificate.speeds
    certificate = replace(whole.certificate, speeds=(replace(slow, **change), *others))
    said = words_of(uomodri, "harmonic", replace(whole, certificate=certificate))
    assert re.match(expected, said), said


def test_where_all_speeds_snap_the_certificate_says_it(uomodri: Study) -> None:
    whole = design(uomodri, "harmonic")
    assert whole.certificate is not None
    speeds = tuple(replace(speed, snaps="since the rotor snaps") for speed in whole.certificate.speeds)
    certificate = replace(whole.certificate, speeds=speeds)
    said = words_of(uomodri, "harmonic", replace(whole, certificate=certificate))
    assert said == certificate.in_words() == "not judged: since the rotor snaps"


def test_only_what_learns_is_asked_whether_it_settles(uomodri: Study) -> None:
    found = {block.heading: dict(block.rows) for block in speed_blocks(uomodri).blocks}
    assert list(found) == [
        "PI (pi, phase-margin)",
        "Anti-cogging table (anti-cogging, phase-margin)",
        "PI-ILC (pi-ilc, phase-margin)",
        "Robust ILC (robust-ilc)",
        "harmonic (harmonic, auto)",
        "current loop",
    ]
    assert "settles" not in found["PI (pi, phase-margin)"] and "settles" not in found["current loop"]
    table = found["Anti-cogging table (anti-cogging, phase-margin)"]
    assert table["settles"] == "it learned before the run, and does not learn during the run"
    assert found["harmonic (harmonic, auto)"]["gains"].count(",") == 1  # kp and ki; the rest is in --long
    assert "b 4.393e+04 rpm/s/A" in found["Robust ILC (robust-ilc)"]["gains"]


@pytest.mark.parametrize(
    ("words", "verdict", "reason"),
    [
        ("yes", "yes", ""),
        ("yes; it learns up to 9 rpm", "yes", "it learns up to 9 rpm"),
        ("no, because it grows by a factor of 1.2", "no", "it grows by a factor of 1.2"),
        ("not judged: it snaps", "not judged", "it snaps"),
        ("not worth it: at 5 rpm it leaves 2 rpm", "not worth it", "at 5 rpm it leaves 2 rpm"),
        ("it learns nothing; frozen", "no", "it learns nothing; frozen"),
    ],
)
def test_an_answer_has_a_verdict_and_its_reason(words: str, verdict: AnswerVerdict, reason: str) -> None:
    assert Answer(verdict, words).reason == reason


@pytest.mark.parametrize(
    ("time", "words"),
    [(0.234, "0.23 s"), (0.34, "0.3 s"), (1.23, "1.2 s"), (2.4, "2.4 s"), (2.96, "3 s"), (84.0, "80 s")],
)
def test_a_time_is_told_as_well_as_it_is_known(time: float, words: str) -> None:
    assert _rounded_time(time) == words


def test_margins_in_words() -> None:
    assert margin_words(None) == "not known: the law is the study's own code"
    assert margin_words(UNSTABLE) == "unstable"
    whole = Margins(True, 628.3185, 1.0471976, 6.5, 6283.185)
    assert margin_words(whole) == "phase 60 deg at 100 Hz, gain 6.50 at 1000 Hz"
    nan = float("nan")
    assert margin_words(replace(whole, gain_margin=nan)) == "phase 60 deg at 100 Hz, no limit of gain"
    assert margin_words(replace(whole, crossover=nan)) == "gain 6.50 at 1000 Hz"


def test_the_answer_of_trials_that_are_certified() -> None:
    study = load("mandra2019")
    assert isinstance(study, TrialStudy)
    found = {block.heading: dict(block.rows) for block in trial_blocks(study, summary(study)).blocks}
    counts = "the error stops falling after 3, 7, 3, 10 trials in the scenario's 4 phases"
    share = r"at the end of each phase at most 2\.07 % of "
    assert re.match(f"yes, certified; {counts}; {share}", found["ILC, Fig. 1"]["settles"])
    assert "settles" not in found["no learning"] and "K_3" not in found["no learning"]["gains"]


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({}, r"no, because in this scenario learning may leave 1\.07 times the error without learning$"),
        (
            {"drive.current_loop.current_limit": "0.5 A"},
            r"no, because at .+ the motion needs an input of [\d.]+, above the limit of 0\.5$",
        ),
    ],
)
def test_the_answer_of_trials_that_are_not(tmp_path: Path, changes: dict[str, Any], answer: str) -> None:
    study = trial_studies.loaded(tmp_path, changes)
    ilc, feedback = (dict(block.rows) for block in trial_blocks(study, summary(study)).blocks)
    assert re.match(answer, ilc["settles"]), ilc["settles"]
    assert "settles" not in feedback and "K_3" in ilc["gains"]


def test_why_a_trial_s_design_is_not_certified(tmp_path: Path) -> None:
    """What is worst is told, even where it isn't the only reason."""
    whole = summary(trial_studies.loaded(tmp_path)).designs["ilc"]
    part, side = whole.certificate.deciding, whole.certificate.decides
    assert part.with_filter is not None

    def reason(**changes: Any) -> str | None:
        models: Any = {side: replace(part, **changes)}
        return why_not(replace(whole, certificate=replace(whole.certificate, **models)))

    growing = replace(part.with_filter, monotone=False, contracting=False, norm=1.2, frequency=50.0)
    assert reason(stable=False, radius=1.02) == (
        f"within a trial the feedback loop is unstable for {part.worst} (largest magnitude of a pole 1.02)"
    )
    assert reason(with_filter=growing) == "an error may grow from trial to trial, at 50 Hz by the factor 1.2"
    assert reason(with_filter=None, without_filter=None) == "no K_3 makes every error smaller"
    assert why_not(replace(whole, beyond=("K_t is outside",))) == "K_t is outside"
    assert why_not(replace(whole, prediction=None)) == "the scenario can't be predicted"
