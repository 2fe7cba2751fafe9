"""Texts of an export's files: the templates, filled with a controller's data.

Among them are the texts of README and example on what the user's board must measure, do and store.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from importlib.resources import files
from string import Template

from cogless.c_literals import array, initialiser, real
from cogless.export.c.parts import HEADERS, corner, extras, motion, parts, sensor
from cogless.export.c.self_test import Stretch, self_test_words
from cogless.export.c.subject import Subject, identifier, stem, study_hash
from cogless.export.prepared import Reals, Recording
from cogless.files import versions
from cogless.study import AnyStudy
from cogless.study.position_sensor import Counted, Encoder, Hall


def board(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders about the board."""
    hold = f"{1e3 * subject.drive_config['monitor']['hold']:.3g} ms"
    comment = "omega_ref [rad/s] is the reference speed: 0 until you set it, and the motor stands."
    if subject.law.name == "trial":
        comment = (
            "The motion is given for a whole trial. Set omega_ref [rad/s] to its derivative: the check for a "
            "stuck angle uses it."
        )
    elif subject.law.name == "space-position":
        comment = "theta_ref [rad], omega_ref and alpha_ref, its derivatives: 0 until you set them."
    words = {
        "measured": _measured(subject),
        "hold": hold,
        "maps": _maps(subject),
        "reference_comment": comment,
    }
    return {**_outputs(subject), **words}


def _outputs(subject: Subject) -> dict[str, str]:
    """Texts about the controller's outputs to the board: duty cycles, or current references."""
    law = "the law" if subject.divider == 1 else f"the law every {subject.divider} calls"
    if subject.foreign:
        return {
            "board_act_declaration": "void board_set_current(cgl_real i_d_ref, cgl_real i_q_ref); "
            "/* [A]; references of your current loop */",
            "out_words": "current references",
            "board_act": "board_set_current(out.i_d_ref, out.i_q_ref);",
            "what_it_runs": f"plausibility of the\nmeasurements, and {law}. The study's current "
            "loop is ideal: `out.i_d_ref` and `out.i_q_ref`\n[A] come out, for a current loop of your own.",
            "safe_output": "the current references are zero",
        }
    foc = subject.drive_config["foc"]
    short = (
        f" with up to psi_f / L_d = {foc['psi_f'] / foc['L_d']:.3g} A"
        if foc["L_d"]
        else " with up to psi_f / L_d"
    )
    return {
        "board_act_declaration": "void board_set_duty(const cgl_real duty[3]); "
        "/* in [0, 1], from the next PWM period on */\n"
        "void board_set_gates(bool on); /* off: all switches open, no current is driven */",
        "out_words": "duty cycles",
        "board_act": "board_set_duty(out.duty);\n"
        "    /* duty cycles of one half would short-circuit a turning motor */\n"
        "    board_set_gates((out.status & ((unsigned)CGL_STATUS_OFF | (unsigned)CGL_STATUS_FAULT)) == 0U);",
        "what_it_runs": f"plausibility of the\nmeasurements, {law}, the current loop. Duty cycles come out, "
        "for the next PWM period.",
        "safe_output": "all duty cycles are one half. These\nshort-circuit a turning motor, and the current "
        f"brakes it{short}. So open the bridge then (gates off); a bridge that\ncan't be opened needs "
        "`.current_max` above twice this current",
    }


def _measured(subject: Subject) -> str:
    """Table rows with the signs, zero points and units of the measurements."""
    two = subject.drive_config["foc"]["phases"] == 2
    forward = "from a towards b" if two else "in the order a, b, c"
    theta_e = f"theta_e = {subject.drive_config['pole_pairs']} theta_m"
    rows = [
        "| `theta_m` | rad, mechanical, wrapped to [0, 2 pi). 0 where the d axis, the magnet's north, stands "
        f"on phase a; {theta_e}. It grows when the field turns {forward} |",
        f"| `omega_m` | rad/s, {_speed(subject)} |",
    ]
    if not subject.foreign:
        phases = (
            "`i_abc[0]`, `i_abc[1]` | A, of phases a and b" if two else "`i_abc` | A, of phases a, b and c"
        )
        rows += [f"| {phases}, positive into the motor; positive `i_q` drives forward |", "| `u_dc` | V |"]
    return "\n".join(rows) + "\n"


