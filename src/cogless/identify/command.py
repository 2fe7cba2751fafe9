"""The commands: identify a motor from logs, and plan the logs of a motor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.identify import config, write
from cogless.identify.config import Identification
from cogless.identify.estimate import CLEAR_ERRORS, Progress, estimate_motor
from cogless.identify.log import Log, load_logs
from cogless.identify.replay import refined
from cogless.identify.result import Estimate
from cogless.identify.sessions import sentences, sessions
from cogless.results.trace import Trace
from cogless.units import DEGREE


@dataclass(frozen=True, eq=False)
class Identified:
    """An estimate, and the simulated trace of each log that could be played, by the log's name."""

    estimate: Estimate
    traces: Mapping[str, Trace]


def identified(logs: Sequence[Path], columns: Path, progress: Progress) -> Identified:
    """Identify a motor. StudyError: a mistake in a file, or logs from which nothing can be identified."""
    if not columns.is_file():
        raise StudyError(f"{columns}: no such file: expected a TOML file that names the columns")
    identification = config.load(columns)
    progress("reading", 0.0)
    return identified_logs(identification, load_logs(list(logs), identification), progress)


def identified_logs(identification: Identification, logs: Sequence[Log], progress: Progress) -> Identified:
    """Identify a motor from logs that are already read. StudyError: nothing can be identified from them."""
    estimate = estimate_motor(identification, list(logs), progress)
    estimate, traces = refined(estimate, progress)
    estimate = standing_out(estimate)
    session_remarks = sentences(sessions(estimate))
    return Identified(replace(estimate, remarks=(*estimate.remarks, *session_remarks)), traces)


def value_lines(estimate: Estimate) -> list[str]:
    """Lines of all values and waves, with their errors."""
    texts = []
    for key, (description, unit, name, torque) in write.VALUE_NAMES.items():
        if key in estimate.values:
            value = estimate.values[key]
            by_torque = write.value_text(value.times(estimate.K_t), torque)
            more = f"  {name.replace('_', ' ')} {by_torque}" if name else ""
            texts.append(f"{description:<30} {write.value_text(value, unit)}{more}")
    for kind, name, factor, unit in estimate.kinds:
        for wave in estimate.waves(name):
            size, phase = wave.size.times(factor), wave.phase.times(1 / DEGREE)
            size_and_phase = f"{write.value_text(size, unit)}, phase {write.value_text(phase, 'deg')}"
            texts.append(f"{f'{kind}, order {wave.order}':<30} {size_and_phase}")
    return texts


def standing_out(estimate: Estimate) -> Estimate:
    """The estimate without the orders that do not stand out of their final errors.

    The search compared orders with the fit's own error; delay and kernels of other widths add to that error.
    Cogging may have any order, so cogging must stand out at the chance of a search of all orders. A sentence
    names each dropped order that may be larger than one that stays. An encoder's error stays in any case if
    the file of columns has an error of this order.
    """
    clear_waves, remarks = dict[str, Any](), []
    for kind, name, factor, unit in estimate.kinds:
        waves = estimate.waves(name)
        clear = CLEAR_ERRORS["cogging"] if name == "cogging" else 1.0
        stays = tuple(
            wave
            for wave in waves
            if wave.size.value > clear * wave.size.error
            or (name == "encoder" and estimate.identification.tells_error(wave.order))
        )
        clear_waves[name] = stays
        least = min((wave.size.value for wave in stays), default=0.0)
        bounds = {wave.order: wave.size.value + wave.size.error for wave in waves if wave not in stays}
        large = [order for order, bound in bounds.items() if bound > least]
        if large:
            orders = ", ".join(map(str, large))
            remarks.append(
                f"{kind[0].upper()}{kind[1:]} of order {orders} is too small to be identified from these "
                f"logs and is left out. It may be up to {max(bounds.values()) * factor:.2g} {unit}."
            )
    unknown = tuple(wave for wave in estimate.of_unknown_cause if wave.size.value > wave.size.error)
    left_out = (*estimate.left_out, *remarks)
    return replace(estimate, **clear_waves, of_unknown_cause=unknown, left_out=left_out)
