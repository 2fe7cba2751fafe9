"""Klipper: ramps of an axis, as a macro makes them and ACCELEROMETER_MEASURE records them.

Read in its source (Klipper3d/klipper, klippy/extras/adxl345.py at 0512a7c): a CSV of the
printer's clock, s, and accelerations, mm/s^2. The planner has the same clock. The log does not say when the
move begins, since the planner waits for its buffer. So the start is found from the acceleration.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cogless.drives.adapter import Adapter, Certainty, Feature, text_of
from cogless.errors import StudyError
from cogless.printer import ramps
from cogless.printer.axis import Axis
from cogless.printer.corrections import Correction, Lines
from cogless.printer.moves import ramp
from cogless.printer.records import DIRECTIONS, Direction, Numbers, Orders, Run, check_saturation, probe

HEADING = "#time,accel_x,accel_y,accel_z"
KLIPPER_LOG = "the CSV of ACCELEROMETER_MEASURE"
RUN_NAME = re.compile(r"cogless-(x|y)-(forward|backward)-(plain|probe)-(\d+)")
RAMP_REPEATS = 3
DWELL_TIME = 500  # ms of rest before and after a move
RATE_LEAST = 800.0  # Hz
WAY_SHARE_LEAST = 0.5  # way / travel, from which on a log shows its direction
GAP_MOST = 20.0  # sampling periods without a sample, at most


def read_samples(path: Path, direction: tuple[float, float]) -> tuple[Numbers, Numbers]:
    """Times, s, and the acceleration along a direction in x and y, m/s^2. StudyError: an unusable log."""
    lines = text_of(path, KLIPPER_LOG).rstrip().splitlines()
    if not lines or lines[0].replace(" ", "") != HEADING:
        raise StudyError(f'{path}: its first line is not "{HEADING}": expected {KLIPPER_LOG}')
    rows = []
    for number, line in enumerate(lines[1:], 2):
        cells = line.split(",")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) != 4 and number == len(lines):
            raise StudyError(
                f"{path}: line {number}: the file is cut here: expected the whole file (Klipper still writes "
                "it after the macro has ended)"
            )
        if len(row) != 4 or not np.all(np.isfinite(row)):
            raise StudyError(f"{path}: line {number}: expected four finite numbers, as in {KLIPPER_LOG}")
        rows.append(row)
    if len(rows) < 2:
        raise StudyError(f"{path}: {len(rows)} samples: expected {KLIPPER_LOG}")
    table = np.array(rows)
    times = table[:, 0]
    steps = np.diff(times)
    if np.any(steps <= 0):
        raise StudyError(
            f"{path}: line {int(np.argmax(steps <= 0)) + 3}: the time does not grow: "
            "expected the rows of one log"
        )
    rate = 1 / float(np.median(steps))
    if rate < RATE_LEAST:
        raise StudyError(
            f"{path}: {rate:.0f} samples a second: expected {RATE_LEAST:.0f} or more; raise the sensor's rate"
        )
    if np.max(steps) > GAP_MOST / rate:
        k = int(np.argmax(steps))
        raise StudyError(
            f"{path}: line {k + 3}: {1e3 * steps[k]:.0f} ms without a sample: expected a log without gaps"
        )
    for axis, values in (("accel_x", table[:, 1]), ("accel_y", table[:, 2])):
        check_saturation(f"{path}: {axis}", 1e-3 * values)
    return times, 1e-3 * (direction[0] * table[:, 1] + direction[1] * table[:, 2])


def log_name(motor: str, direction: str, kind: str, number: int) -> str:
    """The name under which the macro records a run, as RUN_NAME reads it."""
    return f"cogless-{motor}-{direction}-{kind}-{number}"


def log_text(times: Numbers, acceleration: Numbers) -> str:
    """The CSV of ACCELEROMETER_MEASURE. `times`: s; `acceleration`: m/s^2, columns of x, y and z."""
    rows = np.column_stack([times, 1e3 * acceleration]).tolist()
    return "\n".join([HEADING, *("{:.6f},{:.6f},{:.6f},{:.6f}".format(*row) for row in rows)]) + "\n"


def read_runs(paths: Sequence[Path], axis: Axis) -> dict[tuple[Direction, int], dict[str, Run]]:
    """Runs without and with the probe, by direction and number. StudyError: a log that can't be used."""
    runs: dict[tuple[Direction, int], dict[str, Run]] = {}
    for path in paths:
        name = RUN_NAME.search(path.name)
        if name is None:
            raise StudyError(
                f"{path}: the file's name does not say which run it holds: expected a name with "
                f"cogless-{axis.motor}-forward-plain-1, as --plan writes it"
            )
        if name[1] != axis.motor:
            raise StudyError(f"{path}: a run of motor {name[1]}: expected a run of motor {axis.motor}")
        times, acceleration = read_samples(path, axis.direction)
        direction: Direction = "forward" if name[2] == "forward" else "backward"
        correction = probe() if name[3] == "probe" else {}
        pair = runs.setdefault((direction, int(name[4])), {})
        pair[name[3]] = Run(path.name, direction, times, acceleration, correction)
    return runs


