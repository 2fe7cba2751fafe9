"""What a study of trials says of many changes, of runs that diverge or saturate, and of how runs ended."""

import re
from dataclasses import replace
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
import synthetic
import trial_studies

from cogless.cli.printed import print_results
from cogless.design.trials.from_study import design_study
from cogless.design.trials.trial_summary import labelled_notes, megabytes
from cogless.report import lines, outcome, render, verdict, verdicts
from cogless.report.charts import to_page
from cogless.report.phases import NAMED_MOST, Phase, after, groups, phases
from cogless.report.trial_case import case, own_lines, same_size, than
from cogless.report.trials import over_trials, waveforms
from cogless.results.trace import Trace
from cogless.run.simulate import run_study

room = import_module("cogless.report.trial_verdict")  # its package has a function of this name
ILC = "“ILC, Fig. 1”"
TRIALS = 60
FALLS = np.tile(np.hypot(3e-3 * 0.3 ** np.arange(20.0), 0.5e-3), 3)
GROWS = 0.4e-3 * 1.1 ** np.arange(float(TRIALS))
STAYS = np.full(TRIALS, 5e-3)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return synthetic.study(tmp_path_factory.mktemp("study"), synthetic.TRIALS)


@pytest.fixture(scope="module")
def of_left(tmp_path_factory):
    """The study without a floor: judged by what is left."""
    begin = synthetic.TRIALS.index('[[metric]]\nname = "to_floor"')
    end = synthetic.TRIALS.index('[[metric]]\nname = "peak"')
    return synthetic.study(tmp_path_factory.mktemp("left"), synthetic.TRIALS[:begin] + synthetic.TRIALS[end:])


def headline(the_study, **rms):
    (verdict,) = verdicts(synthetic.trial_results(the_study, rms, designed=False))
    return verdict.headline


def with_signals(results, **columns):
    """The results with other signals, each a function of the controller's name."""

    def longer(run):
        own = {name: run.trace[name] for name in run.trace.names if name not in columns}
        own |= {name: np.broadcast_to(f(run.controller), len(run.trace)) for name, f in columns.items()}
        return replace(run, trace=Trace(tuple(own), ("",) * len(own), np.column_stack([*own.values()])))

    return replace(results, runs=[longer(run) for run in results.runs])


