"""What the still pictures draw: curves, bars and marks in matplotlib's axes, before they are rendered."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from cogless.identify.result import Estimate, Value, Wave
from cogless.report import identified, pictures
from cogless.report.charts import (
    Bars,
    Changed,
    Chart,
    ChosenTrials,
    Curve,
    Grid,
    OverAngle,
    OverFrequency,
    OverTrials,
    Series,
    Span,
    Spectrum,
    TrialCurves,
    TrialPanel,
    Trials,
    TrialWaveforms,
    Waveforms,
    Zoom,
)

LOOKS = [{"color": f"C{n}", "label": name} for n, name in enumerate("abc")]


def axes_of(plot):
    axes = Figure().subplots()
    plot.draw(axes)
    return axes


def curves(axes):
    """Colour, x and y of each curve."""
    return [(line.get_color(), list(line.get_xdata()), list(line.get_ydata())) for line in axes.lines]


def curve(controller, values, **more):
    return Curve(controller=controller, values=np.array(values), **more)


def chart(kind=Chart, **more):
    return kind(**{"title": "Title", "x": "along", "quantity": "what", "unit": "A", "series": [], **more})


def rows_of(kind, **charts):
    """The rows of plots of a kind of picture, from a scenario's charts."""
    return (pictures.SPEED_PICTURES | pictures.TRIAL_PICTURES)[kind].rows(SimpleNamespace(**charts), LOOKS)


def test_axes_are_named_by_quantity_and_unit():
    for unit, name in (("A", "what (A)"), ("", "what")):
        (row,) = pictures.stack([chart(unit=unit)], lambda *_: None)
        assert [(plot.x, plot.y, plot.title) for plot in row] == [("along", name, "Title")]


def test_errors_over_the_trials_with_floor_and_changes():
    """Held as logarithms; the names of changes take turns on four lines from the top."""
    marks = [Changed(10 * n, f"change {n}") for n in range(1, 6)]
    both = [curve(0, [0.0, 1.0, 2.0]), curve(2, [1.0, 0.0, -1.0])]
    floored = chart(OverTrials, series=both, note="", floor=0.5, floor_name="floor")
    plain = chart(OverTrials, series=both, note="")
    (first,), (second,) = rows_of("rms", over_trials=Trials([floored, plain], 3, marks, []))
    axes = axes_of(first)
    drawn = curves(axes)
    assert [(colour, x) for colour, x, _ in drawn[:2]] == [("C0", [1, 2, 3]), ("C2", [1, 2, 3])]
    assert [y for _, _, y in drawn[:2]] == [pytest.approx([1, 10, 100]), pytest.approx([10, 1, 0.1])]
    assert drawn[2][2] == [0.5, 0.5] and [x for _, x, _ in drawn[3:]] == [[10 * n] * 2 for n in range(1, 6)]
    assert [line.get_linestyle() for line in axes.lines[2:]] == ["--"] + 5 * [":"]
    assert {line.get_linewidth() for line in axes.lines[2:]} == {0.8}
    assert axes.get_yscale() == "log"
    named, *changes = axes.texts
    assert (named.get_text(), named.xy, named.get_ha(), named.get_va()) == (
        "floor", (0.995, 0.5), "right", "bottom"
    )  # fmt: skip
    assert [(text.get_text(), text.get_position()) for text in changes] == [
        (f"change {n}", (3, 0)) for n in range(1, 6)
    ]
    assert np.array([text.xy for text in changes]) == pytest.approx(
        np.column_stack([[10, 20, 30, 40, 50], [1, 0.94, 0.88, 0.82, 1]])
    )
    assert {text.get_fontsize() for text in axes.texts} == {8}
    assert len(axes_of(second).lines) == 2 + len(marks)  # without a floor


