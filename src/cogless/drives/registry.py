"""All drives; the drive that made a log; a drive's logs as identify takes them."""

from __future__ import annotations

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Any

from cogless import units
from cogless.drives.adapter import Adapter, DriveLogs, Motions, TableFrame, ramped
from cogless.drives.c_table import C_TABLE
from cogless.drives.industrial import AKD, AX8000, NOVANTA
from cogless.drives.klipper import KLIPPER
from cogless.drives.moteus import MOTEUS
from cogless.drives.odrive import ODRIVE
from cogless.drives.plain_table import PLAIN_TABLE
from cogless.drives.predicted_ripple import law_table
from cogless.drives.prusa import PRUSA, PRUSA_M971
from cogless.drives.simplefoc import SIMPLEFOC
from cogless.drives.vesc import VESC
from cogless.drives.wave_table import TMC2130, TMC2240, TMC5160
from cogless.errors import StudyError
from cogless.files import no_device
from cogless.identify import config, plan, read_log
from cogless.identify.config import Identification
from cogless.identify.log import Log, logs_of_columns
from cogless.identify.log_files import LogColumns, readable
from cogless.study import AnyStudy
from cogless.study.datasheet import replaced_by_any
from cogless.study.reading import read
from cogless.study.toml import toml

ADAPTERS: dict[str, Adapter] = {
    adapter.name: adapter
    for adapter in (
        *(MOTEUS, ODRIVE, VESC, SIMPLEFOC, PLAIN_TABLE, C_TABLE, AKD, AX8000, NOVANTA),
        *(KLIPPER, PRUSA, PRUSA_M971, TMC2130, TMC5160, TMC2240),
    )
}
LOGS_NAME = "logs.toml"  # stands beside the script of a plan
FIRST_BYTES = 1 << 14  # bytes of a file, among which its heading is
OWN_TABLES = ("title", "motor", "drive", "controller", "log", "angle_offset")  # tables that --config may have


@dataclass(frozen=True, eq=False)
class Prepared:
    """Logs of a drive with what is known of it. `remarks`: what was guessed or laid over, a sentence each."""

    identification: Identification
    logs: list[Log]
    frame: TableFrame
    remarks: tuple[str, ...]

    @property
    def takes_table(self) -> bool:
        """Whether a table can be written for the drive that made the logs."""
        return self.frame.zero and ADAPTERS[self.frame.drive].write is not None


USES = {  # what an option asks of a drive: one of these
    "--drive": ("read_logs", "identify_runs"),
    "--from": ("read_table",),
    "--to": ("write", "write_correction"),
}


def _can(drive: Adapter, option: str) -> bool:
    return any(getattr(drive, use) is not None for use in USES[option])


def able_drives(option: str) -> str:
    """The names of the drives that an option can have, as text."""
    return ", ".join(name for name, drive in ADAPTERS.items() if _can(drive, option))


def adapter_named(name: str, option: str) -> Adapter:
    """The drive of this name. StudyError names the option, and the drives that it can have."""
    if name not in ADAPTERS:
        raise StudyError(f'{option}: "{name}": expected one of {able_drives(option)}')
    return ADAPTERS[name]


def recognised(path: Path) -> tuple[Adapter, str] | None:
    """The drive that made a log, by the log's first lines, and the kind of log; None: no known drive."""
    lines = first_lines(path)
    for adapter in ADAPTERS.values():
        kind = adapter.recognise(lines) if adapter.recognise is not None else ""
        if kind:
            return adapter, kind
    return None


def first_lines(path: Path) -> list[str]:
    """The whole lines at the beginning of a text file, packed or not; of an NPZ its names, in one line."""
    if path.suffix.lower() == ".npz":
        return [",".join(read_log.read(path, [])[0].headings)]
    with readable(path, "log"):
        no_device(path)
        with (gzip.open if path.name.endswith(".gz") else open)(path, "rb") as file:
            raw = file.read(FIRST_BYTES)
    try:
        return raw[: raw.rfind(b"\n") + 1].decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        return []


def script_files(study: AnyStudy, drive: str, configuration: Path | None) -> Mapping[str, str]:
    """Files, by name, that play on a drive the motions of a plan that need no load from outside.

    StudyError: there is none for this drive, or no plan for this study.
    """
    adapter = adapter_named(drive, "--drive")
    if adapter.write_script is None:
        having = ", ".join(key for key, other in ADAPTERS.items() if other.write_script is not None)
        raise StudyError(
            f'--drive: "{drive}": cogless writes no script for this drive: expected one of {having}'
        )
    play, columns = plan.tables(study)
    assert study.motor is not None and study.drive is not None
    speeds = {
        log: [
            (units.parse(t, units.TIME), units.parse(speed, units.ANGULAR_SPEED))
            for t, speed in scenario["reference"]["profile"]
        ]
        for log, scenario in play["scenario"].items()
        if "load" not in scenario
    }
    limit, K_t = study.drive.current_loop.current_limit, study.motor.star().K_t
    scripts = adapter.write_script(Motions(speeds, limit, K_t, columns), configuration)
    return {**scripts, LOGS_NAME: _log_rules(speeds, adapter.log_pattern)}


def own_law(drive: str, configuration: Path | None) -> dict[str, Any]:
    """The drive's own law with the gains of its configuration, as the controllers of a study.

    Empty: the drive has no law here, or the gains are not known.
    """
    adapter = adapter_named(drive, "--drive")
    if adapter.gains is None or configuration is None:
        return {}
    gains = adapter.gains(configuration)
    return {adapter.name: law_table(adapter.law, gains)} if gains else {}


