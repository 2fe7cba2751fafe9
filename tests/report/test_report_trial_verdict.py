"""The sentences of a verdict on trials on either side of each bound, word by word, for made-up errors."""

from dataclasses import replace
from importlib import import_module
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic

from cogless.design.trials.certificate import GROWTH_ROUNDING
from cogless.design.trials.response import FACTOR_ROUNDING
from cogless.report.phases import Phase, settled
from cogless.report.trial_case import case

room = import_module("cogless.report.trial_verdict")  # its package has a function of this name
ILC, INPUT = "“ILC, Fig. 1”", "ILC into the input"
START = "from the start"
PHI = "the matrix Φ of trial and learning together has a pole outside the unit circle"
LOAD, SECOND = "after the load change (trial 21)", "after the load change (trial 41)"


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A case of a motion with a floor of 1 mrad; the baseline "none" doesn't learn."""
    study = synthetic.study(tmp_path_factory.mktemp("study"), synthetic.TRIALS)
    made = synthetic.trial_results(study, designed=False)
    return case(made, made.runs)


@pytest.fixture
def of(known):
    def contest(counts, rms=None, phases=3, floor=1.0):
        """Counts and RMS, mrad, in phases of twenty trials; an RMS lasts its phase."""
        every = [Phase(1 + 20 * n, 21 + 20 * n, ("load",) if n else ()) for n in range(phases)]
        lasting = {name: np.repeat(np.asarray(x, dtype=float), 20) for name, x in (rms or {}).items()}
        made = replace(known, phases=every, rms=lasting, metric=replace(known.metric, floor=floor))
        made.__dict__["counts"] = counts
        return made

    return contest


@pytest.mark.parametrize(
    ("counts", "rms", "first"),
    [
        ({"none": [inf] * 3, "ilc": [1, 9, 9], "input": [8, 8, 8]}, {}, "input"),  # the largest counts
        ({"none": [inf] * 3, "ilc": [5, 9, 9], "input": [9, 9, 9]}, {}, "ilc"),  # then the sum
        ({"none": [inf] * 3, "ilc": [inf, 1, 1], "input": [99, 99, 99]}, {}, "input"),  # most floors first
        (
            {"none": [2] * 3, "ilc": [2] * 3},
            {"none": [2] * 3, "ilc": [1, 1.5, 1]},
            "ilc",
        ),  # then the worst RMS
        ({"none": [2] * 3, "ilc": [2] * 3}, {"none": [2] * 3}, "none"),  # what isn't known is worse than all
        ({}, {"none": [3, 1, 1], "ilc": [2, 2, 2.5]}, "ilc"),
    ],
)
def test_the_best_is_the_quickest_in_its_slowest_phase(of, counts, rms, first):
    assert room._ranked(of(counts, rms))[0] == first


@pytest.mark.parametrize(
    ("counts", "said", "short"),
    [
        ([1, 1, 1], "in the first trial after every change", "takes up to 1 trial"),
        ([2, 3, 1], "within 3 trials after every change", "takes up to 3 trials"),
        ([3, 3, 1], "within 3 trials after every change", "takes up to 3 trials"),
        (
            [4, 3, 1],
            "within 4 trials of the start and within 3 trials after every change",
            "takes up to 4 trials",
        ),
        (
            [2, inf, inf],
            f"in 1 of 3 phases between changes, but not in the phases {LOAD} and {SECOND}",
            "never reaches it after a change",
        ),
        (
            [inf, 2, 2],
            f"in 2 of 3 phases between changes, but not in the phase {START}",
            f"in 2 of 3 phases between changes, but not in the phase {START}",
        ),
        ([inf, inf, inf], "never reaches it", "never reaches it"),
        ([4], "within 4 trials", "takes 4 trials"),
        ([1], "in the first trial", "takes 1 trial"),
    ],
)
def test_how_soon_the_floor_is_reached(of, counts, said, short):
    found = of({"ilc": counts}, phases=len(counts))
    assert (room._reach(found, "ilc"), room._reach(found, "ilc", short=True)) == (said, short)


@pytest.mark.parametrize(
    ("mine", "best", "said", "where"),
    [
        ([5, 20, 9], [3, 3, 8], f"takes 20 trials to the floor {LOAD}, against 3", 1),
        ([9, 20, 9], [3, 19, 8], f"takes 9 trials to the floor {START}, against 3", 0),  # where most differ
        ([3, 2, 3], [3, 3, 3], "", None),
        ([inf, 2, inf], [3, 3, 3], f"never reaches the floor {START} and {SECOND}", 0),
        ([inf, inf, 2], [inf, 3, 3], f"never reaches the floor {LOAD}, where {ILC} does", 1),
        ([inf, inf, inf], [3, 3, 3], "never reaches the floor", None),
    ],
)
def test_how_much_slower_another_is(of, mine, best, said, where):
    found = of({"ilc": best, "input": mine})
    assert room._slower(found, "input", "ilc") == (said, None if where is None else found.phases[where])


