"""The files of an export, as texts by name."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from cogless.export.c.board import board
from cogless.export.c.edge_cases import Stretch
from cogless.export.c.extras import extras, parts
from cogless.export.c.literals import array, initialiser, real
from cogless.export.c.motion import motion
from cogless.export.c.names import stem
from cogless.export.c.self_test import self_test_words
from cogless.export.c.subject import Subject, study_hash
from cogless.export.prepared import Reals, Recording
from cogless.files import versions

FLAGS = "-std=c99 -O2 -ffp-contract=off"
LEARNING = "frozen while `reference.learn` is false, and whenever the controller finds a reason"


def texts(
    subject: Subject, recording: Recording, memory: Reals, stretches: Sequence[Stretch]
) -> dict[str, str]:
    """Text of each file of an export, by name, except files of the control library.

    `memory`: contents of the law's memory at the start.
    """
    words = _words(subject)
    words |= self_test_words(subject, recording, memory, stretches) | {"ticks": str(len(recording.outputs))}
    names = {f"{stem(subject.name)}.h": "controller.h", f"{stem(subject.name)}.c": "controller.c"}
    same = ("self_test.c", "self_test_data.h", "example_interrupt.c", "README.md")
    return {name: _filled(names.get(name, name), words) for name in (*names, *same)}


def controller_texts(subject: Subject) -> dict[str, str]:
    """Texts of the controller's header and source alone, by file name, to compile with the whole library."""
    words = _words(subject) | {"macro_checks": _precision_check(subject.precision == "d")}
    return {f"{stem(subject.name)}{end}": _filled(f"controller{end}", words) for end in (".h", ".c")}


def _filled(asset: str, words: dict[str, str]) -> str:
    template = files("cogless.export").joinpath("assets", "c", asset).read_text(encoding="utf-8")
    return Template(template).substitute(words)


def _words(subject: Subject) -> dict[str, str]:
    s, name = subject, subject.name
    double = s.precision == "d"
    rate = str(s.rate)
    entries = s.law.entries(s.law_config)
    state = s.law.state
    period = "" if s.law.name == "trial" else ", &controller->drive.loop"
    length = f"{name.upper()}_MEMORY_LENGTH"
    memory = f", controller->memory, {length}" if entries else ""
    own = {"learning_matrix": f"{name}_learning_matrix"} if s.learning_matrix is not None else {}
    return {
        "name": name,
        "stem": stem(name),
        "NAME": name.upper(),
        "pad": " " * len(name),
        "controller": s.controller,
        "scenario": s.scenario,
        "study": s.study.name,
        "title": plain_comment(s.study.title).rstrip("."),
        "title_comment": textwrap.fill(
            plain_comment(s.study.title), 118, initial_indent=" * ", subsequent_indent=" * "
        ),
        "hash": study_hash(s.study),
        "version": versions()["cogless"],
        "command": s.command,
        "law": str(getattr(s.study.controller[s.controller], "law", s.law.name)),
        "precision": "double: define COGLESS_DOUBLE for every file" if double else "single",
        "macro_checks": "\n".join([_precision_check(double), *map(_left_out_check, s.left_out)]),
        "defines": "".join(f", `-D{name}`" for name in s.defines),
        "flags": " ".join([FLAGS, *(f"-D{name}" for name in s.defines)]),
        "rate": rate,
        "law_rate": f"{s.rate / s.divider:g}",
        "period": real(1 / s.rate, s.precision),
        "divider": str(s.divider),
        "law_header": s.law.header,
        "law_state": s.law.state,
        "law_config": s.law.config,
        "law_step": s.law.step,
        "law_values": initialiser(s.headers, s.law.config, s.law_config | own, s.precision),
        "drive_config": initialiser(s.headers, "cgl_drive_config", s.drive_config, s.precision),
        "init_call": f"{state}_init(&controller->law, &{name}_law_config{period}{memory})",
        "reset_call": f"{state}_reset(&controller->law)",
        "learning": LEARNING if entries else "none",
        "reset_comment": _reset_comment(s),
        "memory_define": f"#define {length} {entries} /* numbers */\n" if entries else "",
        "memory_member": f"    cgl_real memory[{length}]; /* what is learned */\n" if entries else "",
        "memory_text": f"{s.memory_length} numbers, within `{name}_controller`" if entries else "none",
        "matrix": matrix_array(name, s.learning_matrix, s.precision),
        "verdict_row": f"| what `cogless design` says of it | {s.verdict} |\n" if s.verdict else "",
        "verdict_comment": verdict_comment(s.verdict),
        "figures": figure_lines(s.figures),
        **board(s),
        **extras(s),
        **parts(s),
        **motion(s),
    }


def verdict_comment(verdict: str) -> str:
    """What `cogless design` says of learning, as lines of the header's comment; empty without learning."""
    start, indent = " * learning         ", " *                  "
    said = textwrap.fill(plain_comment(verdict), 118, initial_indent=start, subsequent_indent=indent)
    return f"{said}\n" if verdict else ""


def plain_comment(text: str) -> str:
    """The text made safe for a C comment."""
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")


def _precision_check(double: bool) -> str:
    condition, expected = ("#ifndef", "with") if double else ("#ifdef", "without")
    kind = "double" if double else "single"
    return (
        f'{condition} COGLESS_DOUBLE\n#error "the study computes in {kind} precision: compile every file '
        f'{expected} COGLESS_DOUBLE"\n#endif'
    )


def _left_out_check(macro: str) -> str:
    return (
        f"#ifndef {macro}\n"
        f'#error "files of the library are left out here: compile every file with {macro}"\n#endif'
    )


def _reset_comment(subject: Subject) -> str:
    if subject.law.cells is None:
        return "As after init."
    if subject.law.name == "anti-cogging":
        return "As after init, but the table stays."
    return "As after init: forgets what was learned, too."


def matrix_array(name: str, matrix: Reals | None, precision: str) -> str:
    if matrix is None:
        return ""
    numbers = array(matrix.ravel(), precision)
    return f"\nstatic const cgl_real {name}_learning_matrix[] = {{\n{numbers}\n}};\n"


def figure_lines(figures: list[tuple[str, str]]) -> str:
    lines = []
    for name, value in figures:
        lines += textwrap.wrap(f" * {name} = {plain_comment(value)}", 118, subsequent_indent=" *     ")
    return "\n".join(lines)
