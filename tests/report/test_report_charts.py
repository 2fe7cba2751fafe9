"""Charts of numbers that are made up: which points, orders and cells they have, and in which unit."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from cogless.design.trials.certificate import Learning
from cogless.report import (
    angle_charts,
    charts,
    comparison,
    map_charts,
    markup,
    order_charts,
    panels,
    svg,
    trial_certificate,
    trials,
)
from cogless.report.charts import to_page
from cogless.results.trace import Trace
from cogless.study.laws.periodic import PiIlc

TURN = 2 * np.pi


@pytest.fixture
def results(monkeypatch):
    """Results of a motor with two pole pairs, in rpm; a run's place is its own."""
    for module in (order_charts, order_charts, map_charts, trial_certificate, trials):
        monkeypatch.setattr(module, "place", lambda results, run: run.place)
    for module in (order_charts, order_charts):
        monkeypatch.setattr(module, "speed_unit", lambda results: "rpm")
    return SimpleNamespace(
        study=SimpleNamespace(motor=SimpleNamespace(pole_pairs=2), label=lambda name: name)
    )


def run_of(place, **signals):
    columns = {name: np.asarray(x, dtype=float) for name, x in signals.items()}
    time = 0.01 * np.arange(len(next(iter(columns.values()), [])))
    trace = Trace(
        ("time", *columns), ("s",) + ("",) * len(columns), np.column_stack([time, *columns.values()])
    )
    return SimpleNamespace(place=place, controller="abc"[place], scenario="low", trace=trace)


# --- orders


@pytest.fixture
def found(monkeypatch):
    """What each run's orders are, in rpm: late in the run, and at its beginning."""
    kept = {}

    def spectrum(results, run, highest):
        early, after = kept[run.place]
        return [x if x is None else np.asarray(x)[: highest + 1] * np.pi / 30 for x in (early, after)]

    monkeypatch.setattr(order_charts, "_before_and_after", spectrum)
    monkeypatch.setattr(order_charts, "_highest", lambda results, run: run.highest)
    monkeypatch.setattr(order_charts, "_signal", lambda run: getattr(run, "signal", "omega_m"))
    return kept


def resolved(place, highest, **more):
    return SimpleNamespace(place=place, highest=highest, **more)


def test_bars_are_of_twelve_electrical_orders_and_the_24_strongest_mechanical_ones(results, found):
    """Up to the order that all runs resolve."""
    found[0] = None, [0.0, *np.arange(40.0, 0, -1)]
    found[1] = np.arange(41.0), [0.0, *np.arange(1.0, 41.0)]
    electrical, mechanical = to_page(order_charts.spectra(results, [resolved(0, 40), resolved(1, 30)]))
    assert electrical["orders"] == list(range(1, 13))
    assert (electrical["title"], electrical["x"]) == (
        "Speed by electrical order",
        "order of the electrical revolution",
    )
    assert (electrical["quantity"], electrical["unit"]) == ("speed amplitude", "rpm")
    first, second = electrical["series"]
    assert first == {"controller": 0, "values": pytest.approx([41 - 2 * n for n in range(1, 13)], rel=1e-4)}
    assert second["values"] == second["early"] == pytest.approx([2 * n for n in range(1, 13)], rel=1e-4)
    assert mechanical["title"] == "Speed by mechanical order, the strongest"
    # order n has max(41 - n, n): the 24 of 1 to 30 that have most
    sizes = sorted(range(1, 31), key=lambda n: -max(41 - n, n))
    assert set(mechanical["orders"]) >= set(sizes[:22]) and len(mechanical["orders"]) == 24
    assert mechanical["orders"] == sorted(mechanical["orders"])
    few, _ = to_page(order_charts.spectra(results, [resolved(0, 11)]))
    assert few["orders"] == [1, 2, 3, 4, 5]


