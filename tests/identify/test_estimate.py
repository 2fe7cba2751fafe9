"""What is left out of a fit, what is taken out of the logs, and values with their errors, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.fits import MODEL, fit_of

from cogless.identify import estimate
from cogless.identify.estimate import _taken_out, _without, whole, with_values
from cogless.identify.regression import Fit
from cogless.identify.result import Estimate, Value, wave_of
from cogless.identify.weak_form import Model, Name


@pytest.mark.parametrize(
    ("name", "changed", "untold"),
    [
        (("j",), {"columns": {"b", "c", "offset", "delay"}}, set()),
        (("b",), {"columns": {"j", "c", "offset", "delay"}}, {("c", 0)}),
        (("offset",), {"columns": {"j", "b", "c", "delay"}}, {("c", 0)}),
        (("delay",), {"columns": {"j", "b", "c", "offset"}, "delay": 0.0}, {("j", 0)}),
        (("cogging", 6, "s"), {"cogging": (24,)}, {("j", 0), ("cogging", 6), ("cogging", 24)}),
        (("ripple", 24, "c"), {"ripple": ()}, {("cogging", 24)}),
        (("encoder", 1, "c"), {"encoder": (2,), "error": {}}, set()),
        (("encoder", 2, "c"), {"encoder": (1,)}, set()),
    ],
)
def test_what_takes_the_place_of_a_column_that_is_left_out_is_not_told(
    name: Name, changed: dict[str, Any], untold: set[tuple[str, int]]
) -> None:
    assert _without(replace(MODEL, untold=frozenset({("b", 0)})), name) == replace(
        MODEL, **changed, untold=frozenset({("b", 0), *untold})
    )


def found(j: float) -> Fit:
    return fit_of(
        {
            ("j",): j,
            ("delay",): 0.5e-3,
            **{("cogging", n, part): n / 100 for n in (6, 24) for part in "cs"},
            ("encoder", 1, "c"): 2e-4,
            ("encoder", 1, "s"): -4e-4,
            ("encoder", 2, "c"): 0.0,
            ("encoder", 2, "s"): 6e-4,
        }
    )


def test_delay_and_sensor_s_error_add_up_to_what_is_out_already() -> None:
    """The sensor's error shows as a torque, so it is divided by the inertia."""
    made = _taken_out(MODEL, found(2e-3))
    assert (made.delay, made.j) == (1.5e-3, 2e-3)
    assert made.error[1] == pytest.approx((0.01 + 0.1, 0.02 - 0.2)) and made.error[2] == pytest.approx(
        (0.0, 0.3)
    )
    assert made.waves == {6: (0.06, 0.06), 24: (0.24, 0.24)}
    none = _taken_out(MODEL, found(0.0))  # an inertia that is none tells no error
    assert (none.delay, none.error, none.waves) == (1.5e-3, MODEL.error, {})
    values = whole(MODEL, found(2e-3))
    assert values["delay",] == 1.5e-3 and values["cogging", 24, "s"] == 0.24
    assert [values["encoder", 1, part] for part in "cs"] == pytest.approx([0.11, -0.18])
    assert [values["encoder", 2, part] for part in "cs"] == pytest.approx([0.0, 0.3])


