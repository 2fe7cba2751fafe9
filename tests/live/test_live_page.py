"""The live page in Chromium: opened, dragged, typed into, switched, zoomed, reloaded, printed, on a phone."""

import base64
import json
import shlex
import time
import tomllib
from urllib.parse import unquote

import axe
import live_studies
import numpy as np
import pytest
from browser import MISSING
from node import NO_ENGINE
from test_live_engine import job

from cogless.live import engine, write
from cogless.live.live_page import asset
from cogless.run.run_plan import plan
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.reading import changed, parse_change

pytestmark = pytest.mark.skipif(bool(MISSING or NO_ENGINE), reason=MISSING or NO_ENGINE)

FEW = ("pi", "pi-ilc")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return live_studies.study(tmp_path_factory.mktemp("study"))


@pytest.fixture
def page(window, path):
    """The page as it is opened first, with all that it shows computed."""
    show(window, path)
    yield window
    window.devtools("Emulation.setEmulatedMedia", media="")
    errors = [entry["message"] for entry in window._post("/se/log", {"type": "browser"})]
    assert errors == []
    assert (
        window.run(
            "return performance.getEntriesByType('resource').map((e) => e.name)"
            ".filter((name) => !name.startsWith('blob:'))"
        )
        == []
    )


def show(shown, path, within=30):
    """Open the page; if it is open, take all changes back, by an address that names none: that takes less."""
    if shown.run("return location.href.split('#')[0]") != path.as_uri():
        shown.open(path, 1300)
    else:
        shown.run(
            "history.replaceState(null, '', location.pathname); dispatchEvent(new Event('hashchange'));"
        )
    settle(shown, within)


def settle(shown, within=30):
    """Wait until all is computed and drawn, at most so many seconds."""
    end = time.monotonic() + within
    while not shown.run("return Boolean(window.cogless && window.cogless.isIdle())"):
        assert time.monotonic() < end, shown.run("return document.getElementById('state').textContent")
        time.sleep(0.02)


def values(shown, controller, off=False):
    return shown.run(f"return cogless.result('{controller}', {json.dumps(off)}).result.values")


def computed(study, scenario, controller):
    """What `cogless run` gives, in the page's order."""
    return list(simulate(study, scenario, controller).metrics.values())


def same(mine, wanted):
    assert len(mine) == len(wanted)
    for a, b in zip(mine, wanted, strict=True):
        assert a == pytest.approx(b, rel=1e-9, abs=1e-15)


def text(shown, where):
    return shown.run(f"return document.querySelector({json.dumps(where)}).innerText")


def click(shown, where):
    shown.run(f"document.querySelector({json.dumps(where)}).click()")
    settle(shown)


def place(shown, key, part):
    """Middle of a slider or field of a key, in the window."""
    found = f'[...document.querySelectorAll("#keys label")].find((l) => l.title === {json.dumps(key)})'
    return shown.run(
        f"const row = {found}.parentElement; row.parentElement.open = true;"
        f"const box = row.querySelector('input[type={part}]'); box.scrollIntoView({{block: 'center'}});"
        "const r = box.getBoundingClientRect(); return [r.left, r.top + r.height / 2, r.width]"
    )


