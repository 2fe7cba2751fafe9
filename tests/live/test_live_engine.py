"""The engine as WebAssembly against the native one, bit for bit."""

import base64
import hashlib

import live_studies
import numpy as np
import pytest
from node import NO_ENGINE, NO_NODE, missing_engines, module_file, run_node

import studies
from cogless.control_library import Status
from cogless.design.auto import load
from cogless.errors import StudyError
from cogless.files import shipped
from cogless.live import engine
from cogless.live.description import blobs, pack, page_runs
from cogless.live.live_page import asset
from cogless.run.run_plan import plan
from cogless.run.simulate import simulate
from cogless.study import Study
from cogless.study.reading import is_arena, read

TICKS = 3000
SPEED = [
    name
    for name, path in shipped("studies").items()
    if not is_arena(read(path)) and isinstance(load(name), Study)
]
RUN = """
const crypto = require("crypto");
const module = new WebAssembly.Module(require("fs").readFileSync(given.module));
return given.jobs.map((job) => {
  try {
    const engine = new Engine(module);
    engine.open(Buffer.from(job.description, "base64"), job.decimation, 10);
    if (job.learned) engine.load(job.learned);
    engine.advance(job.ticks);
    const { rows, names } = engine.take();
    const hash = crypto.createHash("sha256").update(rows).digest("hex"), stored = engine.stored();
    return { hash, names, stored: stored && stored.values.length };
  } catch (error) {
    return { error: error.message };
  }
});
"""

needs = pytest.mark.skipif(bool(NO_NODE or NO_ENGINE), reason=NO_NODE or NO_ENGINE)


def native(planned, ticks):
    """Hash of the native engine's rows, and the number of entries that it learned."""
    state, recorder = planned.start(), planned.engine.Recorder(planned.drive, planned.decimation)
    planned.drive.advance(state, recorder, ticks)
    stored = planned.drive.stored(state)
    entries = None if stored is None else int(np.size(stored["values"]))
    return hashlib.sha256(recorder.take().tobytes()).hexdigest(), entries


def job(study, planned, ticks):
    learned = None
    if planned.learned is not None:
        values = np.asarray(planned.learned, np.float64)
        learned = {"channels": len(values), "cells": values.shape[1], "values": values.ravel().tolist()}
    description = pack(planned.description, study.drive.precision).data
    return {
        "description": base64.b64encode(description).decode(),
        "decimation": planned.decimation,
        "ticks": ticks,
        "learned": learned,
    }


def each_met(pairs):
    """As many of the runs as have every scenario and every controller in them."""
    met = set()
    for scenario, controller in pairs:
        if not {("of", scenario), ("by", controller)} <= met:
            met |= {("of", scenario), ("by", controller)}
            yield scenario, controller


@needs
@pytest.mark.parametrize("name", [*SPEED, "traction"])
def test_each_row_of_each_signal_has_the_native_bits(tmp_path, name):
    study = load(studies.write(tmp_path, studies.TRACTION) if name == "traction" else name)
    # the commissioning of a table, which takes seconds, is another test's
    plain = [pair for pair in page_runs(study) if not tabled(study, pair[1])]
    plans = [plan(study, *pair) for pair in each_met(plain)]
    given = {
        "module": module_file(tmp_path, study.drive.precision),
        "jobs": [job(study, each, TICKS) for each in plans],
    }
    for each, made in zip(plans, run_node(tmp_path, ("engine.js",), RUN, given), strict=True):
        assert "error" not in made, made
        assert (made["hash"], made["stored"]) == native(each, TICKS), each.names[1:]
        assert made["names"] == [signal for signal, _ in each.drive.signals]


WORKER = """
const answers = {}, self = { postMessage: (answer) => answers[answer.id](answer) };
new Function("self", "Engine", "liveMetrics", given.worker)(self, Engine, liveMetrics);
await self.onmessage({ data: { module: require("fs").readFileSync(given.module) } });
const bytes = (text) => new Uint8Array(Buffer.from(text, "base64"));
const { job } = given;
job.description = bytes(job.description);
job.learn.description = bytes(job.learn.description);
const { result, error } = await new Promise((done) => {
  answers[1] = done;
  self.onmessage({ data: { id: 1, job } });
});
return error ? { error } : { map: result.map.values, speed: result.turn.speed, current: result.turn.current };
"""


