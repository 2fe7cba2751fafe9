"""The report of a study of trials: verdict, changes and floor, chosen trials, certificate, one page."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import synthetic
import trial_studies
from matplotlib.backends.backend_agg import FigureCanvasAgg
from test_report import Checker, data_of

from cogless.design.trials.certificate import Certificate, Learning, ModelCertificate
from cogless.design.trials.from_study import design_study
from cogless.design.trials.response import FiniteTrial
from cogless.design.trials.state_feedback import Check
from cogless.design.trials.trial_summary import _proof, verdict_line, warnings
from cogless.report import lines, page, render, trials, verdicts, write, write_plots
from cogless.report.charts import to_page
from cogless.report.markup import unpack
from cogless.report.phases import Phase, phases, zooms
from cogless.report.trial_case import case
from cogless.report.trial_certificate import certificate_table, close_to_one
from cogless.report.trials import _check, gain_table
from cogless.results import Run, TrialResults
from cogless.results.results_json import to_dict
from cogless.results.trace import Trace

ILC, FLOOR = "“ILC, Fig. 1”", "the floor of 1.00 mrad RMS"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return synthetic.study(tmp_path_factory.mktemp("study"), synthetic.TRIALS)


@pytest.fixture(scope="module")
def made(study):
    return synthetic.trial_results(study)


def without_floor(folder):
    """The study with neither a floor nor numbers a phase."""
    text = synthetic.TRIALS
    begin, end = text.index('[[metric]]\nname = "to_floor"'), text.index('[[metric]]\nname = "peak"')
    return synthetic.study(folder, text[:begin] + text[end:])


def alone(study, rms, **options):
    """The verdict on these RMS, mrad, without certificates."""
    values = {name: 1e-3 * np.asarray(x, dtype=float) for name, x in rms.items()}
    (verdict,) = verdicts(synthetic.trial_results(study, values, designed=False, **options))
    return verdict


def falls(start, factor=0.3, floor=0.5):
    """RMS of 60 trials of three phases that begin at `start`, mrad."""
    phase = np.hypot(start * factor ** np.arange(20.0), floor)
    return np.tile(phase, 3)


STAYS = np.full(60, 5.0)


def test_gains_say_how_they_were_found(tmp_path, made):
    """By LMIs with their check, or given: then there is no check to tell of."""
    here = trial_studies.loaded(
        tmp_path, {"controller.own": {"law": "trial-ilc", "K_s": [10.0, 1.0, 50.0], "K_3": 5.0}}
    )
    designed = design_study(here, [("move", "ilc"), ("move", "own")])
    runs = [Run("move", name, made.runs[0].trace, design=designed[("move", name)]) for name in ("ilc", "own")]
    text = re.sub(r"<[^>]+>", "|", gain_table(TrialResults(here, tuple(runs)), runs))
    row = re.search(r"K_1 and K_2 from(.*?)K_3 from", text, re.DOTALL)[1]
    assert "LMIs; checked" in row and row.count("given") == 1


@pytest.mark.parametrize(("passed", "word"), [(True, "checked"), (False, "CHECK FAILED")])
def test_a_check_of_gains_is_told_whatever_it_found(passed, word):
    told = f"{word}: cost at the worst vertex 2.00, expected 2.50 or less"
    assert _check(Check(1e-3, 2.0, 2.5, passed)) == told


def test_gains_have_their_names_and_units(made):
    """What a controller hasn't has a dash."""
    rows = re.findall(r"<tr>(.*?)</tr>", gain_table(made, made.runs))
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]
    named = {cell[0]: cell[1:] for cell in cells}
    ilc = made.runs[1].design
    assert [re.sub(r"<[^>]+>", "", label) for label in named.pop("")] == [
        "no learning (baseline)",
        "ILC, Fig. 1",
        "ILC into the input",
    ]
    assert named == {
        "K_1, theta_m (A/rad)": [f"{ilc.K_1[0]:.6g}"] * 3,
        "K_1, omega_m (A·s/rad)": [f"{ilc.K_1[1]:.6g}"] * 3,
        "K_2, integrator (A/rad)": [f"{ilc.K_2:.6g}"] * 3,
        "N (A/rad)": [f"{ilc.N:.6g}"] * 3,
        "K_3": ["–", "0.694", "0.694"],  # noqa: RUF001
        "feedforward": ["zero-phase error tracking, 2 samples ahead"] * 3,
        "feedforward num (A/rad)": [", ".join(f"{x:.6g}" for x in ilc.feedforward.num)] * 3,
        "feedforward den": ["1"] * 3,
        "K_1 and K_2 from": ["given"] * 3,
        "learned signal into": ["–", "input and integrator", "input"],  # noqa: RUF001
        "shift r (samples)": ["–", "2", "2"],  # noqa: RUF001
        "Q filter b": ["–", ", ".join(f"{x:.6g}" for x in ilc.q_filter.b), "–"],  # noqa: RUF001
        "Q filter a": ["–", ", ".join(f"{x:.6g}" for x in ilc.q_filter.a), "–"],  # noqa: RUF001
        "Q filter acts on": ["–", "the error", "–"],  # noqa: RUF001
        "K_3 from": ["–", *["given, or chosen by frequency"] * 2],  # noqa: RUF001
    }