def test_a_value_s_error_is_of_its_fit_its_logs_its_kernels_and_its_phase() -> None:
    """Twice the larger of fit and logs, and of what other widths of the kernel move it by; then the phase.

    The sensor's error is in the fit by inertia.
    """
    waves = [(kind, n, p) for kind, n in (("cogging", 6), ("encoder", 1)) for p in "cs"]
    names: list[Name] = [("j",), ("load", "x"), *waves]
    here = {name: 0.1 * (n + 1) for n, name in enumerate(names)}
    fit = fit_of(here, 0.01)
    without = {log: fit.values + shift for log, shift in (("a", 0.0), ("b", 0.1), ("c", -0.1))}
    known: Any = None
    model = Model(cogging=(6,), encoder=(1,))
    made = Estimate(known, (), {}, (), (), (), {}, (), (), model, (), fit)
    others = [{("j",): 0.1 + 0.03}, {("j",): 0.1 - 0.04}]
    told = with_values(made, here, others, phase={("j",): 0.07})
    spread = math.sqrt((0.03**2 + 0.04**2) / 2)
    assert list(told.values) == ["j"] and told.values["j"].value == 0.1
    assert told.values["j"].error == pytest.approx(math.hypot(2 * math.hypot(0.01, spread), 0.07))
    assert told.loads == {"x": Value(0.2, 0.02)}
    assert told.cogging == (wave_of(6, *(Value(here["cogging", 6, part], 0.02) for part in "cs")),)
    (once,) = told.encoder
    assert once.size.error == pytest.approx(0.02 / 0.1)  # of both of its parts
    between = with_values(replace(made, fit=replace(fit, without=without)), here, others)
    assert between.loads["x"].error == pytest.approx(4.30265 * math.sqrt(2 / 3 * 0.02), rel=1e-4)
    untold = replace(made.model, untold=frozenset({("j", 0), ("cogging", 6)}))
    fewer = with_values(replace(made, model=untold), here, others)
    assert (fewer.values, fewer.cogging, fewer.encoder) == ({}, (), told.encoder)


@pytest.mark.parametrize(
    ("delay", "error", "said"),
    [
        (3.9e-3, 1e-3, ""),
        (4.1e-3, 1e-3, "5.1 +- 2 ms"),
        (-2.9e-3, 1e-3, ""),
        (-3.1e-3, 1e-3, "-2.1 +- 2 ms"),
        (0.0, 2.6e-3, "1 +- 5.2 ms"),
    ],
)
def test_a_delay_that_no_drive_has_is_left_out(
    monkeypatch: pytest.MonkeyPatch, delay: float, error: float, said: str
) -> None:
    """Of 1 ms that is out already, and what is found beyond it."""
    monkeypatch.setattr(estimate, "_settled", lambda known, logs, model: ([], fit_of({}), model))
    left: list[str] = []
    known: Any = None
    _, _, model = estimate._likely_delay(known, [], [], fit_of({("delay",): delay}, error), MODEL, left)
    assert (model == MODEL) == (said == "")
    if said:
        assert left == [
            f"The delay of the log comes out as {said}, which no drive has; it is left out; add an "
            "acceleration log that turns around sharply."
        ]
        assert (model.delay, model.columns) == (0.0, MODEL.columns - {"delay"})
    without = estimate._likely_delay(known, [], [], fit_of({}), MODEL, left)
    assert without[2] == MODEL


NONE: Any = None  # what is known of the motor, where it does not matter


class Fitted:
    """Fits one after the other, the last again and again; `models` were fitted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *fits: Fit) -> None:
        self.fits, self.models = list(fits), list[Model]()
        monkeypatch.setattr(estimate, "_rows", lambda known, logs, model: self.models.append(model) or [])
        monkeypatch.setattr(estimate, "fit", lambda rows: self.next())

    def next(self) -> Fit:
        return self.fits.pop(0) if len(self.fits) > 1 else self.fits[0]


def late(delay: float) -> Fit:
    return fit_of({("j",): 1e-3, ("delay",): delay}, 1e-3)


def test_a_delay_is_taken_out_until_a_tenth_of_its_error_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five times at most; not beyond what a drive has."""
    model = Model(delay=1e-3)
    fitted = Fitted(monkeypatch, late(2e-4), late(1e-4), late(0.99e-4))
    assert estimate._settled(NONE, [], model)[2].delay == pytest.approx(1.3e-3)
    assert [each.delay for each in fitted.models] == pytest.approx([1e-3, 1.2e-3, 1.3e-3])
    fitted = Fitted(monkeypatch, late(2e-4))
    assert estimate._settled(NONE, [], model)[2].delay == pytest.approx(2e-3)
    assert len(fitted.models) == 6
    for delay in (4e-3, -3e-3):
        fitted = Fitted(monkeypatch, late(delay))
        assert estimate._settled(NONE, [], model)[2] == model and len(fitted.models) == 1