def mouse(shown, kind, x, y):
    shown.devtools("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


def drag(shown, start, end):
    """A drag in ten steps."""
    (x, y), (to_x, to_y) = start, end
    mouse(shown, "mousePressed", x, y)
    for n in range(1, 11):
        mouse(shown, "mouseMoved", x + (to_x - x) * n / 10, y + (to_y - y) * n / 10)
    mouse(shown, "mouseReleased", to_x, to_y)
    settle(shown)


def type_into(shown, key, value):
    shown.run("document.activeElement.blur()")  # the bounds below its field go, and all below moves up
    x, y, width = place(shown, key, "number")
    shown.devtools(
        "Input.dispatchMouseEvent", type="mousePressed", x=x + width / 2, y=y, button="left", clickCount=3
    )
    shown.devtools(
        "Input.dispatchMouseEvent", type="mouseReleased", x=x + width / 2, y=y, button="left", clickCount=3
    )
    shown.devtools("Input.insertText", text=str(value))
    for kind in ("rawKeyDown", "char", "keyUp"):
        shown.devtools("Input.dispatchKeyEvent", type=kind, key="Enter", windowsVirtualKeyCode=13, text="\r")
    settle(shown)


def sets_of(shown):
    """The changes that the page's command asks for."""
    command = shown.run("return document.getElementById('command').textContent")
    words = shlex.split(command)
    return dict(parse_change(words[n + 1]) for n, word in enumerate(words) if word == "--set")


def test_it_opens_with_the_numbers_of_a_run(page, study):
    for controller in FEW:
        same(values(page, controller), computed(study, "low", controller))
    off = changed(study, {"controller.pi-ilc.learning_start": "1e9 s"})
    same(values(page, "pi-ilc", True), computed(off, "low", "pi-ilc"))
    assert "with learning off" in text(page, "#verdicts")
    assert "pi-ilc, learning off" in text(page, "#numbers")
    assert text(page, "#changes").startswith("Nothing")


def test_its_traces_have_the_native_bits(page, study):
    planned = plan(study, "low", "pi-ilc")
    given = job(study, planned, 2000) | {"module": base64.b64encode(engine.module("single")).decode()}
    rows = page.run(
        asset("engine.js").replace('"use strict";', "") + f"const given = {json.dumps(given)};"
        "const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));"
        "return WebAssembly.compile(bytes(given.module)).then((module) => {"
        "const engine = new Engine(module); engine.open(bytes(given.description), given.decimation, 10);"
        "engine.advance(given.ticks); const { rows } = engine.take();"
        "return btoa(String.fromCharCode(...new Uint8Array(rows.buffer, rows.byteOffset, 4096))); })"
    )
    state, recorder = planned.start(), planned.engine.Recorder(planned.drive, planned.decimation)
    planned.drive.advance(state, recorder, 2000)
    assert base64.b64decode(rows) == recorder.take().tobytes()[:4096]


def test_a_dragged_slider_gives_the_numbers_of_set(page, study):
    before = values(page, "pi-ilc")
    key = "controller.pi-ilc.gain"
    x, y, width = place(page, key, "range")
    drag(page, (x + width / 3, y), (x + 0.7 * width, y))
    sets = sets_of(page)
    assert list(sets) == [key] and 0.035 < sets[key] < 0.05
    assert values(page, "pi-ilc") != before
    same(values(page, "pi-ilc"), computed(changed(study, sets), "low", "pi-ilc"))
    assert "Before the change" in text(page, "#verdicts")  # the ghost
    assert "was " in text(page, "#numbers")
    assert key in text(page, "#changes")


def test_typed_values_give_the_numbers_of_set_and_a_button_goes_back(page, study):
    for key, value in (
        ('scenario.low.override."mechanics.inertia"', 4e-4),
        ('scenario.low.override."drive.position_sensor.lines"', 500),
        ("controller.pi-ilc.tuning.phase_margin", 45),
        ("scenario.low.duration", 1.5),
        ("scenario.low.reference", 90),
        ("scenario.low.load", 0.01),
        ("controller.pi-ilc.lead", 5),
    ):
        type_into(page, key, value)
        sets = sets_of(page)
        assert list(sets) == [key]
        for controller in FEW:
            same(values(page, controller), computed(changed(study, sets), "low", controller))
        click(page, "#reset")
        assert sets_of(page) == {}
    same(values(page, "pi-ilc"), computed(study, "low", "pi-ilc"))


def test_a_small_value_is_seen_with_all_its_digits(page):
    """Written out, such as 0.00000264, it is longer than its field."""
    key = "scenario.low.load"
    type_into(page, key, 4.12e-5)
    fields = f"[...document.querySelectorAll('#keys label')].find((l) => l.title === {json.dumps(key)})"
    assert page.run(f"return {fields}.parentElement.querySelector('input[type=number]').value") == "4.12e-5"


def note_of(shown, key):
    return shown.run(
        f"const l = [...document.querySelectorAll('#keys label')].find((l) => l.title === {json.dumps(key)});"
        "return l.parentElement.querySelector('.bounds').textContent"
    )


def test_a_value_beyond_the_slider_is_taken_and_one_beyond_the_field_is_refused_in_words(page, study):
    key = "controller.pi-ilc.gain"
    assert note_of(page, key) == "0 to 6"
    type_into(page, key, 0.1)  # the slider ends at 0.06
    assert sets_of(page) == {key: 0.1}
    same(values(page, "pi-ilc"), computed(changed(study, sets_of(page)), "low", "pi-ilc"))
    type_into(page, key, 1000)
    assert sets_of(page) == {key: 0.1}
    assert note_of(page, key) == "1000 is outside 0 to 6. The value stays at 0.1."
    type_into(page, key, "1,9")  # of which an English browser makes 19, and a German one 1.9
    refused = "Expected a decimal point in place of the comma. The value stays at 0.1."
    assert note_of(page, key) == refused or sets_of(page) == {key: 1.9}
    type_into(page, key, 0.02)
    assert note_of(page, key) == "0 to 6"


def test_a_value_between_stops_says_what_became_of_it(page):
    key = "controller.pi-ilc.tuning.phase_margin"
    type_into(page, key, 46)
    assert sets_of(page) == {key: "45 deg"}
    assert note_of(page, key).startswith("46 became 45: this key has 2") and note_of(page, key).endswith(
        "deg."
    )
    click(page, "#reset")
    assert note_of(page, key) == "25 to 75 deg"


def test_another_scenario_and_another_controller(page, study):
    click(page, "#scenarios [data-name=step]")
    click(page, "#controllers [data-name=table]")
    for controller in (*FEW, "table"):  # the table is learned in a run before
        same(values(page, controller), computed(study, "step", controller))
    click(page, "#controllers [data-name=pi]")
    assert "<i>PI</i>" not in text(page, "#verdicts")
    assert page.run("return cogless.state.shown") == ["pi-ilc", "table"]
    assert "--only step/pi-ilc --only step/table" in text(page, "#command")


def test_what_limits_the_best_run_is_there_until_a_value_is_changed(window, study, tmp_path):
    """It was found for the study's own values, so it isn't told of others."""
    told = 'What limits pi-ilc: steps & "so on".'
    write(study, tmp_path / "live.html", "cogless run study.toml", limits={"low": told})
    text = "return document.getElementById('limit').textContent"
    show(window, tmp_path / "live.html")
    assert window.run(text) == told
    type_into(window, "controller.pi-ilc.gain", 0.03)
    assert window.run(text) == ""
    window.run("document.getElementById('reset').click()")
    settle(window)
    assert window.run(text) == told
    window.run("document.querySelector('#scenarios [data-name=step]').click()")
    settle(window)
    assert window.run(text) == ""


def test_the_address_brings_all_back(page, study, path):
    type_into(page, "controller.pi-ilc.gain", 0.03)
    click(page, "#scenarios [data-name=step]")
    time.sleep(0.2)
    address = page.run("return location.href")
    wanted = values(page, "pi-ilc")
    page.devtools("Page.navigate", url="about:blank")
    page._post("/url", {"url": address})
    settle(page)
    assert page.run("return cogless.state.scenario") == "step"
    assert sets_of(page) == {"controller.pi-ilc.gain": 0.03}
    assert values(page, "pi-ilc") == wanted


def test_nonsense_in_the_address_is_left_alone(page, path):
    page.devtools("Page.navigate", url="about:blank")
    hostile = (
        "scenario=%3Cimg%20src=x%20onerror=alert(1)%3E&controllers=x&controller.pi-ilc.gain=1e999&motor=2"
    )
    page._post("/url", {"url": f"{path.as_uri()}#{hostile}"})
    settle(page)
    assert page.run("return cogless.state.scenario") == "low"
    assert sets_of(page) == {}


def test_the_changed_study_as_a_file_gives_the_same_run(page, study, tmp_path):
    type_into(page, 'scenario.low.override."mechanics.inertia"', 4e-4)
    type_into(page, "controller.pi-ilc.gain", 0.03)
    page.run(
        "const a = document.getElementById('download');"
        "a.addEventListener('click', (e) => e.preventDefault()); a.click()"
    )
    address = page.run("return document.getElementById('download').href")
    found = unquote(address.partition(",")[2])
    (tmp_path / "changed.toml").write_text(found, encoding="utf-8")
    again = load(tmp_path / "changed.toml")
    assert tomllib.loads(found)["seed"] == study.seed
    same(values(page, "pi-ilc"), computed(again, "low", "pi-ilc"))


def test_the_keyboard_moves_a_slider(page):
    place(page, "controller.pi-ilc.q_half_width", "range")
    page.run(
        "[...document.querySelectorAll('#keys label')].find((l) => l.title.endsWith('q_half_width'))"
        ".parentElement.querySelector('input[type=range]').focus()"
    )
    for kind in ("rawKeyDown", "keyUp"):
        page.devtools("Input.dispatchKeyEvent", type=kind, key="ArrowRight", windowsVirtualKeyCode=39)
    settle(page)
    assert sets_of(page) == {"controller.pi-ilc.q_half_width": 2}


def test_a_plot_zooms_and_goes_back(page):
    page.run("document.querySelector('#turn').scrollIntoView({block: 'center'})")
    time.sleep(0.2)  # it is painted when it comes into sight
    where = "document.querySelector('#turn .u-over').getBoundingClientRect()"
    page.run("document.querySelector('#turn .u-over').scrollIntoView({block: 'center'})")
    x, y, width, height = page.run(f"const r = {where}; return [r.left, r.top, r.width, r.height]")
    ticks = "return [...document.querySelectorAll('#turn canvas')].map((c) => c.toDataURL().length).join()"
    before = page.run(ticks)
    drag(page, (x + width * 0.3, y + height / 2), (x + width * 0.5, y + height / 2))
    time.sleep(0.1)
    assert page.run(ticks) != before


def test_on_a_phone_nothing_is_wider_than_the_page(page, path):
    page.open(path, 400)
    settle(page)
    assert page.run("return document.documentElement.scrollWidth") <= 400
    # learning on and off stand side by side
    table = "const table = document.querySelector('#numbers').parentElement;"
    assert page.run(f"{table} return table.scrollWidth <= table.clientWidth")
    page.open(path, 1300)
    settle(page)
    assert page.run("return document.documentElement.scrollWidth") <= 1300


def test_on_paper_the_numbers_are_there(page):
    assert page.pdf().startswith(b"%PDF")
    page.devtools("Emulation.setEmulatedMedia", media="print")
    assert page.run("return getComputedStyle(document.getElementById('values')).display") == "none"
    assert page.run("return document.getElementById('numbers').getBoundingClientRect().height") > 100


def test_the_policy_stops_what_is_not_the_pages_own(page):
    """A script, an image or a request put into the page does nothing."""
    done = page.run(
        "window.broken = 0; const s = document.createElement('script'); s.textContent = 'window.broken = 1';"
        "document.body.append(s);"
        "const sent = fetch('https://example.invalid/').then(() => 'sent', () => 'stopped');"
        "return sent.then((how) => [how, window.broken])"
    )
    assert done == ["stopped", 0]
    page._post("/se/log", {"type": "browser"})  # these two are told there
    assert page.run("return document.title") == "A <b>small</b> drive </script><script>alert(1)</script>"
    assert page.run("return document.querySelectorAll('h1 b, .description b, #verdicts i').length") == 0


def test_a_failing_run_is_told_and_the_page_lives_on(page, study):
    page.run(
        "cogless.state.values.set('controller.pi-ilc.lead', -1); cogless.set('controller.pi-ilc.gain', 0.01)"
    )
    settle(page)
    assert "pi-ilc: memory.lead is outside its range" in text(page, "#verdicts .worse")
    page.run("cogless.state.values.clear(); cogless.set('controller.pi-ilc.gain', 0.02)")
    settle(page)
    same(values(page, "pi-ilc"), computed(study, "low", "pi-ilc"))


def test_it_is_small_and_whole(path):
    page = path.read_text(encoding="utf-8")
    assert len(page) < 1_500_000
    assert page.count('http-equiv="Content-Security-Policy" content="default-src \'none\';') == 1
    for word in ('src="http', 'href="http', "@import", "url(http"):
        assert word not in page


def test_no_row_of_the_page_is_empty(page):
    rows = page.run(
        "const rows = [...document.querySelectorAll('#numbers tbody tr')];"
        "return rows.map((r) => [...r.cells].map((c) => c.innerText))"
    )
    assert len(rows) > 4
    assert all(np.all([cell for cell in row]) for row in rows)


@pytest.mark.skipif(bool(axe.MISSING), reason=axe.MISSING)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(page, scheme):
    media = [{"name": "prefers-color-scheme", "value": scheme}]
    page.devtools("Emulation.setEmulatedMedia", features=media)
    page.run("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    found = axe.findings(page)
    page.devtools("Emulation.setEmulatedMedia", features=[])
    assert found == []