def test_a_mechanical_order_has_a_bar_from_a_thousandth_of_the_largest_on(results, found):
    found[0] = None, [0.0, 0.0101, 10.0, 0.0099, 0.0, np.nan]
    _, mechanical = to_page(order_charts.spectra(results, [resolved(0, 5)]))
    assert mechanical["orders"] == [1, 2]
    results.study.motor.pole_pairs = 1
    (only,) = to_page(order_charts.spectra(results, [resolved(0, 5)]))
    assert only["title"] == "Speed by electrical order" and only["orders"] == [1, 2, 3, 4, 5]
    found[0] = None, None
    assert order_charts.spectra(results, [resolved(0, 5)]) == []


def test_where_any_reference_varies_the_bars_are_of_the_error(results, found):
    found[0] = found[1] = None, [0.0, 1.0, 2.0]
    chart, _ = to_page(order_charts.spectra(results, [resolved(0, 2), resolved(1, 2, signal="omega_error")]))
    assert (chart["title"], chart["quantity"]) == ("Speed error by electrical order", "speed error amplitude")


@pytest.mark.parametrize(
    ("turns", "rows", "highest"),
    [(10, 1000, 40), (10, 1500, 48), (10, 1200, 48), (10, 1199, 47), (0, 100, 48)],
)
def test_orders_are_resolved_by_two_and_a_half_rows_each_and_24_electrical_ones_are_enough(
    results, monkeypatch, turns, rows, highest
):
    monkeypatch.setattr(order_charts, "late", lambda *_: slice(None))
    run = run_of(0, theta_m=TURN * turns * np.arange(rows) / (rows - 1))
    assert order_charts._highest(results, run) == highest


@pytest.fixture
def angles(results, monkeypatch):
    """In place of a spectrum the revolutions from and to which it is taken. Laws learn by default."""
    monkeypatch.setattr(order_charts, "late", lambda results, run: slice(run.late, len(run.trace)))
    monkeypatch.setattr(order_charts, "learned_terms", lambda results, run: getattr(run, "learned", ["term"]))
    monkeypatch.setattr(
        order_charts,
        "order_spectrum",
        lambda theta, x, *_: tuple(np.round(theta[[0, -1]] / TURN, 9)) if len(x) > 1 else None,
    )

    def between(run, late, **more):
        run.__dict__.update(late=late, **more)
        return order_charts._before_and_after(results, run, 9)

    return between


def test_the_early_orders_of_a_law_that_learns_are_of_its_first_turn_at_speed(angles):
    """At speed the error is a twentieth of the reference or less. Ten rows are a turn here."""

    def run(errors, rows=60):
        error = np.concatenate((errors, np.zeros(rows - len(errors))))
        return run_of(
            0,
            theta_m=TURN * np.arange(rows) / 10,
            omega_ref=20.0 + 0 * error,
            omega_error=error,
            omega_m=error,
        )

    assert angles(run([9, 9, 1.01, 1.0]), 40) == ((0.3, 1.3), (4.0, 5.9))
    assert angles(run([-9, -1.01, -1.0]), 40) == ((0.2, 1.2), (4.0, 5.9))
    assert angles(run([1.0]), 40) == ((0.0, 1.0), (4.0, 5.9))
    assert angles(run([9, 9]), 40, learned=[]) == (None, (4.0, 5.9))
    assert angles(run([9] * 60), 40) == (None, (4.0, 5.9))  # never at speed
    assert angles(run([9, 9]), 13) == ((0.2, 1.2), (1.3, 5.9))
    assert angles(run([9, 9]), 12) == (None, (1.2, 5.9))  # its turn ends where the last part begins
    assert angles(run([9, 9], rows=11), 5) == (None, (0.5, 1.0))
    assert angles(run([9, 9]), 58) == ((0.2, 1.2), (5.8, 5.9))
    assert angles(run([9, 9]), 59) == (None, None)


