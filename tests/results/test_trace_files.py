"""Traces in files instead of memory: the same numbers, and only what is in use in memory."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import studies
from cogless import StudyError, rollout, run_study
from cogless.report import render, waveforms
from cogless.report.markup import thin
from cogless.report.order_charts import _first
from cogless.report.panels import varies, varies_in
from cogless.results import Run
from cogless.results import trace as tracing
from cogless.results.results_json import to_dict
from cogless.results.trace import BLOCK_ROWS, Trace, TraceFile, write_netcdf
from cogless.study import changed

SIGNALS = [("time", "s"), ("omega_ref", "rad/s"), ("omega_m", "rad/s")]


def test_results_and_report_are_those_of_traces_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = studies.study(tmp_path, {"trace.energy": True})
    monkeypatch.setattr(tracing, "IN_MEMORY", 0)
    in_files, in_memory = run_study(study, jobs=2, traces=tmp_path), run_study(study)
    assert all(run.trace.mapped is not None for run in in_files.runs)
    assert not any(run.trace.mapped for run in in_memory.runs)
    assert json.dumps(to_dict(in_files)) == json.dumps(to_dict(in_memory))
    assert render(in_files) == render(in_memory)
    for a, b in zip(in_files.runs, in_memory.runs, strict=True):
        for name in (*b.trace.names, *b.trace.derived):
            assert np.array_equal(a.trace[name], b.trace[name]), name
            assert np.array_equal(a.trace.part(name, slice(20, 90)), b.trace[name][20:90]), name
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


def test_a_file_has_room_for_rows_between_the_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = studies.study(tmp_path, {"drive.inverter.kind": "switched", "trace.rate": "45 kHz"})
    (in_memory,) = run_study(study, ["step/pi"]).runs
    monkeypatch.setattr(tracing, "IN_MEMORY", 0)
    (in_file,) = run_study(study, ["step/pi"], traces=tmp_path).runs
    assert in_file.trace.mapped is not None and len(in_file.trace) == 3 * 4500
    assert all(np.array_equal(in_file.trace[name], in_memory.trace[name]) for name in in_memory.trace.names)


def test_traces_of_runs_in_step_may_be_in_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = studies.study(tmp_path)
    noisy = [changed(study, {"drive.current_sensors.noise": f"{noise} mA"}) for noise in (1, 2, 3)]
    in_memory = rollout(noisy, ["low/pi"], 1)
    monkeypatch.setattr(tracing, "IN_MEMORY", 0)
    in_files = rollout(noisy, ["low/pi"], 1, traces=tmp_path)
    for a, b in zip(in_files, in_memory, strict=True):
        (a_run,), (b_run,) = a.runs, b.runs
        assert a_run.lanes > 1 and a_run.trace.mapped is not None
        assert np.array_equal(a_run.trace.data, b_run.trace.data) and a_run.metrics == b_run.metrics


def test_a_trace_in_memory_has_no_file_until_the_room_is_used_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = tracing.TraceRoom(tmp_path)
    assert room.file(SIGNALS, 2_000_000) is None  # 48 MB
    assert room.file(SIGNALS, 1) is not None
    monkeypatch.setattr(tracing, "IN_MEMORY", 8 * 3 * 100)
    room = tracing.TraceRoom(tmp_path)
    assert room.file(SIGNALS, 60) is None
    assert room.file(SIGNALS, 60) is not None
    assert room.file(SIGNALS, 40) is None


def test_a_signal_of_a_trace_in_a_file_is_a_copy(tmp_path: Path) -> None:
    rows = np.arange(300.0).reshape(100, 3)
    file = TraceFile(tmp_path, SIGNALS, 100)
    for piece in np.array_split(rows, 7):
        file.append(piece)
    trace = file.trace()
    assert np.array_equal(trace.data, rows)
    assert not np.shares_memory(trace["omega_m"], trace.data)
    assert trace.window(30.0, 60.0) == slice(10, 21)


def test_no_room_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = TraceFile(tmp_path, SIGNALS, 1_000_000)

    class Full:
        def seek(self, _: int) -> None:
            pass

        def write(self, _: memoryview) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(file, "_file", Full())
    with pytest.raises(StudyError) as caught:
        file.append(np.zeros((10, 3)))
    expected = "expected room for 24 MB of a run's trace, or a lower trace.rate"
    assert str(caught.value) == f"{tmp_path}: no space left on device: {expected}"


@pytest.fixture(scope="module")
def long() -> Trace:
    """More rows than a block, at 1 kHz: a start-up, then noise about a turn a second."""
    count = 2 * BLOCK_ROWS + 12_345
    time, noise = 1e-3 * np.arange(count), np.random.default_rng(4).normal(size=count)
    reference = np.full(count, 2 * np.pi)
    speed = reference * (1 - np.exp(-time / 30)) + 0.1 * noise
    return Trace(*zip(*SIGNALS, strict=True), np.column_stack((time, reference, speed)))


def test_a_long_trace_is_thinned_as_a_whole_one(long: Trace) -> None:
    for span, points in ((None, 1501), (None, 20_000), ((100.0, 400.0), 4000), ((1.0, 1.5), 900)):
        view = waveforms.View(span, points)
        whole, step = thin(long["omega_m"][view.rows_of(long)], points)
        assert np.array_equal(view.thinned(long, lambda rows: long.part("omega_m", rows)), whole)
        assert view.grid(long).step == pytest.approx(step * 1e-3)


def test_what_is_searched_in_a_long_trace(long: Trace) -> None:
    end = long.time[-1]
    assert waveforms._since(long, 400) == pytest.approx(end - 400, abs=2e-3)
    assert waveforms._since(long, 2) == pytest.approx(end - 2, abs=2e-3)
    assert waveforms._since(long, round(end) + 1) is None
    run = Run("s", "c", long)
    error = np.abs(long["omega_error"])
    calm = 1.2 * error[len(error) // 2 :].max()
    assert waveforms._started([run], end) == long.time[np.flatnonzero(error > calm)[-1]]
    late = int(np.argmax(long.time > 400))
    assert _first(long, 0, lambda rows: long.part("time", rows) > 400) == late
    assert _first(long, late + 7, lambda rows: long.part("time", rows) > 400) == late + 7
    assert _first(long, 0, lambda rows: long.part("time", rows) < 0) is None
    assert not varies_in(long, "omega_ref") and varies(long["omega_m"]) == varies_in(long, "omega_m")
    step = replace(long, data=np.where(long.time[:, None] > 500, 2.0, 1.0) * np.ones(3))
    assert varies_in(step, "omega_ref", BLOCK_ROWS + 5) and not varies_in(step, "omega_ref", 510_000)


def test_the_file_has_every_nth_row(tmp_path: Path, long: Trace) -> None:
    for rate, every in ((np.inf, 1), (1000.0, 1), (999.0, 2), (150.0, 7)):
        write_netcdf(tmp_path / "traces.nc", [Run("s", "c", long)], rate=rate)
        with netCDF4.Dataset(tmp_path / "traces.nc") as file:
            group = file["s/c"]
            assert group.every == every
            assert np.array_equal(group["time"][:], long.time[::every])
            assert np.array_equal(group["omega_m"][:], np.float32(long["omega_m"][::every]))
