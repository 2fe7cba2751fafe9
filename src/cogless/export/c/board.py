"""Texts for README and example: what the user's board must measure, do and store."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from cogless.export.c.motion import HEADERS, corner, sensor
from cogless.export.c.subject import Subject
from cogless.study.position_sensor import Counted, Encoder, Hall


def board(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders about the board."""
    hold = f"{1e3 * subject.drive_config['monitor']['hold']:.3g} ms"
    wanted = "omega_ref [rad/s] is what it turns at: 0 until you set it, and the motor stands."
    if subject.law.name == "trial":
        wanted = (
            "The motion is given for a whole trial; omega_ref [rad/s], its derivative, is for the checks."
        )
    elif subject.law.name == "space-position":
        wanted = "theta_ref [rad], omega_ref and alpha_ref, its derivatives: 0 until you set them."
    words = {
        "measured": _measured(subject),
        "hold": hold,
        "maps": _maps(subject),
        "reference_comment": wanted,
    }
    return {**_outputs(subject), **words}


def _outputs(subject: Subject) -> dict[str, str]:
    """Texts about what the board gets from the controller: duty cycles, or a current reference."""
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
        f", up to psi_f / L_d = {foc['psi_f'] / foc['L_d']:.3g} A" if foc["L_d"] else ", up to psi_f / L_d"
    )
    return {
        "board_act_declaration": "void board_set_duty(const cgl_real duty[3]); "
        "/* in [0, 1], from the next PWM period on */\n"
        "void board_set_gates(bool on); /* off: all switches open, no current is driven */",
        "out_words": "duty cycles",
        "board_act": "board_set_duty(out.duty);\n"
        "    /* duty cycles of one half would short-circuit a motor that turns */\n"
        "    board_set_gates((out.status & ((unsigned)CGL_STATUS_OFF | (unsigned)CGL_STATUS_FAULT)) == 0U);",
        "what_it_runs": f"plausibility of the\nmeasurements, {law}, the current loop. Duty cycles come out, "
        "for the next PWM period.",
        "safe_output": "the duty cycles are one half. Open the\nbridge then (gates off): they "
        f"short-circuit a motor that turns{short}, and it brakes; a bridge that can't be opened needs\n"
        "`.current_max` above twice that",
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
    found, simulated = sensor(subject), "by the code that was simulated"
    frequency = corner(subject)
    then = (
        "" if frequency is None else f", then through a low-pass of {frequency:g} Hz (`cogless/low_pass.h`)"
    )
    example = "`measure_motion` in the example calls it"
    if isinstance(found, Hall):
        return f"from Hall sensors, {simulated}: `cogless/hall.h` says what it measures{then}, {example}"
    if isinstance(found, Counted):
        kind = (
            f"{found.lines} lines, {found.counts} counts"
            if isinstance(found, Encoder)
            else f"{found.counts} counts"
        )
        article = "an" if found.kind in ("encoder", "absolute") else "a"
        name = "absolute encoder" if found.kind == "absolute" else found.kind
        header = HEADERS[found.speed_method]
        corrected = subject.encoder_table_config is not None
        own = ", of the angle without the sensor's own error (`cogless/encoder_table.h`)" * corrected
        says = f"`cogless/{header}` says what it measures{own}{then}, {example}"
        return f"from {article} {name} of {kind}, {simulated}: {says}"
    return (
        "measured as in the study, since gains and `.speed_window` assume it. As it is: the study's sensor "
        f"is ideal{then}. A real one's delay is in none of the gains"
    )


def _maps(subject: Subject) -> str:
    """Text on how to store what was learned; empty if it isn't tied to an angle."""
    if subject.map is None:
        return ""
    trial, (channels, cells) = subject.law.name == "trial", subject.map
    asset = files("cogless.export").joinpath("assets", "c", "maps.md")
    rests = "Before it reference.learn = false, for a step of the law or more; afterwards true again."
    return Template(asset.read_text(encoding="utf-8")).substitute(
        name=subject.name,
        map_of=subject.law.map,
        motion=", .motion" if trial else "",
        when_to_save="Between two trials." if trial else f"From the main loop. {rests}",
        channels=channels,
        cells=cells,
    )