def test_a_waterfall_is_sorted_by_speed_and_ends_with_the_last_order_of_any_run(results):
    amplitudes = np.zeros((2, 4))
    amplitudes[:, 0] = [2.0, 3.0]
    other = np.zeros((2, 4))
    other[:, 2] = [1.0, 9.0]
    swept = order_charts.Tracked(
        np.array([1.0, 2.0]), np.array([30.0, 10.0]) * np.pi / 30, {0: amplitudes, 1: other}
    )
    first, second = to_page(order_charts.waterfall(results, swept))
    assert (first["speeds"], first["orders"], first["top"]) == ([10.0, 30.0], 3, 9.0)
    assert [chart["controller"] for chart in (first, second)] == [0, 1]
    assert markup.unpack(first["values"]) == pytest.approx([3, 0, 0, 2, 0, 0], abs=1e-4)
    assert markup.unpack(second["values"]) == pytest.approx([0, 0, 9, 0, 0, 1], abs=1e-4)
    charts = to_page(order_charts.tracking(results, [], swept))
    assert [(c["title"], c["x"], c["along"]) for c in charts] == [
        (f"Order {n} of the mechanical revolution", "speed (rpm)", [10.0, 30.0]) for n in (1, 3)
    ]
    assert [series["values"] for series in charts[1]["series"]] == [[0, 0], [9, 1]]
    still = order_charts.Tracked(np.array([1.0, 2.0]), np.array([3.0, 3.0]), {0: amplitudes})
    assert order_charts.waterfall(results, still) == order_charts.waterfall(results, None) == []
    assert order_charts.tracking(results, [], still) == order_charts.tracking(results, [], None) == []


# --- maps


def learned(place, angle, current, frame="mechanical"):
    memory = {"frame": frame, "angle": np.asarray(angle), "current": np.asarray(current)}
    return SimpleNamespace(place=place, controller="abc"[place], memory=memory)


def test_maps_are_drawn_on_the_grid_of_the_finest_up_to_1440_cells(results):
    results.study.controller = {name: SimpleNamespace(learned=name != "c") for name in "abc"}
    full, half = np.arange(4) * TURN / 4, np.arange(2) * TURN / 4
    runs = [learned(0, full, [0, 1, 2, 3]), learned(1, half, [5, 7]), learned(2, full, [9] * 4)]
    (chart,) = to_page(
        map_charts.maps(results, [*runs, learned(0, full, [1] * 4, "trial"), SimpleNamespace(memory={})])
    )
    assert (chart["x"], chart["angle"]) == ("mechanical angle (°)", [0, 90, 180, 270, 360])
    assert [series["controller"] for series in chart["series"]] == [0, 1]
    assert [series["values"] for series in chart["series"]] == [[0, 1, 2, 3, 0], [5, 7, 5, 7, 5]]
    long = np.arange(2000) * TURN / 2000
    (fine,) = to_page(map_charts.maps(results, [learned(0, long, np.cos(long), "electrical")]))
    assert fine["x"] == "electrical angle (°)" and len(fine["angle"]) == 1441
    assert map_charts.maps(results, [learned(0, [0.0], [1.0])]) == []
    third = np.arange(3) * TURN / 7
    (odd,) = to_page(map_charts.maps(results, [learned(0, third, [0, 1, 2])]))
    assert odd["angle"] == pytest.approx([0, 51.429, 102.857, 154.286], abs=1e-9)  # thousandths of a degree


@pytest.mark.parametrize(
    ("frame", "turns", "rows"), [("mechanical", 2.1, 2), ("electrical", 1.1, 2), ("mechanical", 1.9, 0)]
)
def test_the_polar_map_needs_two_turns_of_its_frame(results, monkeypatch, frame, turns, rows):
    """Two pole pairs: an electrical turn is half of one. What is learned is the sum of its terms."""
    monkeypatch.setattr(map_charts, "learned_terms", lambda results, run: getattr(run, "terms", ["a", "b"]))
    theta = np.linspace(0.0, TURN * turns, 2000)
    x = theta / TURN * (2 if frame == "electrical" else 1)
    run = run_of(0, theta_m=theta, a=x, b=2 * x)
    run.memory = {"frame": frame}
    unlearned = run_of(1, theta_m=theta)
    unlearned.memory, unlearned.terms = {}, []
    found = to_page(map_charts.polar(results, [run, unlearned]))
    if not rows:
        assert found == []
        return
    (chart,) = found
    assert (chart["title"], chart["unit"]) == (f"Learned current around one {frame} revolution", "A")
    (series,) = chart["series"]
    cell = np.arange(360) / 360
    for name, turn in (("low", 0.0), ("values", 0.5), ("high", 1.0)):
        assert series[name] == pytest.approx(3 * (turn + cell), abs=5e-3)
    run.memory = {"frame": "trial"}
    assert map_charts.polar(results, [run]) == []


