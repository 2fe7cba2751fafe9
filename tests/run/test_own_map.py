"""What a user's own law has learned is stored as a map at the end of a run; any law may start from it."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cogless
from cogless.errors import StudyError
from cogless.maps import stored_map
from cogless.maps.stored_map import StoredMap
from cogless.report.charts import to_page
from cogless.report.map_charts import maps
from cogless.results import Run
from cogless.run.simulate import simulate
from cogless.study import Study
from studies import IDEAL
from studies import write as written

LIMIT = 3.0  # A, of IDEAL

PYTHON = """
from math import cos, pi, sin


class Orders:
    map_law = 200

    def __init__(self, orders, kp, ki, rate):
        self.amplitudes = {h: [0.0, 0.0] for h in orders}
        self.kp, self.ki, self.rate, self.integral = kp, ki, rate, 0.0

    def learned_map(self):
        return {h: tuple(x) for h, x in self.amplitudes.items()}

    def load_map(self, learned):
        self.amplitudes = {h: list(learned[h]) for h in self.amplitudes}

    def step(self, inputs):
        error = inputs.omega_ref - inputs.omega_m
        self.integral += self.ki * inputs.ts * error
        learned = 0.0
        for h, x in self.amplitudes.items():
            c, s = cos(h * inputs.theta_m), sin(h * inputs.theta_m)
            if inputs.learn:
                x[0] += self.rate * inputs.ts * error * c
                x[1] += self.rate * inputs.ts * error * s
            learned += x[0] * c + x[1] * s
        return self.kp * error + self.integral + learned


class Cells:
    def __init__(self, kp, ki, rate, parts=1, cells=360):
        self.map_parts, self.cells = parts, [0.0] * cells
        self.kp, self.ki, self.rate, self.integral = kp, ki, rate, 0.0

    def learned_map(self):
        return self.cells

    def load_map(self, learned):
        assert len(learned) == len(self.cells)
        self.cells = learned

    def step(self, inputs):
        error = inputs.omega_ref - inputs.omega_m
        self.integral += self.ki * inputs.ts * error
        count = len(self.cells)
        place = inputs.theta_m * self.map_parts / (2 * pi) * count
        n, share = int(place) % count, place % 1
        if inputs.learn:
            self.cells[n] += self.rate * (1 - share) * error
            self.cells[(n + 1) % count] += self.rate * share * error
        learned = (1 - share) * self.cells[n] + share * self.cells[(n + 1) % count]
        return self.kp * error + self.integral + learned


class Told:
    def __init__(self, learned, law=128, parts=1, refused=False):
        self.learned, self.map_law, self.map_parts, self.refused = learned, law, parts, refused

    def learned_map(self):
        return eval(self.learned)

    def load_map(self, learned):
        if self.refused:
            raise ValueError("not mine")

    def step(self, inputs):
        return 0.0


class Plain:
    def step(self, inputs):
        return 0.0


class Out(Plain):
    def learned_map(self):
        return [0.0, 0.0, 0.0, 0.0]