# --- verdict


def test_verdict_names_the_quickest_and_where_the_others_are_behind(made):
    (verdict,) = verdicts(made)
    assert verdict.tone == "better"
    assert verdict.headline == (
        f"{ILC} is at {FLOOR} within 3 trials after every change; no learning never reaches it."
    )
    details = " ".join(verdict.details)
    assert (
        "ILC into the input takes 17 trials to the floor after the load change (trial 21), against 3; its "
        "first trial "
        f"there is 4.98 times worse than with {ILC} (30.0 mrad against 6.02 mrad)." in details
    )
    assert (
        f"In the last phase {ILC} leaves 0.500 mrad RMS, 10.0 times less than no learning (5.00 mrad)."
        in details
    )
    assert (
        "in the first trial after the change of reference and inertia (trial 41) its error is 1.60 times "
        "that of no learning (8.02 mrad against 5.00 mrad)." in details
    )


def test_a_first_trial_is_told_only_where_it_is_clearly_worse_and_learned(study):
    """Half as much again; what doesn't learn has no first trial of its own."""

    def input_with(times):
        rms = falls(3.0, 0.6)
        rms[20] *= times
        return alone(study, {"ilc": falls(3.0), "input": rms, "none": STAYS}).details[0]

    assert input_with(1.4) == "ILC into the input takes 4 trials to the floor from the start, against 3."
    assert input_with(1.6) == (
        "ILC into the input takes 4 trials to the floor from the start, against 3; its first trial after the "
        "load change "
        f"(trial 21) is 1.60 times worse than with {ILC} (4.87 mrad against 3.04 mrad)."
    )
    details = alone(study, {"ilc": falls(3.0), "none": 2 * STAYS}).details
    assert not any("first trial" in line and line.startswith(("No learning", "With no")) for line in details)


FALLS, GROWS, LOST = falls(3.0), 0.4 * 1.1 ** np.arange(60.0), np.full(60, np.nan)
EVERY = "within 3 trials after every change"
LOAD, CHANGE = "after the load change (trial 21)", "after the change of reference and inertia (trial 41)"
GROWN = "its RMS grows from 0.484 mrad to 2.02 mrad by trial 20."
UNRANKED = "ILC into the input is not ranked: its error grows over the trials."


def but(value, *trials):
    """`FALLS`, but this RMS, mrad, in these slices of its trials."""
    rms = FALLS.copy()
    for some in trials:
        rms[some] = value
    return rms


