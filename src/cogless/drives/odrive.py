"""ODrive: reads captures of firmware 0.5 and 0.6, the configuration, and the cogging map of 0.5.

Headings of a capture are paths of the API. The source of 0.5 was read (odriverobotics/ODrive, f9b5419). That
of 0.6 is closed, so its paths come from the API's documentation. Angles are turns of the encoder; currents
are peak amperes; the map is a torque.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cogless.drives.adapter import (
    Adapter,
    Certainty,
    DriveLogs,
    Feature,
    Recording,
    TableFrame,
    read_columns,
    text_of,
)
from cogless.drives.fault_rows import faults, numbers
from cogless.drives.holding_current import HoldingCurrent, from_samples
from cogless.drives.odrive_script import write_script
from cogless.errors import StudyError
from cogless.identify.log_files import printable
from cogless.identify.read_log import read
from cogless.results.trace import Array

CONFIG_HINT = "the JSON of odrivetool backup-config"
MAP_CELLS = 3600
COUNTS_A_LINE = 4
CONTROL_RATE = 8000.0  # Hz, of control cycles; the times of a high-rate capture may be counts of them
NANOSECONDS_LEAST = 1000.0  # ns between rows, at least; captures that count cycles have smaller steps
PATH_PATTERN = re.compile(r"(?:odrv\w*\.)?(?:axis(?P<axis>\d)\.)?(?P<rest>.+)")
TIME_HEADINGS = ("t", "time", "timestamp", "timestamps")
# Paths below the axis, of 0.5 and then 0.6: the signal, and the factor to SI.
SIGNAL_PATHS: dict[str, tuple[str, float]] = {
    "encoder.pos_estimate": ("theta", math.tau),
    "encoder.vel_estimate": ("omega", math.tau),
    "motor.current_control.Iq_measured": ("i_q", 1.0),
    "motor.current_control.Id_measured": ("i_d", 1.0),
    "motor.current_control.Iq_setpoint": ("i_q_ref", 1.0),
    "pos_estimate": ("theta", math.tau),
    "vel_estimate": ("omega", math.tau),
    "motor.foc.Iq_measured": ("i_q", 1.0),
    "motor.foc.Id_measured": ("i_d", 1.0),
    "motor.foc.Iq_setpoint": ("i_q_ref", 1.0),
}
BUS_PATH = "vbus_voltage"
# Paths below the axis, of 0.5 and then 0.6, that are not zero after a fault.
FAULT_PATHS = ("error", "motor.error", "encoder.error", "controller.error", "active_errors", "disarm_reason")
STATE_PATH, CLOSED_LOOP = "current_state", 8
# Argument of firmware_laws.Odrive -> path of its value below the axis.
LOOP_PATHS = {
    "pos_gain": "controller.config.pos_gain",
    "vel_gain": "controller.config.vel_gain",
    "vel_integrator_gain": "controller.config.vel_integrator_gain",
    "bandwidth": "encoder.config.bandwidth",
}
VELOCITY_CONTROL_MODE = 2


@dataclass(frozen=True)
class Configuration:
    """Values by dotted path, of firmware 0.5 (nested in its file) or 0.6 (one path a line)."""

    path: Path
    values: Mapping[str, Any]
    axis: str

    def number(self, names: Sequence[str], expected: str) -> float:
        """The value at the first of these paths that the file has. StudyError: none, or no number above 0."""
        paths = [f"axis{self.axis}.{name}" for name in names]
        path = next((path for path in paths if path in self.values), None)
        if path is None:
            raise StudyError(f"{self.path}: {' or '.join(paths)}: missing: expected {expected}")
        value = self.values[path]
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
            raise StudyError(f"{self.path}: {path}: {printable(str(value))}: expected {expected}")
        return float(value)

    @property
    def firmware(self) -> str:
        """The firmware, 0.5 or 0.6, whose paths the motor's settings have; "" if neither's."""
        prefixes = {"0.5": f"axis{self.axis}.motor.config.", "0.6": f"axis{self.axis}.config.motor."}
        return next(
            (name for name, prefix in prefixes.items() if any(key.startswith(prefix) for key in self.values)),
            "",
        )

    @property
    def map_on(self) -> bool:
        """Whether the map of firmware 0.5 acts after a start."""
        prefix = f"axis{self.axis}.controller.config.anticogging."
        return all(
            self.values.get(prefix + name) is True for name in ("pre_calibrated", "anticogging_enabled")
        )


def read_configuration(path: Path, axis: str) -> Configuration:
    """Read a configuration. StudyError: the file is none."""
    try:
        contents = json.loads(text_of(path, CONFIG_HINT))
    except ValueError:
        raise StudyError(f"{path}: not readable as JSON: expected {CONFIG_HINT}") from None
    if not isinstance(contents, dict):
        raise StudyError(f"{path}: expected {CONFIG_HINT}")
    return Configuration(path, dict(_flat(contents)), axis)


def _flat(tables: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Each value with its dotted path."""
    pairs = []
    for key, value in tables.items():
        pairs += _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(f"{prefix}{key}", value)]
    return pairs


