"""Commands for a printer's axis: plan its runs, find and export its correction, explain stripes."""

from __future__ import annotations

import cmath
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cogless.cli.terminal import program
from cogless.errors import StudyError
from cogless.lines import print_text, warn

if TYPE_CHECKING:
    from cogless.drives.adapter import Adapter
    from cogless.printer.corrections import Correction
    from cogless.units import Dimension

REPORT_FILE = "report.html"


def printer_adapter(drive: str | None) -> Adapter | None:
    """The adapter of the printer's firmware `drive`; None if `drive` is None or is no printer's firmware."""
    from cogless.drives.registry import ADAPTERS

    adapter = ADAPTERS.get(drive or "")
    return adapter if adapter is not None and adapter.identify_runs is not None else None


def plan_runs(adapter: Adapter, file: Path, output: Path) -> None:
    """Write the files with which a printer runs an axis, and print what to do with them."""
    from cogless.printer.axis import read_axis
    from cogless.results.folder import locked_folder, new_set

    assert adapter.write_runs is not None
    axis = read_axis(file)
    try:
        files = adapter.write_runs(axis)
    except StudyError as error:
        raise StudyError(f"{file}: {error}") from None
    with locked_folder(output, files), new_set(output) as stage:
        for name, text in files.items():
            (stage / name).write_text(text, "utf-8")
    print(f"File of the runs: {output / next(iter(files))}. Its first lines say how to start it.")
    words = ["identify", "--drive", adapter.name, "--drive-config", str(file)]
    print(f"Next: {program()} {shlex.join(words)} LOG...")


def identify_axis(adapter: Adapter, logs: list[Path], file: Path | None, output: Path) -> None:
    """Find an axis's correction in the logs of its runs, print it and write it."""
    from cogless.printer.axis import read_axis
    from cogless.printer.corrections import CORRECTION_FILE
    from cogless.report.carriage import write_report
    from cogless.results.folder import locked_folder, new_set

    assert adapter.identify_runs is not None
    if file is None:
        raise StudyError(
            f"--drive {adapter.name}: expected --drive-config FILE with a table [printer] of "
            "motor, step_angle, pulley_teeth, current, travel, start_x, start_y"
        )
    with locked_folder(output, [CORRECTION_FILE, REPORT_FILE]):
        correction = adapter.identify_runs(logs, read_axis(file))
        lines = correction_lines(correction)
        with new_set(output) as stage:
            (stage / CORRECTION_FILE).write_text(correction.to_json(), "utf-8")
            write_report(correction, lines, stage / REPORT_FILE)
    for line in lines:
        print_text(line, others="  ")
    print(f"\nCorrection: {output / CORRECTION_FILE}")
    print(f"Report: {output / REPORT_FILE}")
    print(f"For a study's law microstepping: {study_line(output / CORRECTION_FILE)}")
    target = "prusa" if adapter.write_correction is not None else "tmc5160"
    print(f"Next: {program()} {shlex.join(['table', str(output), '--to', target])} -o FILE")


def study_line(path: Path) -> str:
    """The TOML line that gives a file's correction to a controller of a study in any folder."""
    from cogless.study.toml import toml

    return f"correction = {toml({'file': str(path.resolve())})}"


def correction_lines(correction: Correction) -> list[str]:
    """Lines on the motor, on each order of the correction in each direction, on friction, and remarks."""
    lines = [
        f"Motor {correction.motor} at {correction.current:.4g} A rms. A correction adds to the electrical "
        "angle u a term A sin(n u + phase) for each order n. A line gives an order's A and phase, and the "
        "ripple without the correction."
    ]
    for direction, entries in correction.directions.items():
        for n, entry in sorted(entries.items()):
            size = abs(entry.value)
            way = 1e6 * size * correction.wavelength / math.tau
            doubt = "" if entry.error < size else ", smaller than its error"
            lines.append(
                f"{direction:<8} order {n}: {size:.4f} rad (+-{entry.error:.4f}), phase "
                f"{cmath.phase(entry.value):+.3f} rad; at a slow speed the carriage swings by "
                f"+-{way:.2f} um: a stripe every {1e3 * correction.wavelength / n:.3g} mm{doubt}"
            )
    friction = correction.friction()
    if friction is not None:
        torque = "" if friction.torque is None else f"{1e3 * friction.torque:.3g} mN*m; "
        lines.append(
            f"Friction, if order 4 comes from the detent alone: {torque}it holds the rotor back by "
            f"{friction.angle:.3f} rad electrical (+-{friction.error:.3f})."
        )
    return [*lines, *correction.remarks]