@pytest.mark.parametrize(
    ("rms", "tone", "headline", "detail"),
    [
        pytest.param({"ilc": but(4, slice(10)), "input": STAYS}, "better",
            f"{ILC} is at {FLOOR} within 11 trials of the start and {EVERY}; no learning never reaches it.",
            f"ILC into the input never reaches the floor; its first trial {LOAD} is 1.64 times worse than "
            f"with {ILC} (5.00 mrad against 3.04 mrad).", id="the start takes longest"),
        pytest.param({"ilc": but(4, slice(10), slice(40, 46)), "input": STAYS}, "better",
            f"{ILC} is at {FLOOR} within 11 trials of the start and within 7 trials after every change; "
            "no learning never reaches it.", None, id="the slowest of the changes"),
        pytest.param({"ilc": falls(6.0, floor=1.2), "input": STAYS, "none": STAYS}, "worse",
            f"No controller reaches {FLOOR}. {ILC} ends each phase with at most 1.20 mrad RMS, "
            "4.17 times less than no learning (5.00 mrad).", None, id="the floor is never reached"),
        pytest.param({"ilc": but(2, slice(20, 40)), "input": STAYS}, "even",
            f"{ILC} is at {FLOOR} in 2 of 3 phases between changes, but not in the phase {LOAD}; no learning "
            "never reaches it.", None,
            id="the floor is reached in some phases"),
        pytest.param({"ilc": FALLS, "input": GROWS}, "better",
            f"{ILC} is at {FLOOR} {EVERY}; no learning never reaches it. {UNRANKED}",
            f"ILC into the input diverges from the start: {GROWN}", id="learning diverges"),
        pytest.param(dict.fromkeys(("none", "ilc", "input"), GROWS), "worse",
            "The error grows over the trials with every controller. No controller beats no learning: it is "
            f"at {FLOOR} in 1 of 3 phases between changes, but not in the phases {LOAD} and {CHANGE}; the "
            f"next, {ILC}, never reaches it "
            "after a change.", f"No learning grows worse from the start: {GROWN}",
            id="every controller diverges"),
        pytest.param({"ilc": FALLS, "input": but(np.nan, slice(30, 60))}, "better",
            f"{ILC} is at {FLOOR} {EVERY}; no learning never reaches it. {UNRANKED}",
            f"ILC into the input diverges {LOAD}: its error doesn't stay finite.", id="an infinite error"),
        pytest.param({"none": FALLS, "ilc": falls(3.0, 0.8), "input": STAYS}, "worse",
            f"No controller beats no learning: it is at {FLOOR} {EVERY}; the next, {ILC}, takes up to 7 "
            "trials.", None, id="the baseline is the best"),
        pytest.param(dict.fromkeys(("none", "ilc", "input"), FALLS), "even",
            f"All controllers are alike: they are at {FLOOR} {EVERY}.", None, id="all tie"),
        pytest.param({"none": STAYS, "ilc": FALLS, "input": FALLS}, "better",
            f"{ILC} and ILC into the input are at {FLOOR} {EVERY}; no learning never reaches it.", None,
            id="those that learn tie"),
        pytest.param({"none": FALLS, "ilc": FALLS, "input": STAYS}, "even",
            f"No learning and {ILC} are at {FLOOR} {EVERY}; the next, ILC into the input, never reaches "
            "it.", None,
            id="the baseline ties"),
        pytest.param({"ilc": but(1.3, slice(44, 60))}, "better",
            f"{ILC} is at {FLOOR} {EVERY}; no learning never reaches it.",
            f"{ILC} does not stay at the floor: 1.30 mrad RMS in the second half of the trials {CHANGE}.",
            id="the floor is not kept"),
    ],
)  # fmt: skip
def test_verdict(study, rms, tone, headline, detail):
    verdict = alone(study, rms)
    assert (verdict.tone, verdict.headline) == (tone, headline)
    assert detail is None or detail in verdict.details


@pytest.mark.parametrize(
    ("rms", "tone", "headline"),
    [
        pytest.param(FALLS, "even", f"{ILC} is at {FLOOR} {EVERY}.", id="at the floor"),
        pytest.param(STAYS, "worse", f"{ILC} never reaches {FLOOR}. {ILC} ends each phase with at most 5.00 "
            "mrad RMS.", id="never there"),
    ],
)  # fmt: skip
def test_verdict_of_one_controller(study, rms, tone, headline):
    verdict = alone(study, {"ilc": rms}, controllers=["ilc"])
    assert (verdict.tone, verdict.headline) == (tone, headline)
    assert verdict.details == ["There is nothing to compare."]


@pytest.mark.parametrize(
    ("rms", "tone", "headline"),
    [
        pytest.param((STAYS, falls(6.0), falls(6.0, 0.8)), "better", f"{ILC} ends each phase with at most "
            "0.500 mrad RMS, 10.0 times less than no learning (5.00 mrad).", id="learning helps"),
        pytest.param((STAYS, 2 * STAYS, 3 * STAYS), "worse", "No controller beats no learning. No learning "
            f"ends each phase with at most 5.00 mrad RMS; the next, {ILC}, with 10.0 mrad.", id="it harms"),
        pytest.param((LOST, LOST, LOST), "worse",
            "The error grows over the trials with every controller. No error stays finite.", id="no number"),
    ],
)  # fmt: skip
def test_verdict_without_a_floor_is_by_what_is_left(tmp_path, rms, tone, headline):
    verdict = alone(without_floor(tmp_path), dict(zip(("none", "ilc", "input"), rms, strict=True)))
    assert (verdict.tone, verdict.headline) == (tone, headline)


def test_phases_in_which_the_floor_is_never_reached_are_named(study):
    """The first of them is where a worse first trial is told; of the baseline it is enough that it fails."""
    start, middle = STAYS.copy(), falls(3.0)
    start[:20], middle[20:40] = falls(3.0)[:20], 5.0
    worse = f"its first trial there is 1.64 times worse than with {ILC} (5.00 mrad against 3.04 mrad)."
    for rms, where in ((start, f"{LOAD} and {CHANGE}"), (middle, LOAD)):
        told = alone(study, {"ilc": falls(3.0), "input": rms, "none": STAYS}).details[0]
        assert told == f"ILC into the input never reaches the floor {where}; {worse}"
    quick = alone(study, {"ilc": np.full(60, 0.5), "input": STAYS, "none": start}).headline
    expected = f"{ILC} is at {FLOOR} in the first trial after every change; no learning "
    expected += "never reaches it after a change."
    assert quick == expected


