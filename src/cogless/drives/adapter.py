"""What each drive's module offers: the logs that it reads, its configuration, the table that it takes.

A drive is one module with an `Adapter`; `registry` lists them. Angles are the rotor's, mechanical, and count
in the direction in which a positive i_q accelerates. Currents are peak amperes.
"""

from __future__ import annotations

import codecs
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from cogless.drives.holding_current import AngleWaves, HoldingCurrent
from cogless.errors import StudyError
from cogless.files import no_device, reason
from cogless.identify.log import HEADINGS_SHOWN
from cogless.identify.log_files import LogColumns, printable
from cogless.identify.read_log import read
from cogless.printer.axis import Axis
from cogless.printer.corrections import Correction
from cogless.results.trace import Array

RAMP_TIME = 1.0  # s, from rest to the first speed of a motion and from the last to rest
FRAME_FILE = "drive.json"  # stands beside the results of identify


class Certainty(StrEnum):
    """How sure it is that a format is read or written as its firmware does."""

    SOURCE = "verified in the drive's source"
    MANUAL = "by the drive's manual"
    DRIVE = "needs one test on the drive"
    OWN = "a format of cogless"


@dataclass(frozen=True)
class Feature:
    """A format that a drive's module reads or writes, and how sure that is."""

    what: str
    certainty: Certainty


@dataclass(frozen=True, eq=False)
class Recording:
    """A log in SI units by signal, as `identify.config.SIGNALS` names them; NaN where a number is missing.

    `kind`: of the log, as `identify` names it; "": not known. `remarks`: what was wrong with
    its files, a sentence each.
    """

    path: Path
    name: str  # "": the file's
    signals: Mapping[str, Array]
    kind: str = ""
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class TableFrame:
    """How the index of the drive's own cogging table follows from the identified angle.

    The index counts as `direction` times the identified angle. `zero`: both are zero at one place;
    `zero_error`: by how much they may differ, rad. `lacking`: why `zero` is false, as text after "since".
    `gains`: of the drive's own law, as its class in `firmware_laws` takes them; empty: not known. `encoder`:
    number of the index's encoder. `encoder_table_on`: whether a correction table of this encoder was on.
    The encoder's own angle is `encoder_direction` times the identified angle plus `encoder_shift`, rad. With
    direction 0, `encoder_lacking` says what would give it. `pole_pairs`: 0 where no table needs them.
    """

    drive: str
    direction: int = 1
    _: KW_ONLY
    zero: bool = False
    zero_error: float = 0.0
    lacking: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    encoder: int = 0
    encoder_table_on: bool = False
    encoder_direction: int = 0
    encoder_shift: float = 0.0
    encoder_lacking: str = ""
    pole_pairs: int = 0

    def to_json(self) -> str:
        return json.dumps(asdict(self), indent=2) + "\n"


@dataclass(frozen=True, eq=False)
class DriveLogs:
    """What a drive's logs and configuration contain: recordings, tables of a file of columns, remarks."""

    recordings: Sequence[Recording]
    tables: Mapping[str, Mapping[str, Any]]  # [motor] and [drive]
    frame: TableFrame
    remarks: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class TableText:
    """A cogging table in the drive's own format.

    `applied`: the current, A, that the firmware makes of the table at an identified angle, rad. `entries`,
    `scale`: for the summary. `install`, `remove`, `sign_check`: what the user does, a line each.
    `table_params`: the table as the class of the drive's law takes it.
    """

    text: str
    entries: int
    scale: str
    applied: Callable[[Array], Array]
    install: str
    remove: str
    sign_check: str
    notes: Sequence[str] = ()
    table_params: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Motions:
    """Speeds of the rotor, rad/s over s, with straight lines between, by the name of the log to record.

    `current_limit`: A; `K_t`: N m/A. `tables`: [motor] and [drive] of the plan's study.
    """

    speeds: Mapping[str, Sequence[tuple[float, float]]]
    current_limit: float
    K_t: float
    tables: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class CorrectionText:
    """A step motor's correction in a firmware's own format. `holds`: what it can and can't hold.

    `share`: the share of the correction that it leaves, rms over the angle of both directions.
    """

    text: str
    share: float
    holds: Sequence[str]
    install: str
    remove: str