def write_correction(adapter: Adapter, source: Path, current: str | None, output: Path | None) -> None:
    """Write a correction in a firmware's own format, after printing what that format can hold.

    `current`: current of the user's motor, compared with that of the logs. `output` None: nothing is written.
    """
    from cogless import units
    from cogless.files import replacing
    from cogless.printer.corrections import read_correction
    from cogless.study.laws.microstepping import wrong_current

    assert adapter.write_correction is not None
    correction = read_correction(source)
    try:
        written = adapter.write_correction(correction)
    except StudyError as error:
        raise StudyError(f"{source}: {error}") from None
    print(f"{adapter.title}, motor {correction.motor}.")
    for line in written.holds:
        print_text(line, others="  ")
    if current is not None:
        other = _quantity("--current", current, units.CURRENT)
        text = wrong_current(correction.current, other)
        if text:
            warn(f"{text}; record the runs at that current")
    file = str(output) if output is not None else "FILE"
    print(f"Current: {correction.current:.4g} A rms; another current needs its own runs.")
    print(f"Install: {written.install.replace('FILE', file)}")
    print(f"Remove: {written.remove}")
    if output is not None:
        with replacing(output) as temporary:
            temporary.write_text(written.text, "utf-8")
        print(f"Table: {output}")


def _quantity(option: str, text: str, dimension: Dimension) -> float:
    """The value of an option, in SI units and above zero. A plain number has the unit that messages show."""
    from cogless import units

    unit = dimension.example or dimension.unit
    try:
        value = units.parse(text if units.unit_of(text) else f"{text} {unit}", dimension)
    except units.UnitError as error:
        raise StudyError(f'{option}: "{text}": {error}') from None
    if not value > 0:
        raise StudyError(
            f'{option}: "{text}": expected {dimension.name} above zero, such as {dimension.sample(1)}'
        )
    return value


def _option(name: str, metavar: str, help: str) -> Any:
    return typer.Option(name, metavar=metavar, help=help, show_default=False)


def stripe(
    spacing: Annotated[str, _option("--spacing", "LENGTH", "Distance from one stripe to the next, in mm.")],
    speed: Annotated[str, _option("--speed", "SPEED", "Print speed of the wall, in mm/s.")],
    pulley: Annotated[
        int, typer.Option("--pulley", min=4, metavar="TEETH", help="Number of teeth of the motor's pulley.")
    ] = 20,
    step_angle: Annotated[
        str,
        typer.Option("--step-angle", metavar="ANGLE", help="Angle of a full step of the motor, in degrees."),
    ] = "1.8",
    belt_pitch: Annotated[
        str, typer.Option("--belt-pitch", metavar="LENGTH", help="Length of the belt per tooth, in mm.")
    ] = "2",
    diagonal: Annotated[
        bool,
        typer.Option(
            "--diagonal",
            help="The wall is along a diagonal of a CoreXY printer, where only one motor moves.",
        ),
    ] = False,
) -> None:
    """Name the cause of stripes on a print: an order of the motor, a belt tooth, the pulley, or ringing."""
    from cogless import units
    from cogless.printer.axis import CARRIAGE_SPEED
    from cogless.printer.stripe import stripe_causes
    from cogless.study.motor import teeth_of

    angle = _quantity("--step-angle", step_angle, units.ANGLE)
    if not teeth_of(angle):
        raise StudyError(
            f'--step-angle: "{step_angle}": expected 360 deg divided by four times the number of teeth, such '
            'as "1.8 deg"'
        )
    length, velocity = (
        _quantity("--spacing", spacing, units.LENGTH),
        _quantity("--speed", speed, CARRIAGE_SPEED),
    )
    causes = stripe_causes(
        length,
        velocity,
        pulley_teeth=pulley,
        step_angle=angle,
        belt_pitch=_quantity("--belt-pitch", belt_pitch, units.LENGTH),
        diagonal=diagonal,
    )
    print(f"A stripe every {1e3 * length:.3g} mm at {1e3 * velocity:.3g} mm/s: {velocity / length:.0f} Hz.")
    for cause in causes:
        place = "" if cause.kind == "ringing" else f" ({1e3 * cause.spacing:.3g} mm)"
        print_text(f"{cause.line[0].upper()}{cause.line[1:]}{place}.", others="  ")
    if not causes:
        print("No cause fits: no order of the motor, belt tooth, pulley, or ringing between 15 and 400 Hz.")
    if len(causes) > 1:
        print(
            "Print the part at half the speed. If the spacing stays, the cause is the motor or the belt; "
            "if it halves, the cause is ringing."
        )
