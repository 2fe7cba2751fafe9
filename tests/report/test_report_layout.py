"""The reports as they are laid out: at 1300 and 400 pixels, and on paper."""

import re
from dataclasses import replace

import axe
import numpy as np
import pytest
import synthetic
from browser import MISSING, browser
from test_report import data_of
from test_report_orders import RATE, with_signals

from cogless.report import write
from cogless.report.markup import asset
from cogless.results import Results

FEW = ["pi", "fair-pi", "pi-ilc"]
MORE = {"other": "PI with twice the published gains", "another": "PI with half of the published gains"}


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """Results of five controllers, two with long names; ripple of each mechanical order up to the 30th."""
    text = synthetic.STUDY
    begin, end = text.index("[controller.fair-pi]"), text.index("[controller.pi-ilc]")
    for name, label in MORE.items():
        one = text[begin:end].replace("fair-pi", name).replace("PI re-tuned", label)
        text = text.replace("[[metric]]", f"{one}[[metric]]", 1)
    study = synthetic.study(tmp_path_factory.mktemp("five"), text)
    few = synthetic.results(synthetic.study(tmp_path_factory.mktemp("few")), rate=5000)
    copies = [replace(run, controller=name) for run in few.runs if run.controller == "pi" for name in MORE]
    order = [*FEW, *MORE]
    runs = sorted([*few.runs, *copies], key=lambda run: (run.scenario, order.index(run.controller)))
    return Results(study, [rippling(run) for run in runs])


def rippling(run):
    data = run.trace.data.copy()
    angle = np.outer(run.trace["theta_m"], np.arange(1, 31))
    data[:, run.trace.names.index("omega_m")] += 0.02 * np.cos(angle).sum(axis=1)
    return replace(run, trace=replace(run.trace, data=data))


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    study = synthetic.study(tmp_path_factory.mktemp("trials"), synthetic.TRIALS)
    return synthetic.trial_results(study)


@pytest.fixture(scope="module")
def pages(tmp_path_factory, five, trials):
    folder = tmp_path_factory.mktemp("pages")
    for name, results in {"speed": five, "trials": trials}.items():
        write(results, folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in ("speed", "trials")}


# --- as it is written


@pytest.mark.parametrize("kind", ["speed", "trials"])
def test_every_table_of_figures_scrolls_by_keys_under_its_name(pages, kind):
    page = pages[kind].read_text(encoding="utf-8")
    tables = [(page[: at.start()][-120:], at[1]) for at in re.finditer(r'<table class="(\w+)"', page)]
    assert {name for _, name in tables} == {
        "speed": {"numbers", "terms"},
        "trials": {"numbers", "proof", "gains"},
    }[kind]
    for before, _ in tables:
        assert re.search(r'<div class="scroll" tabindex="0" role="region" aria-label="[^"]+">$', before)


def test_each_scenario_is_a_part_of_its_own_with_its_verdict_and_colours(pages, five):
    page = pages["speed"].read_text(encoding="utf-8")
    parts = re.findall(
        r'<article class="scenario" data-scenario="(\d)"( hidden)?>(.*?)</article>', page, re.S
    )
    assert [(place, bool(hidden)) for place, hidden, _ in parts] == [("0", False), ("1", True)]
    for (_, _, part), scenario in zip(parts, five.scenarios, strict=True):
        assert f"<h2>{scenario}</h2>" in part and part.count('class="headline"') == 1
        assert [label in part for label in MORE.values()] == [True, True]
        for section in ("numbers", "waveforms", "spectra", "terms"):
            assert f'data-part="{section}"' in part
    assert "7.52 times less" in parts[0][2] and "7.52 times less" not in parts[1][2]


def test_the_reference_is_drawn_last(pages):
    """What is drawn later lies on top."""
    for scenario in data_of(pages["speed"].read_text(encoding="utf-8"))["scenarios"]:
        series = scenario["waveforms"]["panels"][0]["series"]
        assert [s.get("dash", False) for s in series] == [False] * 5 + [True]
        assert "dash" in scenario["events"][0]["panels"][0]["series"][-1] if scenario["events"] else True


# --- as it is laid out

needs_browser = pytest.mark.skipif(bool(MISSING), reason=MISSING)