@pytest.mark.parametrize(
    ("mine", "rms", "said"),
    [
        (
            [3, 5],
            3.0,
            f"{INPUT} takes 5 trials to the floor {LOAD}, against 3; its first trial there is 1.50 times "
            "worse",
        ),
        (
            [5, 3],
            3.0,
            f"{INPUT} takes 5 trials to the floor {START}, against 3; its first trial {LOAD} is 1.50 times "
            "worse",
        ),
        ([3, 3], 3.0, f"With {INPUT} the first trial {LOAD} is 1.50 times worse"),
        ([3, 5], 2.9, f"{INPUT} takes 5 trials to the floor {LOAD}, against 3."),
        ([3, 3], 2.9, ""),
    ],
)
def test_who_is_behind_in_trials_and_in_the_first_of_them(of, mine, rms, said):
    """A first trial is told if it is 1.5 times as bad or worse, and the controller learns."""
    found = of(
        {"ilc": [3, 3], "input": mine, "none": [3, 9]}, {"ilc": [1, 2], "input": [1, rms], "none": [1, 9]}, 2
    )
    more = f" than with {ILC} (3.00 mrad against 2.00 mrad)." if said.endswith("worse") else ""
    assert room._behind(found, "input", "ilc") == said + more
    assert room._behind(found, "none", "ilc") == ""


@pytest.mark.parametrize(
    ("counts", "tie"),
    [([2, 5, 1], True), ([5, 5, 5], True), ([2, 6, 1], False), ([2, 4, 1], False), ([2, 5, inf], False)],
)
def test_controllers_tie_if_their_slowest_phases_are_as_quick(of, counts, tie):
    found = of({"ilc": [3, 5, 4], "input": counts})
    assert room._as_quick(found, "ilc", "ilc") and room._as_quick(found, "input", "ilc") is tie
    found.__dict__["growing"] = {"input": None}
    assert not room._as_quick(found, "input", "ilc")


@pytest.mark.parametrize(
    ("mine", "other", "said"),
    [
        (1.05, 1.0, "as much as no learning (1.00 mrad)"),  # a twentieth more is a tie
        (1.06, 1.0, "1.06 times more than no learning (1.00 mrad)"),
        (1.0, 1.05, "as much as no learning (1.05 mrad)"),
        (1.0, 1.06, "1.06 times less than no learning (1.06 mrad)"),
        (1.0, 0.0, "infinitely more than no learning (0 mrad)"),
        (1.0, inf, "against no learning (not finite)"),
        (1.0, nan, "against no learning (not finite)"),
    ],
)
def test_a_value_beside_another(of, mine, other, said):
    assert room._compared_words(of({}), mine, other, "none") == said


def test_what_is_left_is_told_beside_the_baseline_or_else_the_next(of):
    less = f"{ILC} ends each phase with at most 2.00 mrad RMS, 1.50 times less than no learning (3.00 mrad)."
    three = {"none": [3, 1], "ilc": [2, 2], "input": [4, 0]}
    assert room._least_rms_sentence(of({}, three, 2), list(three)) == less
    assert room._least_rms_sentence(of({}, {"none": [3], "ilc": [2]}, 1), ["none", "ilc"]) == less.replace(
        "each phase with at most", "with"
    )
    own = "No learning ends with 1.00 mrad RMS"
    assert room._least_rms_sentence(of({}, {"none": [1], "ilc": [2]}, 1), ["none", "ilc"]) == (
        f"{own}; the next, {ILC}, with 2.00 mrad."
    )
    assert room._least_rms_sentence(of({}, {"none": [1]}, 1), ["none", "ilc"]) == f"{own}."


@pytest.mark.parametrize(
    ("rms", "tone", "begins"),
    [
        ({"none": [1.05], "ilc": [1.0]}, "even", f"{ILC} ends with 1.00 mrad RMS, as much as"),
        ({"none": [1.06], "ilc": [1.0]}, "better", f"{ILC} ends with 1.00 mrad RMS, 1.06 times less"),
        ({"none": [1.0], "ilc": [1.0]}, "worse", "No controller beats no learning. No learning ends with"),
        ({"none": [1.0]}, "even", "No learning ends with 1.00 mrad RMS."),
        ({"ilc": [2.0], "input": [3.0]}, "even", f"{ILC} ends with 2.00 mrad RMS; the next, {INPUT}, with"),
        ({"none": [nan], "ilc": [inf]}, "worse", "No error stays finite."),
    ],
)
def test_without_a_floor_what_is_left_in_the_end_decides(of, rms, tone, begins):
    found = of({}, rms, 1, None)
    found.__dict__["growing"] = {}
    told, sentence = room._by_rms(found, room._ranked(found))
    assert told == tone and sentence.startswith(begins)


