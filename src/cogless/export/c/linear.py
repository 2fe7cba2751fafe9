"""Write the folder of `cogless export --to c` for a linear plant: the law alone, without a drive."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cogless.c_layout import control_layout
from cogless.c_literals import initialiser
from cogless.control_library import C_LAWS
from cogless.export import sources
from cogless.export.c.export_c import figures
from cogless.export.c.subject import identifier, study_hash
from cogless.export.c.texts import (
    C_FLAGS,
    figure_lines,
    law_texts,
    matrix_array,
    study_words,
    verdict_comment,
    verdict_list,
)
from cogless.export.prepared import first_scenario
from cogless.files import versions
from cogless.results.trace import Trace
from cogless.run.run_plan import Plan, failures, plan, trace_of
from cogless.study import TrialStudy

TEST_SAMPLES = 2000  # most samples of a self-test, except that two trials are always allowed
TEST_TRIALS = 3  # most trials of a self-test


def export_linear(
    study: TrialStudy,
    controller: str,
    target: Path,
    scenario: str | None = None,
    command: str = "",
    announce: Callable[[str], None] = lambda _: None,
) -> None:
    """Write a controller of a linear plant as C, completely or not at all. Arguments are as in `export_c`.

    StudyError: the export can't be made or written.
    """
    sources.check(target)
    where = first_scenario(study, controller, scenario)
    planned = plan(study, where, controller)
    trials = min(study.scenario[where].trials, max(2, min(TEST_TRIALS, TEST_SAMPLES // study.samples(where))))
    trace = recorded(planned, trials * study.samples(where))
    written = contents(study, planned, trace, trials, command)
    manifest = {
        "study": study.name,
        "sha256": study_hash(study),
        "scenario": where,
        "controller": controller,
        "law": "trial",
        "version": versions()["cogless"],
    }
    if planned.description["controller"]["learning_matrix"] is not None:
        announce(sources.size(written, planned.description["controller"]["learning_matrix"].nbytes))
    sources.write(target, written, manifest)


def recorded(planned: Plan, ticks: int) -> Trace:
    """Trace of the first `ticks` samples of a run, a row for each sample. StudyError: the run fails."""
    recorder = planned.engine.Recorder(planned.drive, 1, ticks)
    with failures(*planned.names):
        planned.drive.advance(planned.start(), recorder, ticks)
    return trace_of(planned.drive.signals, recorder)


def contents(study: TrialStudy, planned: Plan, trace: Trace, trials: int, command: str) -> dict[str, bytes]:
    """Contents of the exported files, by their path in the folder."""
    words = _template_words(study, planned, command) | {
        "trials": str(trials),
        "rows": _bit_pattern_lines(trace),
        "bits": "uint64_t",
    }
    return sources.with_library(law_texts("linear", words), sources.closure(["trial.h"]))


def _template_words(study: TrialStudy, planned: Plan, command: str) -> dict[str, str]:
    """{placeholder: text} for the templates."""
    _, scenario, controller = planned.names
    assert study.plant is not None
    layout, law = control_layout("double"), C_LAWS["trial"]
    description = planned.description["controller"]
    config: dict[str, Any] = layout.decode(law.config, description["config"])
    name, matrix = identifier(controller), description["learning_matrix"]
    own = {} if matrix is None else {"learning_matrix": f"{name}_learning_matrix"}
    numbers, verdict = figures(study, scenario, controller)
    entries = law.entries(config)
    assert entries is not None
    return {
        **study_words(study, scenario, controller, command),
        "flags": f"{C_FLAGS} -DCOGLESS_DOUBLE",
        "period": f"{study.period:g}",
        "samples": str(study.samples(scenario)),
        "states": str(study.states),
        "state_names": ", ".join(study.plant.names),
        "entries": entries,
        "limit": f"{study.plant.input_limit:g}",
        "law_values": initialiser(layout.headers, law.config, config | own, "d"),
        "matrix": matrix_array(name, None if matrix is None else np.asarray(matrix), "d"),
        "verdict_comment": verdict_comment(verdict),
        "verdict_list": verdict_list(verdict),
        "figures": figure_lines(numbers),
    }


def _bit_pattern_lines(trace: Trace) -> str:
    """C rows with the bit patterns of y_ref, states and u, and with the status, a line for each sample."""
    names = ["y_ref", *(name for name in trace.names if name.startswith("x_")), "u"]
    bits = np.column_stack([trace[name] for name in names]).astype(np.float64).view(np.uint64)
    status = trace["status"].astype(int)

    def line(row: list[int], code: int) -> str:
        y_ref, *x, u = (f"0x{word:016x}U" for word in row)
        return f"    {{{y_ref}, {{{', '.join(x)}}}, {u}, {code}U}},"

    return "\n".join(line(row, code) for row, code in zip(bits.tolist(), status.tolist(), strict=True))