def test_orders_that_do_not_stand_out_five_times_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor those below a thousandth of the largest; ripple that is tied to cogging keeps both."""
    settled = list[Model]()
    monkeypatch.setattr(
        estimate, "_settled", lambda known, logs, model: settled.append(model) or ([], fit_of({}), model)
    )
    model = Model(
        cogging=(6, 12, 24, 30), ripple=(8, 24), encoder=(1, 2), error={1: (0.0, 0.9), 2: (0.0, 0.1)}
    )

    def kept(twelve: float = 0.0, noise: float = 0.0, tied: float = 101.0) -> Model:
        orders = (("cogging", model.cogging), ("ripple", model.ripple), ("encoder", model.encoder))
        sizes = {(kind, order): 0.0 for kind, of in orders for order in of}
        sizes |= {("cogging", 6): 1.0, ("cogging", 12): twelve, ("cogging", 30): 1.0}
        values = {
            ("j",): 1.0,
            **{(*name, p): size * (p == "c") for name, size in sizes.items() for p in "cs"},
        }
        inflation = np.array([tied if name == ("ripple", 24, "c") else 1.0 for name in values])
        found = fit_of(values, noise, inflation=inflation)
        return estimate._significant(NONE, [], [], found, model)[2]

    error = 0.1 / math.sqrt(2) / 5
    assert kept(noise=1.01 * error).encoder == (1,) and kept(noise=0.99 * error).encoder == (1, 2)
    assert kept(noise=1.01 * error).error == {1: (0.0, 0.9)}
    assert kept(1.1e-3).cogging == (6, 12, 24, 30) and kept(0.9e-3).cogging == (6, 24, 30)
    assert kept(0.9e-3).ripple == (24,) and kept(0.9e-3, tied=100.0).ripple == ()
    assert kept(0.9e-3, tied=100.0).cogging == (6, 30)
    before = len(settled)
    model = Model(cogging=(6, 30))
    assert kept() == model and len(settled) == before  # nothing to leave out


def test_a_value_s_error_has_what_kernels_of_other_widths_move_it_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three quarters of the width, and a third more."""
    monkeypatch.setattr(estimate, "coefficients", lambda known, logs, model, factor: {("j",): factor})
    monkeypatch.setattr(estimate.findings, "without_nonsense", lambda made, left: made)
    made = estimate._told(NONE, [], Model(), [], fit_of({("j",): 1.0}), ["Remark."], [])
    assert made.values["j"].error == pytest.approx(2 * math.sqrt((0.25**2 + 0.35**2) / 2))
    assert made.remarks == ("Remark.",)


def test_what_cannot_be_told_apart_is_left_out_the_least_important_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names: list[Name] = [
        ("c",),
        ("b",),
        ("offset",),
        ("delay",),
        ("load", "x"),
        ("c_hold",),
        ("ripple", 24, "c"),
    ]

    def wide(*by: float) -> Fit:
        return fit_of(dict.fromkeys(names, 1.0), inflation=np.array(by))

    def told(*fits: Fit, y: tuple[float, ...] = (1.0, -1.0), model: Model = MODEL) -> tuple[list[str], Model]:
        Fitted(monkeypatch, *fits[1:], wide(*[1.0] * 7))
        rows: Any = [SimpleNamespace(y=np.array(y))]
        left: list[str] = []
        return left, estimate._told_apart(NONE, [], rows, fits[0], model, left)[2]

    plain = wide(*[1.0] * 7)
    assert told(wide(100, 100, 100, 100, 1e9, 1e9, 100)) == ([], MODEL)
    left, model = told(wide(200, 200, 200, 200, 1, 1, 200), wide(200, 200, 200, 1, 1, 1, 1))
    assert left == [estimate.CURES[key] for key in ("delay", "offset")]
    assert model == _without(_without(MODEL, ("delay",)), ("offset",))
    for y, one_load in (((1.0, 3.1), True), ((1.0, -3.1), False), ((0.0, 2.0), False)):
        left, model = told(plain, y=y)
        assert (
            left
            == [
                "Order 24: K_t ripple and cogging cannot be told apart; record logs with loads of both signs."
            ]
            * one_load
        )
        assert model.ripple == (() if one_load else (24,))
    held = replace(MODEL, columns=frozenset({"offset"}), ripple=())
    left, model = told(wide(1, 1, 200, 1, 1, 1, 1), model=held)  # held angles: no friction beside it
    assert left == [] and model.columns == frozenset()