def _log_rules(speeds: Mapping[str, Sequence[tuple[float, float]]], pattern: str) -> str:
    """The file of --config for the logs that a script records: it has the reference of each log."""
    lines = [
        "# The speed that the script commands in each log. identify simulates the drive's own law with it."
    ]
    for number, (name, points) in enumerate(speeds.items()):
        profile = [[f"{t:.6g} s", f"{speed:.6g} rad/s"] for t, speed in ramped(points)]
        lines += [
            "",
            "[[log]]",
            f"file = {toml(pattern.format(name=name, number=number))}",
            f"reference = {toml({'profile': profile})}",
        ]
    return "\n".join(lines) + "\n"


def prepare(
    paths: Sequence[Path], drive: str | None, configuration: Path | None, columns: Path | None
) -> Prepared:
    """Read a drive's logs. `drive`: its name, or None to guess it. `columns`: the file of --config.

    StudyError: a file that can't be used, or what is lacking.
    """
    if configuration in paths:
        raise StudyError(
            f"{configuration}: is among the logs and in --drive-config: expected only in --drive-config"
        )
    remarks = []
    if drive is None:
        match = recognised(paths[0])
        if match is None:
            if paths[0].stat().st_size == 0:
                raise StudyError(f"{paths[0]}: empty: expected a heading and rows of numbers")
            raise StudyError(
                f"{paths[0]}: its first lines fit no known drive: expected --config FILE that names the "
                f"columns, or --drive NAME, one of {able_drives('--drive')}"
            )
        adapter, kind = match
        remarks.append(f"{paths[0].name}: its first lines are those of {adapter.title}, {kind}.")
    else:
        adapter = adapter_named(drive, "--drive")
        match = recognised(paths[0])
        if match is not None and match[0] is not adapter:
            other, kind = match
            raise StudyError(
                f"{paths[0]}: its first lines are those of {other.title}, {kind}: expected a log of "
                f"{adapter.title}, "
                f"or --drive {other.name}"
            )
    if adapter.read_logs is None:
        raise StudyError(
            f'--drive: "{adapter.name}": cogless reads no logs of this drive: expected one of '
            f"{able_drives('--drive')}"
        )
    logs = adapter.read_logs(paths, configuration)
    merged = _merged(logs, columns, adapter)
    laws = [adapter.name] if merged.get("controller") == _own_law(adapter, logs) else []
    identification = config.from_tables(
        columns or configuration or paths[0],
        merged,
        laws,
        described_in=configuration.name if configuration is not None else paths[0].name,
        replay_rule=_replay_rule(adapter, logs),
    )
    read_columns = [
        (
            recording.path,
            LogColumns(
                recording.name,
                dict(recording.signals),
                tuple(recording.signals),
                tuple(recording.remarks),
            ),
        )
        for recording in logs.recordings
    ]
    if adapter.write is not None and not logs.frame.zero:
        remarks.append(f"No cogging table can be written for this drive, since {logs.frame.lacking}.")
    return Prepared(
        identification, logs_of_columns(read_columns, identification), logs.frame, (*remarks, *logs.remarks)
    )


def _merged(logs: DriveLogs, columns: Path | None, adapter: Adapter) -> dict[str, Any]:
    """The tables of a file of columns: the drive's, replaced by the user's where his file has them.

    If his file has the reference of a log and no controller, the controller is the drive's own law.
    """
    tables, recordings = logs.tables, logs.recordings
    own = {} if columns is None else read(columns)
    other = next((key for key in own if key not in OWN_TABLES), None)
    if other is not None:
        raise StudyError(
            f"{columns}: {other}: expected one of {', '.join(OWN_TABLES)}; "
            f"with --drive, cogless knows the columns of {adapter.name}"
        )
    motor = own.get("motor", {})
    drive = own.get("drive", {})
    replaced = replaced_by_any(motor) if isinstance(motor, dict) else frozenset()
    merged: dict[str, Any] = {
        "title": f"A motor from the logs of its {adapter.name}",
        "angle_offset": "0 rad",
        **own,
        "motor": {**{key: v for key, v in tables["motor"].items() if key not in replaced}, **motor},
        "drive": {**tables["drive"], **drive},
    }
    merged["log"] = [
        *own.get("log", []),
        *({"file": escape(r.name or r.path.name), "kind": r.kind} for r in recordings if r.kind),
    ]
    if adapter.law and logs.frame.gains and "controller" not in own and _any_reference(own):
        merged["controller"] = _own_law(adapter, logs)
    names = {r: r.name or r.path.name for r in recordings}
    signals = dict.fromkeys(signal for r in recordings for signal in r.signals)
    merged["columns"] = {
        signal: {"name": signal, "files": [escape(names[r]) for r in recordings if signal in r.signals]}
        for signal in signals
    }
    if adapter.mean_currents:
        merged["columns"]["i_q"]["mean"] = True
    return merged


def _replay_rule(adapter: Adapter, logs: DriveLogs) -> str:
    """What the replay of a log of this drive needs, in words."""
    law = "its controller, since cogless has no model of the drive's own law"
    if adapter.law:
        law = "the gains of its law in the configuration" if not logs.frame.gains else ""
    rule = "its reference in the --config file"
    if adapter.write_script is not None:
        plan = f"identify --plan --drive {adapter.name}"
        rule = f"its reference (from {LOGS_NAME} of {plan}: give --config {LOGS_NAME})"
    return f"{rule} and {law}" if law else rule


def _own_law(adapter: Adapter, logs: DriveLogs) -> dict[str, Any]:
    """The drive's own law, as the controllers of a study."""
    return {adapter.name: law_table(adapter.law, logs.frame.gains)}


def _any_reference(tables: Mapping[str, Any]) -> bool:
    rules = tables.get("log", [])
    return isinstance(rules, list) and any(isinstance(rule, dict) and "reference" in rule for rule in rules)
