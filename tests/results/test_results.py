"""results.json: its shape, "never", whole or not at all; the check of the output directory."""

import importlib.metadata
import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic import STUDY, results, study

from cogless.errors import StudyError
from cogless.files import reason, replacing, versions, writable
from cogless.results import Results
from cogless.results.fault_response import Fault, Response
from cogless.results.results_json import run_id, to_dict, write


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return results(study(tmp_path_factory.mktemp("study")), rate=5000)


def test_shape(made, tmp_path):
    write(made, tmp_path / "results.json")
    held = json.loads((tmp_path / "results.json").read_text())
    assert held["study"] == "synthetic" and held["seed"] == 7 and held["interrupted"] is False
    assert held["version"] == held["versions"]["cogless"]
    assert {"python", "numpy"} <= held["versions"].keys()
    assert [(run["scenario"], run["controller"]) for run in held["runs"]] == [
        (scenario, controller)
        for scenario in ("low-speed", "step-on")
        for controller in ("pi", "fair-pi", "pi-ilc")
    ]
    metrics = held["runs"][0]["metrics"]
    assert metrics.keys() == {
        "speed_orders_rad_s", "speed_ripple_rad_s", "torque_ripple_N_m", "copper_loss_W", "chattering_A",
    }  # fmt: skip
    assert metrics["speed_orders_rad_s"] == pytest.approx(
        [0.9 * 0.10472, 0.4 * 0.10472, 4.8 * 0.10472], rel=1e-3
    )
    assert held["metrics"]["speed_orders_rad_s"] == {
        "kind": "order",
        "unit": "rad/s",
        "signal": "omega_m",
        "order": [1, 2, 6],
        "frame": "electrical",
    }
    assert held["settings"]["mechanics"]["inertia"] == "2.5e-4 kg*m^2"


def test_a_run_is_known_by_its_settings_and_results(made, tmp_path):
    """Sixteen digits in all of its files, whatever the order in which metrics stand."""
    name = run_id(made)
    assert re.fullmatch("[0-9a-f]{16}", name)
    first, *others = made.runs
    turned = replace(first, metrics=dict(reversed(first.metrics.items())))
    assert run_id(Results(made.study, [turned, *others])) == name
    assert run_id(Results(made.study, others)) != name != run_id(replace(made, interrupted=True))
    write(made, tmp_path / "results.json", {"report.html": "ab"})
    held = json.loads((tmp_path / "results.json").read_text())
    assert (held["run"], held["files"]) == (name, {"report.html": "ab"})


def test_a_version_that_is_not_known_is_told(monkeypatch):
    """A copy that was never installed has none."""
    known = importlib.metadata.version

    def version(package):
        if package == "cogless":
            raise importlib.metadata.PackageNotFoundError
        return known(package)

    monkeypatch.setattr(importlib.metadata, "version", version)
    found = versions.__wrapped__()
    assert found["cogless"] == "not installed" and found["numpy"] == known("numpy")


def test_never_is_null(made):
    held = to_dict(made)
    assert held["runs"][3]["controller"] == "pi"
    assert held["runs"][3]["metrics"]["settling_s"] is None
    assert held["runs"][5]["metrics"]["settling_s"] > 0


def test_a_wrong_name_tells_the_metrics_there_are(made):
    with pytest.raises(KeyError, match="no metric 'speed_riple'; there are speed_orders_rad_s, speed_ripple"):
        made.runs[0].metrics["speed_riple"]
    assert made.runs[0].metrics.get("speed_riple") is None


def test_not_a_number_is_null(made):
    run = made.runs[0]
    broken = type(run)(
        run.scenario, run.controller, run.trace, {}, {"a": float("nan"), "b": [1.0, float("inf")]}
    )
    assert to_dict(Results(made.study, [broken]))["runs"][0]["metrics"] == {"a": None, "b": [1.0, None]}


def test_a_quality_of_learning_that_is_not_known_is_null(made):
    quality = {"known": True, "residual": 0.5, "progress": 0.25}
    for known, told in ((True, [0.5, 0.25]), (False, [None, None])):
        run = replace(made.runs[2], quality={**quality, "known": known})
        written = to_dict(Results(made.study, [run]))["runs"][0]["quality"]
        assert list(written.items()) == list(zip(("residual_rad_per_s", "progress"), told, strict=True))


def test_memory_in_short(made):
    runs = to_dict(made)["runs"]
    assert runs[0]["memory"] == {}
    assert runs[2]["memory"] == pytest.approx(
        {"frame": "electrical", "cells": 256, "peak_A": 0.02, "rms_A": 0.02 / 2**0.5}
    )


