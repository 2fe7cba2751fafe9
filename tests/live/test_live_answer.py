"""What one sees first in the live page: two figures, a revolution, two rotors; and what one may add."""

import json
import time
from pathlib import Path

import live_studies
import numpy as np
import pytest
from browser import MISSING
from node import NO_ENGINE
from test_live_page import computed, same, sets_of, settle, show, text, values

from cogless.live.key_words import KEY_WORDS, key_words
from cogless.live.keys import adjustable
from cogless.run.simulate import simulate
from cogless.study import load
from cogless.study.reading import changed

needs_browser = pytest.mark.skipif(bool(MISSING or NO_ENGINE), reason=MISSING or NO_ENGINE)
RPM = np.pi / 30
DOCS = Path(__file__).parents[2] / "docs"
ROUNDING_LEVELS = 8  # of 255, in single pixels at the edge of a curve


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return live_studies.study(tmp_path_factory.mktemp("study"))


@pytest.fixture
def page(window, path):
    show(window, path)
    yield window
    window.devtools("Emulation.setEmulatedMedia", media="", features=[])
    assert [entry["message"] for entry in window._post("/se/log", {"type": "browser"})] == []


def figures(shown):
    return shown.run("return [...document.querySelectorAll('#figures strong')].map((s) => s.textContent)")


@needs_browser
def test_it_opens_with_the_figures_of_both_runs(page, study):
    ripples = [
        next(x for name, x in simulate(study, "low", c).metrics.items() if "ripple" in name) / RPM
        for c in ("pi", "pi-ilc")
    ]
    before, after, change = figures(page)
    assert [float(before), float(after)] == pytest.approx(ripples, rel=5e-3)
    assert change == f"{float(f'{ripples[0] / ripples[1]:.3g}'):g} times less"
    command = "document.getElementById('figures').getBoundingClientRect()"
    assert page.run(f"return {command}.top") < 250


@needs_browser
def test_the_picture_is_the_runs_speed_over_the_angle(page, study):
    """Against the native trace, by NumPy, at each of the page's angles that the trace has turned through."""
    trace = simulate(study, "low", "pi").trace
    theta, speed = trace["theta_m"], trace["omega_m"]
    drawn = page.run("return cogless.result('pi').result.revolution")
    cells = len(drawn) - 1
    first = np.flatnonzero(np.abs(theta[-1] - theta) >= 2 * np.pi)[-1]
    start = np.ceil(theta[first] / (2 * np.pi) * cells) + 1
    at = np.arange(start, start + cells - 2)
    expected = np.interp(at * 2 * np.pi / cells, theta[first:], speed[first:])
    assert np.array(drawn)[at.astype(int) % cells] == pytest.approx(expected, rel=1e-9)


@needs_browser
def test_the_ripple_over_the_time_is_the_rms_of_a_revolution(page, study):
    trace = simulate(study, "low", "pi").trace
    ripple = page.run("return cogless.result('pi').result.ripple")
    turns = abs(trace["theta_m"][-1] - trace["theta_m"][0]) / (2 * np.pi)
    rows = round(len(trace) / turns) if turns >= 2 else len(trace) // 20
    for end, value in list(zip(ripple["at"], ripple["values"], strict=True))[::7]:
        last = int(np.argmin(np.abs(trace.time - end))) + 1
        assert value == pytest.approx(np.std(trace["omega_m"][max(0, last - rows) : last]), rel=0.05)


@needs_browser
@pytest.mark.parametrize("width", [1300, 400])
def test_the_picture_is_in_sight_when_the_page_opens(window, path, width):
    window.open(path, width)
    settle(window)
    top, high = window.run(
        "const r = document.querySelector('#picture .plot').getBoundingClientRect(); return [r.top, r.height]"
    )
    assert top < 450 and high >= 360
    window.open(path, 1300)
    settle(window)