def test_the_last_eight_turns_are_laid_over_each_other_from_angle_zero():
    turns = np.linspace(0.25, 10.5, 4101)
    rows = map_charts._last_turns(turns, turns)
    assert rows.shape == (8, 360) and rows[:, 0] == pytest.approx(np.arange(2, 10))
    assert rows[0] == pytest.approx(2 + np.arange(360) / 360, abs=1e-3)
    back = map_charts._last_turns(-turns, turns)
    assert back.shape == (8, 360) and back[:, 0] == pytest.approx(np.arange(2, 10))
    assert back[0, 1:] == pytest.approx(3 - np.arange(1, 360) / 360, abs=1e-3)
    assert map_charts._last_turns(np.linspace(0.25, 1.9, 99), np.zeros(99)).shape == (0, 360)
    assert map_charts._last_turns(np.linspace(0.0, 1.0, 99), np.zeros(99)).shape == (1, 360)
    for broken in (np.array([np.nan, 3.0]), np.zeros(0)):
        assert map_charts._last_turns(broken, np.zeros(len(broken))).shape == (0, 360)
    assert map_charts._last_turns(np.array([0.0, 3.0]), np.array([0.0, np.inf])).shape == (0, 360)


# --- over the angle, and over frequency


@pytest.mark.parametrize(
    ("begun", "end", "chosen"),
    [
        (5.0, 21.7, [4, 5, 7, 11, 20]),
        (5.9, 21.7, [4, 5, 7, 11, 20]),
        (5.0, 22.0 - 1e-7, [4, 5, 7, 12, 21]),  # a whole one but for rounding
        (0.0, 3.0, [0, 1, 2]),
        (1.5, 3.0, [0, 1, 2]),
        (3.0, 3.0, [2]),
        (0.5, 0.9, []),
    ],
)
def test_periods_are_chosen_ever_more_sparsely(begun, end, chosen):
    assert angle_charts._chosen(begun, end) == chosen


def test_a_period_is_on_an_even_grid():
    turns = np.linspace(0.0, 4.0, 4001)
    assert angle_charts._on_angle_grid(turns, turns**2, 2) == pytest.approx(
        (2 + np.arange(361) / 360) ** 2, abs=1e-4
    )
    assert angle_charts._on_angle_grid(turns, turns, 0) == pytest.approx(np.arange(361) / 360, abs=1e-9)


def test_what_learning_leaves_is_drawn_between_what_is_learned():
    """A loop leaves at each frequency that frequency itself here; its lines are 10 Hz apart, up to 45 Hz."""
    f = np.array([9.0, 10.0, 15.0, 40.0, 41.0])
    loop = SimpleNamespace(periods_per_second=10.0, highest=45.0, orders=None, share_left=lambda at: at + 0j)
    assert angle_charts._remaining_share(loop, f, 0.0) == pytest.approx(
        [np.nan, 10, 15, 40, np.nan], nan_ok=True
    )
    assert angle_charts._remaining_share(loop, f, 0.5) == pytest.approx(
        [np.nan, np.nan, 15, 40, 41], nan_ok=True
    )
    loop.orders = np.array([1.5, 2.0])
    assert angle_charts._remaining_share(loop, f, 0.0) == pytest.approx(
        [np.nan, np.nan, 15, np.nan, np.nan], nan_ok=True
    )
    loop.orders = np.zeros(0)
    assert np.all(np.isnan(angle_charts._remaining_share(loop, f, 0.0)))


