"""Parts of an export that only some laws need: a calibration run, trials."""

from __future__ import annotations

from string import Template

from cogless.export.c.literals import initialiser, real
from cogless.export.c.subject import Subject

CALIBRATE = """
/* With the interrupt shut out: the following steps ignore the reference and make the calibration run, which
 * fills the table: slowly forward, then backward. CGL_STATUS_BUSY is set until it is done. */
void ${name}_calibrate(${name}_controller *controller)"""
CALIBRATE_BODY = """
{
    cgl_anti_cogging_calibrate(&controller->law);
}
"""
CALIBRATE_DECLARATIONS = """void board_shut_interrupt(void);
void board_open_interrupt(void);
void find_cogging(void);
"""
CALIBRATE_EXAMPLE = """
/* From the main loop, with the motor free to turn. */
void find_cogging(void)
{
    board_shut_interrupt();
    ${name}_calibrate(&controller);
    board_open_interrupt();
}
"""
CALIBRATE_ROW = "| calibration | `${name}_calibrate` starts it; until then the table is empty |\n"

BEGIN = """
/* Before each trial, with the rotor where it starts and the interrupt shut out. y_ref: theta_ref at the
 * ${samples} samples [rad], to be left alone until the next call. */
void ${name}_begin_trial(${name}_controller *controller, const cgl_real *y_ref)"""
BEGIN_BODY = """
{
    cgl_drive_reset(&controller->drive);
${begin_resets}    cgl_trial_begin(&controller->law, y_ref);
}
"""
END = """
/* After each trial, in the background, while steps go on: learns from it. False where it could
 * not: what was learned stays. */
bool ${name}_end_trial(${name}_controller *controller)"""
END_BODY = """
{
    return cgl_trial_end(&controller->law);
}
"""
TRIAL_DECLARATIONS = """void board_shut_interrupt(void);
void board_open_interrupt(void);
void board_wait_for_trial(void); /* returns after the samples of a trial */
void repeat_motion(void);

/* The motion: theta_ref at each of the samples [rad]. Its derivative goes into reference.omega_ref meanwhile,
 * for the checks. */
static const cgl_real motion[${samples}] = {0};
"""
TRIAL_EXAMPLE = """
/* From the main loop: one trial after the other. */
void repeat_motion(void)
{
    for (;;) {
        board_shut_interrupt();
        ${name}_begin_trial(&controller, motion);
        board_open_interrupt();
        board_wait_for_trial();
        (void)${name}_end_trial(&controller);
    }
}
"""
TRIAL_ROW = (
    "| a trial | `${name}_begin_trial`, then ${samples} samples, one every ${divider} steps, then "
    "`${name}_end_trial` from the background |\n"
)

PART = {
    "part_includes": '#include "cogless/${part}.h"\n',
    "part_members": "    cgl_${part} ${part};\n",
    "part_declarations": "extern const cgl_${part}_config ${name}_${part}_config;\n",
    "part_configs": """
const cgl_${part}_config ${name}_${part}_config = {
${values}
};
""",
    "part_inits": """    if (cgl_${part}_init(&controller->${part}, &${name}_${part}_config, ${period})
        != CGL_OK) {
        return CGL_ERROR_CONFIG;
    }
""",
    "part_resets": "    cgl_${part}_reset(&controller->${part});\n",
}
BEGIN_RESETS = "    cgl_dead_time_reset(&controller->dead_time);\n"
COMPENSATE = """    if ((out->status & (unsigned)CGL_STATUS_OFF) == 0U) {
        cgl_dead_time_step(&controller->dead_time, &drive->currents, out->duty);
    }
"""


def parts(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders for the compensation of dead time; empty without it."""
    config = subject.dead_time_config
    if config is None:
        return dict.fromkeys((*PART, "compensate"), "")
    words = {
        "part": "dead_time",
        "name": subject.name,
        "period": real(1 / subject.rate, subject.precision),
        "values": initialiser(subject.headers, "cgl_dead_time_config", config, subject.precision),
    }
    return {key: Template(text).substitute(words) for key, text in PART.items()} | {"compensate": COMPENSATE}


def extras(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders for these parts; empty for laws that don't need them."""
    found = dict.fromkeys(
        ("more_declarations", "more_definitions", "more_rows", "example_declarations", "example_definitions"),
        "",
    )
    if subject.law.name == "anti-cogging":
        found = {
            "more_declarations": f"{CALIBRATE};\n",
            "more_definitions": _without_comment(CALIBRATE) + CALIBRATE_BODY,
            "more_rows": CALIBRATE_ROW,
            "example_declarations": CALIBRATE_DECLARATIONS,
            "example_definitions": CALIBRATE_EXAMPLE,
        }
    elif subject.law.name == "trial":
        found = {
            "more_declarations": f"{BEGIN};\n{END};\n",
            "more_definitions": _without_comment(BEGIN) + BEGIN_BODY + _without_comment(END) + END_BODY,
            "more_rows": TRIAL_ROW,
            "example_declarations": TRIAL_DECLARATIONS,
            "example_definitions": TRIAL_EXAMPLE,
        }
    words = {
        "name": subject.name,
        "divider": str(subject.divider),
        "samples": str(subject.law_config.get("samples", "")),
        "begin_resets": BEGIN_RESETS if subject.dead_time_config else "",
    }
    return {key: Template(text).substitute(words) for key, text in found.items()}


def _without_comment(declaration: str) -> str:
    """The declaration without its comment, as the beginning of the function's definition."""
    return "\n" + declaration.partition("*/\n")[2]