@needs_browser
def test_two_rotors_turn_until_one_stops_them(page):
    picture = "return document.getElementById('rotor').toDataURL()"
    moves = lambda: len({(time.sleep(0.1), page.run(picture))[1] for _ in range(4)}) > 1  # noqa: E731
    page.run("document.getElementById('rotors').scrollIntoView()")
    assert text(page, "#turn-rotor") == "Stop" and moves()
    page.run("document.getElementById('turn-rotor').click()")
    time.sleep(0.1)
    assert text(page, "#turn-rotor") == "Turn" and not moves()
    page.run("document.getElementById('turn-rotor').click()")
    assert moves()


@needs_browser
def test_rotors_rest_where_motion_is_not_wanted(page):
    still = [{"name": "prefers-reduced-motion", "value": "reduce"}]
    page.devtools("Emulation.setEmulatedMedia", features=still)
    time.sleep(0.2)
    assert text(page, "#turn-rotor") == "Turn"
    pictures = set()
    for _ in range(3):
        time.sleep(0.1)
        pictures.add(page.run("return document.getElementById('rotor').toDataURL()"))
    assert len(pictures) == 1


@needs_browser
def test_a_page_at_rest_looks_the_same_each_time_it_opens(page, path, monkeypatch):
    """What `python docs/screenshots.py` needs; which run ends first differs from time to time."""
    monkeypatch.syspath_prepend(str(DOCS))
    from screenshots import picture

    pictures = [np.asarray(picture(page, path), int) for _ in range(3)]
    page.devtools("Emulation.setScrollbarsHidden", hidden=False)
    for other in pictures[1:]:
        assert np.abs(other - pictures[0]).max() <= ROUNDING_LEVELS


@needs_browser
def test_the_link_has_the_changed_values(page, study):
    page.run("cogless.set('scenario.low.load', 0.01)")
    settle(page)
    page.run("window.copied = ''; navigator.clipboard.writeText = async (text) => { window.copied = text; }")
    page.run("document.getElementById('link').click()")
    time.sleep(0.1)
    link = page.run("return window.copied")
    assert link.startswith("file://") and text(page, "#link-note") == "Copied."
    page.run("document.getElementById('reset').click()")
    settle(page)
    time.sleep(0.3)  # the address follows
    page.run(f"location.hash = {json.dumps(link.partition('#')[2])}")
    settle(page)
    assert sets_of(page) == {"scenario.low.load": "0.01 N*m"}


@needs_browser
def test_an_order_is_added_and_removed_with_the_numbers_of_the_command(page, study, tmp_path):
    press = "[...document.querySelectorAll('#keys button')].find((b) => b.textContent === {})"
    page.run(press.format("'Add a cogging order'") + ".click()")
    settle(page)
    page.run("cogless.set('cogging.0.order', 10); cogless.set('cogging.0.torque', 3)")
    settle(page)
    sets = sets_of(page)
    (rows,) = sets.values()
    assert list(sets) == ['scenario.low.override."motor.cogging"']
    assert rows[-1] == {"order": 10, "torque": "3 mN*m"} and len(rows) == len(study.motor.cogging) + 1
    other = changed(study, sets)
    for controller in ("pi", "pi-ilc"):
        same(values(page, controller), computed(other, "low", controller))
        assert computed(other, "low", controller) != computed(study, "low", controller)
    (tmp_path / "changed.toml").write_text(page.run("return cogless.toml()"), encoding="utf-8")
    same(values(page, "pi"), computed(load(tmp_path / "changed.toml"), "low", "pi"))
    page.run(press.format("'Remove'") + ".click()")
    settle(page)
    assert sets_of(page) == {}
    same(values(page, "pi"), computed(study, "low", "pi"))