@pytest.mark.parametrize(
    ("turns", "period", "ends"),
    [(20.0, 1e-3, (2.0, 450.0)), (0.0, 1e-3, (0.1, 450.0)), (20.0, 0.1, (2.0, 20.0))],
)
def test_a_sensitivity_is_from_a_tenth_of_the_revolutions_to_nearly_half_the_rate(
    monkeypatch, turns, period, ends
):
    """It covers a decade at least, and begins at 0.1 Hz at rest. A law without linear model has no curve."""
    scenario = {"low": SimpleNamespace(top_reference=TURN * turns)}
    for name, value in {
        "speed_loop": lambda *_: SimpleNamespace(period=period), "plants": lambda plant: np.ones((3, 2)),
        "_feedback": lambda results, run, omega_m: omega_m if run == 1 else None,
        "place": lambda results, run: run,
        "sensitivity": lambda plant, feedback, omega, *_: omega / TURN * np.exp(0.01j * feedback),
        "learned_terms": lambda *_: [], "_loop": lambda *_: None,
    }.items():  # fmt: skip
        monkeypatch.setattr(angle_charts, name, value)
    run = type("Run", (int,), {"scenario": "low"})
    results = SimpleNamespace(study=SimpleNamespace(scenario=scenario))
    magnitude, phase = to_page(angle_charts.bode(results, [run(0), run(1)]))
    f = magnitude["frequency"]
    assert (f[0], f[-1], len(f)) == (*map(pytest.approx, ends), 400)
    (series,) = magnitude["series"]
    assert (series["controller"], series["label"], series["fade"]) == (1, "", 1.0)
    assert series["values"] == pytest.approx(20 * np.log10(f), abs=1e-3)
    assert phase["series"][0]["values"] == pytest.approx([np.degrees(0.01 * TURN * turns)] * 400, abs=1e-2)
    assert angle_charts.bode(results, [run(0)]) == []


def test_a_sensitivity_in_decibels_and_degrees():
    S = np.array([1.0, -0.1, 10j, 0.0, 1e-5])
    assert angle_charts._decibels(S) == pytest.approx([0, -20, 20, -80, -80])
    assert angle_charts._degrees(S)[:3] == pytest.approx([0, 180, 90])


# --- trials


def factors(frequency, values):
    return Learning(1.0, 1.0, "", 0.9, True, False, 1.2, (np.array(frequency), np.array(values)))


def test_factors_of_all_controllers_share_the_frequencies_above_zero(results):
    """A controller has a full curve, that with its Q filter if there is one; the one without it is dashed."""
    one, two = factors([0.0, 10.0, 30.0], [1.0, 0.5, 0.5]), factors([0.0, 20.0], [2.0, 4.0])
    runs = [run_of(0, x=[0.0]), run_of(1, x=[0.0])]
    chart = to_page(trial_certificate._chart(results, "Plant", [(runs[0], one, False), (runs[1], two, True)]))
    assert chart["frequency"] == [10, 20, 30]
    assert chart["title"] == "Plant: |F| of the worst plant, without Q filter dashed"
    full, dashed = chart["series"]
    assert ("dash" in full, dashed["dash"]) == (False, True)
    assert markup.unpack(full["values"]) == pytest.approx([0.5] * 3, abs=1e-4)
    assert markup.unpack(dashed["values"]) == pytest.approx([3, 4, 4], abs=1e-4)
    assert (
        to_page(trial_certificate._chart(results, "Plant", [(runs[0], one, False)]))["title"]
        == "Plant: |F| of the worst plant"
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1 + 0.9e-9, "1"), (1 - 0.9e-9, "1"), (1 + 1.1e-9, "1 + 1.1e-09"), (1 - 1.1e-9, "1 − 1.1e-09"),  # noqa: RUF001
        (1 + 4.9e-3, "1 + 4.9e-03"), (1 - 4.9e-3, "1 − 4.9e-03"), (1 + 5.1e-3, "1.01"), (1 - 5.1e-3, "0.995"),  # noqa: RUF001
    ],
)  # fmt: skip
def test_a_factor_is_told_by_its_distance_from_one_where_that_is_small(value, text):
    assert trial_certificate.close_to_one(value) == text