@pytest.mark.parametrize(
    ("count", "rms", "told"), [(10, 1.06, True), (11, 1.06, False), (10, 1.04, False), (inf, 1.06, False)]
)
def test_a_floor_is_lost_if_it_was_reached_in_the_first_half_of_a_phase(of, count, rms, told):
    found = of({"ilc": [3, count]}, {"ilc": [0.5, rms]}, 2)
    lost = f"{ILC} does not stay at the floor: 1.06 mrad RMS in the second half of the trials {LOAD}."
    assert room._leaves_floor(found, "ilc") == (lost if told else "")
    found.__dict__["growing"] = {"ilc": None}
    assert room._leaves_floor(found, "ilc") == ""
    for lacking in (
        of({}, {"ilc": [2.0]}, 1),
        of({"ilc": [3]}, {}, 1),
        of({"ilc": [3]}, {"ilc": [2]}, 1, None),
    ):
        assert room._leaves_floor(lacking, "ilc") == ""


def test_of_the_phases_that_lose_the_floor_the_worst_is_told(of):
    found = of({"ilc": [3, 3, 3]}, {"ilc": [2.0, 4.0, 3.0]})
    assert room._leaves_floor(found, "ilc").endswith(
        f"4.00 mrad RMS in the second half of the trials {LOAD}."
    )


def test_the_best_is_compared_with_the_baseline_at_the_end_and_in_first_trials(of):
    """If it reached the floor in any phase. A first trial after a change is told if 1.5 times as bad."""
    counts = {"none": [inf, inf], "ilc": [1, inf], "input": [inf, inf]}
    end = f"In the last phase {ILC} leaves 3.00 mrad RMS, 1.50 times more than no learning (2.00 mrad)."
    first = (
        f" What it has learned does not fit at first: in the first trial {LOAD} its error is 1.50 times that "
        "of no learning (3.00 mrad against 2.00 mrad)."
    )
    rms = {"none": [9.0, 2.0], "ilc": [1.0, 3.0], "input": [1.0, 2.9]}
    found = of(counts, rms, 2)
    found.__dict__["growing"] = {}
    assert room._against_the_baseline(found, "ilc") == end + first
    assert room._against_the_baseline(found, "input") == ""  # it never was at the floor
    assert room._against_the_baseline(found, "none") == ""
    alone = of({"none": [inf], "ilc": [1]}, {"none": [2.0], "ilc": [1.0]}, 1)
    assert room._against_the_baseline(alone, "ilc") == (
        f"At the end {ILC} leaves 1.00 mrad RMS, 2.00 times less than no learning (2.00 mrad)."
    )
    found.__dict__["growing"] = {"ilc": None}
    assert room._against_the_baseline(found, "ilc") == ""
    assert room._against_the_baseline(of({"ilc": [1]}, {"ilc": [1.0]}, 1), "ilc") == ""


@pytest.mark.parametrize(
    ("counts", "tone", "says"),
    [
        ({"none": [inf] * 2, "ilc": [inf] * 2}, "worse", "No controller reaches the floor of 1.00 mrad RMS."),
        ({"ilc": [inf] * 2}, "worse", f"{ILC} never reaches the floor of 1.00 mrad RMS."),
        ({"ilc": [2, 1]}, "even", f"{ILC} is at the floor of 1.00 mrad RMS within 2 trials of the start"),
        ({"none": [2, 2], "ilc": [2, 2]}, "even", "All controllers are alike: they are at the floor"),
        ({"none": [2, 2], "ilc": [3, 3]}, "worse", "No controller beats no learning: it is at the floor"),
        ({"none": [2, 2], "ilc": [2, 2], "input": [3, 3]}, "even", f"no learning and {ILC} are at the floor"),
        ({"none": [3, 3], "ilc": [2, 2]}, "better",
            f"{ILC} is at the floor of 1.00 mrad RMS within 2 trials "),
        ({"none": [inf] * 2, "ilc": [2, inf]}, "even", f"{ILC} is at the floor of 1.00 mrad RMS in 1 of 2"),
        ({"ilc": [2, 2], "input": [3, 3]}, "better",
            f"{ILC} is at the floor of 1.00 mrad RMS within 2 trials "),
    ],
)  # fmt: skip
def test_the_first_sentence_where_there_is_a_floor(of, counts, tone, says):
    found = of(counts, phases=2)
    told, sentence = room._by_floor(found, room._ranked(found))
    assert told == tone and sentence.startswith(says)