def test_the_first_trials_of_four_phases_are_drawn_with_their_references():
    phases = [ChosenTrials(f"phase no {n}", [10 * n + 1, 10 * n + 5]) for n in range(5)]
    trials = [{str(10 * n + 1): np.array([n, n + size]) for n in range(5)} for size in (1, 2)]
    panels = [
        chart(
            TrialPanel,
            series=[TrialCurves(controller=1 + k, trials=of_them) for k, of_them in enumerate(trials)],
            references=[np.array([0.0, n]) for n in range(5)],
        ),
        chart(TrialPanel, series=[TrialCurves(controller=0, trials=trials[0])], references=[]),
    ]
    waves = TrialWaveforms(
        panels=panels, phases=phases, note="", x="time in the trial (s)", start=0.5, step=2.0
    )
    above, below = rows_of("trials", waveforms=waves)
    assert [plot.x for plot in above] == [
        f"time in the trial (s); phase no\n{n}" for n in range(4)
    ]  # 32 a line
    axes = axes_of(above[3])
    assert [(colour, x) for colour, x, _ in curves(axes)] == [
        (colour, [0.5, 2.5]) for colour in ("C1", "C2", pictures.REFERENCE["color"])
    ]
    assert np.array([y for *_, y in curves(axes)]) == pytest.approx(np.array([[3, 4], [3, 5], [0, 3]]))
    assert axes.lines[2].get_linestyle() == "--"
    assert len(axes_of(below[3]).lines) == 1


def test_factors_of_a_certificate_are_over_a_logarithmic_axis_with_a_line_at_one():
    both = [curve(1, [0.5, 0.25]), curve(1, [0.75, 1.5], dash=True)]
    certificate = [chart(OverFrequency, frequency=np.array([1.0, 100.0]), series=both)]
    ((plot,),) = rows_of("certificate", certificate=certificate)
    axes = axes_of(plot)
    full, dashed, one = axes.lines
    assert [line.get_color() for line in (full, dashed)] == ["C1", "C1"]
    assert list(full.get_xdata()) == [1.0, 100.0]
    assert full.get_ydata() == pytest.approx([0.5, 0.25], rel=1e-4)
    assert dashed.get_ydata() == pytest.approx([0.75, 1.5], rel=1e-4)
    assert (full.get_linestyle(), full.get_label(), dashed.get_linestyle()) == ("-", "b", "--")
    assert axes.get_legend_handles_labels()[1] == ["b"]  # once
    assert one.get_ydata() == [1, 1] and (one.get_linewidth(), one.get_color()) == (1, pictures.FAINT)
    assert axes.get_xscale() == "log" and axes.get_ylim()[0] == 0


def waves(*details):
    """Ten points from 0 to 9 s, and finer ones of half a second in the spans of `details`."""
    fine = [start + 0.5 * np.arange(count) for start, count in details]
    both = [
        curve(1, np.arange(10.0), details=fine),
        Curve(dash=True, values=np.arange(10.0), details=fine),
    ]
    return Waveforms([chart(series=both)], "time (s)", 0.0, 1.0, [Grid(start, 0.5) for start, _ in details])


def test_waveforms_are_drawn_whole_and_at_their_end_or_their_fault():
    zooms = {
        "whole run": (0.0, 9.0), "after start-up": (2.0, 9.0), "last revolution": (8.0, 9.0),
        "fault at 4 s": (3.0, 6.0),
    }  # fmt: skip
    for names, shown in (
        (["whole run", "after start-up", "last revolution"], ["after start-up", "last revolution"]),
        (["whole run", "last revolution", "fault at 4 s"], ["whole run", "fault at 4 s"]),
        (["whole run"], ["whole run"]),
    ):
        buttons = [Zoom(name, *zooms[name]) for name in names]
        (row,) = rows_of("waveforms", waveforms=waves(), zooms=buttons, marks=[])
        assert [plot.x for plot in row] == [f"time (s), {name}" for name in shown]
        for plot, name in zip(row, shown, strict=True):
            first, last = zooms[name]
            both = curves(axes_of(plot))
            assert [colour for colour, *_ in both] == ["C1", pictures.REFERENCE["color"]]
            for _, x, y in both:
                assert x == np.arange(first, last + 1).tolist() and y == pytest.approx(x, abs=1e-3)


@pytest.mark.parametrize(
    ("begin", "end", "step"),
    [(3.0, 5.0, 0.5), (2.0, 6.0, 0.5), (1.9, 5.0, 1.0), (3.0, 6.1, 1.0)],  # a coarse point about 3 to 5 s
)
def test_a_zoom_is_drawn_in_the_finer_points_that_reach_within_a_coarse_one(begin, end, step):
    shown = waves((7.0, 2), (3.0, 4))
    times, values = pictures._finest(shown, shown.panels[0].series[0], Zoom("", begin, end))
    assert np.diff(times) == pytest.approx(step) and len(values) == (4 if step == 0.5 else 10)
    assert times[0] == values[0] == (3.0 if step == 0.5 else 0.0)


