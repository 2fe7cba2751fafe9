"""What cogless says of a drive that somebody described in public, and what is left of its trouble."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cogless.design.auto import load
from cogless.design.warnings import beyond_drive, warnings
from cogless.report import limit, verdicts, with_limits
from cogless.results import Results
from cogless.run.simulate import run_study, simulate
from cogless.study import AnyStudy, Study, changed
from cogless.study.reading import Remark


def problem(folder: Path, text: str, changes: Mapping[str, Any] | None = None) -> Study:
    """The study of a text with changes; its scenario is x."""
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    study = load(path, dict(changes or {}))
    assert isinstance(study, Study)
    return study


def designed(study: Study, part: str, controller: str = "pi") -> Remark:
    """The one sentence with this part that the design says of a controller before it runs."""
    remarks = [*warnings(study, "x", controller), *beyond_drive(study, ["x"])]
    (remark,) = (each for each in remarks if part in str(each))
    return remark


def silent(study: Study, controller: str = "pi") -> bool:
    """Whether the design says nothing of a controller."""
    return not [*warnings(study, "x", controller), *beyond_drive(study, ["x"])]


def limited(study: Study) -> tuple[Results, Remark]:
    """The results of a run with their limit, and the remark that names the limit."""
    results = with_limits(run_study(study), jobs=1)
    remark = limit(results, "x")
    assert remark is not None
    return results, remark


def headline(study: Study) -> str:
    """The first sentence of the verdict."""
    (verdict,) = verdicts(run_study(study))
    return verdict.headline


def speed_error(study: AnyStudy, change: Mapping[str, Any] | None = None, controller: str = "pi") -> float:
    """RMS of the true speed error in the second half of a run, over the reference, with a change."""
    trace = simulate(changed(study, dict(change or {})), "x", controller).trace
    error = (trace["omega_ref"] - trace["omega_m"])[len(trace) // 2 :]
    return float(np.sqrt(np.mean(error**2)) / np.max(np.abs(trace["omega_ref"])))
