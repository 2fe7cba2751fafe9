"""`drives` and `table`: what is read and written for drives that people own."""

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

FLAWED_SHARE = 0.1  # of the holding current's rms: a table that leaves more is told


def drives() -> None:
    """List the drives whose logs cogless reads and whose cogging tables it writes, and how sure that is."""
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
            help="A folder of cogless identify, a stored map, or with --from a drive's table.",
        ),
    ],
    to: Annotated[
        str | None, typer.Option("--to", metavar="DRIVE", help="Write for this drive.", show_default=False)
    ] = None,
    output: Annotated[
        Path | None,
        output_option("File for the table. Without -o nothing is written, only described.", "FILE", False),
    ] = None,
    from_: Annotated[
        str | None, typer.Option("--from", metavar="DRIVE", help="SOURCE is a table of this drive.")
    ] = None,
    drive_config: Annotated[
        Path | None,
        typer.Option("--drive-config", metavar="FILE", help="Configuration file of the drive of --from."),
    ] = None,
    shift: Annotated[
        str | None,
        typer.Option(
            "--shift",
            metavar="ANGLE",
            help="Angle of the new drive's index where SOURCE's is zero, mechanical.",
        ),
    ] = None,
    reverse: Annotated[
        bool, typer.Option("--reverse", help="Angle and current of the new drive count the other way.")
    ] = False,
    current: Annotated[
        str | None,
        typer.Option(
            "--current",
            metavar="CURRENT",
            help="Current of a printer's motor, A rms; warns if the runs had another.",
        ),
    ] = None,
    study: Annotated[
        Path | None,
        typer.Option(
            "--study", metavar="DIR", help="Also write a study of the motor under the drive's own law there."
        ),
    ] = None,
    encoder: Annotated[
        bool,
        typer.Option("--encoder", help="Write the table that corrects the drive's encoder, not the cogging."),
    ] = False,
) -> None:
    """Write a cogging table in a drive's own format.

    Says what the drive's own interpolation and rounding leave of the cogging, how to install the table and to
    take it out, and how to check its sign. `cogless drives` lists what each drive takes.
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
        other = next((name for name, value in options.items() if value is not None), None)
        if other is not None:
            raise StudyError(
                f"{other}: expected none with --to {to}: a correction is over the electrical angle"
            )
        write_correction(adapter, source, current, output)
        return
    if current is not None:
        raise StudyError(
            f"--current: expected none with --to {to}: its table is a current over the rotor's angle"
        )
    if encoder:
        if from_ is not None or shift is not None or reverse or study is not None:
            raise StudyError("--encoder: expected only SOURCE, --to and -o beside it")
        _write_encoder_table(source, adapter, output)
        return
    if adapter.write is None:
        raise StudyError(f"--to: {to}: takes no table: {adapter.refusal}")
    holding, frame = _source(source, from_, adapter, drive_config)
    if shift is not None:
        holding = holding.turned(-1 if reverse else 1, _angle(shift))
        frame = TableFrame(to, zero=True)
    elif reverse:
        raise StudyError(
            "--reverse: expected --shift ANGLE beside it: the zero of a reversed angle is another"
        )
    if not frame.zero:
        raise StudyError(f"{source}: the table's zero is not known, since {frame.lacking}")
    written = adapter.write(holding, frame)
    rest = residue(holding, written.entries, written.applied)
    torque = f", {1e3 * holding.K_t * rest.before:.3g} mN*m" if holding.K_t else ""
    predicted, why_not = _predict(source, frame, written, adapter, study)
    lines = [
        *predicted,
        f"Holding current: {1e3 * rest.before:.4g} -> {1e3 * rest.after:.3g} mA rms{torque}; rounding and "
        f"interpolation leave {rest.share:.2%}, most of it order {rest.order}, "
        f"{1e3 * rest.amplitude:.2g} mA.",
        *why_not,
        f"{adapter.title}: {written.entries} entries, {written.scale}.",
    ]
    if rest.share > FLAWED_SHARE:
        highest = max(holding.orders)
        lines.append(
            f"! The orders reach {highest}: {written.entries} entries hold those below "
            f"{written.entries // 2}."
        )
    if frame.zero_error:
        highest = max(holding.orders)
        lines.append(f"The table's zero is known to {frame.zero_error * highest:.2g} rad of order {highest}.")
    _put(written, lines, output)


def _put(written: TableText, lines: Sequence[str], output: Path | None) -> None:
    """Print lines and what the user does with the table, and write it."""
    from cogless.files import replacing

    for line in (*lines, *_instructions(written, output)):
        print(line)
    if output is not None:
        with replacing(output) as temporary:
            temporary.write_text(written.text, "utf-8")
        print(f"Table: {output}")
    else:
        print("No table is written: -o FILE writes it.")


def _write_encoder_table(source: Path, adapter: Adapter, output: Path | None) -> None:
    """The correction of the encoder that a folder of identify tells."""
    import math

    from cogless.drives.adapter import FRAME_FILE, frame_from
    from cogless.drives.encoder_table import correction_from
    from cogless.drives.holding_current import residue

    if adapter.write_encoder is None:
        raise StudyError(f"--encoder: {adapter.name}: no table of its encoder is written: see cogless drives")
    correction, frame = correction_from(source), frame_from(source / FRAME_FILE)
    if frame.drive != adapter.name or not frame.zero:
        lacking = frame.lacking or f"its logs are of {frame.drive}: expected some of {adapter.name}"
        raise StudyError(f"{source}: the table's zero is not known, since {lacking}")
    written = adapter.write_encoder(correction, frame)
    rest = residue(correction, written.entries, written.applied)
    before, after = (math.degrees(value) for value in (rest.before, rest.after))
    _put(
        written,
        [
            f"Encoder's error: {before:.3g} -> {after:.2g} deg rms, which the table's own rounding leaves.",
            f"{adapter.title}, encoder {frame.encoder}: {written.entries} entries, {written.scale}.",
        ],
        output,
    )


def _predict(
    source: Path, frame: TableFrame, written: TableText, adapter: Adapter, study: Path | None
) -> tuple[list[str], list[str]]:
    """Lines on the ripple under the drive's own law, or on why it is not predicted.

    `study`: where the study of it is written.
    """
    from cogless.drives import predicted_ripple
    from cogless.results.folder import locked_folder, new_set

    lacking = ""
    if not adapter.law:
        lacking = f"{adapter.title} has no law of a drive's own: expected --to of a drive that has one"
    elif not (source / predicted_ripple.STUDY_NAME).is_file():
        lacking = f"it has no {predicted_ripple.STUDY_NAME}: expected a folder of cogless identify with it"
    elif not frame.gains:
        lacking = "the logs came without the gains of its law: expected them in the file of --drive-config"
    if study is not None and study.resolve() == source.resolve():
        lacking = "expected another folder than that of cogless identify"
    if lacking:
        if study is not None:
            raise StudyError(f"--study: {study}: {lacking}")
        return [], [f"No ripple of the speed is predicted, since {lacking}."] if adapter.law else []
    tables = predicted_ripple.study_tables(source, frame, written, adapter.law)
    lines = []
    for ripple in predicted_ripple.ripples(tables, source / predicted_ripple.STUDY_NAME):
        texts = {name: f"{value:.3g}" for name, value in ripple.by_controller.items()}
        lines.append(
            f"Ripple at {ripple.speed} r/min: {texts['without']} -> {texts['table']} r/min rms with the "
            f"table; {texts['third']} with 30 % of it, {texts['turned-third']} with -30 %."
        )
    simulated = f"Simulated forward, under {adapter.title}'s own law"
    if study is None:
        return [
            *lines,
            f"{simulated}; --study DIR writes the study that does it, with which to try gains.",
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
    """The current, and how its angle lies to the index of the drive that it is written for."""
    from cogless.drives import holding_current
    from cogless.drives.adapter import FRAME_FILE, TableFrame, frame_from
    from cogless.drives.registry import adapter_named

    to = target.name
    logs = "" if target.read_logs is None else f"logs of {to}, or "
    shift = f"{logs}--shift ANGLE, the index of {to} where the source's angle is zero"
    unknown = f"it is over another angle: expected {shift}"
    if from_ is not None:
        adapter = adapter_named(from_, "--from")
        if adapter.read_table is None:
            raise StudyError(f"--from: {from_}: no table of it can be read: see cogless drives")
        current = adapter.read_table(source, configuration)
        return current, TableFrame(to, zero=to == from_ or target.own_angle, lacking=unknown)
    if not source.exists():
        raise StudyError(f"{source}: no such file or folder: expected a folder of cogless identify, or a map")
    if not source.is_dir():
        return holding_current.from_stored_map(source), TableFrame(to, zero=target.own_angle, lacking=unknown)
    current = holding_current.from_identified(source)
    if target.own_angle or target.read_logs is None:
        return current, TableFrame(to, zero=target.own_angle, lacking=unknown)
    if not (source / FRAME_FILE).is_file():
        return current, TableFrame(
            to, lacking=f"it has no {FRAME_FILE}: expected cogless identify with --drive {to}"
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
        f"Take out: {written.remove}",
        *written.notes,
    ]
