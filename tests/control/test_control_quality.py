"""The C library's judgement of learning."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference.quality import Quality

TS = 1e-3
PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
FIELDS = {"span": 2 * math.pi, "longest": 1.0, "outlier": 0.0, "floor": 0.0}


class CQuality:
    def __init__(self, library, ts=TS, **fields):
        self.lib = library.lib
        self.config = library.new("cgl_quality_config", **fields)
        self.state = library.new("cgl_quality")
        assert self.lib.cgl_quality_init(self.state, self.config, ts) == self.lib.CGL_OK

    def step(self, error, omega, learning=True) -> bool:
        return self.lib.cgl_quality_step(self.state, error, omega, learning)

    def read(self):
        return self.lib.cgl_quality_read(self.state)


def ripple(library, amplitude, turns=1, offset=0.0):
    """Errors over whole turns of 100 samples, at a speed whose 100 samples are a little more than a turn."""
    n = np.arange(100 * turns)
    errors = offset + amplitude * np.sin(2 * np.pi * 6 * n / 100)
    return [(float(library.real(e)), 63.0) for e in errors]


@PRECISIONS
@pytest.mark.parametrize("seed", range(4))
def test_equals_the_reference(precision, seed):
    library, rng = control_library(precision), np.random.default_rng(seed)
    fields = FIELDS | {"outlier": 3.0, "floor": 0.2, "longest": 0.5}
    c, reference = CQuality(library, **fields), Quality(**fields, ts=TS)
    outliers = 0
    for n in range(3000):
        scale = math.exp(-n / 1500)
        error = float(library.real(scale * (rng.normal() + 0.3)))
        error = [math.nan, math.inf, 20.0, -1e30][rng.integers(4)] if rng.random() < 0.01 else error
        omega = [5.0, 60.0, -90.0, 40.0][n // 750] if rng.random() > 0.01 else math.nan
        learning = n > 400 and bool(rng.integers(2))
        outlier = c.step(error, omega, learning)
        assert outlier == reference.step(error, omega, learning)
        outliers += outlier and abs(error) <= 1e14
        assert c.state.windows == len(reference.ripples)
        report, bound = c.read(), 300 * library.eps
        assert abs(report.residual - reference.residual) <= bound * 10
        assert abs(report.progress - reference.progress) <= bound * 10
        assert abs(c.state.trend - reference.trend) <= bound * 10
    assert outliers > 5
    assert c.read().progress > 0.3


@PRECISIONS
@pytest.mark.parametrize("amplitude", [1e-9, 0.37, 1e6])
def test_the_residual_is_the_standard_deviation_over_a_turn(precision, amplitude):
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    assert not c.read().known
    for sample in ripple(library, amplitude):
        c.step(*sample)
    assert c.read().known
    assert c.read().residual == pytest.approx(amplitude / math.sqrt(2), rel=100 * library.eps)


@PRECISIONS
@pytest.mark.parametrize("amplitude, residual", [(1.3e-15, 0.0), (1.5e-15, 1.5e-15), (9.9e13, 9.9e13)])
def test_the_residual_from_the_smallest_to_the_largest(precision, amplitude, residual):
    """A variance below 1e-30 is nothing."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for sample in ripple(library, amplitude):
        c.step(*sample)
    assert c.read().residual == pytest.approx(residual / math.sqrt(2), rel=1e-5, abs=0)


@PRECISIONS
@pytest.mark.parametrize("error, known", [(9.9e13, True), (1.01e14, False)])
def test_an_error_above_its_bound_counts_for_nothing(precision, error, known):
    c = CQuality(control_library(precision), **FIELDS)
    assert [c.step(error, 63.0) for _ in range(100)] == [not known] * 100
    assert c.read().known == known


@PRECISIONS
def test_the_root_is_right_to_the_last_bit(precision):
    c = CQuality(control_library(precision), **FIELDS)
    for n in range(100):
        c.step(2.0 if n % 2 else -2.0, 63.0)
    assert c.read().residual == 2.0