@needs_browser
def test_a_changed_order_of_the_study_is_in_the_list_too(page, study):
    keys = page.run("return cogless.page.keys.map((k) => [k.key, k.start])")
    torque, start = next((k, x) for k, x in keys if k.startswith("scenario.low") and "motor.cogging.0." in k)
    page.run(f"cogless.set({json.dumps(torque)}, {2 * start})")
    page.run("cogless.set('cogging.1.order', 5); cogless.set('cogging.1.torque', 1)")
    settle(page)
    sets = sets_of(page)
    assert list(sets) == ['scenario.low.override."motor.cogging"']
    same(values(page, "pi"), computed(changed(study, sets), "low", "pi"))


@needs_browser
def test_another_sensor_gives_the_numbers_of_the_command(page, study, tmp_path):
    """Beside a value of a key that works with it; a key that does not is taken back and says so."""
    words = page.run("return cogless.page.sensors.map((sensor) => sensor.words)")
    assert "absolute, 12 bits" in words and any("speed by" in one for one in words)
    page.run("cogless.set('scenario.low.load', 0.01)")
    page.run("cogless.set('controller.pi-ilc.tuning.phase_margin', 45)")
    for n, one in enumerate(words, 1):
        choose_sensor(page, n)
        sets = sets_of(page)
        assert sets.keys() == {"drive.position_sensor", "scenario.low.load"}, one
        other = changed(study, sets)
        for controller in ("pi", "pi-ilc"):
            same(values(page, controller), computed(other, "low", controller))
    (tmp_path / "changed.toml").write_text(page.run("return cogless.toml()"), encoding="utf-8")
    same(values(page, "pi"), computed(load(tmp_path / "changed.toml"), "low", "pi"))
    assert f"sensor={len(words)}" in page.run("return cogless.address()")
    label = "[...document.querySelectorAll('#keys label')].find((l) => l.title.endsWith('phase_margin'))"
    assert page.run(f"return {label}.parentElement.querySelector('input').disabled")
    choose_sensor(page, 0)
    assert sets_of(page) == {"scenario.low.load": "0.01 N*m"}


def choose_sensor(shown, n):
    of_page = "const list = document.getElementById('sensor');"
    shown.run(of_page + f"list.value = {n}; list.dispatchEvent(new Event('change'))")
    settle(shown)


@needs_browser
def test_the_address_brings_the_sensor_back(page, study):
    page.run("location.hash = '#scenario=low&controllers=pi&sensor=2&scenario.low.load=0.01'")
    settle(page)
    time.sleep(0.3)
    assert sets_of(page).keys() == {"drive.position_sensor", "scenario.low.load"}
    settle(page)
    same(values(page, "pi"), computed(changed(study, sets_of(page)), "low", "pi"))
    for nonsense in ("99", "-1", "x", "1.5"):
        page.run(f"location.hash = '#scenario=low&sensor={nonsense}'")
        time.sleep(0.3)
        settle(page)
        assert sets_of(page) == {}


# --- words


def test_each_key_of_a_page_has_words(tmp_path):
    study = live_studies.study(tmp_path)
    keys = live_studies.found(study).keys
    assert keys and all(key_words(study, key.candidate.label) for key in keys)
    assert key_words(study, "mechanics.inertia") == key_words(study, "inertia") == "inertia of all that turns"
    assert key_words(study, "mechanics.load_side.inertia") == "inertia behind the shaft"
    order = study.source.tables["motor"]["cogging"][0]["order"]
    assert key_words(study, "motor.cogging.0.torque") == f"cogging, order {order:g}"
    assert key_words(study, "drive.current_sensors.offset.1") == "offset of current sensor 2"
    assert key_words(study, "load, from trial 31") == "torque of the load from trial 31"
    assert key_words(study, "beta_1") == ""
    assert len({pattern for pattern, _ in KEY_WORDS}) == len(KEY_WORDS)


def test_the_current_limit_can_be_changed(tmp_path):
    study = live_studies.study(tmp_path)
    assert "drive.current_loop.current_limit" in [k.candidate.key for k in adjustable(study).keys]
