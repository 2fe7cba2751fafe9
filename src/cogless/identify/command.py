"""The commands: identify a motor from logs, and plan the logs of a motor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cogless.errors import StudyError
from cogless.identify import config, write
from cogless.identify.estimate import Progress, estimate
from cogless.identify.log import load_logs
from cogless.identify.replay import refined
from cogless.identify.result import Estimate
from cogless.identify.sessions import sentences, sessions
from cogless.results.trace import Trace

DEGREES = 180 / math.pi


@dataclass(frozen=True, eq=False)
class Identified:
    """An estimate, and the simulated trace of each log that could be played, by the log's name."""

    estimate: Estimate
    traces: Mapping[str, Trace]


def identified(logs: Sequence[Path], columns: Path, progress: Progress) -> Identified:
    """Identify a motor. StudyError: a mistake in a file, or logs that tell nothing."""
    if not columns.is_file():
        raise StudyError(f"{columns}: no such file: expected a TOML file that names the columns")
    known = config.load(columns)
    progress("reading", 0.0)
    made = estimate(known, load_logs(list(logs), known), progress)
    made, traces = refined(made, progress)
    said = sentences(sessions(made))
    return Identified(replace(made, remarks=(*made.remarks, *said)), traces)


def lines(made: Estimate) -> list[str]:
    """What was found, a line each."""
    found = []
    for key, (about, unit, name, torque) in write.NAMES.items():
        if key in made.values:
            value = made.values[key]
            more = f"  {name.replace('_', ' ')} {write.shown(value.times(made.K_t), torque)}" if name else ""
            found.append(f"{about:<30} {write.shown(value, unit)}{more}")
    for kind, waves, factor, unit in (
        ("cogging", made.cogging, 1e3 * made.K_t, "mN*m"),
        ("K_t ripple", made.ripple, 100.0, "%"),
        ("encoder's error", made.encoder, DEGREES, "deg"),
    ):
        for wave in waves:
            size, phase = wave.size.times(factor), wave.phase.times(DEGREES)
            said = f"{write.shown(size, unit)}, phase {write.shown(phase, 'deg')}"
            found.append(f"{f'{kind}, order {wave.order}':<30} {said}")
    return found