@PRECISIONS
def test_each_window_is_about_the_mean_of_the_last(precision):
    """In single precision a small ripple far from the centre is lost."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for offset in (0.0, 100.0, 100.0):
        for sample in ripple(library, 0.01, offset=offset):
            c.step(*sample)
    assert c.read().residual == pytest.approx(0.01 / math.sqrt(2), rel=0.02)


@PRECISIONS
def test_a_constant_error_is_no_ripple(precision):
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for sample in ripple(library, 0.1, offset=1.0):
        c.step(*sample)
    assert c.read().residual == pytest.approx(0.1 / math.sqrt(2), rel=1e-3)


@PRECISIONS
@pytest.mark.parametrize("rate, offset", [(20e3, 1.03), (20e3, 10.3), (1e3, -10.3)])
def test_an_offset_that_stays_is_no_ripple_from_the_first_window_on(precision, rate, offset):
    library = control_library(precision)
    c = CQuality(library, 1 / rate, **FIELDS | {"longest": 60.0})
    for n in range(round(3 * rate)):
        c.step(offset + 0.01 * math.sin(2 * math.pi * 6 * n / rate), 2 * math.pi)
    assert c.read().known
    assert c.read().residual == pytest.approx(0.01 / math.sqrt(2), rel=0.02)


@PRECISIONS
def test_progress_is_since_learning_began_and_ends(precision):
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for _ in range(3):
        for sample in ripple(library, 1.0):
            c.step(*sample, learning=False)
    assert (c.read().progress, c.read().improving) == (0, False)
    for turn in range(12):
        for sample in ripple(library, 0.9**turn):
            c.step(*sample)
    assert c.read().progress == pytest.approx(1 - 0.9**11, rel=1e-3)
    assert c.read().improving
    for _ in range(7):
        for sample in ripple(library, 0.9**11):
            c.step(*sample)
    assert not c.read().improving
    assert not c.read().worsening
    for turn in range(10):
        for sample in ripple(library, 1.05**turn):
            c.step(*sample)
    assert c.read().worsening
    assert c.read().progress < 0


@PRECISIONS
def test_a_run_up_is_nothing_that_was_learned_away(precision):
    library = control_library(precision)
    learning, alone = CQuality(library, **FIELDS), CQuality(library, **FIELDS)
    for n, (error, omega) in enumerate(ripple(library, 1.0, turns=8)):
        run_up = 50.0 * math.exp(-n / 30)
        learning.step(error + run_up, omega)
        alone.step(error + run_up, omega, learning=False)
    assert learning.read().progress == pytest.approx(0, abs=0.02)
    report = alone.read()
    assert (report.progress, report.improving, report.worsening) == (0, False, False)


@PRECISIONS
@pytest.mark.parametrize("rate, changing", [(0.979, True), (0.981, False)])
def test_two_per_cent_a_window_is_improving_or_worsening(precision, rate, changing):
    library = control_library(precision)
    down, up = CQuality(library, **FIELDS), CQuality(library, **FIELDS)
    for turn in range(60):
        for sample in ripple(library, rate**turn):
            down.step(*sample)
        for sample in ripple(library, rate**-turn):
            up.step(*sample)
    assert (down.read().improving, down.read().worsening) == (changing, False)
    assert (up.read().improving, up.read().worsening) == (False, changing)


@PRECISIONS
@pytest.mark.parametrize("sign", [1, -1])
def test_two_per_cent_exactly_is_neither(precision, sign):
    library = control_library(precision)
    c, still = CQuality(library, **FIELDS), library.real(0.04)  # of the square
    c.state.began = True
    c.state.trend = sign * still
    assert not (c.read().improving or c.read().worsening)
    c.state.trend = sign * np.nextafter(still, library.real(1))
    assert (c.read().improving, c.read().worsening) == (sign < 0, sign > 0)


@PRECISIONS
def test_a_standing_rotor_ends_a_window_after_a_time(precision):
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for _ in range(999):
        c.step(0.1, 0.0)
    assert not c.read().known
    c.step(0.1, 0.0)
    assert c.read().known


@PRECISIONS
def test_an_outlier_teaches_nothing_until_it_is_usual(precision):
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 5.0, "floor": 0.5})
    assert not c.step(100.0, 63.0)  # nothing is known yet
    for sample in ripple(library, 0.01, turns=3):
        c.step(*sample)
    assert not c.step(0.4, 63.0)  # below the floor
    assert c.step(0.6, 63.0)
    answers = [c.step(2.0, 63.0) for _ in range(300)]
    assert answers[0]
    assert not answers[-1]


@PRECISIONS
def test_a_rest_ends_neither_learning_nor_progress(precision):
    """No error at all tells nothing of what is usual, nor of what there was before learning."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    for _ in range(3000):
        assert not c.step(0.0, 0.0)
    refused = [c.step(*sample) for turn in range(10) for sample in ripple(library, 0.8**turn)]
    assert sum(refused) == 0
    assert c.read().progress == pytest.approx(1 - 0.8**9, rel=1e-3)