def identify_runs(paths: Sequence[Path], axis: Axis) -> Correction:
    """The correction of ramps in both directions. StudyError: a run is missing, or a log can't be used."""
    runs = read_runs(paths, axis)
    lines: dict[Direction, Lines] = {}
    chosen: dict[Direction, list[dict[str, Run]]] = {}
    for direction in DIRECTIONS:
        pairs = [pair for (name, _), pair in sorted(runs.items()) if name == direction]
        if not pairs:
            raise StudyError(
                f"{paths[0].parent}: no {direction} run: expected runs in both directions, since "
                "friction makes the corrections of the two directions differ"
            )
        for pair in pairs:
            lacking = next((kind for kind in ("plain", "probe") if kind not in pair), None)
            if lacking is not None:
                other = next(iter(pair.values())).name
                raise StudyError(
                    f"{paths[0].parent}: {other}: its second log is missing: expected a file of the same "
                    f'name, but with "{lacking}"'
                )
        chosen[direction] = pairs
    for direction, pairs in chosen.items():
        lines[direction] = ramps.identify_ramps(axis, [(pair["plain"], pair["probe"]) for pair in pairs])
    _check_ways([chosen[direction][0]["plain"] for direction in DIRECTIONS], axis)
    return Correction.from_lines(axis, lines)


def _check_ways(runs: Sequence[Run], axis: Axis) -> None:
    """StudyError: both runs go the same way. A sensor may be mounted either way, so one run is no test."""
    ways = [ramps.displacement(run) for run in runs]
    if min(map(abs, ways)) > WAY_SHARE_LEAST * axis.travel and ways[0] * ways[1] > 0:
        raise StudyError(
            f"{runs[1].name}: the carriage goes the same way as in {runs[0].name}: expected a run in each "
            "direction, as --plan writes them"
        )


def correction_words(correction: Orders) -> str:
    """Orders as SET_PHASE_CORRECTION takes them: ORDER:MAGNITUDE:PHASE, rad, with commas between."""
    return ",".join(f"{n}:{abs(c):.6f}:{np.angle(c):.6f}" for n, c in sorted(correction.items())) or "0:0:0"


def write_runs(axis: Axis) -> Mapping[str, str]:
    """A macro that makes the logs of an axis."""
    move = ramp(axis)
    start = (1e3 * axis.start_x, 1e3 * axis.start_y)
    end = tuple(s + 1e3 * move.length * d for s, d in zip(start, axis.direction, strict=True))
    stepper, feed = f"stepper_{axis.motor}", 6e4 * move.speed
    limits = "printer.configfile.settings.printer"
    body = [
        f"SET_VELOCITY_LIMIT VELOCITY={1e3 * move.speed:.3f} ACCEL={1e3 * move.acceleration:.3f} "
        "MINIMUM_CRUISE_RATIO=0",
        "SET_INPUT_SHAPER SHAPER_FREQ_X=0 SHAPER_FREQ_Y=0",
        "G90",
    ]
    for number in range(1, RAMP_REPEATS + 1):
        for direction in DIRECTIONS:
            first, last = (start, end) if direction == "forward" else (end, start)
            for kind, correction in (("plain", {}), ("probe", probe())):
                words = correction_words(correction)
                body += [
                    f"SET_PHASE_CORRECTION STEPPER={stepper} FORWARD={words} BACKWARD={words}",
                    f"G1 X{first[0]:.4f} Y{first[1]:.4f} F{feed:.1f}",
                    "M400",
                    f"G4 P{DWELL_TIME}",
                    "ACCELEROMETER_MEASURE",
                    f"G4 P{DWELL_TIME}",
                    f"G1 X{last[0]:.4f} Y{last[1]:.4f} F{feed:.1f}",
                    f"G4 P{DWELL_TIME}",
                    f"ACCELEROMETER_MEASURE NAME={log_name(axis.motor, direction, kind, number)}",
                ]
    body += [
        f"SET_PHASE_CORRECTION STEPPER={stepper} FORWARD=0:0:0 BACKWARD=0:0:0",
        f"SET_VELOCITY_LIMIT VELOCITY={{{limits}.max_velocity}} ACCEL={{{limits}.max_accel}}",
        "M400",
        'RESPOND MSG="cogless: done; RESTART puts input shaper and limits back"',
    ]
    top = [
        "# Home the printer, then run COGLESS_RAMPS. The logs are /tmp/*cogless-*.csv.",
        "# SET_PHASE_CORRECTION is the command of a module that corrects the step times. Klipper itself has",
        "# no such module. FORWARD and BACKWARD are lists of waves: ORDER:MAGNITUDE:PHASE,ORDER:..., in rad.",
        f"[gcode_macro COGLESS_RAMPS_{axis.motor.upper()}]",
        "gcode:",
    ]
    return {"cogless_ramps.cfg": "\n".join([*top, *(f"    {line}" for line in body)]) + "\n"}


KLIPPER = Adapter(
    name="klipper",
    title="Klipper",
    reads=(
        Feature(
            "logs of ACCELEROMETER_MEASURE (CSV) during speed ramps of an axis, to correct its step motor",
            Certainty.SOURCE,
        ),
    ),
    writes=(),
    identify_runs=identify_runs,
    write_runs=write_runs,
    refusal="Klipper has no correction of its own; --to tmc5160 and others write the wave table of its "
    "driver",
)