def test_noise_and_growth_below_the_floor_are_no_divergence(study):
    noisy = 0.3 + 0.2 * np.random.default_rng(0).random(60)
    noisy[:20] = np.linspace(0.1, 0.9, 20)
    assert not any("diverges" in d for d in alone(study, {"ilc": noisy}).details)


def test_growth_is_half_as_much_again_in_eight_trials_or_more(made):
    """The medians of first and last quarter are compared; next to nothing has to be above a floor."""
    found = case(made, made.runs)
    assert found._grown(np.array([2.0] * 6 + [3.02] * 2)) == (2.0, pytest.approx(3.02))
    assert found._grown(np.array([2.0] * 6 + [2.98] * 2)) is None
    assert found._grown(np.array([2.0] * 5 + [9.0] * 2)) is None
    found = replace(found, metric=replace(found.metric, floor=None))
    assert found._grown(np.array([1.0, 1.0] + [1e-8] * 4 + [1e-7] * 2)) == (1e-8, 1e-7)
    assert found._grown(np.array([1.0, 1.0] + [1e-11] * 4 + [1e-10] * 2)) is None


def test_a_name_that_is_no_word_keeps_its_letters(tmp_path):
    text = synthetic.TRIALS.replace('label = "ILC, Fig. 1"', "").replace('label = "no learning"', "")
    verdict = alone(synthetic.study(tmp_path, text), {"ilc": falls(3.0)})
    assert verdict.headline.startswith("ilc is at the floor") and verdict.headline.endswith(
        "; none never reaches it."
    )


def test_no_verdict_where_there_are_no_numbers(made):
    bare = [Run(r.scenario, r.controller, replace(r.trace, data=r.trace.data[:0])) for r in made.runs]
    assert verdicts(replace(made, runs=bare)) == []


def certified(made, name, **changes):
    """The results with other values in a controller's certificate of the exactly sampled plant."""

    def one(run):
        if run.controller != name:
            return run
        certificate = run.design.certificate
        learning = {k: v for k, v in changes.items() if k in ("norm", "monotone", "frequency")}
        others = {k: v for k, v in changes.items() if k not in learning}
        exact = replace(certificate.exact, **others)
        if learning:
            exact = replace(exact, with_filter=replace(exact.with_filter, **learning))
        return replace(run, design=replace(run.design, certificate=replace(certificate, exact=exact)))

    return replace(made, runs=[one(run) for run in made.runs])


def test_verdict_tells_what_the_certificate_says(made):
    details = verdicts(made)[0].details
    assert any(
        d.startswith("ILC into the input is not certified: at 200 Hz the error may grow") for d in details
    )
    assert any(
        d.startswith("Certified: while nothing changes, no frequency of the error grows")
        and f"{ILC} (exactly" in d
        for d in details
    )
    assert details[-1] == "One more sample of delay at the input makes every loop unstable at some corner."
    details = verdicts(certified(made, "ilc", norm=1.7, monotone=False, frequency=12.0))[0].details
    expected = f"{ILC} is not certified: at 12.0 Hz the error may grow by the factor 1.70"
    assert any(d.startswith(expected) for d in details)
    details = verdicts(certified(made, "ilc", radius=1.1, stable=False, worst="vertex 2"))[0].details
    assert any("within a trial the loop is unstable for vertex 2 (largest pole 1.10" in d for d in details)


@pytest.mark.parametrize(
    ("growth", "why"),
    [
        (
            1.5,
            "near the beginning or the end of a trial the error may grow by the factor 1.50 from one "
            "trial to the next",
        ),
        (0.9, "the matrix Φ of trial and learning together has a pole outside the unit circle"),
    ],
)
def test_a_certificate_may_fail_though_no_frequency_grows(made, growth, why):
    details = verdicts(certified(made, "ilc", norm=0.9, monotone=False, growth=growth))[0].details
    assert f"{ILC} is not certified: {why} (exactly sampled plant)." in details


def test_a_run_that_diverges_is_told_beside_its_certificate(study):
    growing = synthetic.trial_results(study, {"ilc": 4e-4 * 1.1 ** np.arange(60.0)})
    assert (f"The models certify {ILC}, but this run contradicts them: the run counts.") in verdicts(growing)[
        0
    ].details


def test_loops_that_a_sample_of_delay_makes_unstable_are_named(made):
    assert verdicts(certified(made, "ilc", delayed_stable=True))[0].details[-1] == (
        "One more sample of delay at the input makes the loop of no learning and ILC into the input unstable "
        "at some corner."
    )