def test_settings_that_json_does_not_have(tmp_path):
    law = '[controller.mine]\nlaw = "python"\nobject = "a.py:A"\n'
    law += "params = {top = inf, day = 2026-01-02}\n[[metric]]"
    odd = study(tmp_path, STUDY.replace("[[metric]]", law, 1))
    write(Results(odd, []), tmp_path / "results.json")
    held = json.loads((tmp_path / "results.json").read_text())
    assert held["settings"]["controller"]["mine"]["params"] == {"top": "inf", "day": "2026-01-02"}


def test_interrupted_without_runs(made):
    held = to_dict(Results(made.study, [], interrupted=True))
    assert held["interrupted"] is True and held["runs"] == []


def test_a_learned_signal_in_short(made):
    """It is of trials or over an angle, and may be empty or not finite."""
    for memory, found in (
        ({"learned": [1.0, -3.0]}, {"samples": 2, "peak": 3.0}),
        ({"learned": []}, {"samples": 0, "peak": 0.0}),
        ({"learned": [1.0, math.inf]}, {"samples": 2, "peak": None}),
        ({"current": [], "frame": "electrical"},
            {"frame": "electrical", "cells": 0, "peak_A": 0.0, "rms_A": 0.0}),
        ({"current": [1e200, 0.0], "frame": "mechanical"},
            {"frame": "mechanical", "cells": 2, "peak_A": 1e200, "rms_A": None}),
    ):  # fmt: skip
        run = replace(made.runs[0], memory=memory)
        assert to_dict(Results(made.study, [run]))["runs"][0]["memory"] == found


def test_a_response_to_a_fault_in_plain_numbers(made):
    """What never happened, or grew beyond all numbers, is null."""
    response = Response(
        Fault(1.0, 1.5, ("x",)), ("y",), noticed_after=0.1, safe=0.2, not_learning=None, saturated=0.3,
        before=None, after=(2.0, 3.0), ripple_before=None, ripple_after=math.nan, largest_error=4.0,
        largest_current=math.inf, current_limit=5.0,
    )  # fmt: skip
    run = replace(made.runs[0], faults=(response,))
    assert to_dict(Results(made.study, [run]))["runs"][0]["faults"] == [{
        "what": ["x"], "time_s": 1.0, "duration_s": 0.5, "noticed": ["y"], "noticed_after_s": 0.1,
        "safe_s": 0.2, "not_learning_s": None, "saturated_s": 0.3, "before_s": None, "after_s": [2.0, 3.0],
        "ripple_before_rad_s": None, "ripple_after_rad_s": None, "largest_speed_error_rad_s": 4.0,
        "largest_current_A": None, "current_limit_A": 5.0,
    }]  # fmt: skip


def test_a_reason_is_the_system_s_in_lower_case():
    assert reason(OSError(2, "No Such File")) == "no such file" and reason(OSError("Odd")) == "Odd"


def test_whole_or_absent(tmp_path):
    path = tmp_path / "results.json"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), replacing(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    with replacing(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole" and list(tmp_path.iterdir()) == [path]


def test_a_link_stays_and_what_it_leads_to_is_replaced(tmp_path):
    """Also where that isn't there yet."""
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "link", tmp_path / "there" / "target"
    link.symlink_to(target)
    for text in ("new", "again"):
        with replacing(link) as temporary:
            temporary.write_text(text)
        assert link.is_symlink() and target.read_text() == text
    assert list(target.parent.iterdir()) == [target]


def test_what_is_no_file_is_written_to_and_stays(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with replacing(pipe) as path:
        path.write_text("all")
    assert os.read(reader, 9) == b"all" and pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]
    os.close(reader)
    for folder in (tmp_path, Path(".")):
        with pytest.raises(StudyError) as caught, replacing(folder) as path:
            path.write_text("")
        assert str(caught.value) == f"{folder}: is a directory: expected a file that can be written"


def test_writable_directory_is_made_and_goes_again_if_nothing_is_written(tmp_path):
    with writable(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir() and not list((tmp_path / "a" / "b").iterdir())
    assert not (tmp_path / "a").exists()
    with writable(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "file").write_text("")
    assert (tmp_path / "a" / "b" / "file").exists()


def test_a_directory_of_the_user_stays(tmp_path):
    (tmp_path / "empty").mkdir()
    with writable(tmp_path / "empty"):
        pass
    assert (tmp_path / "empty").is_dir()


@pytest.mark.parametrize("inside", ["", "below"])
def test_unwritable_directory(tmp_path, inside):
    (tmp_path / "file").write_text("")
    folder = writable(tmp_path / "file" / inside if inside else tmp_path / "file")
    with pytest.raises(StudyError, match="expected a directory that can be written") as caught, folder:
        pass
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)