def tables(configuration: Configuration, bus_voltage: float) -> dict[str, dict[str, Any]]:
    """[motor] and [drive] as the configuration gives them."""

    def number(name: str, expected: str, *others: str) -> float:
        return configuration.number([f"motor.config.{name}", f"config.motor.{name}", *others], expected)

    limit = configuration.number(
        ["motor.config.current_lim", "config.motor.current_soft_max"], "a current above zero"
    )
    bandwidth = number("current_control_bandwidth", "a bandwidth above zero, rad/s")
    rate = f"{CONTROL_RATE:.0f} Hz"
    loop: dict[str, Any] = {"current_limit": f"{limit:.9g} A"}
    drive: dict[str, Any] = {"rates": {"current_loop": rate, "speed_loop": rate}, "current_loop": loop}
    if bus_voltage > 0:
        loop["bandwidth"] = f"{bandwidth / math.tau:.9g} Hz"
        drive["inverter"] = {"bus_voltage": f"{bus_voltage:.4g} V"}
    else:
        loop["kind"] = "ideal"
    counts = configuration.values.get(f"axis{configuration.axis}.encoder.config.cpr")
    if isinstance(counts, int) and counts > 0 and counts % COUNTS_A_LINE == 0:
        drive["position_sensor"] = {"kind": "encoder", "lines": counts // COUNTS_A_LINE}
    inductance = f"{number('phase_inductance', 'the inductance of a calibrated motor'):.9g} H"
    return {
        "motor": {
            "pole_pairs": round(number("pole_pairs", "a number of pole pairs")),
            "R_s": f"{number('phase_resistance', 'the resistance of a calibrated motor'):.9g} ohm",
            "L_d": inductance,
            "L_q": inductance,
            "K_t": f"{number('torque_constant', 'a torque constant above zero, N m/A'):.9g} N*m/A",
        },
        "drive": drive,
    }


def gains(configuration: Configuration) -> dict[str, float]:
    """The controller's gains, as `firmware_laws.Odrive` takes them; empty: the file lacks some."""
    prefix = f"axis{configuration.axis}."
    values = {name: configuration.values.get(prefix + path) for name, path in LOOP_PATHS.items()}
    numbers = {name: float(x) for name, x in values.items() if isinstance(x, int | float) and x >= 0}
    if len(numbers) < len(LOOP_PATHS):
        return {}
    if configuration.values.get(prefix + "controller.config.control_mode") == VELOCITY_CONTROL_MODE:
        numbers["pos_gain"] = 0.0
    return numbers


def recognise(first: Sequence[str]) -> str:
    paths = _paths(first[0].split(",") if first else [])
    signals = {SIGNAL_PATHS[rest][0] for _, rest in paths.values() if rest in SIGNAL_PATHS}
    if not {"theta", "i_q"} <= signals:
        return ""
    return f"a capture of firmware {_firmware(list(paths))}"


def _firmware(headings: Sequence[str]) -> str:
    """The firmware that has such paths, "0.5" or "0.6"."""
    old = any(rest.startswith("encoder.") for _, rest in _paths(headings).values())
    return "0.5" if old else "0.6"


def _paths(headings: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Axis and path below it, by heading; a heading without an axis is of axis 0."""
    paths = {}
    for heading in headings:
        match = PATH_PATTERN.fullmatch(heading.strip())
        if match is not None:
            paths[heading.strip()] = (match["axis"] or "0", match["rest"])
    return paths


def read_logs(paths: Sequence[Path], configuration: Path | None) -> DriveLogs:
    """Captures, all of one axis. StudyError: a file that can't be used."""
    if configuration is None:
        raise StudyError(f"{paths[0]}: a log of ODrive: expected --drive-config FILE with {CONFIG_HINT}")
    captures = [_capture(path) for path in paths]
    axes = {axis for _, axis, _, _ in captures}
    if len(axes) > 1:
        raise StudyError(f"{paths[0]}: axes {', '.join(sorted(axes))}: expected the logs of one axis")
    settings = read_configuration(configuration, axes.pop())
    for path in paths:
        release = _firmware(read(path, [])[0].headings)
        if settings.firmware not in ("", release):
            raise StudyError(
                f"{configuration}: a configuration of firmware {settings.firmware}: expected the "
                f"configuration of the drive that recorded {path}, with firmware {release}"
            )
    kind = "table-on" if settings.map_on else ""
    recordings = [replace(recording, kind=kind) for recording, *_ in captures]
    remarks = [remark for *_, lines in captures for remark in lines]
    if kind:
        remarks.append(
            f"{configuration}: its anti-cogging map is on: the logged current contains the current of "
            "this map."
        )
    volts = [volt for _, _, volt, _ in captures if volt > 0]
    frame = TableFrame("odrive", zero=True, gains=gains(settings))
    return DriveLogs(recordings, tables(settings, float(np.median(volts)) if volts else 0.0), frame, remarks)


def _capture(path: Path) -> tuple[Recording, str, float, list[str]]:
    """A log in SI units, its axis, its bus voltage or 0, and remarks."""
    headings = read(path, [])[0].headings
    times = [heading for heading in headings if heading.strip().lower() in TIME_HEADINGS]
    columns = {
        heading: (axis, rest)
        for heading, (axis, rest) in _paths(headings).items()
        if rest in SIGNAL_PATHS or rest == BUS_PATH
    }
    signals_named = {SIGNAL_PATHS[rest][0]: rest for _, rest in columns.values() if rest in SIGNAL_PATHS}
    for signal, example in (("theta", "axis0.encoder.pos_estimate"), ("i_q", "axis0....Iq_measured")):
        if signal not in signals_named:
            others = ", ".join(printable(heading) for heading in headings[:8])
            raise StudyError(
                f'{path}: no column such as "{example}"; it has {others}: expected a log of ODrive'
            )
    if len(times) != 1:
        raise StudyError(f"{path}: expected one column of the time, named one of {', '.join(TIME_HEADINGS)}")
    axes = {axis for axis, rest in columns.values() if rest in SIGNAL_PATHS}
    if len(axes) > 1:
        raise StudyError(
            f"{path}: axes {', '.join(sorted(axes))}: expected the columns of one axis in a file"
        )
    log = read_columns(path, [times[0], *columns], times, "ODrive")
    signals: dict[str, Array] = {}
    volts = 0.0
    for heading, (_, rest) in columns.items():
        values = np.asarray(log.columns[heading])
        if rest == BUS_PATH:
            volts = float(np.nanmedian(values))
        else:
            signal, factor = SIGNAL_PATHS[rest]
            signals[signal] = factor * values
    seconds, remarks = _seconds(path, times[0], np.asarray(log.columns[times[0]]))
    flags = {heading: rest for heading, (_, rest) in _paths(headings).items() if rest in FAULT_PATHS}
    states = [heading for heading, (_, rest) in _paths(headings).items() if rest == STATE_PATH]
    read_flags = numbers(path, [*flags, *states], times[0])
    modes = next((read_flags.pop(heading) for heading in states if heading in read_flags), None)
    fault = faults(path, seconds - seconds[0], read_flags, modes, CLOSED_LOOP)
    good_rows = {name: values[: fault.rows] for name, values in {"t": seconds, **signals}.items()}
    recording = Recording(path, "", good_rows, remarks=log.remarks)
    return recording, axes.pop(), volts, [*remarks, *fault.remarks]


def _seconds(path: Path, heading: str, times: Array) -> tuple[Array, list[str]]:
    """The time in s. High-rate captures give whole numbers of nanoseconds, or of control cycles."""
    if heading.strip().lower() != "timestamps" or np.any(times % 1):
        return times, []
    step = float(np.median(np.diff(times)))
    if step >= NANOSECONDS_LEAST:
        return 1e-9 * (times - times[0]), [f"{path.name}: timestamps are taken as nanoseconds."]
    cycles = f"{path.name}: timestamps are taken as control cycles of {CONTROL_RATE:g} Hz."
    return (times - times[0]) / CONTROL_RATE, [cycles]


def read_table(path: Path, configuration: Path | None) -> HoldingCurrent:
    """The map of firmware 0.5: get_anticogging_value(i) for i = 0 ... 3599, N m, a JSON list or a line each.

    Value i was measured at i / 3600 of a turn, from one side only: half the friction is in the values' mean.
    """
    if configuration is None:
        raise StudyError(
            f"{path}: a map of torques: expected --drive-config FILE with motor.config.torque_constant"
        )
    settings = read_configuration(configuration, "0")
    K_t = settings.number(["motor.config.torque_constant"], "a torque constant above zero, N m/A")
    text = text_of(path, f"{MAP_CELLS} values of get_anticogging_value")
    try:
        values = np.array(json.loads(text) if text.lstrip().startswith("[") else text.split(), np.float64)
    except (TypeError, ValueError):
        raise StudyError(f"{path}: expected {MAP_CELLS} numbers, as a JSON list or one per line") from None
    if values.shape != (MAP_CELLS,) or not np.all(np.isfinite(values)):
        raise StudyError(f"{path}: {values.size} numbers: expected {MAP_CELLS} finite ones")
    return from_samples(values / K_t, K_t, str(path))


ODRIVE = Adapter(
    name="odrive",
    title="ODrive",
    reads=(
        Feature(
            "firmware 0.5: NPZ or CSV of a BulkCapture; headings time, axis0.encoder.pos_estimate, ...",
            Certainty.SOURCE,
        ),
        Feature(
            "firmware 0.6: NPZ or CSV of a high-rate capture; headings timestamps, axis0.pos_estimate, ...",
            Certainty.DRIVE,
        ),
        Feature("firmware 0.5: the map that get_anticogging_value returns, as a table", Certainty.SOURCE),
        Feature("odrivetool backup-config: motor and drive", Certainty.DRIVE),
    ),
    writes=(
        Feature(
            "identify --plan: a script that records the logs with ODrive's Python package",
            Certainty.DRIVE,
        ),
    ),
    recognise=recognise,
    read_logs=read_logs,
    read_table=read_table,
    write_script=write_script,
    law="Odrive",
    gains=lambda path: gains(read_configuration(path, "0")),
    refusal="firmware 0.5 allows reading its map, but not writing it; 0.6 documents neither; --to csv or "
    "--to c writes a table for code of your own",
)