def test_a_run_outside_the_ranges_is_not_called_certified(made):
    def told(results):
        return [d for d in verdicts(results)[0].details if "ertif" in d and ILC in d]

    def one(run):
        beyond = ("scenario table-1, from trial 31: J is 9, outside the design's 1 to 2",)
        design = replace(run.design, beyond=beyond if run.controller == "ilc" else ())
        return replace(run, design=design)

    outside = told(replace(made, runs=[one(run) for run in made.runs]))
    (line,) = outside
    assert line.startswith(f"The certificate says nothing about {ILC}: scenario table-1")


def test_a_limit_that_is_reached_is_said(made):
    def limited(run):
        status = np.zeros((len(run.trace), 1))
        rows = len(status) // made.study.scenario[run.scenario].trials
        status[: 2 * rows : 7] = 1.0 if run.controller == "ilc" else 0.0
        names, units = (*run.trace.names, "status"), (*run.trace.units, "")
        return replace(run, trace=Trace(names, units, np.hstack([run.trace.data, status])))

    assert not any("at its limit" in d for d in verdicts(made)[0].details)
    details = verdicts(replace(made, runs=[limited(run) for run in made.runs]))[0].details
    expected = f"The input is at its limit, where nothing is learned: {ILC} in 2 of "
    assert any(d.startswith(expected) for d in details)


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1"), (1 + 1e-12, "1"), (1.00032, "1 + 3.2e-04"), (0.9999, "1 − 1.0e-04"), (0.5, "0.500")],  # noqa: RUF001
)
def test_what_is_close_to_one(value, text):
    assert close_to_one(value) == text


# --- phases


def test_phases_say_what_changed(study):
    found = phases(study.scenario["move"])
    assert [p.name for p in found] == ["start", "trial 21: load", "trial 41: reference, mechanics.inertia"]
    assert [p.chosen for p in found] == [[1, 2, 5, 20], [21, 22, 25, 40], [41, 42, 45, 60]]
    assert [(z["from"], z["to"]) for z in to_page(zooms(found))] == [(1, 60), (1, 30), (19, 50), (39, 60)]


def test_a_zoom_is_on_less_than_four_fifths_of_the_trials():
    for start, all_changes in ((50, True), (51, False)):  # up to trial 79 and 80 of 100
        names = [zoom["name"] for zoom in to_page(zooms([Phase(1, start, ()), Phase(start, 101, ("load",))]))]
        assert ("all changes" in names) == all_changes
    assert (
        len(zooms([Phase(1, 36, ())])) == 1 and len(zooms([Phase(1, 41, ())])) == 2
    )  # 29 of 34, of 39 steps
    assert to_page(zooms([Phase(1, 2, ())])) == [{"name": "all trials", "from": 1, "to": 1}]


# --- page