@PRECISIONS
@pytest.mark.parametrize("start", [320, 350, 399])
def test_a_shock_shorter_than_a_turn_teaches_nothing(precision, start):
    """Wherever in its window it begins; what comes after has the bound of before."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    answers = []
    for n, (error, omega) in enumerate(ripple(library, 0.1, turns=9)):
        answers.append(c.step(error + (5.0 if start <= n < start + 90 else 0.0), omega))
    assert all(answers[start : start + 95])  # and a sixteenth of a window
    assert sum(answers) in (95, 96)
    assert c.step(0.5, 63.0)


@PRECISIONS
@pytest.mark.parametrize("count, refused", [(3, 0), (4, 5)])
def test_four_outliers_to_one_side_are_a_shock(precision, count, refused):
    """After them nothing is learned for a sixteenth of the window, 6 samples from the last on."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    for sample in ripple(library, 0.1, turns=3):
        c.step(*sample)
    assert all(c.step(1.0, 63.0) for _ in range(count))
    assert sum(c.step(0.0, 63.0) for _ in range(40)) == refused


@PRECISIONS
@pytest.mark.parametrize("error, refused", [(1.99, False), (2.01, True)])
def test_errors_of_up_to_twice_what_lasts_are_learned(precision, error, refused):
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    for n, (usual, omega) in enumerate(ripple(library, 0.1, turns=5)):
        c.step(1.0 if n >= 300 and 50 <= n % 100 < 54 else usual, omega)
    assert c.step(error, 63.0) == refused


@PRECISIONS
@pytest.mark.parametrize("share, progress", [(1.02, 0.5), (0.98, 0.0)])
def test_a_window_that_turned_by_a_sixteenth_is_what_there_was_before_learning(precision, share, progress):
    library = control_library(precision)
    c = CQuality(library, **FIELDS)
    for n in range(1000):  # ends by its time
        c.step(math.sin(2 * math.pi * n / 100), share * 2 * math.pi / 16, learning=False)
    for sample in ripple(library, 0.5):
        c.step(*sample)
    assert c.read().progress == pytest.approx(progress, abs=1e-5)


@PRECISIONS
def test_an_error_that_stays_at_one_place_is_learned_until_it_has_gone(precision):
    """A bump in a hundredth of the turn is an outlier for ever if only the turn's mean square decides."""
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    bump, refused = np.zeros(5), []
    for n, (error, omega) in enumerate(ripple(library, 0.1, turns=40)):
        bump = np.full(5, 2.0) if n == 500 else bump
        if 50 <= n % 100 < 55:
            refused.append(c.step(error + bump[n % 100 - 50], omega))
            bump[n % 100 - 50] *= 1.0 if refused[-1] else 0.5
        else:
            c.step(error, omega)
    assert refused == [False] * 25 + [True] * 10 + [False] * 165
    assert np.all(bump < 1e-3)
    assert c.step(2.0, 63.0)  # a new one is looked at anew


@PRECISIONS
def test_a_shock_is_none_of_what_lasts(precision):
    library = control_library(precision)
    c = CQuality(library, **FIELDS | {"outlier": 4.0})
    bumps = []
    for n, (error, omega) in enumerate(ripple(library, 0.1, turns=20)):
        bump = 1.0 if n >= 500 and 50 <= n % 100 < 55 else 0.0
        shock = 5.0 if 1010 <= n < 1030 or 1210 <= n < 1230 else 0.0
        refused = c.step(error + bump + shock, omega)
        assert refused >= (shock > 0)
        bumps += [refused] if bump > 0 else []
    assert bumps[:10] == [True] * 10  # two windows
    assert sum(bumps[10:]) <= 20


@PRECISIONS
def test_the_peaks_of_noise_do_not_open_the_door(precision):
    library, rng = control_library(precision), np.random.default_rng(2)
    c = CQuality(library, **FIELDS | {"outlier": 4.0, "longest": 10.0})
    peaks = 0
    for e in rng.normal(size=100_000).astype(library.real).tolist():
        peaks += c.step(e, 1.0)
        assert c.state.last_peak_square == 0
    assert peaks > 5
    assert c.step(10.0, 1.0)


@PRECISIONS
@pytest.mark.parametrize(
    "field, value",
    [(name, v) for name in FIELDS for v in (-1.0, math.nan, math.inf)]
    + [("longest", 1e-4), ("longest", 1e9), ("outlier", 0.5)],
)
def test_init_refuses(precision, field, value):
    library = control_library(precision)
    config = library.new("cgl_quality_config", **{**FIELDS, field: value})
    refused = library.lib.cgl_quality_init(library.new("cgl_quality"), config, TS)
    assert refused == library.lib.CGL_ERROR_CONFIG
