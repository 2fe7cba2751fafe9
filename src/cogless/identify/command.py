"""The commands: identify a motor from logs, and plan the logs of a motor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cogless.errors import StudyError
from cogless.identify import config, write
from cogless.identify.config import Identification
from cogless.identify.estimate import CLEAR_ERRORS, Progress, estimate
from cogless.identify.log import Log, load_logs
from cogless.identify.replay import refined
from cogless.identify.result import Estimate, Wave
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
    return identified_logs(known, load_logs(list(logs), known), progress)


def identified_logs(identification: Identification, logs: Sequence[Log], progress: Progress) -> Identified:
    """Identify a motor from logs that are read. StudyError: logs that tell nothing."""
    made = estimate(identification, list(logs), progress)
    made, traces = refined(made, progress)
    made = standing_out(made)
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
    for kind, waves, factor, unit in _kinds(made):
        for wave in waves:
            size, phase = wave.size.times(factor), wave.phase.times(DEGREES)
            said = f"{write.shown(size, unit)}, phase {write.shown(phase, 'deg')}"
            found.append(f"{f'{kind}, order {wave.order}':<30} {said}")
    return found


def _kinds(made: Estimate) -> tuple[tuple[str, tuple[Wave, ...], float, str], ...]:
    """What has orders: its name, waves, and the factor to a unit."""
    return (
        ("cogging", made.cogging, 1e3 * made.K_t, "mN*m"),
        ("K_t ripple", made.ripple, 100.0, "%"),
        ("encoder's error", made.encoder, DEGREES, "deg"),
    )


def standing_out(made: Estimate) -> Estimate:
    """The estimate without the orders that do not stand out of the errors that are told.

    What found them was the fit's own error: delay and kernels of other widths add to it. Cogging may have
    any order, so it must stand out at the chance of a search of all of them. A sentence names those that may
    be larger than one that stays. An error of the encoder stays where the file of columns tells another.
    """
    kept, said = [], []
    for kind, waves, factor, unit in _kinds(made):
        clear = CLEAR_ERRORS["cogging"] if waves is made.cogging else 1.0
        stays = tuple(
            wave
            for wave in waves
            if wave.size.value > clear * wave.size.error
            or (waves is made.encoder and made.known.tells_error(wave.order))
        )
        kept.append(stays)
        least = min((wave.size.value for wave in stays), default=0.0)
        bounds = {wave.order: wave.size.value + wave.size.error for wave in waves if wave not in stays}
        large = [order for order, bound in bounds.items() if bound > least]
        if large:
            orders = ", ".join(map(str, large))
            said.append(
                f"{kind[0].upper()}{kind[1:]} of order {orders} is too small for these logs and is left out. "
                f"It may be up to {max(bounds.values()) * factor:.2g} {unit}."
            )
    cogging, ripple, encoder = kept
    return replace(made, cogging=cogging, ripple=ripple, encoder=encoder, left_out=(*made.left_out, *said))