def _speed(subject: Subject) -> str:
    """Text on how the study's sensor measures the speed."""
    position, simulated = sensor(subject), "by the code that was simulated"
    frequency = corner(subject)
    then = (
        "" if frequency is None else f", then through a low-pass of {frequency:g} Hz (`cogless/low_pass.h`)"
    )
    example = "`measure_motion` in the example calls this code"
    if isinstance(position, Hall):
        return (
            f"from Hall sensors, {simulated}: `cogless/hall.h` says what this code measures{then}; {example}"
        )
    if isinstance(position, Counted):
        kind = (
            f"{position.lines} lines, {position.counts} counts"
            if isinstance(position, Encoder)
            else f"{position.counts} counts"
        )
        article = "an" if position.kind in ("encoder", "absolute") else "a"
        name = "absolute encoder" if position.kind == "absolute" else position.kind
        header = HEADERS[position.speed_method]
        corrected = subject.encoder_table_config is not None
        own = ", of the angle without the sensor's own error (`cogless/encoder_table.h`)" * corrected
        says = f"`cogless/{header}` says what this code measures{own}{then}; {example}"
        return f"from {article} {name} of {kind}, {simulated}: {says}"
    return (
        f"measured as in the study, by an ideal sensor{then}. So the gains and `.speed_window` allow for no "
        "delay of a real sensor: to change this, put your sensor into the study and export again"
    )


def _maps(subject: Subject) -> str:
    """Text on how to store the learned map; empty if the controller has no map to store."""
    if subject.map is None:
        return ""
    trial, (channels, cells) = subject.law.name == "trial", subject.map
    asset = files("cogless.export").joinpath("assets", "c", "maps.md")
    rests = "set reference.learn = false, wait for a step of the law, save, and set it true again."
    return Template(asset.read_text(encoding="utf-8")).substitute(
        name=subject.name,
        map_of=subject.law.map,
        motion=", .motion" if trial else "",
        when_to_save="Between two trials." if trial else f"From the main loop: {rests}",
        channels=channels,
        cells=cells,
    )


C_FLAGS = "-std=c99 -O2 -ffp-contract=off"
LEARNING = "frozen while `reference.learn` is false, and while a check of the controller stops it"


def texts(
    subject: Subject, recording: Recording, memory: Reals, stretches: Sequence[Stretch]
) -> dict[str, str]:
    """Text of each file of an export, by name, except files of the control library.

    `memory`: contents of the law's memory at the start.
    """
    words = _template_words(subject)
    words |= self_test_words(subject, recording, memory, stretches) | {"ticks": str(len(recording.outputs))}
    names = {f"{stem(subject.name)}.h": "controller.h", f"{stem(subject.name)}.c": "controller.c"}
    same = ("self_test.c", "self_test_data.h", "example_interrupt.c", "README.md")
    return {name: _filled(names.get(name, name), words) for name in (*names, *same)}


def law_texts(assets: str, words: Mapping[str, str]) -> dict[str, str]:
    """{name: text} of the files that export a law without a drive. `assets`: prefix of the template names."""
    names = {
        f"{words['stem']}.h": ".h",
        f"{words['stem']}.c": ".c",
        "self_test.c": "_test.c",
        "self_test_data.h": "_data.h",
        "README.md": "_README.md",
    }
    return {name: _filled(f"{assets}{ending}", words) for name, ending in names.items()}


def controller_texts(subject: Subject) -> dict[str, str]:
    """Texts of the controller's header and source alone, by file name, to compile with the whole library."""
    words = _template_words(subject) | {"macro_checks": _precision_check(subject.precision == "d")}
    return {f"{stem(subject.name)}{end}": _filled(f"controller{end}", words) for end in (".h", ".c")}


def _filled(asset: str, words: Mapping[str, str]) -> str:
    template = _asset(asset).replace("${bit_access}\n", _asset("bits.c"))
    return Template(template).substitute(words)


def _asset(name: str) -> str:
    return files("cogless.export").joinpath("assets", "c", name).read_text(encoding="utf-8")


