"""Pictures of the docs: each is made by a command, none is stale; diagrams are drawn as they are written."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

DOCS = Path(__file__).parents[2] / "docs"
LAWS = ["pi", "adrc", "pi-ilc", "pi-afc", "harmonic", "robust-ilc", "anti-cogging", "trial"]
LAWS += ["space-position", "space-speed"]


@pytest.fixture(autouse=True)
def extensions(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    yield
    for name in ("blocks", "figures", "screenshots", "from_code", "drive_pictures"):
        sys.modules.pop(name, None)


def pages():
    return {
        path: path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md") if "_build" not in path.parts
    }


def test_no_page_has_a_picture_that_no_command_makes():
    for path, text in pages().items():
        outside = re.sub(r"```\{(run|shell)-figure\}.*?```", "", text, flags=re.DOTALL)
        assert not re.search(r"!\[|\{image\}|\{figure\}|<img", outside), path


def test_each_kept_picture_is_checked_by_the_page_that_makes_it():
    text = "\n".join(pages().values())
    for path in (DOCS / "images").iterdir():
        checked = f":copy: images/{path.name}" in text or f"{{screenshot}} {path.name}" in text
        assert checked, path


def test_the_screenshot_shows_the_page_as_it_is_made_today():
    from screenshots import COMMAND, source

    with Image.open(DOCS / "images" / "live.png") as image:
        assert image.info["Source"] == source(), f"stale: {COMMAND}"


@pytest.mark.parametrize("law", LAWS)
def test_each_law_has_a_diagram_and_a_picture(law):
    text = (DOCS / "laws" / f"{law}.md").read_text(encoding="utf-8")
    assert text.count("```{blocks}") == 1 and "```{run-figure}" in text


def test_each_drive_with_a_law_has_a_picture_and_another_says_why_it_has_none():
    from drives.oracle_logs import FIRMWARES

    sections = (DOCS / "guide" / "drives.md").read_text(encoding="utf-8").split("\n## ")[1:]
    text = {title.lower(): body for title, _, body in (section.partition("\n") for section in sections)}
    for drive in FIRMWARES:
        assert f"```{{drive-figure}} {drive}\n" in text[drive]
    assert "VESC has no cogging table" in text["vesc"]


def test_the_picture_of_a_drive_has_the_curves_and_the_ripple_of_its_caption(tmp_path):
    pytest.importorskip("sphinx")
    from drive_pictures import drawn
    from figures import numbers

    path, ripples = drawn("simplefoc", tmp_path)
    assert ripples["table"] < 0.1 * ripples["none"]
    (low, high), (calm_low, calm_high) = numbers(path)[:2]  # of the speed, r/min
    assert low < calm_low < 30 < calm_high < high
    # a curve within its ends has at most half their distance as its rms
    assert ripples["none"] < (high - low) / 2 and ripples["table"] < (calm_high - calm_low) / 2


def picture(path, series):
    about = PngInfo()
    about.add_text("Series", series)
    Image.new("RGB", (2, 2)).save(path, pnginfo=about)
    return path


def test_a_picture_with_other_numbers_is_stale(tmp_path):
    pytest.importorskip("sphinx")
    from figures import same

    one = picture(tmp_path / "a.png", "[[-1, 2], [0, 0]]")
    assert same(one, picture(tmp_path / "b.png", "[[-1.001, 2.001], [0, 0]]"))
    assert not same(one, picture(tmp_path / "c.png", "[[-1, 2.1], [0, 0]]"))
    assert not same(one, picture(tmp_path / "d.png", "[[-1, 2]]"))
    assert not same(one, tmp_path / "missing.png")
    plain = tmp_path / "plain.png"
    Image.new("RGB", (2, 2)).save(plain)
    assert not same(plain, plain)


def test_a_figure_of_the_report_knows_its_numbers(tmp_path):
    """What `same` compares: the ends of each curve."""
    pytest.importorskip("sphinx")
    import synthetic
    from figures import numbers

    from cogless.report import write_plots

    results = synthetic.results(synthetic.study(tmp_path), rate=1000)
    alone = replace(results, runs=results.runs[:1])
    waves = next(path for path in write_plots(alone, tmp_path) if path.name == "low-speed-waveforms.png")
    found = np.array(numbers(waves))
    assert np.all(found[:, 0] <= found[:, 1])
    # the speed of the PI after the start-up: 60 r/min and its ripple of 0.9 + 0.4 + 4.8 + 0.3
    assert found[:, 1].max() == pytest.approx(60 + 6.4, abs=0.5)


# --- diagrams

LOOP = """
ref: 0 0 = w_ref
e: 1 0 sum
pi: 2 0 a < b|PI
t: 3 0 dot
enc: 2 1 sensor
ref > e > pi > t
t ^ enc
enc > e -
""".splitlines()


def test_arrows_run_from_edge_to_edge_with_one_corner():
    pytest.importorskip("sphinx")
    from blocks import COLUMN, HIGH, RADIUS, ROW, WIDE, drawn

    svg = drawn(LOOP, "caption")
    lines = [
        [tuple(map(float, point.split(","))) for point in points.split()]
        for points in re.findall(r'points="(.*?)"', svg)
    ]
    assert lines[1] == [(COLUMN + RADIUS, 0), (2 * COLUMN - WIDE / 2, 0)]
    assert lines[3] == [(3 * COLUMN, 0), (3 * COLUMN, ROW), (2 * COLUMN + WIDE / 2, ROW)]
    assert lines[4] == [(2 * COLUMN - WIDE / 2, ROW), (COLUMN, ROW), (COLUMN, RADIUS)]
    assert svg.count("marker-end") == 4  # none into the branch
    assert "\u2212" in svg and HIGH > 0


def test_a_diagram_has_a_name_and_its_texts_are_escaped():
    pytest.importorskip("sphinx")
    from blocks import drawn

    svg = drawn(LOOP, 'a "loop" <b>')
    assert 'aria-label="a &quot;loop&quot; &lt;b&gt;"' in svg
    assert "a &lt; b" in svg and ">PI<" in svg and '<tspan dy="4" font-size="9">ref</tspan>' in svg


@pytest.mark.parametrize("line", ["ref > nowhere", "ref", "x: 1 sum"])
def test_a_line_that_is_none_is_named(line):
    pytest.importorskip("sphinx")
    from blocks import drawn

    with pytest.raises(ValueError, match=re.escape(line)):
        drawn([*LOOP, line], "caption")