@pytest.mark.parametrize(
    ("limit", "text"),
    [(0.9e-4, "none"), (1.1e-4, "0.00022"), (-1.1e-4, "-0.00022"), (None, trial_certificate.DASH)],
)
def test_a_limit_of_a_gain_is_none_if_it_is_rounding(limit, text):
    """A ten-thousandth of the gain in use, here 2."""
    learning = SimpleNamespace(K_3_limit=limit and 2 * limit)
    assert trial_certificate._limit(learning, 2.0) == trial_certificate._limit(learning, -2.0) == text
    beside = trial_certificate._limit(learning, 2.0, " with Q filter")
    assert beside == ("" if limit is None else f'<span class="small"><br>{text} with Q filter</span>')
    assert trial_certificate._limit(None, 2.0, " with Q filter") == ""


def test_trials_that_a_logarithmic_axis_cannot_show_are_told(results):
    runs = [run_of(n, x=[0.0]) for n in range(3)]
    values = {"a": np.array([1.0, 0.0, 100.0]), "b": np.array([0.0, 0.0, np.inf, np.nan]), "c": None}
    chart = to_page(trials._chart(results, "Title", "RMS", "mrad", runs, values))
    assert chart["note"] == (
        "The logarithmic axis cannot show: a, 1 trial at zero; b, 2 trials at zero; b, 2 trials not finite."
    )
    assert [series["controller"] for series in chart["series"]] == [0, 1]
    assert markup.unpack(chart["series"][0]["values"])[[0, 2]] == pytest.approx([0, 2], abs=1e-4)
    assert (chart["title"], chart["x"], chart["quantity"], chart["unit"]) == ("Title", "trial", "RMS", "mrad")
    assert to_page(trials._chart(results, "", "", "", runs[:1], {"a": np.array([1.0])}))["note"] == ""


# --- data and small pictures


def test_a_chart_is_the_pages_json():
    """A field at its default is left out, another may have its own key; only a curve is packed."""
    curve = charts.Curve(values=np.array([1.0, np.nan, 3.0]), details=[np.array([1.0])], dash=True)
    held = charts.Span(1.0, 2.0, "held")
    made = charts.OverGrid(
        title="T", quantity="q", unit="A", start=0.0, step=0.5, x_unit="s", holds=[held], series=[curve]
    )
    drawn = to_page(made)
    (series,) = drawn.pop("series")
    assert drawn == {
        "title": "T", "quantity": "q", "unit": "A", "start": 0.0, "step": 0.5, "about": "s",
        "held": [{"from": 1.0, "to": 2.0, "label": "held"}],
    }  # fmt: skip
    assert series == {"dash": True, "values": markup.pack(curve.values), "details": [markup.pack(np.ones(1))]}
    plain = charts.Series(controller=0, label="", values=np.array([1.234567, np.inf]))
    assert to_page(plain) == {"controller": 0, "label": "", "values": [1.2346, None]}


@pytest.mark.parametrize(
    ("low", "high", "names"),
    [
        (0.0, 1.0, ["0", "0.2", "0.4", "0.6", "0.8", "1"]),
        (-0.3, 0.3, ["-0.2", "0", "0.2"]),
        (1234.1, 1234.3, ["1234.1", "1234.15", "1234.2", "1234.25", "1234.3"]),
        (2e-7, 9e-7, ["2e-07", "4e-07", "6e-07", "8e-07"]),
        (5.0, 5.0, ["5", "5.2", "5.4", "5.6", "5.8", "6"]),
    ],
)
def test_ticks_of_an_axis_are_round(low, high, names):
    axis = svg.linear("what", low, high)
    assert [*axis.ticks.values()] == names
    assert [*axis.ticks] == pytest.approx([float(name) for name in names], rel=1e-9, abs=1e-12)
    assert axis.shares([axis.low, axis.high, axis.low - 1]) == pytest.approx([0, 1, 0])


# --- numbers


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1e-4, "0.000100"), (0.99e-4, "9.9e-05"), (0.01, "0.0100"), (1000.0, "1000"), (999_999.0, "999999"),
        (1e6, "1e+06"),
    ],
)  # fmt: skip
def test_a_number_has_an_exponent_below_a_ten_thousandth_and_from_a_million_on(value, text):
    assert markup.number(value) == text and markup.number(-value) == f"-{text}"