# Keeps each canvas's texts: [text, left, top, right, bottom], px.
RECORD = """
const write = CanvasRenderingContext2D.prototype.fillText;
const wipe = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...box) {
  this.canvas.texts = [];
  return wipe.apply(this, box);
};
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  const box = this.measureText(text);
  const [left, top] = [x - box.actualBoundingBoxLeft, y - box.actualBoundingBoxAscent];
  const [right, bottom] = [x + box.actualBoundingBoxRight, y + box.actualBoundingBoxDescent];
  const turned = ([x, y]) => this.getTransform().transformPoint({ x, y });
  const [a, b] = [[left, top], [right, bottom]].map(turned); // an upright text has them the other way round
  const corners = [Math.min(a.x, b.x), Math.min(a.y, b.y), Math.max(a.x, b.x), Math.max(a.y, b.y)];
  if (text.trim()) (this.canvas.texts ??= []).push([text, ...corners]);
  return write.call(this, text, x, y);
};
"""
TEXTS = "return [...document.querySelectorAll('canvas')].map((c) => [c.width, c.height, c.texts ?? []])"


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("chromium")) as shown:
        shown.devtools("Page.addScriptToEvaluateOnNewDocument", source=RECORD)
        yield shown


def overlapping(texts):
    return [
        (a[0], b[0])
        for i, a in enumerate(texts)
        for b in texts[:i]
        if a[1] < b[3] - 1 and b[1] < a[3] - 1 and a[2] < b[4] - 1 and b[2] < a[4] - 1
    ]


@needs_browser
@pytest.mark.parametrize("kind", ["speed", "trials"])
@pytest.mark.parametrize("width", [1300, 400])
def test_texts_on_plots_are_whole_and_apart(chromium, pages, kind, width):
    chromium.open(pages[kind], width)
    if kind == "speed":  # far in, where numbers are long
        chromium.run("[...document.querySelectorAll('.zooms button')].at(-1).click()")
    drawn = chromium.run(TEXTS)
    assert len(drawn) > 4 and all(texts for _, _, texts in drawn)
    for wide, high, texts in drawn:
        assert overlapping(texts) == []
        for text, left, top, right, bottom in texts:
            assert left >= -1 and top >= -1 and right <= wide + 1 and bottom <= high + 1, text


@needs_browser
def test_an_axis_has_two_numbers_at_least(chromium, tmp_path):
    """Steps of 0.5 A, the next after 0.25 A, leave only the 0 of a current up to 0.4 A."""
    made = synthetic.results(synthetic.study(tmp_path), rate=RATE)
    moved = with_signals(made, "low-speed", i_q_ref=lambda run: 0.4 * np.sin(20 * run.trace.time))
    write(moved, tmp_path / "report.html")
    chromium.open(tmp_path / "report.html", 1300)
    drawn = chromium.run(TEXTS)
    (current,) = (texts for _, _, texts in drawn if any(text.startswith("i_q_ref") for text, *_ in texts))
    beside = [text for text, _, _, right, _ in current if right < 76 and re.fullmatch(r"-?[\d.]+", text)]
    assert len(beside) > 1


@needs_browser
@pytest.mark.parametrize("kind", ["speed", "trials"])
@pytest.mark.parametrize("width", [1300, 400])
def test_nothing_is_cut_off_but_what_scrolls_by_keys(chromium, pages, kind, width):
    chromium.open(pages[kind], width)
    page, wider = chromium.run("""
      const cuts = (e) => getComputedStyle(e).overflowX;
      const shown = [...document.querySelectorAll("main, main *")].filter((e) => e.checkVisibility());
      const wide = shown.filter((e) => e.clientWidth && e.scrollWidth > e.clientWidth + 1);
      const cut = wide.filter((e) => cuts(e) !== "visible" && !e.matches(".uplot *"));
      const told = cut.map((e) => [e.className, e.tabIndex, cuts(e), e.ariaLabel]);
      return [document.documentElement.scrollWidth, told];
    """)
    assert page <= width
    for name, tab, overflow, label in wider:
        assert (tab, overflow) == (0, "auto") and label, name
    if width == 1300:
        assert wider == []  # there is room for five controllers
    else:
        assert {"scroll"} <= {name for name, *_ in wider}
        stays = chromium.run("""
          const box = document.querySelector(".scroll:has(.numbers)");
          const heading = box.querySelector("tbody th");
          box.scrollLeft = 1000;
          return heading.getBoundingClientRect().left - box.getBoundingClientRect().left;
        """)
        assert stays == pytest.approx(1, abs=1)  # what a row is stands beside its figures