"""

# The law `Orders`, with two orders; and one whose map is what its params say.
ORDERS = """
#include "cogless/plugin.h"
#include <math.h>
typedef struct { double order[2], a[2], b[2], kp, ki, rate, integral; } law;
uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }
size_t cogless_plugin_state_size(void) { return sizeof(law); }
int cogless_plugin_init(void *state, const double *params, size_t count, double ts)
{
    law *s = state;
    (void)ts;
    s->order[0] = params[0]; s->order[1] = params[1];
    s->kp = params[2]; s->ki = params[3]; s->rate = params[4];
    return count != 5;
}
void cogless_plugin_learned_map(const void *state, cogless_plugin_map *map)
{
    const law *s = state;
    map->law = 200;
    map->entries = 2; map->order = s->order; map->cosine = s->a; map->sine = s->b;
}
int cogless_plugin_load_map(void *state, const cogless_plugin_map *map)
{
    law *s = state;
    for (int n = 0; n < 2; ++n) {
        if (map->order[n] != s->order[n]) return 1;
        s->a[n] = map->cosine[n];
        s->b[n] = map->sine[n];
    }
    return map->entries != 2 || map->current != 0 || map->parts != 1;
}
void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    law *s = state;
    const double error = in->omega_ref - in->omega_m;
    double learned = 0.0;
    s->integral += s->ki * in->ts * error;
    for (int n = 0; n < 2; ++n) {
        const double c = cos(s->order[n] * in->theta_m), d = sin(s->order[n] * in->theta_m);
        if (in->learn) {
            s->a[n] += s->rate * in->ts * error * c;
            s->b[n] += s->rate * in->ts * error * d;
        }
        learned += s->a[n] * c + s->b[n] * d;
    }
    out->i_q_ref = s->kp * error + s->integral + learned;
}
"""
TOLD = """
#include "cogless/plugin.h"
typedef struct { double law, parts, entries, kind, order, current[8]; } law;
uint32_t cogless_plugin_version(void) { return VERSION; }
size_t cogless_plugin_state_size(void) { return sizeof(law); }
int cogless_plugin_init(void *state, const double *params, size_t count, double ts)
{
    double *to = state;
    (void)ts;
    for (size_t n = 0; n < count; ++n) to[n] = params[n];
    return 0;
}
void cogless_plugin_learned_map(const void *state, cogless_plugin_map *map)
{
    const law *s = state;
    if (map->law != 128 || map->parts != 1 || map->entries != 0 || map->current != 0) map->law = 999;
    if (s->law != 0.0) map->law = (uint32_t)s->law;
    if (s->parts != 0.0) map->parts = (uint32_t)s->parts;
    map->entries = (size_t)s->entries;
    if (s->kind == 0.0) map->current = s->current;
    if (s->kind >= 1.0) map->cosine = map->sine = s->current;
    if (s->kind >= 2.0) map->order = &s->order;
}
LOAD
void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    (void)state; (void)in; (void)out;
}
"""
LOAD = """
int cogless_plugin_load_map(void *state, const cogless_plugin_map *map)
{
    (void)map;
    return ((law *)state)->current[7] != 0.0;
}
"""

FEEDBACK = {"kp": 0.8, "ki": 20.0}
LINES = [line.strip() for line in PYTHON.splitlines()]
TELLS = LINES.index("return eval(self.learned)") + 1
REFUSES = LINES.index('raise ValueError("not mine")') + 1
LAWS: dict[str, dict[str, Any]] = {
    "orders": {"object": "law.py:Orders", "params": {**FEEDBACK, "rate": 10.0, "orders": [6, 24]}},
    "cells": {"object": "law.py:Cells", "params": {**FEEDBACK, "rate": 0.2}},
    "electrical": {"object": "law.py:Cells", "params": {**FEEDBACK, "rate": 0.02, "parts": 4, "cells": 128}},
    "c": {"library": "orders.so", "params": [6, 24, 0.8, 20.0, 10.0]},
    "pi": {"law": "pi", **FEEDBACK},
    "pi-ilc": {"law": "pi-ilc", **FEEDBACK, "gain": 0.6, "cells": 360},
    "pi-afc": {"law": "pi-afc", **FEEDBACK, "gain": 10.0, "orders": [6, 24]},
}
MORE = """
[scenario]
turns = { duration = "1 s", reference = "120 rpm", initial_speed = "120 rpm" }
[controller]
law = { law = "pi", kp = 1, ki = 1 }
[[metric]]
name = "first"
kind = "ripple-rms"
signal = "omega_m"
window = ["0 s", "0.5 s"]
[[metric]]
name = "last"
kind = "ripple-rms"
signal = "omega_m"
last = "0.5 s"
"""
FIRST, LAST = "first_rad_s", "last_rad_s"


def compiled(folder: Path, name: str, text: str) -> None:
    (folder / f"{name}.c").write_text(text)
    include = Path(cogless.__file__).parent / "include"
    flags = ["-std=c99", "-O1", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", f"-I{include}"]
    subprocess.run(["cc", *flags, f"{name}.c", "-o", f"{name}.so", "-lm"], cwd=folder, check=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    (folder / "law.py").write_text(PYTHON)
    compiled(folder, "orders", ORDERS)
    compiled(folder, "told", TOLD.replace("LOAD", LOAD).replace("VERSION", "COGLESS_PLUGIN_VERSION"))
    compiled(folder, "out", TOLD.replace("LOAD", "").replace("VERSION", "3"))
    written(folder, f'title = "Own maps"\n{IDEAL}{MORE}')
    return folder


def study(folder: Path, law: dict[str, Any], duration: int = 1, changes: Any = None, **more: Any) -> Study:
    kind = {"law": "python"} if "object" in law else {"law": "library"} if "library" in law else {}
    own = {"learning": True} if kind else {}
    here = {"controller.law": {**kind, **own, **law, **more}, "scenario.turns.duration": duration}
    return cogless.load(folder / "study.toml", {**here, **(changes or {})})


def ran(folder: Path, law: dict[str, Any], duration: int = 1, **more: Any) -> Run:
    return simulate(study(folder, law, duration, **more), "turns", "law")


@pytest.fixture(scope="module")
def learned(folder: Path) -> dict[str, Run]:
    """The run in which each law learned, whose map is then in NAME.bin."""
    runs = {name: ran(folder, law, 1 if name == "pi" else 20) for name, law in LAWS.items()}
    for name, run in runs.items():
        if run.map is not None:
            stored_map.write(folder / f"{name}.bin", bytes(run.map))
    return runs


@pytest.mark.parametrize(
    ("name", "about"),
    [
        ("orders", ("own law 200", (6, 7, 8), 1, 2, (LIMIT, LIMIT, 65535.0))),
        ("c", ("own law 200", (6, 7, 8), 1, 2, (LIMIT, LIMIT, 65535.0))),
        ("cells", ("own law 128", (1,), 1, 360, (LIMIT,))),
        ("electrical", ("own law 128", (1,), 4, 128, (LIMIT,))),
    ],
)
def test_the_map_of_a_run_tells_whose_it_is_and_what(
    learned: dict[str, Run], folder: Path, name: str, about: Any
) -> None:
    run = learned[name]
    (found,) = stored_map.read(folder / f"{name}.bin")
    stored = found.map
    assert isinstance(stored, StoredMap) and run.map is not None
    assert (stored.law_name, stored.units, stored.parts, stored.cells, stored.limits) == about
    assert (stored.turns, stored.ratio, stored.motion) == (1, 1, 0)
    assert stored.motor == learned["pi-ilc"].map.motor
    assert run.memory["frame"] == ("electrical" if name == "electrical" else "mechanical")
    # IDEAL's cogging is 4 mN*m sin(24 theta), and K_t 0.12 N*m/A
    step = run.memory["angle"][1]
    theta = np.arange(len(run.memory["angle"])) * step * (6 if name == "electrical" else 24)
    spectrum = 2 * np.mean(run.memory["current"] * np.exp(1j * theta))
    assert abs(spectrum) == pytest.approx(4 / 120, rel=0.1)


def test_python_and_c_store_the_same_bits(learned: dict[str, Run], folder: Path) -> None:
    assert (folder / "orders.bin").read_bytes() == (folder / "c.bin").read_bytes()
    start = {"start": {"map": "cells.bin"}}
    both = [ran(folder, LAWS[name], **start) for name in ("orders", "c")]
    assert np.array_equal(both[0].trace["omega_m"], both[1].trace["omega_m"])
    assert both[0].map is not None and bytes(both[0].map) == bytes(both[1].map)


OWN, ANY = ["orders", "cells", "electrical", "c"], ["pi-ilc", "pi-afc"]
PAIRS = [(by, law) for by in OWN for law in (*OWN, *ANY)] + [(by, law) for by in ANY for law in OWN]


@pytest.mark.parametrize(
    ("by", "law"), [pair for pair in PAIRS if pair[1] != "electrical" or pair[0] == "electrical"]
)
def test_a_run_starts_with_the_ripple_already_gone(
    learned: dict[str, Run], folder: Path, by: str, law: str
) -> None:
    """Learning does not begin in this run: all that helps is the map."""
    run = ran(folder, LAWS[law], start={"map": f"{by}.bin"}, learning_start=100)
    before, plain = learned[by].metrics[LAST], learned["pi"].metrics[FIRST]
    assert before < 0.3 * plain
    assert run.metrics[FIRST] < 1.2 * before + 0.1 * plain


def test_a_law_that_learned_before_shows_its_learned_part(learned: dict[str, Run], folder: Path) -> None:
    made = study(folder, LAWS["orders"], start={"map": "orders.bin"}, learning=False)
    assert made.controller["law"].learned and not made.controller["law"].learns
    results = cogless.run_study(made)
    (chart,) = to_page(maps(results, results.runs))
    assert np.ptp(chart["series"][0]["values"]) == pytest.approx(2 * 4 / 120, rel=0.1)


def test_faults_and_a_start_go_together(learned: dict[str, Run], folder: Path) -> None:
    fault = {"kind": "angle-missing", "time": "0.2 s", "duration": "10 ms"}
    made = study(folder, LAWS["c"], start={"map": "c.bin"}, changes={"scenario.turns.faults": [fault]})
    run = simulate(made, "turns", "law")
    assert run.metrics[LAST] < 0.3 * learned["pi"].metrics[LAST]


def test_what_is_above_the_limit_is_stored_as_the_limit(folder: Path) -> None:
    run = ran(folder, {"object": "law.py:Told", "params": {"learned": "[4.0, -1.0, -9.0, 0.5]"}})
    assert run.map is not None
    assert run.map.values.tolist() == [[3.0, -1.0, -3.0, 0.5]]


@pytest.mark.parametrize("nothing", ["None", "[]", "{}"])
def test_a_law_may_have_nothing_to_store(folder: Path, nothing: str) -> None:
    run = ran(folder, {"object": "law.py:Told", "params": {"learned": nothing}})
    assert run.map is None and not run.memory


def test_a_library_of_version_3_runs(folder: Path) -> None:
    assert ran(folder, {"library": "out.so", "params": [0, 0, 0]}).map is None


FORM = "learned_map() returns currents over the angle, {order: (cosine, sine)}, or None"
WHOLE = "the learned map: expected whole orders from 1 to 65535, each once"


def told(learned: str, **more: Any) -> dict[str, Any]:
    return {"object": "law.py:Told", "params": {"learned": learned, **more}}


def library(*params: float) -> dict[str, Any]:
    return {"library": "told.so", "params": list(params)}


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (told("'words'"), FORM),
        (told("[[1.0, 2.0], [3.0, 4.0]]"), FORM),
        (told("{24: 1.0}"), FORM),
        (told("{24: (1.0, 2.0, 3.0)}"), FORM),
        (told("{'24': (1.0, 2.0)}"), FORM),
        (told("7.0"), FORM),
        (told("[0.0, float('nan')]"), "the learned map: entry 1 is not a finite number"),
        (told("{2: (0, 0), 3: (float('inf'), 0)}"), "the learned map: entry 1 is not a finite number"),
        (told("{2.5: (0, 0)}"), WHOLE),
        (told("{0: (0, 0)}"), WHOLE),
        (told("{65536: (0, 0)}"), WHOLE),
        (told("[0.0]", law=7), "the learned map: law 7: expected 128 to 255"),
        (told("[0.0]", law=256), "the learned map: law 256: expected 128 to 255"),
        (told("[0.0]", law="mine"), "map_law: expected a whole number"),
        (told("[0.0]", parts=0), "the learned map: parts 0: expected 1 or more"),
        (told("[0.0]", parts=1.5), "map_parts: expected a whole number"),
        (told("{2: (0, 0)}", parts=4), "the learned map: parts 4: expected 1 with orders"),
        (told("1 / 0"), f"law.py line {TELLS}: ZeroDivisionError: division by zero"),
        (library(5, 0, 1, 0), "the learned map: law 5: expected 128 to 255"),
        (library(0, 0, 1e9, 0), "the learned map: 1000000000 entries: expected at most 16777216"),
        (library(0, 2, 1, 2, 24), "the learned map: parts 2: expected 1 with orders"),
        (library(0, 0, 1, 1, 24), "the learned map: expected current, or cosine, sine and order"),
        (library(0, 0, 2, 2, 24, 24), WHOLE),
        (library(0, 0, 1, 2, 0.5), WHOLE),
    ],
)
def test_what_is_no_map_is_told_before_the_run(folder: Path, law: dict[str, Any], expected: str) -> None:
    with pytest.raises(StudyError) as failed:
        ran(folder, law)
    assert str(failed.value) == f"{folder / 'study.toml'}: controller.law: scenario turns: {expected}"


def test_a_map_that_is_none_at_the_end_is_told_with_its_time(folder: Path) -> None:
    (folder / "late.py").write_text(
        "class Late:\n    a = 0.0\n    def step(self, inputs):\n        self.a = float('nan')\n"
        "        return 0.0\n    def learned_map(self):\n        return [self.a, 0.0]\n"
    )
    with pytest.raises(StudyError) as failed:
        ran(folder, {"object": "late.py:Late"})
    expected = "controller.law: scenario turns at 1 s: the learned map: entry 0 is not a finite number"
    assert str(failed.value) == f"{folder / 'study.toml'}: {expected}"


WAVE = np.cos(2 * np.pi / 16 * np.arange(16))
SIXTH = np.cos(6 * 2 * np.pi / 64 * np.arange(64))
BOTH = "a library with cogless_plugin_learned_map and cogless_plugin_load_map"


@pytest.mark.parametrize(
    ("law", "given", "expected"),
    [
        (LAWS["orders"], (WAVE, (1,)),
            "a map of 16 entries, which hold orders up to 7: expected orders up to the law's 24"),
        (LAWS["c"], (9 * SIXTH, (1,)), "an entry of 9: expected at most the law's limit, 3"),
        (LAWS["cells"], (WAVE, (4,)),
            "a map of acceleration: expected a map of this law's kind, or of a current only"),
        (LAWS["cells"], (WAVE, (1,), 0), "a trial's signal: expected a map over the angle"),
        (LAWS["electrical"], (WAVE, (1,)),
            "a map over a revolution: expected one over the law's period, 1/4 of a revolution, or over a "
            "whole fraction of it"),
        ({"object": "law.py:Plain"}, (WAVE, (1,)),
            "expected a class with the methods learned_map() and load_map(learned)"),
        ({"object": "law.py:Out"}, (WAVE, (1,)), "the class has no method load_map(learned)"),
        ({"library": "out.so", "params": []}, (WAVE, (1,)), f"expected {BOTH}"),
        ({"library": "out.so", "params": [0, 0, 8, 0]}, (WAVE, (1,)),
            "the library does not export cogless_plugin_load_map"),
        (library(0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1), (WAVE, (1,)),
            "the library's cogless_plugin_load_map refuses this map"),
        (told("[0.0] * 8", refused=True), (WAVE, (1,)), f"law.py line {REFUSES}: ValueError: not mine"),
        (told("None"), (WAVE, (1,)), "expected a class with the methods learned_map() and load_map(learned)"),
    ],
)  # fmt: skip
def test_a_start_that_cannot_be_is_told_before_the_run(
    folder: Path, law: dict[str, Any], given: Any, expected: str
) -> None:
    values, units, *turns = given
    over = turns[0] if turns else 1
    stored = StoredMap(values, units, (10.0,), turns=over, parts=over)
    stored_map.write(folder / "given.bin", bytes(stored))
    with pytest.raises(StudyError) as failed:
        ran(folder, law, start={"map": "given.bin"})
    where = f'{folder / "study.toml"}: controller.law.start.map: "given.bin"'
    assert str(failed.value) == f"{where}: {expected}"