def test_page_is_one_offline_file(made):
    page = render(made)
    checker = Checker()
    checker.feed(page)
    assert checker.open == [] and checker.loaded == []
    assert not re.search(r"\b(None|nan)\b(?! of)", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    assert "url(" not in page and "@import" not in page
    parts = ["within 3 trials after every change", 'data-part="over-trials"', 'class="numbers"']
    parts += ['data-part="waveforms"']
    parts += ['class="proof"', 'class="gains"', "Assumption about"]
    places = [page.index(part) for part in parts]
    assert places == sorted(places)
    for text in (
        "seed 11",
        "numpy",
        "The motion is not in the text",
        "[controller.ilc]",
        "K_1, theta_m (A/rad)",
    ):
        assert text in page


def test_changes_and_floor_are_marked(made):
    over = data_of(render(made))["scenarios"][0]["over_trials"]
    assert over["marks"] == [
        {"trial": 21, "name": "trial 21: load"},
        {"trial": 41, "name": "trial 41: reference, mechanics.inertia"},
    ]
    rms, peak = over["charts"]
    assert (rms["floor"], rms["floor_name"], rms["unit"]) == (pytest.approx(1.0), "floor 1.00 mrad", "mrad")
    assert peak["title"] == "Peak" and "floor" not in peak
    for series, run in zip(rms["series"], made.runs, strict=True):
        wanted = 1e3 * np.asarray(run.metrics["error_rms_rad"])
        np.testing.assert_allclose(10 ** unpack(series["values"]), wanted, rtol=1e-3)


def test_a_logarithmic_axis_has_no_place_for_zero(study):
    rms = synthetic.rms_of_trials(study, "ilc")
    rms[[3, 4]], rms[7] = 0.0, np.nan
    made = synthetic.trial_results(study, {"ilc": rms}, designed=False)
    chart = to_page(trials.over_trials(made, made.runs))["charts"][0]
    values = unpack(chart["series"][1]["values"])
    assert np.flatnonzero(np.isnan(values)).tolist() == [3, 4, 7]
    assert chart["note"] == (
        "The logarithmic axis cannot show: ILC, Fig. 1, 2 trials at zero; ILC, Fig. 1, 1 trial not finite."
    )


def test_chosen_trials_hold_what_the_trace_has(made, study):
    waves = data_of(render(made))["scenarios"][0]["waveforms"]
    assert [(p["title"], p["quantity"], p["unit"]) for p in waves["panels"]] == [
        ("Position, reference dashed", "position", "rad"),
        ("Position error", "error", "mrad"),
        ("Current reference", "i_q_ref", "A"),
        ("Learned signal", "v", "rad"),
    ]
    assert (waves["x"], waves["note"]) == ("time in the trial (s)", "")
    assert [p["trials"] for p in waves["phases"]] == [[1, 2, 5, 20], [21, 22, 25, 40], [41, 42, 45, 60]]
    assert waves["start"] == pytest.approx(0) and waves["step"] == pytest.approx(study.period)
    position, error, _, learned = waves["panels"]
    run = made.runs[1]
    of_trials = run.trace["theta_error"].reshape(60, -1) * 1e3
    assert error["unit"] == "mrad" and position["unit"] == "rad"
    for trial, packed in error["series"][1]["trials"].items():
        wanted = of_trials[int(trial) - 1]
        np.testing.assert_allclose(unpack(packed), wanted, atol=1e-4 * np.ptp(wanted))
    assert np.max(unpack(position["references"][2])) == pytest.approx(2.0, rel=1e-3)
    assert [s["controller"] for s in learned["series"]] == [1, 2]  # the other learns nothing


def test_so_many_phases_are_drawn_and_the_rest_is_told(made, monkeypatch):
    monkeypatch.setattr(trials, "MOST_PHASES", 2)
    waves = to_page(trials.waveforms(made, made.runs))
    assert waves["note"] == "Only the first 2 of 3 phases are drawn."
    assert [phase["name"] for phase in waves["phases"]] == ["start", "trial 21: load"]


def test_long_trials_are_thinned(made, monkeypatch):
    monkeypatch.setattr(trials, "TRIAL_PAGE_POINTS", 1)
    monkeypatch.setattr(trials, "TRIAL_POINTS_LEAST", 20)
    waves = to_page(trials.waveforms(made, made.runs))
    values = unpack(waves["panels"][1]["series"][0]["trials"]["1"])
    assert len(values) <= 20
    assert waves["start"] + waves["step"] * (len(values) - 1) == pytest.approx(0.25, abs=0.02)


def test_points_are_shared_by_panels_runs_and_chosen_trials(made, monkeypatch):
    """Four panels, three runs, twelve trials: 144 waveforms."""
    monkeypatch.setattr(trials, "TRIAL_POINTS_LEAST", 1)
    monkeypatch.setattr(trials, "TRIAL_PAGE_POINTS", 144 * 20 + 143)
    waves = to_page(trials.waveforms(made, made.runs))
    assert len(unpack(waves["panels"][1]["series"][0]["trials"]["1"])) == 20


def test_trials_stay_readable_however_many_runs_share_the_page(made):
    waves = to_page(trials.waveforms(replace(made, runs=made.runs * 500), made.runs))
    assert len(unpack(waves["panels"][1]["series"][0]["trials"]["1"])) == len(made.runs[0].trace) / 60


def test_certificate_on_the_page(made):
    page = render(made)
    for text in (
        "may grow",
        "monotone",
        "contracting",
        "stable",
        "exactly sampled",
        "1 + 2.4e-04",
        ">none</td>",
        " with Q filter<",
    ):
        assert text in page
    design, exact = data_of(page)["scenarios"][0]["certificate"]
    about = "|F| of the worst plant, without Q filter dashed"
    assert (design["title"], exact["title"]) == (
        f"Design model (Euler): {about}",
        f"Plant, exactly sampled: {about}",
    )
    learning = made.runs[1].design.certificate.exact
    assert [(s["controller"], s.get("dash", False)) for s in exact["series"]] == [
        (1, False),
        (1, True),
        (2, False),
    ]
    magnitude = unpack(exact["series"][0]["values"])
    wanted = np.interp(exact["frequency"], *learning.with_filter.curve)
    np.testing.assert_allclose(magnitude, wanted, atol=1e-4)
    assert exact["frequency"][-1] == pytest.approx(200)


def learning(norm, frequency, monotone, contracting=False, limit=1.2):
    curve = np.array([0.0, 100.0]), np.array([norm, 0.5])
    return Learning(norm, frequency, "vertex 3", 0.9, monotone, contracting, limit, curve)


def with_certificates(made, design, exact, discretisation="euler"):
    """The results with this certificate in "ilc", and none in the others."""

    def one(run):
        if run.controller != "ilc":
            return replace(run, design=None)
        both = Certificate(design, exact, discretisation, 60)
        return replace(run, design=replace(run.design, certificate=both, K_3=0.694))

    return replace(made, runs=[one(run) for run in made.runs])


def texts(row):
    return [" ".join(re.sub(r"<[^>]+>", " ", cell).split()) for cell in re.findall(r"<td.*?</td>", row)]


def test_certificate_table_cell_by_cell(made):
    plain = ModelCertificate(
        0.9852, "vertex 1", True, 1.273, False, 0.5, learning(0.976, 62.5, True, True),
        learning(1.0, 200.0, True, limit=1e-4 * 0.694), 1.2, lambda: FiniteTrial(0.999, 1.04, 1.17, 1.1),
    )  # fmt: skip
    bad = ModelCertificate(1.02, "vertex 2", False, 0.9, True, None, None, None, None)
    both = with_certificates(made, plain, bad)
    page = certificate_table(both, both.runs)
    first, second = re.findall(r"<tr>(.*?)</tr>", page.split("<tbody>")[1])
    assert '<th rowspan="2">' in first and "<th" not in second
    assert texts(first) == [
        "Euler", "0.985 stable", "1.27 unstable", "0.500", "0.976 contracting at 62.5 Hz",
        "1 monotone at 200 Hz", "1.20 may grow", "1.17", "1.2 none with Q filter",
    ]  # fmt: skip
    assert texts(second) == [
        "exactly sampled, decides", "1.02 unstable", "0.900 stable", *["–"] * 5, "–",  # noqa: RUF001
    ]  # fmt: skip
    assert (
        '<td title="vertex 1"><span class="value">0.985</span> <span class="tag good">stable</span>' in first
    )
    assert '<td title="vertex 3">' in first and 'class="tag bad">may grow' in first
    fine = replace(plain, growth=1.0, with_filter=None)
    alone = with_certificates(made, fine, None, "exact")
    shown = certificate_table(alone, alone.runs)
    (only,) = re.findall(r"<tr>(.*?)</tr>", shown.split("<tbody>")[1])
    assert texts(only)[6] == "1 doesn't grow" and texts(only)[-1] == "1.2"
    assert texts(only)[0] == "exactly sampled"


def test_a_certificate_in_lines(made):
    """As `cogless design` prints it, in one line and as rows, and as a warning unless all is well."""
    good = ModelCertificate(
        0.9852, "vertex 1", True, 1.273, False, 0.5, learning(0.976367, 62.5, True, True), None, 0.99
    )
    grows = replace(good, without_filter=learning(1.00032, 198.8, False, limit=-1e-12), delayed_stable=True)
    lost = replace(good, stable=False, without_filter=None, growth=None)

    def told(design, exact):
        run = with_certificates(made, design, exact).runs[1]
        assert run.controller == "ilc"
        return verdict_line(run.design), warnings(run.design), list(_proof(run.design.certificate))

    line, warned, rows = told(good, grows)
    assert line == (
        "the error's largest factor from trial to trial: Euler model: 0.976367 at 62.5 Hz, contracting; "
        "exact model: 1.00032 at 198.8 Hz, may grow"
    )
    assert warned == [line]
    assert rows == [
        (
            "Euler", "0.9852", "1.273 unstable", "0.976367 at 62.5 Hz, contracting", "-", "0.99", "-", "-",
            "1.2000",
        ),
        ("exact, decides", "0.9852", "1.273", "1.00032 at 198.8 Hz, may grow", "-", "0.99", "-", "-", "none"),
    ]  # fmt: skip
    monotone = replace(good, without_filter=learning(1.0, 0.0, True))
    line, warned, _ = told(good, monotone)
    assert line.endswith("exact model: 1 at 0 Hz, monotone") and warned == []
    line, warned, rows = told(lost, None)
    assert (
        line == "the error's largest factor from trial to trial: Euler model: unstable along the trial"
        and warned == [line]
    )
    assert rows == [("Euler", "0.9852 unstable", "1.273 unstable", *["-"] * 6)]
    line, warned, _ = told(replace(good, without_filter=None), None)
    assert line == "the error's largest factor from trial to trial: Euler model: no learning" and warned == []


def test_certificates_stay_out_of_the_results_file(made):
    assert "curve" not in json.dumps(to_dict(made))


def test_page_without_designs_or_runs(study):
    page = render(synthetic.trial_results(study, designed=False))
    assert 'class="proof"' not in page and 'class="gains"' not in page
    both = synthetic.trial_results(study)
    one = render(replace(both, runs=both.runs[:1]))
    assert "Numbers of move" in one
    empty = render(TrialResults(study, [], interrupted=True))
    assert "Interrupted" in empty and "No controller can be judged" in empty
    assert data_of(empty)["scenarios"] == []


def test_page_of_runs_without_traces(made):
    """As rollout leaves them."""
    bare = [replace(run, trace=replace(run.trace, data=run.trace.data[:0])) for run in made.runs]
    page = render(replace(made, runs=bare))
    assert "within 3 trials after every change" in page
    shown = data_of(page)["scenarios"][0]
    assert shown["waveforms"]["panels"] == [] and len(shown["over_trials"]["charts"]) == 2


def test_page_of_a_diverged_run(study, tmp_path):
    """Without a warning too: they are errors here. What isn't finite, or too large, is no number."""
    made = synthetic.trial_results(study, designed=False)
    rms = [*np.asarray(made.runs[2].metrics["error_rms_rad"])[:9], *[np.inf] * 51]
    metrics = {"error_rms_rad": rms, "first_error_rad": [0.003, np.inf, np.inf]}

    def diverged(value):
        data = made.runs[2].trace.data.copy()
        data[1000:, 2:] = value
        trace = replace(made.runs[2].trace, data=data)
        broken = replace(made.runs[2], trace=trace, metrics={**made.runs[2].metrics, **metrics})
        return replace(made, runs=[*made.runs[:2], broken])

    pages = [render(diverged(value)) for value in (np.nan, np.inf, 1e300)]
    assert all("doesn&#x27;t stay finite" in page for page in pages)
    assert data_of(pages[0]) == data_of(pages[1]) == data_of(pages[2])
    assert len(write_plots(diverged(np.nan), tmp_path)) == 2


def test_text_of_the_user_is_escaped(tmp_path):
    nasty = '</script><script>alert(1)</script><!-- & \\" $title'
    text = synthetic.TRIALS.replace("A shaft moved from point to point", nasty).replace("ILC, Fig. 1", nasty)
    text = text.replace("The motion is not in the text", nasty).replace("Made by formula", nasty)
    page = render(synthetic.trial_results(synthetic.study(tmp_path, text)))
    assert "alert(1)</script>" not in page and "<!--" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert data_of(page)["controllers"][1]["label"] == nasty.replace("\\", "")
    checker = Checker()
    checker.feed(page)
    assert checker.open == []


def test_the_file_is_whole_or_not_at_all(made, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    write(made, path)
    whole = path.read_text()

    def fails(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(page, "render", fails)
    with pytest.raises(KeyboardInterrupt):
        write(made, path)
    assert path.read_text() == whole and list(tmp_path.iterdir()) == [path]


def test_lines_of_the_terminal(made):
    found = lines(made, "move")
    assert [line.title for line in found[:3]] == [f"to floor, from trial {start}" for start in (1, 21, 41)]
    assert [found[1].value_text(name) for name in ("none", "ilc", "input")] == ["never", "3", "17"]
    assert found[1].best == {"ilc"}
    assert found[4].value_text("ilc") == "6.02 mrad"


def test_pictures(made, tmp_path, monkeypatch):
    print_png, heights = FigureCanvasAgg.print_png, []

    def keep(canvas, path, **options):
        heights.append(canvas.figure.get_size_inches()[1])
        if len(heights) == 3:  # the others are rendered for a run that diverges
            print_png(canvas, path, **options)
        path.touch()

    monkeypatch.setattr(FigureCanvasAgg, "print_png", keep)
    written = write_plots(made, tmp_path)
    assert [path.name for path in written] == [
        f"move-{kind}.png" for kind in ("rms", "trials", "certificate")
    ]
    assert written[-1].read_bytes().startswith(b"\x89PNG")
    assert heights == pytest.approx([0.9 + rows for rows in (2 * 3.4, 4 * 1.7, 2 * 2.6)])  # in


def test_a_page_of_many_trials_is_small(tmp_path):
    """Four runs of 500 trials of 1000 rows."""
    text = synthetic.TRIALS.replace("trials = 60", "trials = 500").replace('"0.25 s"', '"2.5 s"')
    study = synthetic.study(tmp_path, text)
    rms = np.full(500, 1e-3)
    made = synthetic.trial_results(study, {name: rms for name in ("none", "ilc", "input")})
    runs = [*made.runs, made.runs[-1]]
    write(replace(made, runs=runs), tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 4_000_000