@needs_browser
def test_bars_are_wide_enough_to_be_seen_at_400_pixels(chromium, pages):
    """Each order has as many bars as controllers; narrower than 2 px they would vanish."""
    chromium.open(pages["speed"], 400)
    narrowest = chromium.run("""
      const widths = [];
      const fill = CanvasRenderingContext2D.prototype.fillRect;
      CanvasRenderingContext2D.prototype.fillRect = function (x, y, width, height) {
        widths.push(width);
        return fill.call(this, x, y, width, height);
      };
      document.querySelector(".log").click();
      return new Promise((done) => setTimeout(() => done(Math.min(...widths)), 50));
    """)
    assert narrowest >= 2


@needs_browser
@pytest.mark.parametrize("kind", ["speed", "trials"])
def test_paper_has_the_plots_of_all_scenarios_and_the_screen_one_again(chromium, pages, kind):
    chromium.open(pages[kind], 1300)
    of_each = """
      const canvases = (scenario) => [...scenario.querySelectorAll("canvas")];
      const widest = (all) => Math.max(0, ...all.map((c) => c.clientWidth));
      const all = [...document.querySelectorAll(".scenario")].map(canvases);
      return all.map((some) => [some.length, widest(some)]);
    """
    before = chromium.run(of_each)
    chromium.run("dispatchEvent(new Event('beforeprint'))")
    chromium.devtools("Emulation.setEmulatedMedia", media="print")
    printed = chromium.run(of_each)
    heads = "return [...document.querySelectorAll('.printed h2')].map((h) => h.checkVisibility())"
    titles = chromium.run(heads)
    assert all(titles) and all(count >= 5 and 400 < widest <= 680 for count, widest in printed)
    assert all(texts for _, _, texts in chromium.run(TEXTS))
    chromium.devtools("Emulation.setEmulatedMedia", media="")
    chromium.run("dispatchEvent(new Event('afterprint'))")
    assert chromium.run(of_each) == before and all(count == 0 for count, _ in before[1:])


def test_paper_begins_a_scenario_on_a_page_of_its_own():
    paper = asset("report.css").split("@media print")[1]
    assert re.search(r"\.scenario \{[^}]*break-before: page", paper)
    assert re.search(r"\.printed \{ display: block", paper)


@needs_browser
@pytest.mark.parametrize("kind", ["speed", "trials"])
def test_a_plots_numbers_open_as_a_table(chromium, pages, kind):
    chromium.open(pages[kind], 1300)
    rows = chromium.run("""
      const fold = document.querySelector(".panel details");
      fold.open = true;
      return new Promise((done) => setTimeout(() => {
        const row = (r) => [...r.children].map((c) => c.textContent);
        done([...fold.querySelectorAll("tr")].map(row));
      }, 50));
    """)
    head, *body = rows
    assert 2 < len(body) <= 25 and all(len(row) == len(head) for row in body)
    assert all(re.fullmatch(r"-?[\d.]+(e[-+]?\d+)?|\u2013", cell) for row in body for cell in row)


@needs_browser
@pytest.mark.skipif(bool(axe.MISSING), reason=axe.MISSING)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", ["speed", "trials"])
def test_axe_finds_nothing_serious(chromium, pages, kind, scheme):
    chromium.devtools(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}]
    )
    chromium.open(pages[kind], 1300)
    chromium.run("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    chromium.run("document.querySelector('.bar .chips button').click()")  # one is hidden
    found = axe.findings(chromium)
    chromium.devtools("Emulation.setEmulatedMedia", features=[])
    assert found == []


@needs_browser
@pytest.mark.skipif(bool(axe.MISSING), reason=axe.MISSING)
def test_axe_finds_what_is_wrong(chromium, tmp_path):
    page = tmp_path / "page.html"
    page.write_text('<!doctype html><html lang="en"><title>t</title><main><button></button></main>')
    chromium.open(page, 400)
    assert [line.split(":")[0] for line in axe.findings(chromium)] == ["button-name"]