def test_a_fault_is_shaded_as_far_as_it_is_shown():
    ends = ((0.0, 2.0), (1.0, 3.0), (4.0, 4.5), (5.0, 8.0), (6.0, 7.0))
    marks, zooms = [Span(a, b, "") for a, b in ends], [Zoom("whole run", 2.0, 6.0)]
    ((plot,),) = rows_of("waveforms", waveforms=waves(), zooms=zooms, marks=marks)
    shaded = axes_of(plot).patches
    assert [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in shaded] == [
        (2.0, 3.0), (4.0, 4.5), (5.0, 6.0)
    ]  # fmt: skip
    assert {(to_hex(patch.get_facecolor()), patch.get_alpha()) for patch in shaded} == {("#b3401f", 0.13)}


def test_a_learned_map_is_a_curve_over_the_angle():
    both = [Series(controller=n, values=np.array([n, 1.0, 2.0])) for n in (1, 0)]
    ((plot,),) = rows_of("map", maps=[chart(OverAngle, angle=[0, 90, 180], series=both)])
    assert curves(axes_of(plot)) == [("C1", [0, 90, 180], [1, 1.0, 2.0]), ("C0", [0, 90, 180], [0, 1.0, 2.0])]


def test_bars_of_an_order_stand_side_by_side_about_its_place():
    """Of two controllers each is 0.39 wide, and drawn in 92 % of that; what is no number has no height."""
    sizes = ((2, [1.0, np.nan]), (0, [3.0, 4.0]))
    both = [Bars(controller=n, values=np.array(values)) for n, values in sizes]
    ((plot,),) = rows_of("spectra", spectra=[chart(Spectrum, orders=[6, 24], series=both)])
    axes = axes_of(plot)
    for bars, colour, x, heights in zip(
        axes.containers, ("C2", "C0"), (-0.195, 0.195), ([1, 0], [3, 4]), strict=True
    ):
        assert {to_hex(bar.get_facecolor()) for bar in bars} == {to_hex(colour)}
        assert [bar.get_x() + bar.get_width() / 2 for bar in bars] == pytest.approx([x, 1 + x])
        assert [bar.get_width() for bar in bars] == pytest.approx([0.92 * 0.39] * 2)
        assert [bar.get_height() for bar in bars] == heights
    assert [text.get_text() for text in axes.get_xticklabels()] == ["6", "24"]
    assert not any(line.get_visible() for line in axes.get_xgridlines())
    end = 0.195 + 0.46 * 0.39  # of the outer bars, beyond their place
    assert axes.get_xlim() == pytest.approx((-end - 0.05 * (1 + 2 * end), 1 + end + 0.05 * (1 + 2 * end)))


@pytest.fixture
def figures(monkeypatch):
    """Figures and what their files say about them, in the order in which they are written, not rendered."""
    kept = []

    def keep(canvas, path, metadata):
        path.touch()
        kept.append((canvas.figure, metadata))

    monkeypatch.setattr(FigureCanvasAgg, "print_png", keep)
    return kept


def test_a_picture_is_as_wide_as_its_columns_need_and_as_high_as_its_rows(tmp_path, figures):
    def line(label):
        return pictures.Plot(lambda ax: ax.plot([0, 1], [2.00004, np.nan], label=label), label, "y", "title")

    pictures.save(tmp_path / "one.png", "Word " * 30, [[line("a")], [line("b")], [line("b")]], 2.0, "run")
    pictures.save(tmp_path / "two.png", "Short", [[line("a"), line("a")]], 1.5, "", (2, 1, 7))
    pictures.save(tmp_path / "bars.png", "", [[pictures.Plot(lambda ax: ax.bar([0, 1], [3, -1]))]], 1.0, "")
    (one, about), (two, _), (bars, of_bars) = figures
    assert one.get_size_inches().tolist() == pytest.approx([9, 0.9 + 3 * 2.0])
    assert two.get_size_inches().tolist() == pytest.approx([12, 0.9 + 1.5])
    assert max(map(len, one.get_suptitle().splitlines())) in range(68, 73) and two.get_suptitle() == "Short"
    assert one._suptitle.get_position()[0] == 0.01 and one._suptitle.get_fontweight() == "bold"
    assert [axes.get_xlabel() for axes in one.axes] == ["a", "", "b"]  # not where the next has the same
    assert [axes.get_title() for axes in two.axes] == ["title", ""]
    assert two.axes[0].get_gridspec().get_width_ratios() == (2, 1)
    assert about == {"Run": "run", "Series": "[[2.0, 2.0], [2.0, 2.0], [2.0, 2.0]]"}
    assert of_bars["Series"] == "[[-1.0, 3.0]]" and not bars.legends[0].get_texts()