@needs
def test_a_table_is_commissioned_in_the_page_bit_for_bit(tmp_path):
    """The page's own worker fills the table by its slow run, and runs with it, as `cogless run` does."""
    study = live_studies.study(tmp_path)
    packed, planned = blobs(study, "step", "table"), plan(study, "step", "table")

    def number(blob, path):
        return next(n for n in blob.numbers if n.path == path).read(blob.data)

    run, learn = packed["run"], packed["learn"]
    rate = study.drive.rates.current_loop
    given = {
        "module": module_file(tmp_path, study.drive.precision),
        "worker": asset("worker.js"),
        "job": {
            "description": base64.b64encode(run.data).decode(),
            "ticks": number(run, "page.ticks"),
            "decimation": number(run, "page.decimation"),
            "learned": None,
            "learn": {
                "description": base64.b64encode(learn.data).decode(),
                "ticks": number(learn, "page.ticks"),
                "divider": number(run, "page.divider"),
                "rate": rate,
                "busy": int(Status.BUSY),
            },
            "about": {"unit": number(run, "page.unit")},
            "metrics": [],
        },
    }
    made = run_node(tmp_path, ("engine.js", "metrics.js"), WORKER, given)
    assert "error" not in made, made
    table = np.asarray(planned.learned, np.float64).ravel() / number(run, "page.unit")
    assert np.ptp(table) > 0.01
    assert np.array_equal(made["map"], table)
    trace = simulate(study, "step", "table").trace
    for name, seen in (("omega_m", made["speed"]), ("i_q", made["current"])):
        assert len(seen) > 100 and np.array_equal(seen, trace[name][-len(seen) :])


def tabled(study, controller):
    return getattr(study.controller[controller], "calibration", None) is not None


@needs
def test_what_the_engine_refuses_reaches_the_page_in_its_words(tmp_path):
    study = load("uomodri")
    blob = blobs(study, "slow", "pi-ilc")["run"]
    (place,) = [n for n in blob.numbers if n.path == "controller.config.gain"]
    wrong = bytearray(blob.data)
    wrong[place.offset : place.offset + 4] = np.float32(-1.0).tobytes()
    jobs = [
        {"description": base64.b64encode(data).decode(), "decimation": 4, "ticks": 10, "learned": None}
        for data in (bytes(wrong), blob.data[:100])
    ]
    made = run_node(tmp_path, ("engine.js",), RUN, {"module": module_file(tmp_path, "single"), "jobs": jobs})
    refused = {"error": "pi-ilc: pi_ilc.gain is outside its range"}
    assert made == [refused, {"error": "description: too short"}]


def test_without_the_module_one_line_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "package_folders", list)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: None)
    assert not engine.is_there("single")
    with pytest.raises(StudyError, match=r"^live: this build has no engine for pages: run `make web`, or"):
        engine.module("single")


def test_a_compilation_is_announced(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(engine, "package_folders", list)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(engine, "compiled", lambda sources, target, precision: target.write_bytes(b"made"))
    assert engine.module("single") == engine.module("single") == b"made"
    line = "live: compiling the engine for pages, once for this version: one to three minutes\n"
    assert capsys.readouterr().err == line


def test_a_module_that_is_shipped_is_there(monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "package_folders", lambda: [tmp_path])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "live").mkdir()
    (tmp_path / "live" / engine.NAMES["single"]).write_bytes(b"module")
    assert engine.is_there("single") and not engine.is_there("double")
    assert engine.module("single") == b"module"


def test_tests_of_the_page_are_skipped_while_one_of_the_two_modules_is_missing(monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "package_folders", lambda: [tmp_path])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "live").mkdir()
    assert missing_engines() == "needs the WebAssembly engine, single and double: make web"
    for precision, missing in (("single", "needs the WebAssembly engine, double: make web"), ("double", "")):
        (tmp_path / "live" / engine.NAMES[precision]).write_bytes(b"module")
        assert missing_engines() == missing


def test_packed_numbers_lie_where_they_say(tmp_path):
    study = studies.study(tmp_path)
    blob = blobs(study, *page_runs(study)[0])["run"]
    found = {n.path: n.read(blob.data) for n in blob.numbers}
    assert found["motor.R_s"] == study.motor.R_s
    assert found["mechanics.inertia"] == study.mechanics.inertia
    assert found["page.ticks"] == 6000
    assert len({n.offset for n in blob.numbers}) == len(blob.numbers)
    with pytest.raises(TypeError, match=r"controller.x: complex"):
        pack({"controller": {"law": "python", "x": 1j}}, "single")