def ramped(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points of time and speed, with a ramp from rest before them and a ramp to rest after them."""
    (_, first), (end, last) = points[0], points[-1]
    before = [(0.0, 0.0)] if first else []
    start = RAMP_TIME if first else 0.0
    after = [(start + end + RAMP_TIME, 0.0)] if last else []
    return [*before, *((start + t, speed) for t, speed in points), *after]


@dataclass(frozen=True, eq=False)
class Adapter:
    """A drive's module. `recognise`: the kind of its log that begins with these lines; "": none.

    `read_logs`, `read_table` also take the file of `--drive-config`. `write`: the drive's own text of a
    table; None: `refusal` says why the drive takes none. `write_script`: files by name,
    of which the first plays motions and logs them; `log_pattern`: the log of a motion, by name and number.
    `identify_runs`, `write_runs`, `write_correction`: the same for a printer's axis, whose motor has no
    sensor. `law`: the class of the drive's own law in `firmware_laws`; `gains`: the law's arguments in the
    file of `--drive-config`, empty if it has none. `own_angle`: its table is over the angle of
    the table's source. `write_encoder`: its own text of a correction of its encoder; None: it takes none.
    `mean_currents`: a row of its logs has the mean current since the row before.
    """

    name: str
    title: str
    reads: tuple[Feature, ...]
    writes: tuple[Feature, ...]
    recognise: Callable[[Sequence[str]], str] | None = None
    read_logs: Callable[[Sequence[Path], Path | None], DriveLogs] | None = None
    write: Callable[[HoldingCurrent, TableFrame], TableText] | None = None
    read_table: Callable[[Path, Path | None], HoldingCurrent] | None = None
    write_script: Callable[[Motions, Path | None], Mapping[str, str]] | None = None
    identify_runs: Callable[[Sequence[Path], Axis], Correction] | None = None
    write_runs: Callable[[Axis], Mapping[str, str]] | None = None
    write_correction: Callable[[Correction], CorrectionText] | None = None
    refusal: str = ""
    law: str = ""
    gains: Callable[[Path], Mapping[str, float]] | None = None
    log_pattern: str = "{name}.csv"
    own_angle: bool = False
    write_encoder: Callable[[AngleWaves, TableFrame], TableText] | None = None
    mean_currents: bool = False


def text_of(path: Path, expected: str) -> str:
    """The text of a small file, UTF-8 or as Windows redirects it, UTF-16. StudyError: it can't be read."""
    try:
        no_device(path)
        with path.open("rb") as file:
            utf_16 = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        return path.read_text(encoding="utf-16" if utf_16 else "utf-8-sig")
    except UnicodeDecodeError:
        raise StudyError(f"{path}: not UTF-8: expected {expected}") from None
    except OSError as error:
        raise StudyError(f"{path}: {reason(error)}: expected {expected}") from error


def read_columns(path: Path, names: Sequence[str], needed: Sequence[str], title: str) -> LogColumns:
    """Those columns of these headings that the log has. The first of `needed` is the time.

    Rows without a time are left out; other cells may lack their number, and are NaN. StudyError: a
    needed column is missing, or a cell is no number.
    """
    (log,) = read(path, list(names), with_gaps=True)
    lacking = next((name for name in needed if name not in log.columns), None)
    if lacking is not None:
        others = ", ".join(map(printable, log.headings[:HEADINGS_SHOWN]))
        raise StudyError(f'{path}: no column "{lacking}"; it has {others}: expected a log of {title}')
    timed = ~np.isnan(log.columns[needed[0]])
    return replace(log, columns={name: values[timed] for name, values in log.columns.items()})


def frame_from(path: Path) -> TableFrame:
    """The frame that identify wrote beside its results. StudyError: the file is no such one."""
    try:
        return TableFrame(**json.loads(text_of(path, "a file that identify --drive writes")))
    except (TypeError, ValueError):
        raise StudyError(f"{path}: expected what identify --drive writes") from None
