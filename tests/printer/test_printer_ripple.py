"""The ripple by order over the speed, from ramps, against the independent axis; and its picture."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from printer.printer_bench import FILE, PROBE, SIGNS, ramp_records, write_klipper_logs
from printer.printer_plant import order_sizes, sampled, study_axes
from report.curves import curves

from cogless.printer.axis import Axis, read_axis
from cogless.printer.corrections import Correction, Lines, OrderRipple
from cogless.printer.moves import ramp
from cogless.printer.ramps import blocks, identify_ramps
from cogless.printer.records import FITTED_ORDERS, Run
from cogless.report.carriage import render
from cogless.report.svg import LEFT_EDGE, LOW_EDGE, PANEL_WIDTH, RIGHT_MARGIN, TOP_EDGE

Records = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
AXES = study_axes(1)
RESONANCES = np.array([62.0, 228.0])  # Hz, of the belt with the motor's own stiffness
NEAR = 0.15  # of a resonance's frequency


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> Axis:
    path = tmp_path_factory.mktemp("axis") / "printer.toml"
    path.write_text(FILE)
    return read_axis(path)


@pytest.fixture(scope="module")
def records() -> Records:
    return ramp_records(AXES, 1)


@pytest.fixture(scope="module")
def lines(axis: Axis, records: Records) -> Lines:
    rng = np.random.default_rng(5)

    def run(kind: str) -> Run:
        t, values = records["forward", kind]
        times, x = sampled(t, values[:, 0], rng, 3200, 0.1, start=-0.5, end=t[-1] + 0.3)
        return Run(kind, "forward", times, x, PROBE if kind == "probe" else {})

    return identify_ramps(axis, [(run("plain"), run("probe")) for _ in range(3)])


def test_ramps_show_the_ripple_of_a_constant_speed_and_a_resonance_too_low(lines: Lines, axis: Axis) -> None:
    constant = order_sizes(AXES, lines.ripple[1].speeds, {})
    for n, one in lines.ripple.items():
        true = constant[: len(one.speeds), n - 1]
        apart = np.min(np.abs(n * one.speeds[:, None] / axis.wavelength / RESONANCES - 1), axis=1)
        heard = (apart > NEAR) & (one.before > 3 * one.doubt)
        assert np.count_nonzero(heard) >= 3 and one.speeds[0] < 0.035 and one.speeds[-1] > 0.19
        assert np.all(np.abs(one.before - true)[heard] < (0.08 * true + 0.5 * one.doubt)[heard])
    loudest = int(np.argmax(lines.ripple[1].before))
    one = lines.ripple[1]
    assert one.speeds[loudest] == pytest.approx(0.05, abs=1e-3)
    assert 2 < constant[loudest, 0] / one.before[loudest] < 4


def test_what_a_correction_leaves_is_what_a_ramp_with_it_shows(
    lines: Lines, axis: Axis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A third ramp, with the correction in the driver, without noise."""
    correction = {n: entry.value for n, entry in lines.coefficients.items()}
    monkeypatch.setattr("printer.printer_bench.PROBE", correction)
    t, values = ramp_records(AXES, 1)["forward", "probe"]
    times, x = sampled(t, values[:, 0], np.random.default_rng(1), 3200, 0.0, step=1e-9, end=t[-1])
    third = blocks(Run("third", "forward", times, x, correction), 0.0, ramp(axis), axis.wavelength)
    for n, one in lines.ripple.items():
        squares = np.abs(third.coefficients[:, FITTED_ORDERS.index(n)]) ** 2
        left = []
        for speed in one.speeds:
            near = np.abs(third.speeds - speed) < 2e-3
            omega = 2 * np.pi * n * speed / axis.wavelength
            left.append(np.sqrt(np.mean(squares[near])) / omega**2)
        assert np.all(np.abs(one.after - left) < 2.5 * one.doubt)
        assert np.sum(one.after**2) < 0.3 * np.sum(one.before**2)


def correction(ripple: OrderRipple) -> Correction:
    return Correction("x", 0.8, 8e-4, None, {}, ripple={"forward": {2: ripple}})


def test_the_picture_is_the_numbers_on_logarithmic_axes() -> None:
    """Values that rise a hundredfold in two straight steps; what is below the axis ends at its edge."""
    speeds = np.array([0.02, 0.04, 0.08])
    one = OrderRipple(speeds, np.array([1e-7, 1e-6, 1e-5]), np.array([1e-7, 1e-7, 1e-9]), np.zeros(3))
    page = render(correction(one), ["x <y>"])
    assert "<h1>Motor x: ripple of the carriage</h1>" in page and "x &lt;y&gt;" in page
    assert "Order 2 forward, a stripe every 0.4 mm" in page
    drawn = curves(page)
    assert [colour for colour, _ in drawn] == ["c0", "c1", "c1"]
    before, after = (points for _, points in drawn[:2])
    middle = (LOW_EDGE + TOP_EDGE) / 2
    assert before[:, 1] == pytest.approx([LOW_EDGE, middle, TOP_EDGE], abs=0.1)
    assert before[1, 0] == pytest.approx(np.mean(before[[0, 2], 0]), abs=0.1)
    assert LEFT_EDGE < before[0, 0] < before[2, 0] < PANEL_WIDTH - RIGHT_MARGIN
    assert after[:, 1] == pytest.approx(3 * [LOW_EDGE], abs=0.1)
    assert re.findall(r'text-anchor="end">([\d.]+)</text>', page) == ["0.1", "1", "10"]
    rows = re.findall(r"<tr><th>order 2 forward</th>(.*?)</tr>", page)
    assert "<td>20</td><td>0.100</td><td>0.100</td>" in rows[0] and len(rows) == 3


def test_without_ramps_there_is_no_picture() -> None:
    page = render(replace(correction(OrderRipple(*(np.zeros(0),) * 4)), ripple={}), ["one line"])
    assert "Ripple over speed" not in page and "one line" in page


def test_identify_writes_the_report(records: Records, tmp_path: Path, capsys: Any) -> None:
    axis = tmp_path / "printer.toml"
    axis.write_text(FILE)
    logs = write_klipper_logs(tmp_path, records, 0, np.random.default_rng(5), 0.1)
    words = ["--drive", "klipper", "--drive-config", axis, "-o", tmp_path / "found"]
    code, out, err = cogless(capsys, "identify", *logs, *words)
    assert (code, err) == (0, "") and f"\nReport: {tmp_path / 'found' / 'report.html'}\n" in out
    page = (tmp_path / "found" / "report.html").read_text("utf-8")
    titles = re.findall(r'aria-label="Order (\d) (\w+), a stripe every ([\d.]+) mm"', page)
    assert titles == [(str(n), d, f"{0.8 / n:.3g}") for d in SIGNS for n in PROBE]
