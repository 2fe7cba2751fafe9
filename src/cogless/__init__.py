"""Simulate, design and compare controllers that remove torque ripple from permanent-magnet drives."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cogless.design.auto import load
    from cogless.errors import StudyError
    from cogless.results import Results, Run, TrialResults
    from cogless.results.trace import Trace
    from cogless.run.simulate import rollout, run_study
    from cogless.study import Study, TrialStudy, changed, for_scenario

# Module of each public name. It is imported at first use, so that importing cogless stays quick.
_HOMES = {
    "StudyError": "cogless.errors",
    "Results": "cogless.results",
    "Run": "cogless.results",
    "rollout": "cogless.run.simulate",
    "run_study": "cogless.run.simulate",
    "Study": "cogless.study",
    "TrialResults": "cogless.results",
    "TrialStudy": "cogless.study",
    "changed": "cogless.study",
    "for_scenario": "cogless.study",
    "load": "cogless.design.auto",
    "Trace": "cogless.results.trace",
}

__all__ = [
    "Results",
    "Run",
    "Study",
    "StudyError",
    "Trace",
    "TrialResults",
    "TrialStudy",
    "changed",
    "for_scenario",
    "load",
    "rollout",
    "run_study",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from cogless.files import versions

        return versions()["cogless"]
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'cogless' has no attribute {name!r}")
