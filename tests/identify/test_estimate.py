"""What is left out of a fit, what is taken out of the logs, and values with their errors, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.fits import MODEL, fit_of

from cogless.errors import StudyError
from cogless.identify import estimate
from cogless.identify.estimate import _taken_out, _without, whole, with_values
from cogless.identify.regression import Fit
from cogless.identify.result import Estimate, Value, wave_of
from cogless.identify.weak_form import Model, Name, Sensor


@pytest.mark.parametrize(
    ("name", "changed", "untold"),
    [
        (("j",), {"columns": {"b", "c", "offset", "delay"}, "encoder": (), "error": {}}, set()),
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
    """Gives these fits in turn, the last again and again, and keeps the models that were fitted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *fits: Fit) -> None:
        self.fits, self.models = list(fits), list[Model]()
        monkeypatch.setattr(estimate, "_rows", lambda known, logs, model: self.models.append(model) or [])
        monkeypatch.setattr(estimate, "fit", lambda rows: self.next())

    def next(self) -> Fit:
        return self.fits.pop(0) if len(self.fits) > 1 else self.fits[0]


def late(delay: float) -> Fit:
    return fit_of({("j",): 1e-3, ("delay",): delay}, 1e-3)


def test_a_delay_is_taken_out_until_a_tenth_of_its_error_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """That is done five times at most, and not beyond a delay that a drive may have."""
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

    def kept(twelve: float = 0.0, noise: float = 0.0, tied: float = 101.0, told: int = 0) -> Model:
        orders = (("cogging", model.cogging), ("ripple", model.ripple), ("encoder", model.encoder))
        sizes = {(kind, order): 0.0 for kind, of in orders for order in of}
        sizes |= {("cogging", 6): 1.0, ("cogging", 12): twelve, ("cogging", 30): 1.0}
        values = {
            ("j",): 1.0,
            **{(*name, p): size * (p == "c") for name, size in sizes.items() for p in "cs"},
        }
        inflation = np.array([tied if name == ("ripple", 24, "c") else 1.0 for name in values])
        found = fit_of(values, noise, inflation=inflation)
        known: Any = SimpleNamespace(tells_error=lambda order: order == told)
        return estimate._significant(known, [], [], found, model)[2]

    error = 0.1 / math.sqrt(2) / 5
    assert kept(noise=1.01 * error).encoder == (1,) and kept(noise=0.99 * error).encoder == (1, 2)
    assert kept(noise=1.01 * error).error == {1: (0.0, 0.9)}
    assert kept(noise=1.01 * error, told=2).encoder == (1, 2)  # of which the file says another
    assert kept(1.1e-3).cogging == (6, 12, 24, 30) and kept(0.9e-3).cogging == (6, 24, 30)
    assert kept(0.9e-3).ripple == (24,) and kept(0.9e-3, tied=100.0).ripple == ()
    assert kept(0.9e-3, tied=100.0).cogging == (6, 30)
    before = len(settled)
    model = Model(cogging=(6, 30))
    assert kept() == model and len(settled) == before  # nothing to leave out
    model = Model(cogging=(6, 30), encoder=(1,))  # of whose error nothing is taken out
    assert kept(noise=0.01).encoder == ()


FOUR: Any = SimpleNamespace(motor=SimpleNamespace(pole_pairs=4), step=0.0)  # pole pairs
MOVING, HELD = SimpleNamespace(dt=1e-3), SimpleNamespace(dt=0.0)


@pytest.mark.parametrize(
    ("law", "columns"), [(None, "j b c offset delay"), ((1, -1.0, -0.1), "j b c offset")]
)
def test_logs_that_turn_are_searched_for_everything_but_what_a_feedback_law_hides(
    monkeypatch: pytest.MonkeyPatch, law: Any, columns: str
) -> None:
    monkeypatch.setattr(estimate.findings, "one_speed", lambda logs: False)
    laws = iter([law, law, law, None])
    monkeypatch.setattr(estimate.findings, "feedback", lambda log: next(laws))
    monkeypatch.setattr(estimate.findings, "kernel_width", lambda known, logs: 6e-3)
    left: list[str] = []
    logs: list[Any] = [HELD, MOVING, MOVING]
    wanted = Model((24,), encoder=(1, 2), columns=frozenset(columns.split()))
    assert estimate._start(FOUR, logs, left) == (logs, wanted)
    assert left == [
        "All logs of a turning motor show the feedback law: the delay cannot be identified; add an "
        "acceleration log."
    ] * (law is not None)
    left.clear()
    laws = iter([law, None])  # one of two
    assert "delay" in estimate._start(FOUR, logs, left)[1].columns and left == []
    monkeypatch.setattr(estimate.findings, "kernel_width", lambda known, logs: 4e-3)
    monkeypatch.setattr(estimate, "_scanned", lambda known, logs, model: (logs, model.width))
    laws = iter([None, None])
    assert estimate._start(FOUR, logs, left) == (logs, ([MOVING, MOVING], 4e-3))


