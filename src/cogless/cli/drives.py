"""`drives` lists the supported drives; `table` writes a table in a drive's own format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cogless.cli.options import output_option
from cogless.cli.printers import write_correction
from cogless.errors import StudyError

if TYPE_CHECKING:
    from cogless.drives.adapter import Adapter, TableFrame, TableText
    from cogless.drives.holding_current import HoldingCurrent

FLAWED_SHARE = 0.1  # share of the holding current's rms; a table that leaves more gets a warning


def drives() -> None:
    """List the supported drives: logs that cogless reads, tables that it writes, and how each is verified."""
    from cogless.drives.registry import ADAPTERS

    for adapter in ADAPTERS.values():
        print(f"{adapter.name}: {adapter.title}")
        for verb, features in (("reads", adapter.reads), ("writes", adapter.writes)):
            for feature in features:
                print(f"  {verb:<7}{feature.what} ({feature.certainty.value})")
        if adapter.refusal:
            print(f"  takes no table: {adapter.refusal}")


def table(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE",
            help="Folder that `cogless identify` wrote, or a stored map. With --from: the table of a drive.",
        ),
    ],
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="DRIVE",
            help="Drive for which to write the table, by its name in `cogless drives`. Required.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option(
            "File for the table. Without -o, the command describes the table, but does not write it.",
            "FILE",
            False,
        ),
    ] = None,
    from_: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="DRIVE",
            help="Drive from which the table in SOURCE comes, by its name in `cogless drives`.",
        ),
    ] = None,
    drive_config: Annotated[
        Path | None,
        typer.Option("--drive-config", metavar="FILE", help="Configuration file of the --from drive."),
    ] = None,
    shift: Annotated[
        str | None,
        typer.Option(
            "--shift",
            metavar="ANGLE",
            help="Mechanical angle that the --to drive shows where the angle in SOURCE is zero.",
        ),
    ] = None,
    reverse: Annotated[
        bool,
        typer.Option(
            "--reverse",
            help="For a --to drive that counts angle and current in the opposite direction to SOURCE. "
            "Needs --shift.",
        ),
    ] = False,
    current: Annotated[
        str | None,
        typer.Option(
            "--current",
            metavar="CURRENT",
            help="Only for printers: rms current of the motor, in A. cogless warns if the logs have another "
            "current.",
        ),
    ] = None,
    study: Annotated[
        Path | None,
        typer.Option(
            "--study",
            metavar="DIR",
            help="Also write into the folder DIR a study of the motor with the drive's own control law.",
        ),
    ] = None,
    encoder: Annotated[
        bool,
        typer.Option(
            "--encoder",
            help="Write a table against the angle error of the drive's encoder instead of a cogging table.",
        ),
    ] = False,
) -> None:
    """Write a cogging table in a drive's own format.

    Prints how much cogging remains because the drive rounds and interpolates the table, how to install and
    remove the table, and how to check its sign. `cogless drives` lists the tables that cogless writes.
    """
    from cogless.drives.adapter import TableFrame
    from cogless.drives.holding_current import residue
    from cogless.drives.registry import able_drives, adapter_named
    from cogless.files import check_replaceable

    if to is None:
        raise StudyError(f"--to: missing: expected one of {able_drives('--to')}")
    adapter = adapter_named(to, "--to")
    if output is not None:
        check_replaceable(output)
    if adapter.write_correction is not None:
        options = {
            "--from": from_,
            "--drive-config": drive_config,
            "--shift": shift,
            "--reverse": reverse or None,
            "--study": study,
            "--encoder": encoder or None,
        }
        option = next((name for name, value in options.items() if value is not None), None)
        if option is not None:
            raise StudyError(
                f"{option}: expected no such option with --to {to}: its table is over the electrical angle"
            )
        write_correction(adapter, source, current, output)
        return
    if current is not None:
        raise StudyError(
            f"--current: expected no such option with --to {to}: only the correction of a printer's motor "
            "depends on the current"
        )
    if encoder:
        if from_ is not None or shift is not None or reverse or study is not None:
            raise StudyError("--encoder: expected only --to and -o with this option")
        _write_encoder_table(source, adapter, output)
        return
    if adapter.write is None:
        raise StudyError(f"--to: {to}: takes no table: {adapter.refusal}")
    holding, frame = _source(source, from_, adapter, drive_config)
    if shift is not None:
        holding = holding.turned(-1 if reverse else 1, _angle(shift))
        frame = TableFrame(to, zero=True)
    elif reverse:
        raise StudyError("--reverse: expected --shift ANGLE, too: a reversed angle has another zero")
    if not frame.zero:
        raise StudyError(f"{source}: the rotor angle of the table's first entry is unknown: {frame.lacking}")
    written = adapter.write(holding, frame)
    rest = residue(holding, written.entries, written.applied)
    torque = f", {1e3 * holding.K_t * rest.before:.3g} mN*m" if holding.K_t else ""
    predicted, why_not = _predict(source, frame, written, adapter, study)
    lines = [
        *predicted,
        f"Holding current: {1e3 * rest.before:.4g} mA rms{torque}. Because of rounding and interpolation, "
        f"the table differs from it by {1e3 * rest.after:.3g} mA rms ({rest.share:.2%}), most of it in order "
        f"{rest.order} ({1e3 * rest.amplitude:.2g} mA).",
        *why_not,
        f"{adapter.title}: {written.entries} entries, {written.scale}.",
    ]
    if rest.share > FLAWED_SHARE:
        highest = max(holding.orders)
        lines.append(
            f"! SOURCE has orders up to {highest}: a table of {written.entries} entries holds "
            f"only orders below {written.entries // 2}."
        )
    if frame.zero_error:
        highest = max(holding.orders)
        lines.append(
            f"The mechanical angle of the table's first entry has an error of up to {frame.zero_error:.2g} "
            f"rad. This shifts the phase of order {highest}, the highest, by up to "
            f"{frame.zero_error * highest:.2g} rad."
        )
    _put(written, lines, output)


def _put(written: TableText, lines: Sequence[str], output: Path | None) -> None:
    """Print these lines and instructions for the user, and write the table if `output` is given."""
    from cogless.files import replacing

    for line in (*lines, *_instructions(written, output)):
        print(line)
    if output is not None:
        with replacing(output) as temporary:
            temporary.write_text(written.text, "utf-8")
        print(f"Table: {output}")
    else:
        print("No table was written: -o FILE writes one.")


def _write_encoder_table(source: Path, adapter: Adapter, output: Path | None) -> None:
    """Write the encoder's correction, which a folder of `cogless identify` holds, as the drive's table."""
    import math

    from cogless.drives.adapter import FRAME_FILE, frame_from
    from cogless.drives.encoder_table import correction_from
    from cogless.drives.holding_current import residue

    if adapter.write_encoder is None:
        raise StudyError(
            f"--encoder: {adapter.name}: expected a drive whose encoder table cogless writes: see "
            "cogless drives"
        )
    correction, frame = correction_from(source), frame_from(source / FRAME_FILE)
    if frame.drive != adapter.name or not frame.zero:
        lacking = frame.lacking or f"its logs are of {frame.drive}: expected logs of {adapter.name}"
        raise StudyError(f"{source}: the rotor angle of the table's first entry is unknown: {lacking}")
    written = adapter.write_encoder(correction, frame)
    rest = residue(correction, written.entries, written.applied)
    before, after = (math.degrees(value) for value in (rest.before, rest.after))
    _put(
        written,
        [
            f"Encoder's error: {before:.3g} deg rms. With the table, {after:.2g} deg rms remain, since its "
            "entries are rounded.",
            f"{adapter.title}, encoder {frame.encoder}: {written.entries} entries, {written.scale}.",
        ],
        output,
    )


def _predict(
    source: Path, frame: TableFrame, written: TableText, adapter: Adapter, study: Path | None
) -> tuple[list[str], list[str]]:
    """Two lists of lines: the ripple under the drive's own law, and why this ripple is not predicted.

    `study`: folder into which the simulated study is written.
    """
    from cogless.drives import predicted_ripple
    from cogless.results.folder import locked_folder, new_set

    lacking = ""
    if not adapter.law:
        lacking = f"cogless models no control law of {adapter.title}: expected another drive after --to"
    elif not (source / predicted_ripple.STUDY_NAME).is_file():
        lacking = (
            f"{source} has no {predicted_ripple.STUDY_NAME}, which cogless identify writes if the logs show "
            "the inertia: expected a folder that has it"
        )
    elif not frame.gains:
        lacking = (
            "the gains of the drive's law are unknown: expected identify with a --drive-config file that has "
            "them"
        )
    if study is not None and study.resolve() == source.resolve():
        lacking = "expected a folder other than that of cogless identify"
    if lacking:
        if study is not None:
            raise StudyError(f"--study: {study}: {lacking}")
        return [], [f"No ripple of the speed is predicted, since {lacking}."] if adapter.law else []
    tables = predicted_ripple.study_tables(source, frame, written, adapter.law)
    lines = []
    for ripple in predicted_ripple.ripples(tables, source / predicted_ripple.STUDY_NAME):
        texts = {name: f"{value:.3g}" for name, value in ripple.by_controller.items()}
        lines.append(
            f"Predicted ripple at {ripple.speed} rpm: {texts['without']} rpm rms without the table, "
            f"{texts['table']} with it. To check the sign: {texts['third']} with 30 % of the table, "
            f"{texts['turned-third']} with -30 %."
        )
    simulated = f"Simulated in forward direction under {adapter.title}'s own law"
    if study is None:
        return [
            *lines,
            f"{simulated}; --study DIR writes the simulated study, in which you can try gains.",
        ], []
    names = [predicted_ripple.STUDY_NAME, predicted_ripple.LAW_FILE.name]
    with locked_folder(study, names), new_set(study) as stage:
        predicted_ripple.write_study(stage, tables)
    return [*lines, f"{simulated}. Study: cogless run {study / predicted_ripple.STUDY_NAME}"], []


def _angle(text: str) -> float:
    """An angle of the command line, rad."""
    from cogless import units

    try:
        return units.parse(text, units.ANGLE)
    except units.UnitError as error:
        raise StudyError(f'--shift: "{text}": {error}') from None


def _source(
    source: Path, from_: str | None, target: Adapter, configuration: Path | None
) -> tuple[HoldingCurrent, TableFrame]:
    """The holding current that SOURCE holds, and how its angle relates to the index of the drive `target`."""
    from cogless.drives import holding_current
    from cogless.drives.adapter import FRAME_FILE, TableFrame, frame_from
    from cogless.drives.registry import adapter_named

    to = target.name
    logs = "" if target.read_logs is None else f"logs of {to}, or "
    shift = f"{logs}--shift ANGLE, the angle of {to}'s encoder where the source's angle is zero"
    unknown = f"SOURCE does not say where its angle is zero on {to}'s encoder: expected {shift}"
    if from_ is not None:
        adapter = adapter_named(from_, "--from")
        if adapter.read_table is None:
            raise StudyError(
                f"--from: {from_}: expected a drive whose table cogless reads: see cogless drives"
            )
        current = adapter.read_table(source, configuration)
        return current, TableFrame(to, zero=to == from_ or target.own_angle, lacking=unknown)
    if not source.exists():
        raise StudyError(
            f"{source}: no such file or folder: expected a folder of cogless identify, or a stored map"
        )
    if not source.is_dir():
        return holding_current.from_stored_map(source), TableFrame(to, zero=target.own_angle, lacking=unknown)
    current = holding_current.from_identified(source)
    if target.own_angle or target.read_logs is None:
        return current, TableFrame(to, zero=target.own_angle, lacking=unknown)
    if not (source / FRAME_FILE).is_file():
        return current, TableFrame(
            to, lacking=f"the folder has no {FRAME_FILE}: expected a folder of cogless identify --drive {to}"
        )
    frame = frame_from(source / FRAME_FILE)
    if frame.drive != to:
        has_table = adapter_named(frame.drive, "--to").write is not None
        own = f"--to {frame.drive}, " if has_table else ""
        lacking = f"its logs are of {frame.drive}: expected {own}{shift}"
        return current, TableFrame(to, lacking=lacking)
    return current, frame


def _instructions(written: TableText, output: Path | None) -> list[str]:
    file = str(output) if output is not None else "FILE"
    return [
        f"Install: {written.install.replace('FILE', file)}",
        f"Check the sign: {written.sign_check}.",
        f"Remove: {written.remove}",
        *written.notes,
    ]