def test_only_pictures_with_a_plot_are_written(tmp_path, figures, monkeypatch):
    monkeypatch.setattr(pictures, "run_id", lambda results: "id")
    one = pictures.Picture(
        lambda data, looks: [[pictures.Plot(lambda ax: ax.plot([0], [data], **looks[0]))]], 1.5
    )
    kinds = {
        "none": pictures.Picture(lambda *_: [], 1.0),
        "one": one,
        "empty": pictures.Picture(lambda *_: [[]], 1.0),
    }
    monkeypatch.setattr(pictures, "colours", lambda results: {"pi": 1})
    study = SimpleNamespace(title="Study", label=str.upper)
    results = SimpleNamespace(scenarios=["low"], study=study)
    assert pictures.write_plots(results, [5.0], kinds, tmp_path) == [tmp_path / "low-one.png"]
    ((figure, about),) = figures
    assert (figure.get_suptitle(), about["Run"]) == ("Study: low", "id")
    (line,) = figure.axes[0].lines
    assert (line.get_label(), list(line.get_ydata()), line.get_linewidth()) == ("PI", [5.0], 0.9)
    assert line.get_color() == pictures.asset("report.css").split("--c1: ")[1][:7]


@pytest.mark.parametrize(("count", "length", "abreast"), [(3, 4, 3), (20, 3, 12), (20, 6, 9), (2, 200, 1)])
def test_a_legend_has_as_many_columns_as_its_labels_leave_room_for(tmp_path, figures, count, length, abreast):
    """108 letters in a line; each label takes six more."""
    labels = [f"{n:02d}".ljust(length, "x")[:length] for n in range(count)]
    plot = pictures.Plot(lambda ax: [ax.plot([0], [0], label=label) for label in labels])
    pictures.save(tmp_path / "legend.png", "", [[plot]], 1.0, "")
    assert figures[0][0].legends[0]._ncols == abreast


def test_the_found_orders_are_bars_with_their_errors(tmp_path, figures):
    waves = tuple(Wave(order, Value(size, error), Value(0.0, 0.0)) for order, size, error in (
        (6, 0.03, 0.01), (24, 0.05, 0.0)
    ))  # fmt: skip
    motor = SimpleNamespace(star=lambda: SimpleNamespace(K_t=0.5))
    servo: Any = SimpleNamespace(title="Servo", motor=motor)
    made = Estimate(servo, (), {}, waves, (), waves[:1] * 4, {}, (), ())
    identified.write_plot(made, tmp_path / "orders.png")
    ((figure, _),) = figures
    assert figure.get_suptitle() == "Servo: orders, with errors at 95 %"
    assert figure.get_size_inches()[1] == pytest.approx(0.9 + 2 * 1.7)
    cogging, encoder = figure.axes
    assert (cogging.get_title(loc="left"), cogging.get_ylabel()) == ("Cogging", "mN m")
    assert (encoder.get_title(loc="left"), encoder.get_ylabel()) == ("Encoder's error", "deg")
    bars = [bar for group in cogging.containers for bar in group]
    assert [(bar.get_x(), bar.get_width(), bar.get_height()) for bar in bars] == [
        pytest.approx((-0.3, 0.6, 15.0)), pytest.approx((0.7, 0.6, 25.0))
    ]  # fmt: skip
    blue = pictures.asset("report.css").split("--c1: ")[1][:7]
    assert {to_hex(bar.get_facecolor()) for bar in bars} == {blue.lower()}
    (first, second) = cogging.lines
    assert list(first.get_xdata()) == [0, 0] and first.get_ydata() == pytest.approx([10, 20])
    assert second.get_ydata() == pytest.approx([25, 25]) and first.get_linewidth() == 2
    assert [text.get_text() for text in cogging.get_xticklabels()] == ["6", "24"]
    assert cogging.get_xlim() == (-1, 3) and encoder.get_xlim() == (-1, 4)
    assert not any(line.get_visible() for line in cogging.get_xgridlines())
    assert encoder.containers[0][0].get_height() == pytest.approx(np.degrees(0.03))
    made = replace(made, cogging=(), encoder=())
    identified.write_plot(made, tmp_path / "nothing.png")
    assert len(figures) == 1 and not (tmp_path / "nothing.png").exists()