def test_held_angles_tell_cogging_and_an_offset_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    left: list[str] = []
    alone = ([HELD], Model(cogging=(24,), columns=frozenset({"offset"})))
    assert estimate._start(FOUR, [HELD], left) == alone
    assert left.pop() == (
        "No log of a turning motor: inertia and friction cannot be identified; add an acceleration log."
    )
    monkeypatch.setattr(estimate.findings, "one_speed", lambda logs: True)
    monkeypatch.setattr(estimate.findings, "said_of_one_speed", lambda logs: f"{len(logs)} at one speed")
    assert estimate._start(FOUR, [HELD, MOVING], left) == alone and left == ["1 at one speed"]
    with pytest.raises(StudyError, match=r"^2 at one speed$"):
        estimate._start(FOUR, [MOVING, MOVING], left)


def test_rows_are_filtered_by_the_model_s_kernel_or_another_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate, "rows_of", lambda *of: [of])
    model, logs = Model(width=2e-3), ["a", "b"]
    for factor, width in (({}, 2e-3), ({"factor": 1.5}, 3e-3)):
        made: Any = estimate._rows(FOUR, logs, model, **factor)
        assert made == [(log, model, pytest.approx(width), Sensor(0.0, 4)) for log in logs]


def test_a_narrow_kernel_begins_at_the_delay_that_fits_the_slowest_log_best(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Among -2 to 5 ms, a kernel's width apart; with orders beside those of the poles instead of the encoder.

    From there delay and eccentricity are found together. A load's log is the last that is taken.
    """
    tried, settled = list[Model](), list[Any]()

    def fitted(rows: list[Model]) -> Fit:
        (model,) = rows
        tried.append(model)
        values = {("j",): 2.0, **{("cogging", n, p): n / 10 for n in model.cogging for p in "cs"}}
        return replace(fit_of(values), noise={"slow": abs(model.delay - 1.2e-3)})

    def settle(known: Any, logs: Any, model: Model) -> tuple[Model, None]:
        settled.append((logs, model))
        return replace(model, delay=1.3e-3, error={1: (0.1, 0.2)}), None

    monkeypatch.setattr(estimate, "_rows", lambda known, logs, model: [model])
    monkeypatch.setattr(estimate, "fit", fitted)
    monkeypatch.setattr(estimate, "settled", settle)
    monkeypatch.setattr(estimate.findings, "speed", lambda log: log.speed)
    slow, *others = (
        SimpleNamespace(name=name, kind=kind, speed=speed, dt=1e-4)
        for name, kind, speed in (("slow", "", 2.0), ("fast", "", 3.0), ("load", "load", 1.0))
    )
    model = Model((24,), encoder=(1, 2), columns=frozenset("jbc"), width=1e-3)
    logs: list[Any] = [*others, slow]
    found = estimate._scanned(FOUR, logs, model)
    assert [each.delay for each in tried] == pytest.approx([1e-3 * n for n in range(-2, 5)])
    columns = frozenset({"j", "c", "offset"})
    for each in tried:
        assert each.cogging == tuple(n + k for n in (8, 16, 24) for k in range(-2, 3))
        assert (each.encoder, each.columns, each.width) == ((), columns, 1e-3)
    ((of, start),) = settled
    waves = {n: (n / 10, n / 10) for n in (8, 16, 24)}
    assert of == [slow] and start == replace(
        model, cogging=(8, 16, 24), encoder=(1,), columns=columns | {"delay"}, delay=pytest.approx(1e-3),
        waves=waves, j=2.0,
    )  # fmt: skip
    assert found == replace(
        start, delay=1.3e-3, error={1: (0.1, 0.2)}, columns=frozenset("jbc"), encoder=(1, 2)
    )


def test_a_delay_that_is_known_is_in_no_column(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, model = fit_of({}), replace(MODEL, delay=3e-3, columns=MODEL.columns - {"delay"})
    monkeypatch.setattr(estimate, "_settled", lambda known, logs, model: (["rows"], fit, model))
    made = Estimate(NONE, (), {}, (), (), (), {}, (), (), MODEL, (), None)
    found = estimate.at_delay(made, 3e-3)
    assert (found.model, found.fit, found.rows) == (model, fit, ("rows",))


def test_orders_are_added_until_no_more_are_found_or_there_are_forty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the delay and the encoder's error; where currents accelerate, K_t ripple is looked for, too."""
    fitted, told = Fitted(monkeypatch, fit_of({})), list[Any]()
    monkeypatch.setattr(estimate, "_without_sidebands", lambda known, logs, model, found: model)
    found = iter([[7], [11, 5], []])
    monkeypatch.setattr(estimate, "found_orders", lambda rows, fit, width, known: next(found))
    start = replace(MODEL, cogging=(24,), ripple=())
    made: Any = estimate._searched(FOUR, [], start, lambda *of: told.append(of))
    assert made == replace(start, cogging=(5, 7, 8, 11, 24), ripple=(8, 24))
    assert [model.cogging for model in fitted.models[:3]] == [(24,), (7, 24), (5, 7, 11, 24)]
    assert fitted.models[3].cogging == (4, 5, 7, 8, 11, 24) and fitted.models[3].encoder == (4, 8)
    fitted.models.pop()
    assert all(model.encoder == () and "delay" not in model.columns for model in fitted.models)
    assert told == [(f"orders: {n}", 0.0) for n in (1, 2, 4)]
    count = iter(range(100, 200))
    monkeypatch.setattr(estimate, "found_orders", lambda rows, fit, width, known: [next(count)])
    held = replace(start, columns=frozenset({"offset"}))
    many: Any = estimate._searched(FOUR, [], held, lambda *of: None)
    assert len(many.cogging) == 41 and many.ripple == ()


def test_orders_beside_larger_ones_are_the_encoder_s_if_it_errs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Below half of the larger; what the error does not explain comes back."""
    settled, errs, back, delays = list[tuple[int, ...]](), [True], [list[int]()], list[float]()

    def settle(known: Any, logs: Any, model: Model) -> Any:
        settled.append(model.cogging)
        delay = delays.pop(0) if delays else 0.0
        return [], fit_of({("delay",): delay}), replace(model, j=model.j + 1)

    monkeypatch.setattr(estimate, "_settled", settle)
    monkeypatch.setattr(estimate, "_errs", lambda found, model, order: errs[0] and order == 2)
    monkeypatch.setattr(estimate, "found_orders", lambda rows, fit, width, known: back[0])
    sizes = {6: 0.1, 22: 0.09, 23: 0.05, 24: 0.2, 25: 0.11, 30: 0.01}
    found = fit_of({("cogging", n, p): size * (p == "s") for n, size in sizes.items() for p in "cs"})
    model = Model(cogging=(6, 8, 22, 23, 24, 25, 30), encoder=(1, 2))

    def kept() -> tuple[int, ...]:
        settled.clear()
        return estimate._without_sidebands(NONE, [], model, found)[2].cogging

    fewer = (6, 8, 24, 25, 30)
    assert kept() == fewer and settled == [fewer]
    back[0] = [23]
    assert kept() == (6, 8, 23, 24, 25, 30) and settled == [fewer, (6, 8, 23, 24, 25, 30)]
    back[0], delays[:] = (
        [],
        [-3e-3],
    )  # of all others, which no log has: the error is found with the large ones
    assert kept() == fewer and settled == [fewer, (6, 24, 25), fewer]
    delays[:] = [6e-3]
    assert estimate._without_sidebands(NONE, [], model, found)[2].j == 2  # and is where the others begin
    back[0], errs[0] = [23], False
    assert kept() == model.cogging and settled == [fewer, model.cogging]
    model = replace(model, encoder=())
    assert kept() == model.cogging and settled == [model.cogging]


def test_a_value_s_error_has_what_kernels_of_other_widths_move_it_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other widths are 0.75 and 1.35 of the model's."""
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
        last, _, made = estimate._told_apart(NONE, [], rows, fits[0], model, left)
        assert (last == []) == (made != model)  # those of the model that is left
        return left, made

    plain = wide(*[1.0] * 7)
    assert told(wide(100, 100, 100, 100, 1e9, 1e9, 100)) == ([], MODEL)
    left, model = told(wide(200, 200, 200, 200, 1, 1, 200), wide(200, 200, 200, 1, 1, 1, 1))
    assert left == [estimate.CURES[key] for key in ("delay", "offset")]
    assert model == _without(_without(MODEL, ("delay",)), ("offset",))
    for y, one_load in (((1.0, 3.1), True), ((1.0, -3.1), False), ((0.0, 2.0), False)):
        left, model = told(plain, y=y)
        alike = estimate.CURES["ripple"].format(24)
        assert left == [alike] * one_load
        assert model.ripple == (() if one_load else (24,))
    held = replace(MODEL, columns=frozenset({"offset"}), ripple=())
    left, model = told(wide(1, 1, 200, 1, 1, 1, 1), model=held)  # held angles: no friction beside it
    assert left == [] and model.columns == frozenset()


def test_a_search_begins_again_with_what_stands_out_until_that_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """A false order may hide a true one. With nothing left to begin with, or in a circle, it ends."""
    model, begun = replace(MODEL, delay=0.0), list[Any]()

    def searched(known: Any, logs: Any, model: Model, progress: Any) -> Any:
        begun.append(model)
        return [], fit_of({}), model

    def ends(*kept: tuple[int, ...]) -> tuple[int, ...]:
        begun.clear()
        rest = iter(kept)

        def significant(known: Any, logs: Any, rows: Any, found: Fit, model: Model) -> Any:
            return rows, found, replace(model, cogging=next(rest), delay=1e-3)

        monkeypatch.setattr(estimate, "_significant", significant)
        return estimate._searched_again(NONE, [], model, lambda *of: None)[2].cogging

    monkeypatch.setattr(estimate, "_searched", searched)
    assert ends((28,), (28, 56), (28, 56)) == (28, 56)  # as it was found first
    assert begun == [model, replace(model, cogging=(28,)), replace(model, cogging=(28, 56))]
    assert ends((24,), (24,)) == (24,) and ends(()) == ()
    assert ends((1,), (2,), (1,)) == (1,)
    assert ends(*((n,) for n in range(1, 9))) == (5,)