def at_limit(run_length, trials):
    """The status of a run whose input is at its limit at one sample of its first `trials` trials."""
    status = np.zeros(run_length)
    status[: trials * (run_length // TRIALS) : run_length // TRIALS] = 1.0
    return status


# --- a ranking without those that diverge


def test_the_ranking_says_whom_it_leaves_out(study):
    assert headline(study, ilc=FALLS, input=GROWS, none=STAYS).endswith(
        "no learning never reaches it. ILC into the input is not ranked: its error grows over the trials."
    )
    assert headline(study, ilc=GROWS, input=GROWS, none=STAYS).endswith(
        f"{ILC} and ILC into the input are not ranked: their errors grow over the trials."
    )
    assert "ranked" not in headline(study, ilc=FALLS, input=FALLS, none=STAYS)
    assert "ranked" not in headline(study, ilc=GROWS, input=GROWS, none=GROWS)


def test_one_that_diverges_is_never_the_next(study, of_left):
    """Though it was at the floor sooner than others, or has less error at the end than they have."""
    slow = np.tile(np.hypot(30e-3 * 0.6 ** np.arange(20.0), 0.5e-3), 3)
    assert "; the next, ILC into the input, takes up to" in headline(study, none=FALLS, ilc=GROWS, input=slow)
    said = headline(of_left, none=STAYS, ilc=0.1 * GROWS, input=2 * STAYS)
    assert "; the next, ILC into the input, with 10.0 mrad." in said and f"{ILC} is not ranked" in said


def test_a_floor_that_only_one_that_diverges_was_at_is_not_called_unreached(study):
    assert headline(study, none=STAYS, ilc=GROWS, input=STAYS).startswith(
        "No controller stays at the floor of 1.00 mrad RMS."
    )
    assert headline(study, none=STAYS, ilc=STAYS, input=STAYS).startswith("No controller reaches the floor")


def test_the_only_one_that_does_not_diverge_has_nobody_behind(study):
    said = headline(study, none=FALLS, ilc=GROWS, input=GROWS)
    assert said.startswith("No controller beats no learning: it is at the floor of 1.00 mrad RMS within")
    assert "the next" not in said


# --- the limit


@pytest.mark.parametrize(
    ("trials", "share"), [(60, "every trial"), (30, "30 of 60 trials"), (29, None), (0, None)]
)
def test_the_best_is_not_called_best_without_its_limit(study, trials, share):
    made = synthetic.trial_results(study, {"ilc": FALLS, "none": STAYS, "input": STAYS}, designed=False)
    length = len(made.runs[0].trace)
    made = with_signals(made, status=lambda name: at_limit(length, trials if name == "ilc" else 0))
    (verdict,) = verdicts(made)
    but = f" But the input of {ILC} is at its limit in {share}."
    assert verdict.headline.endswith(but if share else "no learning never reaches it.")
    assert verdict.tone == ("even" if trials == TRIALS else "better")
    every = f"The input is at its limit, where nothing is learned: {ILC} in {trials} of 60 trials."
    assert (every in verdict.details) == (trials > 0)


def test_the_current_of_the_best_stands_beside_the_baseline_s(study):
    made = synthetic.trial_results(study, {"ilc": FALLS, "none": STAYS}, designed=False)
    current = {"none": 2.0, "ilc": 3.0, "input": 2.0}
    made = with_signals(made, i_q_ref=lambda name: current[name])
    (verdict,) = verdicts(made)
    assert f"{ILC} needs 3.00 A RMS of current, 1.50 times more than no learning." in verdict.details
    current["ilc"] = 2.05
    made = with_signals(synthetic.trial_results(study, {"ilc": FALLS}, designed=False), i_q_ref=current.get)
    assert f"{ILC} needs 2.05 A RMS of current, as much as no learning." in verdicts(made)[0].details


def test_the_table_has_current_and_trials_at_the_limit(study):
    """The current of the phase that takes most at its end; both lines stand below the study's metrics."""
    made = synthetic.trial_results(study, designed=False)
    length = len(made.runs[0].trace)
    steps = np.repeat([2.0, 9.0, 3.0, 4.0, 9.0, 1.0], length // 6)  # halves of three phases
    made = with_signals(made, i_q_ref=lambda _: steps, status=lambda _: at_limit(length, 7))
    rms, limited = own_lines(case(made, made.runs))[-2:]
    assert (rms.title, rms.value_text("ilc")) == ("current rms at the end, worst phase", "9.00 A")
    assert (limited.title, limited.value_text("ilc")) == ("trials at the current limit, of 60", "7")
    assert not rms.best and rms.ratio("ilc", "none") is None
    page = render(made)
    assert page.index("first error") < page.index(rms.title) < page.index(limited.title)


def test_what_is_left_without_learning_stands_in_the_table(tmp_path):
    """Of a law that learns, in the phase where it is worst itself."""
    results = run_study(trial_studies.loaded(tmp_path))
    judged = case(results, results.runs)
    line = own_lines(judged)[0]
    assert line.title == "error rms without learning at the end, worst phase"
    (ilc,) = (run for run in results.runs if run.controller == "ilc")
    rms = np.sqrt(np.mean(ilc.feedback["theta_error"].reshape(3, -1) ** 2, axis=1))
    assert line.values == {"ilc": pytest.approx(rms[judged.worst_phase("ilc")])}


def test_many_trials_above_the_feedback_are_said_though_the_end_is_below(study):
    """Up to five in a row are none too many; an end above is said by another sentence."""

    def said(rms):
        made = synthetic.trial_results(study, {"ilc": rms, "none": STAYS}, designed=False)
        judged = case(made, made.runs)
        judged.__dict__["feedback"] = {"ilc": [4.0, 4.0, 4.0]}
        return room._above_for_long(judged, "ilc")

    rms = FALLS.copy()
    rms[22:28] = 7e-3, 8e-3, 9e-3, 8e-3, 7e-3, 4.3e-3
    assert said(rms) == (
        f"{ILC} is worse than its feedback alone in 6 trials in a row: up to 9.00 mrad RMS in trial 25, "
        "against 4.00 mrad."
    )
    rms[27] = 4.1e-3  # as much
    assert said(rms) == ""
    rms[22:40] = 9e-3
    assert said(rms) == ""


@pytest.mark.parametrize(
    ("final", "where"),
    [
        ([2.0, 5.0, 6.0], " in 2 of 3 phases, most after the change of reference and inertia (trial 41)"),
        ([2.0, 3.0, 6.0], " in 1 of 3 phases, after the change of reference and inertia (trial 41)"),
        ([9.0, 9.0, 6.0], " in 3 of 3 phases, most after the change of reference and inertia (trial 41)"),
    ],
)
def test_one_that_ends_above_its_feedback_says_in_how_many_phases(study, final, where):
    """And where it is worst, by the ratio to that feedback."""
    made = synthetic.trial_results(study, designed=False)
    judged = case(made, made.runs)
    judged.__dict__["final"] = {"ilc": final}
    judged.__dict__["feedback"] = {"ilc": [4.0, 4.0, 2.0]}
    assert room._against_its_feedback(judged, "ilc", "none") == (
        f"{ILC} is worse than without learning{where}: it ends with 6.00 mrad RMS, and its feedback alone "
        "with 2.00 mrad."
    )


def test_controllers_that_lack_a_certificate_for_one_reason_share_a_sentence(tmp_path):
    """The motion needs more current than there is, for any controller; the number has its unit."""
    limit = {
        "drive.current_loop.current_limit": "1.6 A",
        "controller.twin": {"law": "trial-ilc", "q_filter": {"cutoff": "30 Hz"}},
    }
    results = run_study(trial_studies.loaded(tmp_path, limit))
    (verdict,) = verdicts(results)
    (sentence,) = (each for each in verdict.details if "not certified" in each)
    assert re.fullmatch(
        r"(ilc and twin|twin and ilc) are not certified: by the models the motion needs \d\.\d\d A at "
        r"mechanics\.inertia = \S+, but the limit is 1\.60 A\.",
        sentence,
    )


# --- many changes


def test_changes_alike_are_one_group_if_they_are_many():
    def made(count):
        return [Phase(1, 2, ()), *(Phase(n, n + 1, ("start",)) for n in range(2, count + 2))]

    few, many = groups(made(NAMED_MOST)), groups(made(NAMED_MOST + 1))
    assert [group.name for group in few] == ["start", "trial 2: start", "trial 3: start", "trial 4: start"]
    assert [group.name for group in many] == ["start", "trial 2: 4 start changes"]
    assert [group.row for group in many] == ["from trial 1", "worst of 4 start changes from trial 2"]
    assert [phase.start for phase in many[1].drawn] == [2, 5]
    other = [*made(30), Phase(32, 40, ("load", "mechanics.inertia")), Phase(40, 50, ("load",))]
    assert [group.start for group in groups(other)] == [1, 2, 32, 40]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ([1], "after the load change (trial 2)"),
        ([0, 1], "from the start and after the load change (trial 2)"),
        ([1, 2, 3], "after the load change (trial 2), after the load change (trial 3) and after the load "
         "change (trial 4)"),
        ([1, 2, 3, 4], "after 4 of 6 load changes"),
        ([0, 1, 2, 3, 4, 7], "from the start, after 4 of 6 load changes and after the change of load and "
         "inertia (trial 8)"),
        ([1, 2, 3, 4, 5, 6], "after all 6 load changes"),
    ],
)  # fmt: skip
def test_phases_in_a_sentence_are_counted_if_they_are_many(numbers, words):
    every = [Phase(n + 1, n + 2, ("load",) if n else ()) for n in range(7)]
    every.append(Phase(8, 9, ("load", "mechanics.inertia")))
    assert after([every[n] for n in numbers], every) == words


@pytest.fixture(scope="module")
def thirty(tmp_path_factory):
    """A drive whose start is somewhere else from each second trial on, thirty times."""
    text, starts = trial_studies.DRIVE, np.random.default_rng(3).uniform(-0.02, 0.02, 30)
    changes = ",\n".join(
        f'{{ trial = {2 * n + 2}, initial_angle = "{x:.5f} rad" }}' for n, x in enumerate(starts)
    )
    begin, end = text.index("changes = ["), text.index("[controller.ilc]")
    text = text[:begin] + f"changes = [{changes}]\n" + text[end:]
    text = text.replace("trials = 12", "trials = 62") + (
        '[[metric]]\nname = "final"\nkind = "final-rms"\nsignal = "theta_error"\nunit = "mrad"\n'
    )
    return run_study(trial_studies.loaded(tmp_path_factory.mktemp("thirty"), text=text))


def test_thirty_changes_make_one_row_one_mark_and_one_button(thirty):
    titles = [line.title for line in lines(thirty, "move")]
    assert titles == [
        "to floor, from trial 1",
        "to floor, worst of 30 start changes from trial 2",
        "final, from trial 1",
        "final, worst of 30 start changes from trial 2",
    ]
    values = {run.controller: run.metrics["final_rad"] for run in thirty.runs}
    worst = lines(thirty, "move")[-1]
    assert worst.values == {name: pytest.approx(1e3 * max(of[1:])) for name, of in values.items()}
    over = to_page(over_trials(thirty, thirty.runs))
    assert over["marks"] == [{"trial": 2, "name": "trial 2: 30 start changes"}]
    assert len(over["zooms"]) <= 3
    drawn = to_page(waveforms(thirty, thirty.runs))
    assert [phase["name"] for phase in drawn["phases"]] == ["start", "trial 2: start", "trial 60: start"]
    assert drawn["note"] == "Of the 30 start changes, the first and the last are drawn."


def test_thirty_changes_are_counted_in_the_verdict(thirty):
    (verdict,) = verdicts(thirty)
    for sentence in (verdict.headline, *verdict.details):
        assert sentence.count("after the start change") <= 2, sentence
        assert len(sentence) < 400, sentence


def test_a_row_of_many_changes_is_never_where_one_of_them_never_is(thirty):
    counts = {run.controller: run.metrics["to_floor"] for run in thirty.runs}
    row = lines(thirty, "move")[1]
    for name, of in counts.items():
        known = [x for x in of[1:] if x is not None and np.isfinite(x)]
        assert row.values[name] == (max(known) if len(known) == 30 else None)


# --- how each run ended


@pytest.mark.parametrize(
    ("value", "other", "words"),
    [
        (1.0, 46.0, "46.0 times less"),
        (46.0, 1.0, "46.0 times more"),
        (1.0, 1.05, "as much"),
        (1.05, 1.0, "as much"),
        (1.0, 1.06, "1.06 times less"),
        (1.0, 0.0, "infinitely more"),
        (np.nan, 1.0, "–"),  # noqa: RUF001
    ],
)
def test_a_value_against_another_in_words(value, other, words):
    assert than(value, other) == words
    assert same_size(value, other) == (words == "as much")


def test_the_terminal_says_how_each_run_ended(tmp_path, capsys):
    """Its numbers are those of the run: computed here from the traces, for a motion that needs more current
    than there is."""
    limit = {"drive.current_loop.current_limit": "1.6 A"}
    results = run_study(trial_studies.loaded(tmp_path, limit))
    by_name = {run.controller: run for run in results.runs}
    title, ends = verdict(results, "move").headline, outcome(results, "move")
    assert title == verdicts(results)[0].headline
    cells = dict(ends.rows)
    end_of = {}
    for name, run in by_name.items():
        rms = np.sqrt(np.mean(run.trace["theta_error"].reshape(12, -1) ** 2, axis=1))
        end = end_of[name] = max(np.sqrt(np.mean(rms[first + 2 : first + 4] ** 2)) for first in (0, 4, 8))
        current = np.sqrt(np.mean(run.trace["i_q_ref"].reshape(12, -1) ** 2, axis=1))
        most = max(np.sqrt(np.mean(current[first + 2 : first + 4] ** 2)) for first in (0, 4, 8))
        limited = np.any(run.trace["status"].reshape(12, -1).astype(int) & 1, axis=1).sum()
        assert float(cells[name][0]) == pytest.approx(rms[0], rel=5e-3)
        assert float(cells[name][1]) == pytest.approx(end, rel=5e-3)
        assert float(cells[name][4]) == pytest.approx(most, rel=5e-3)
        assert cells[name][5] == f"{limited} of 12" and limited > 0
    worst = max(
        range(3), key=lambda n: np.mean(np.square(by_name["ilc"].metrics["error_rad"][4 * n + 2 : 4 * n + 4]))
    )
    alone = by_name["ilc"].feedback["theta_error"].reshape(3, -1)[worst]
    alone_rms = np.sqrt(np.mean(alone**2))
    assert float(cells["ilc"][2]) == pytest.approx(alone_rms, rel=5e-3)
    assert cells["ilc"][3] == than(end_of["ilc"], alone_rms)
    assert cells["feedback"][2:4] == ["–", "–"]  # noqa: RUF001
    print_results(results)
    shown = capsys.readouterr().out
    assert title in shown and ends.note in shown and cells["ilc"][3] in shown


def test_a_study_with_values_of_trials_alone_has_a_table_too(tmp_path, capsys):
    """Neither does it claim to have no metric, nor explain a mark that it doesn't show."""
    results = run_study(trial_studies.loaded(tmp_path, text=trial_studies.LINEAR))
    print_results(results)
    shown = capsys.readouterr().out
    assert "no metric" not in shown and "* best" not in shown
    assert "ilc ends each phase with at most" in shown
    assert "RMS of the error and of the input." in shown


def test_words_fit_eighty_columns(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("cogless.lines.terminal_columns", lambda: 80)
    print_results(run_study(trial_studies.loaded(tmp_path)))
    shown = capsys.readouterr().out.splitlines()
    rows = [line for line in shown if line.startswith(("ilc ", "feedback ")) and " of 12" in line]
    assert len(rows) == 2 and all(len(line) <= 80 for line in shown)


# --- notes


def test_a_note_stands_with_its_own_controllers(tmp_path):
    """A note on K_3 is of those that learn with it, though others share their feedback."""
    ahead = {"q_filter": {"cutoff": "12 Hz", "acts_on": "signal"}, "shift": 3}
    twin = {"law": "trial-ilc", "label": "the same, twice", **ahead}
    changes = {f"controller.ilc.{key}": value for key, value in ahead.items()}
    study = trial_studies.loaded(tmp_path, changes | {"controller.twin": twin})
    designs = {
        name: design
        for (_, name), design in design_study(study, [("move", n) for n in study.controller]).items()
    }
    notes = labelled_notes(study, designs)
    of_gain = [note for note in notes if "K_3 was chosen by the frequency response" in note]
    assert len(of_gain) == 1 and of_gain[0].startswith(
        "ilc; the same, twice: K_3 was chosen by the frequency response"
    )
    assert not any("K_3" in str(note) for note in designs["feedback"].notes)
    for name, design in designs.items():
        for note in design.notes:
            for cure in note.cures:
                assert all(not key.startswith("controller.") or f".{name}." in key for key in cure)


def test_a_note_of_all_has_no_name(tmp_path):
    beyond = {"scenario.move.override": {"mechanics.inertia": "2e-3 kg*m^2"}}
    study = trial_studies.loaded(tmp_path, beyond)
    designs = {
        name: design
        for (_, name), design in design_study(study, [("move", n) for n in study.controller]).items()
    }
    assert any(note.startswith("scenario move, from trial 1:") for note in labelled_notes(study, designs))


@pytest.mark.parametrize(
    ("size", "text"), [(1_000_000, "1 MB"), (23_700_000, "23.7 MB"), (62_500, "0.0625 MB")]
)
def test_a_size_in_megabytes(size, text):
    assert megabytes(size) == text


def test_the_phases_of_many_changes_cover_all_trials(thirty):
    found = groups(phases(thirty.study.scenario["move"]))
    assert found[0].start == 1 and found[-1].stop == 63
    assert all(a.stop == b.start for a, b in pairwise(found))