def study_words(study: AnyStudy, scenario: str, controller: str, command: str) -> dict[str, str]:
    """{placeholder: text} about the study, for the templates. `command`: the command line of the export."""
    name, title = identifier(controller), plain_comment(study.title)
    return {
        "name": name,
        "stem": stem(name),
        "NAME": name.upper(),
        "controller": controller,
        "scenario": scenario,
        "study": study.name,
        "title": title.rstrip("."),
        "title_comment": textwrap.fill(title, 118, initial_indent=" * ", subsequent_indent=" * "),
        "hash": study_hash(study),
        "version": versions()["cogless"],
        "command": command,
        "law": study.controller[controller].law,
    }


def law_words(subject: Subject) -> dict[str, str]:
    """{placeholder: text} for the placeholders that the templates of every law have."""
    s = subject
    double = s.precision == "d"
    own = {"learning_matrix": f"{s.name}_learning_matrix"} if s.learning_matrix is not None else {}
    return {
        **study_words(s.study, s.scenario, s.controller, s.command),
        "precision": "double: define COGLESS_DOUBLE for every file" if double else "single",
        "macro_checks": "\n".join([_precision_check(double), *map(_left_out_check, s.left_out)]),
        "defines": "".join(f", `-D{name}`" for name in s.defines),
        "flags": " ".join([C_FLAGS, *(f"-D{name}" for name in s.defines)]),
        "rate": str(s.rate),
        "law_values": initialiser(s.headers, s.law.config, s.law_config | own, s.precision),
    }


def _template_words(subject: Subject) -> dict[str, str]:
    s, name = subject, subject.name
    entries = s.law.entries(s.law_config)
    state = s.law.state
    period = "" if s.law.name == "trial" else ", &controller->drive.loop"
    length = f"{name.upper()}_MEMORY_LENGTH"
    memory = f", controller->memory, {length}" if entries else ""
    return {
        **law_words(s),
        "pad": " " * len(name),
        "law_rate": f"{s.rate / s.divider:g}",
        "period": real(1 / s.rate, s.precision),
        "divider": str(s.divider),
        "law_header": s.law.header,
        "law_state": s.law.state,
        "law_config": s.law.config,
        "law_step": s.law.step,
        "drive_config": initialiser(s.headers, "cgl_drive_config", s.drive_config, s.precision),
        "init_call": f"{state}_init(&controller->law, &{name}_law_config{period}{memory})",
        "reset_call": f"{state}_reset(&controller->law)",
        "learning": LEARNING if entries else "none",
        "reset_comment": _reset_comment(s),
        "memory_define": f"#define {length} {entries} /* numbers */\n" if entries else "",
        "memory_member": f"    cgl_real memory[{length}]; /* what is learned */\n" if entries else "",
        "memory_text": f"{s.memory_length} numbers, within `{name}_controller`" if entries else "none",
        "matrix": matrix_array(name, s.learning_matrix, s.precision),
        "verdict_list": verdict_list(s.verdict),
        "verdict_comment": verdict_comment(s.verdict),
        "figures": figure_lines(s.figures),
        **board(s),
        **extras(s),
        **parts(s),
        **motion(s),
    }


def verdict_list(verdict: Sequence[str]) -> str:
    """The verdict of `cogless design` on learning, as a list for a README; empty without a verdict."""
    lines = [textwrap.fill(one, 118, initial_indent="- ", subsequent_indent="  ") for one in verdict]
    return "\n".join(["\n`cogless design` says about the learning:\n", *lines, ""]) if verdict else ""


def verdict_comment(verdict: Sequence[str]) -> str:
    """The verdict of `cogless design` on learning, as lines of a comment in C; empty without a verdict."""
    start, indent = " * learning         ", " *                  "
    lines: list[str] = []
    for statement in map(plain_comment, verdict):
        first = indent if lines else start
        lines += textwrap.wrap(statement, 118, initial_indent=first, subsequent_indent=indent)
    return "".join(f"{line}\n" for line in lines)


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
        f'#error "this export leaves out files of the library: compile every file with {macro}"\n#endif'
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