def learning(**values):
    return SimpleNamespace(**{"norm": 0.5, "frequency": 12.0, **values})


@pytest.mark.parametrize(
    ("norm", "growth", "why"),
    [
        (1 + 2 * FACTOR_ROUNDING, None, "at 12.0 Hz the error may grow by the factor 1 + 2.0e-09"),
        (
            1 + FACTOR_ROUNDING,
            1 + 2 * GROWTH_ROUNDING,
            "near the beginning or the end of a trial the error may grow by the factor 1 + 2.0e-04",
        ),
        (1 + FACTOR_ROUNDING, 1 + GROWTH_ROUNDING, PHI),
        (1 + FACTOR_ROUNDING, None, PHI),
    ],
)
def test_a_factor_grows_if_it_is_above_one_by_more_than_rounding(norm, growth, why):
    told = room._growing(SimpleNamespace(growth=growth), learning(norm=norm))
    assert told.removesuffix(" from one trial to the next") == why


@pytest.mark.parametrize(
    ("stable", "said"),
    [
        ({"ilc": (True, False)}, f"the loop of {ILC}"),
        ({"ilc": (True, False), "input": (True, False)}, "every loop"),
        ({"ilc": (True, False), "input": (True, True)}, f"the loop of {ILC}"),
        ({"ilc": (True, False), "input": (False, False)}, f"the loop of {ILC}"),
        ({"ilc": (True, True), "input": (False, False)}, ""),
    ],
)
def test_loops_that_a_sample_of_delay_unsettles(of, stable, said):
    found = of({})
    found.__dict__["certified"] = {
        name: (None, None, SimpleNamespace(stable=now, delayed_stable=then))
        for name, (now, then) in stable.items()
    }
    whole = f"One more sample of delay at the input makes {said} unstable at some corner."
    assert room._delay(found) == (whole if said else "")


@pytest.mark.parametrize(
    ("rms", "left"), [([9, 3, 4], 3.5355339), ([5], 5), ([9, 9, 3, 4], 3.5355339), ([9] * 10 + [2] * 10, 2)]
)
def test_what_is_left_in_the_end_is_of_the_second_half_of_the_trials(rms, left):
    assert settled(np.array(rms, dtype=float)) == pytest.approx(left)


def test_the_worst_of_what_is_left_is_not_finite_if_one_phase_s_is_not(of):
    found = of({}, {"none": [1, 3], "ilc": [1, nan], "input": [inf, 1]}, 2)
    assert [found.worst(name) for name in ("none", "ilc", "input", "nobody")] == [3, inf, inf, inf]
    assert found.first("none", found.phases[1]) == 3 and np.isnan(found.first("nobody", found.phases[0]))


@pytest.mark.parametrize(
    ("mine", "other", "ratio", "phase", "values"),
    [
        ([9, 2, 6], [1, 2, 4], 1.5, 2, "6.00 mrad against 4.00 mrad"),  # not in the first phase
        ([9, 6, 2], [1, 4, 2], 1.5, 1, "6.00 mrad against 4.00 mrad"),
        ([9, 6, 2], [1, 0, 2], 1.0, 2, "2.00 mrad against 2.00 mrad"),  # of nothing there is no multiple
        ([9, inf, 2], [1, 1, 2], 1.0, 2, "2.00 mrad against 2.00 mrad"),
        ([9, nan, nan], [1, 1, 2], 0.0, 0, "9.00 mrad against 1.00 mrad"),
    ],
)
def test_the_worst_first_trial_is_that_of_the_largest_multiple(of, mine, other, ratio, phase, values):
    found = of({}, {"ilc": mine, "none": other})
    assert found.worst_first("ilc", "none") == (ratio, found.phases[phase], values)


def test_the_first_phase_that_grows_is_told_with_its_lowest_and_last_error(of):
    """For each controller, as medians of quarters of the twenty trials."""
    found = of({}, {"none": [2, 2, 2], "ilc": [2, 2, 2]})
    found.rms["ilc"][35:40], found.rms["ilc"][55:] = 3.5, 9.0
    found.rms["none"][45] = nan
    (ilc, none) = (found.growing[name] for name in ("ilc", "none"))
    assert ilc == (found.phases[1], 2.0, 3.5)
    assert none[:2] == (found.phases[2], 2.0) and np.isnan(none[2])
