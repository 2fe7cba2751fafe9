"""Orders over speed and time, the polar map, sensitivity and the table of jitter: against formulas."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic
from test_report import data_of

from cogless.design.learning_loop import LearningLoop
from cogless.design.verdict import judged
from cogless.report import angle_charts, map_charts, order_charts, render, tables
from cogless.report.charts import to_page
from cogless.report.comparison import runs_in
from cogless.report.markup import unpack
from cogless.results import Results

RATE, RPM = 5000, 2 * np.pi / 60
UPRIGHT, RESONANCE = 12, 45.0  # an order, and a frequency in Hz


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return synthetic.results(synthetic.study(tmp_path_factory.mktemp("study")), rate=RATE)


def with_signals(results, scenario, **signals):
    """The results with other signals in the runs of a scenario: arrays, or functions of the run."""

    def one(run):
        if run.scenario != scenario:
            return run
        data = run.trace.data.copy()
        for name, x in signals.items():
            if name in run.trace.names:
                data[:, run.trace.names.index(name)] = x(run) if callable(x) else x
        return replace(run, trace=replace(run.trace, data=data))

    return Results(results.study, [one(run) for run in results.runs])


@pytest.fixture(scope="module")
def run_up(made):
    """From 60 to 600 r/min in 10 s, with ripple of one order and of one frequency."""
    time = np.arange(10 * RATE) / RATE
    omega = (60 + 54 * time) * RPM
    theta = np.cumsum(omega) / RATE
    ripple = 0.5 * RPM * np.cos(UPRIGHT * theta) + 0.25 * RPM * np.cos(2 * np.pi * RESONANCE * time)
    return with_signals(made, "low-speed", omega_ref=omega, theta_m=theta, omega_m=omega + ripple)


# --- orders over speed


def test_an_order_stands_upright_and_a_resonance_runs_across(run_up):
    runs = runs_in(run_up, "low-speed")
    chart, *others = to_page(order_charts.waterfall(run_up, order_charts.tracked(run_up, runs)))
    assert [c["controller"] for c in (chart, *others)] == [0, 1, 2]
    cells = unpack(chart["values"]).reshape(len(chart["speeds"]), chart["orders"])
    speeds = np.array(chart["speeds"])
    assert np.all(np.diff(speeds) > 0) and 60 < speeds[0] < 100
    assert cells[:, UPRIGHT - 1] == pytest.approx(np.full(len(speeds), 0.5), rel=0.1)
    # the resonance's order is its frequency per revolution: it falls as the speed rises
    for k in (len(speeds) // 3, len(speeds) - 1):
        row = cells[k].copy()
        row[UPRIGHT - 2 : UPRIGHT + 1] = 0
        order = RESONANCE / (speeds[k] / 60)
        assert np.argmax(row) + 1 == pytest.approx(order, abs=1.5)


def test_the_strongest_orders_are_followed_over_the_speed(run_up):
    runs = runs_in(run_up, "low-speed")
    found = order_charts.tracked(run_up, runs)
    charts = to_page(order_charts.tracking(run_up, runs, found))
    assert found.sweeps and charts[0]["x"] == "speed (rpm)"
    chart = next(c for c in charts if c["title"].startswith(f"Order {UPRIGHT} "))
    assert chart["series"][0]["values"] == pytest.approx([0.5] * len(chart["along"]), rel=0.1)


def test_at_a_constant_speed_a_law_that_learns_lowers_its_orders_over_time(made):
    runs = runs_in(made, "low-speed")
    found = order_charts.tracked(made, runs)
    assert not found.sweeps and order_charts.waterfall(made, found) == []
    charts = to_page(order_charts.tracking(made, runs, found))
    chart = next(c for c in charts if c["title"] == "Order 24 of the mechanical revolution")
    pi, _, ilc = (np.array(s["values"]) for s in chart["series"])
    times = np.array(chart["along"])
    assert chart["x"] == "time (s)" and times == pytest.approx(np.arange(1, len(times) + 1), abs=0.1)
    assert pi[1:] == pytest.approx([4.8] * (len(times) - 1), rel=0.01)  # the first has the start
    middle = times - 0.5  # of a revolution
    assert ilc[2:] == pytest.approx(0.46 + (4.8 - 0.46) * np.exp(-middle[2:]), rel=0.12)


def test_without_learning_or_a_sweep_nothing_is_followed(made):
    runs = [run for run in runs_in(made, "low-speed") if run.controller != "pi-ilc"]
    assert order_charts.tracking(made, runs, order_charts.tracked(made, runs)) == []


def test_eight_revolutions_are_enough_for_orders_over_time(made):
    runs = runs_in(made, "low-speed")  # one revolution a second
    for rows, pieces in ((7.99 * RATE, None), (8.01 * RATE, 8)):
        part = [replace(run, trace=replace(run.trace, data=run.trace.data[: round(rows)])) for run in runs]
        found = order_charts.tracked(made, part)
        assert (None if found is None else len(found.times)) == pieces


def test_48_pieces_at_most_of_as_many_revolutions_each(run_up):
    runs = runs_in(run_up, "low-speed")
    found = order_charts.tracked(run_up, runs)
    assert list(order_charts.tracked(run_up, runs[:1]).amplitudes) == [0]  # of one controller too
    assert len(found.times) == len(found.speeds) == 27  # 55 revolutions, two a piece
    assert {amplitudes.shape for amplitudes in found.amplitudes.values()} == {(27, 120)}
    (chart, *_) = to_page(order_charts.waterfall(run_up, found))
    assert (chart["title"], chart["quantity"], chart["unit"]) == ("Orders over speed", "speed", "rpm")
    assert chart["top"] == max(np.nanmax(amplitudes) for amplitudes in found.amplitudes.values())


def test_the_four_strongest_orders_of_anybody_are_followed_and_half_as_fast_again_is_a_sweep():
    quiet, loud = np.array([[3.0, 0.0, 1.0, 0.0, 5.0, 0.0]]), np.array([[0.0, 4.0, 2.0, 0.0, 0.0, 0.0]])
    found = order_charts.Tracked(np.ones(2), np.array([1.0, 1.5]), {0: quiet, 1: loud})
    assert found.followed == [1, 2, 3, 5] and found.sweeps
    assert replace(found, amplitudes={1: loud}).followed == [2, 3]  # what isn't there isn't followed
    assert replace(found, amplitudes={0: 1.0 + np.arange(6.0)[None]}).followed == [3, 4, 5, 6]
    assert not replace(found, speeds=np.array([1.0, 1.49])).sweeps


def test_a_run_of_few_revolutions_has_no_orders_over_time(made):
    assert order_charts.tracked(made, runs_in(made, "step-on")) is None  # four revolutions


def test_orders_that_the_rows_do_not_resolve_are_left_out(made):
    slow = [replace(r, trace=replace(r.trace, data=r.trace.data[::50])) for r in runs_in(made, "low-speed")]
    found = order_charts.tracked(made, slow)
    assert np.all(np.isnan(found.amplitudes[0][:, 40:]))  # 100 rows per revolution
    assert np.all(np.isfinite(found.amplitudes[0][:, :39]))


# --- the learned current around a circle


@pytest.mark.parametrize("direction", [1, -1])
def test_the_polar_map_has_the_mean_and_the_spread_of_the_last_revolutions(made, direction):
    time = np.arange(10 * RATE) / RATE
    theta = direction * 2 * np.pi * time  # the law's frame is electrical, of four pole pairs
    learned = (0.1 + 0.01 * np.floor(time)) * np.sin(4 * theta) + 0.02 * np.cos(4 * theta)
    results = with_signals(made, "low-speed", theta_m=theta, term_ilc=learned)
    (chart,) = to_page(map_charts.polar(results, runs_in(results, "low-speed")))
    (series,) = chart["series"]
    angle = np.deg2rad(np.arange(360))
    # the last eight electrical revolutions: one with 0.17 A, four with 0.18 A, three with 0.19 A
    assert chart["title"].endswith("electrical revolution")
    middle = 0.1825 * np.sin(angle) + 0.02 * np.cos(angle)
    assert series["values"] == pytest.approx(middle, abs=2e-3)
    spread = np.array(series["high"]) - np.array(series["low"])
    assert spread == pytest.approx(np.abs(0.02 * np.sin(angle)), abs=2e-3)


def test_a_controller_that_learns_nothing_is_not_in_the_polar_map(made):
    runs = [run for run in runs_in(made, "low-speed") if run.controller != "pi-ilc"]
    assert map_charts.polar(made, runs) == []


# --- sensitivity


def test_sensitivity_is_that_of_the_design_and_learning_lowers_what_repeats(made):
    runs = runs_in(made, "low-speed")
    magnitude, phase = to_page(angle_charts.bode(made, runs))
    assert (magnitude["unit"], phase["unit"]) == ("dB", "°")
    named = {(s["controller"], s["label"]): np.array(s["values"], float) for s in magnitude["series"]}
    assert set(named) == {(0, ""), (1, ""), (2, "off"), (2, "on"), (2, "between")}
    f = np.array(magnitude["frequency"])
    # the same PI: the same sensitivity
    assert named[0, ""] == pytest.approx(named[2, "off"])
    loop: LearningLoop = judged(made.study, "low-speed", "pi-ilc")[-1]
    n = round(10 / loop.periods_per_second)
    at = n * loop.periods_per_second
    off, on = (np.interp(at, f, named[2, which]) for which in ("off", "on"))
    assert on - off == pytest.approx(20 * np.log10(loop.residual(at)), abs=0.5)
    assert on < off - 3
    # far up feedback does nothing; with delay, Bode's integral lifts some frequencies above 0 dB
    assert named[0, ""][-1] == pytest.approx(0, abs=1.5) and np.nanmax(named[0, ""]) > 0


# --- jitter


def cells(html):
    rows = {}
    for row in html.split("<tr>")[2:]:
        head = row.split("</th>")[0].removeprefix("<th>")
        rows[head] = [part.split("</span>")[0] for part in row.split('<span class="value">')[1:]]
    return rows


def test_jitter_and_torque_ripple_are_those_of_the_rows_at_the_end(made):
    results = with_signals(
        made, "low-speed", tau_e=lambda run: 0.2 + 0.05 * np.sin(4 * run.trace["theta_m"]), tau_cogging=0.0
    )
    runs = runs_in(results, "low-speed")
    text = tables.late_table(results, runs)
    found = cells(text)
    assert list(found) == [
        "speed ripple, rms", "speed ripple as measured, rms", "torque ripple, (max \u2212 min) / (max + min)"
    ]  # fmt: skip
    assert "Over the last part of the run, from 8 to 10 s. Jitter is the deviation from the mean." in text
    assert found["torque ripple, (max \u2212 min) / (max + min)"] == ["0.250"] * 3
    rows = tables.late(results, runs[0])
    expected = np.std(runs[0].trace["omega_error"][rows]) / RPM
    assert found["speed ripple, rms"][0] == f"{expected:.2f} rpm"
    measured = np.std(runs[0].trace["omega_error_measured"][rows]) / RPM
    assert found["speed ripple as measured, rms"][0] == f"{measured:.2f} rpm"
    assert not any("position" in name for name in found)


def test_a_drive_that_holds_its_position_has_its_jitter_true_and_measured(made):
    random = np.random.default_rng(3)
    jitter = 1e-3 * random.normal(size=10 * RATE)
    results = with_signals(
        made, "low-speed", omega_ref=0.0, omega_m=0.0, theta_m=jitter, theta_measured=3 * jitter
    )
    found = cells(tables.late_table(results, runs_in(results, "low-speed")))
    sigma = np.std(jitter[8 * RATE :])
    values = {name: float(row[0].split()[0]) for name, row in found.items() if "position" in name}
    assert values == pytest.approx(
        {
            "position jitter, rms": sigma,
            "position jitter as measured, rms": 3 * sigma,
            "position jitter, 3 sigma": 3 * sigma,
            "position jitter as measured, 3 sigma": 9 * sigma,
        },
        rel=0.02,
    )


def test_the_page_has_the_parts_that_the_scenario_has_data_for(run_up):
    swept, stepped = data_of(render(run_up))["scenarios"]
    assert swept["waterfall"] and swept["tracking"] and swept["polar"] and swept["bode"]
    assert not stepped["waterfall"] and not stepped["tracking"]