@pytest.mark.parametrize(
    ("count", "points", "rows"), [(100, 100, 0), (101, 100, 3), (1000, 100, 20), (1001, 100, 21), (7, 4, 4)]
)
def test_a_bucket_has_the_fewest_rows_that_leave_so_many_points(count, points, rows):
    assert markup.bucket(count, points) == rows


def test_a_constant_is_packed_as_it_is_and_what_is_no_number_as_none():
    assert markup.unpack(markup.pack(np.full(3, 2.5))).tolist() == [2.5] * 3
    packed = markup.pack(np.array([-1.0, np.nan, np.inf, 3.0]))
    assert (packed["offset"], packed["scale"]) == (1.0, pytest.approx(4 / 65534))
    assert markup.unpack(packed) == pytest.approx([-1, np.nan, np.nan, 3], nan_ok=True)
    nothing = markup.pack(np.array([np.nan]))
    assert (nothing["offset"], nothing["scale"]) == (0.0, 1.0)
    assert markup.plain(np.array([1.234567, np.inf, 0.0])) == [1.2346, None, 0.0]


@pytest.mark.parametrize(
    ("reference", "varies"),
    [
        ([2.0, 2.0 + 1.8e-6], False),  # a millionth of the largest
        ([2.0, 2.0 + 2.2e-6], True),
        ([-2.0, -2.0 - 1.8e-6], False),
        ([0.0, 0.9e-15], False),  # at rest, of a billionth of a rad/s
        ([0.0, 1.1e-15], True),
        ([], True),
    ],
)
def test_a_reference_varies_by_more_than_rounding(reference, varies):
    assert panels.varies(np.array(reference)) is varies


def test_the_baseline_has_a_colour_for_itself_and_the_others_share_seven():
    names = [f"c{n}" for n in range(10)]
    study = SimpleNamespace(controller=dict.fromkeys(names), baseline="c2")
    ran = [SimpleNamespace(controller=name) for name in reversed(names) if name != "c9"]
    found = markup.colours(SimpleNamespace(study=study, runs=ran))
    assert list(found.items()) == [
        ("c0", 1), ("c1", 2), ("c2", 0), ("c3", 3), ("c4", 4), ("c5", 5), ("c6", 6), ("c7", 7), ("c8", 1)
    ]  # fmt: skip
    assert markup.place(SimpleNamespace(study=study, runs=ran[:2]), ran[0]) == 1


# --- what a run turned


@pytest.mark.parametrize(("rows", "whole"), [(102, False), (100.5, True)])
def test_a_revolution_lacks_two_rows_at_most(rows, whole):
    """A hundred rows have 99 ways between them."""
    theta = TURN / rows * np.arange(100)
    assert (order_charts.order_spectrum(theta, np.cos(theta), 4, pole_pairs=1) is not None) == whole


@pytest.mark.parametrize(
    ("turned", "why"), [(0.99, "its learning was frozen all the time"), (1.01, "of its period")]
)
def test_learning_shows_once_the_rotor_has_turned_by_a_cell(monkeypatch, turned, why):
    """Of the ten in a quarter of a revolution. Then its period is looked at, in all of the hundred rows."""
    law = PiIlc.model_construct(memory="map", cells=10, gain=1.0)
    for name, value in {
        "revolutions_learned": lambda *_: Fraction(1, 4), "travelled": lambda *_: "theta_m",
        "never": lambda *_: None, "starts_too_late": lambda *_: None,
        "too_short": lambda law, share, theta, time, speed: "of its period" if time == 1.0 else None,
    }.items():  # fmt: skip
        monkeypatch.setattr(comparison, name, value)
    theta = TURN / 40 * turned * np.linspace(0, 1, 100)
    run = run_of(0, theta_m=theta, status=np.zeros(100), omega_ref=np.ones(100))
    study = SimpleNamespace(controller={"a": law})
    assert comparison.unlearned(SimpleNamespace(study=study), run) == why
