"""Code of the example that measures angle and speed with the study's sensor, as the simulation does.

This code first corrects the angle for the sensor's own error. It then estimates the speed from the corrected
angle.

Parts of an export that only some laws or drives need: a calibration run, trials, compensation of dead time.
"""

from __future__ import annotations

import math
from string import Template

from cogless.c_literals import initialiser, real
from cogless.export.c.subject import Subject
from cogless.study.position_sensor import Counted, Encoder, Hall, IdealSensor

HEADERS = {
    "M": "speed_count.h",
    "average": "speed_count.h",
    "T": "speed_timed.h",
    "MT": "speed_timed.h",
    "observer": "angle_observer.h",
}
COUNTER = "uint32_t board_counter(void); /* returns the encoder's counter: 16 bits, four counts a line */\n"
SENSOR_WORD = "uint32_t board_counter(void); /* returns the sensor's raw value, 0 to ${last} */\n"
HALL = """uint32_t board_hall(void); /* returns the sector, 0 to 5, which forward rotation counts up */
"""
TIMES = """uint32_t board_edge_time(void); /* returns the timer as captured at the last edge [ticks] */
uint32_t board_timer(void); /* returns the timer now [ticks] */
"""
COUNTED = """static const cgl_speed_count_config speed_config = {.counts = ${counts}U, .window = ${window}U};
static cgl_speed_count speed;
static uint32_t count_before[${window}];
"""
SENSOR_STATES = {
    "M": COUNTED,
    "average": COUNTED,
    "MT": """static const cgl_speed_timed_config speed_config = {
    .counts = ${counts}U, .timer = ${timer}${last_interval}};
static cgl_speed_timed speed;
static cgl_edges edges;
""",
    "observer": """static const cgl_angle_observer_config speed_config = {.bandwidth = ${bandwidth}};
static cgl_angle_observer speed;
""",
}
DEFINITIONS = """static const cgl_encoder_config encoder_config = {
    .counts = ${counts}U, .range = ${range}U${absolute}};
static cgl_encoder encoder;
${states}
/* ${about} */
static void measure_motion(cgl_measurement *now)
{
${due}    cgl_encoder_step(&encoder, board_counter());
    now->theta_m = cgl_radians(encoder.turns);
${correct}${speed}${filter}}
"""
ABOUT = """Angle and speed from the encoder's counts. The angle is zero where the encoder stood at the start:
 * call cgl_encoder_index at the index pulse, or cgl_encoder_place."""
ABOUT_WORD = "Angle and speed from the sensor's raw value. encoder_config.zero is this value at angle zero."
HALL_DEFINITIONS = """static const cgl_hall_config hall_config = {
    .pole_pairs = ${pole_pairs}U, .edges = ${edges}U, .timer = ${timer}};
static cgl_hall hall;
${states}
/* Angle and speed from the Hall sensors. They do not show which electrical revolution it is. */
static void measure_motion(cgl_measurement *now)
{
    cgl_hall_step(&hall, board_hall(), board_edge_time(), board_timer());
    now->theta_m = cgl_radians(hall.turns);
    now->omega_m = hall.omega_m;
${filter}}
"""
FILTER_DEFINITIONS = """${states}
/* What the drive does to the measured speed. */
static void measure_motion(cgl_measurement *now)
{
${filter}}
"""
TABLE_STATE = """static const cgl_encoder_table_config table_config = {
${table_config}
};
static cgl_encoder_table table;
"""
TABLE_START = "cgl_encoder_table_init(&table, &table_config, ${period})"
TAKE = "        omega_m = ${step};\n"
TAKE_CORRECTED = """        const cgl_real mean = ${step};
        omega_m = cgl_encoder_table_speed(&table, mean, speed.time);
"""
TABLE_AVERAGE = {
    "due": "    static cgl_real omega_m;\n",
    "speed": """    const cgl_real mean = ${step};
    omega_m = cgl_encoder_table_speed(&table, mean, speed.time);
    now->omega_m = omega_m;
""",
}
CORRECT = """    now->omega_m = ${before}; /* of the last period */
    cgl_encoder_table_step(&table, now, controller.drive.i_q, true);
"""
FILTER_STATE = """static const cgl_low_pass_config filter_config = {.bandwidth = ${corner}};
static cgl_low_pass speed_filter;
"""
FILTER = "    now->omega_m = cgl_low_pass_step(&speed_filter, now->omega_m);\n"
FILTER_START = "cgl_low_pass_init(&speed_filter, &filter_config, ${period})"
DUE = """    static cgl_real omega_m;
    static uint32_t countdown; /* calls until the speed is due, with the law */
"""
WHEN_DUE = """    if (countdown == 0U) {
        countdown = ${NAME}_DIVIDER;
${take}    }
    --countdown;
    now->omega_m = omega_m;
"""
SENSOR_STEPS = {
    "M": "cgl_speed_count_step(&speed, encoder.count)",
    "average": "cgl_speed_count_step(&speed, encoder.count)",
    "MT": "cgl_speed_timed_step(&speed, &edges, board_timer())",
}
SPEED = {
    "M": WHEN_DUE,
    "average": "    now->omega_m = ${step};\n",
    "MT": "    cgl_edges_pass(&edges, encoder.count, board_edge_time());\n" + WHEN_DUE,
    "observer": "    cgl_angle_observer_step(&speed, ${turns});\n    now->omega_m = speed.omega;\n",
}
STARTS = {
    "M": "cgl_speed_count_init(&speed, &speed_config, ${law_period}, count_before, ${window}U)",
    "average": "cgl_speed_count_init(&speed, &speed_config, ${period}, count_before, ${window}U)",
    "MT": "cgl_speed_timed_init(&speed, &speed_config)",
    "observer": "cgl_angle_observer_init(&speed, &speed_config, ${period})",
}
CORRECTED_TURNS = "cgl_encoder_table_turns(&table, encoder.turns)"
ENCODER_START = "cgl_encoder_init(&encoder, &encoder_config, board_counter())"
HALL_START = "cgl_hall_init(&hall, &hall_config)"
EMPTY = dict.fromkeys(
    ("motion_includes", "motion_declarations", "motion_definitions", "motion_start", "motion_call"), ""
)


def sensor(subject: Subject) -> IdealSensor | Counted | Hall:
    """The study's position sensor; an ideal sensor if the study has no drive."""
    drive = subject.study.drive
    return drive.position_sensor if drive is not None else IdealSensor()


def corner(subject: Subject) -> float | None:
    """Corner frequency of the drive's speed filter, Hz; None without a filter."""
    drive = subject.study.drive
    return None if drive is None else drive.speed_filter


def motion_parts(subject: Subject) -> list[str]:
    """Headers of the control library that the example needs for the study's sensor and speed filter."""
    position = sensor(subject)
    parts = ["encoder.h", HEADERS[position.speed_method]] if isinstance(position, Counted) else []
    if isinstance(position, Hall):
        parts = ["hall.h"]
    if isinstance(position, Counted) and subject.encoder_table_config is not None:
        parts.append("encoder_table.h")
    return parts + ["low_pass.h"] * (corner(subject) is not None)


def motion(subject: Subject) -> dict[str, str]:
    """Texts that fill the example's placeholders for angle and speed; empty if the board measures both."""
    position, frequency = sensor(subject), corner(subject)
    if isinstance(position, IdealSensor) and frequency is None:
        return EMPTY
    words = {
        "NAME": subject.name.upper(),
        "period": real(1 / subject.rate, subject.precision),
        "law_period": real(subject.divider / subject.rate, subject.precision),
        "pole_pairs": str(subject.drive_config["pole_pairs"]),
        "corner": real(math.tau * (frequency or 0.0), subject.precision),
    }
    declarations, starts, states, text, more = "", list[str](), "", FILTER_DEFINITIONS, dict[str, str]()
    if isinstance(position, Counted):
        timer = position.timer if isinstance(position, Encoder) else 0.0
        method = "MT" if position.timed else position.speed_method
        count = min(position.counts, 2**32 - 1)
        words |= {
            "counts": str(count),
            "last": str(count - 1),
            "range": "65536" if isinstance(position, Encoder) else str(count),
            "absolute": "" if isinstance(position, Encoder) else ", .absolute = true",
            "about": ABOUT if isinstance(position, Encoder) else ABOUT_WORD,
            "window": str(position.window if method == "average" else 1),
            "timer": real(timer, subject.precision),
            "last_interval": ", .last_interval = true" if position.speed_method == "T" else "",
            "bandwidth": real(position.bandwidth, subject.precision),
        }
        declarations = (COUNTER if isinstance(position, Encoder) else SENSOR_WORD) + TIMES * position.timed
        starts, states, text = [ENCODER_START, STARTS[method]], SENSOR_STATES[method], DEFINITIONS
        table = subject.encoder_table_config
        more = {"due": DUE if position.each_law_period else "", "correct": "", "speed": SPEED[method]}
        words |= {"step": SENSOR_STEPS.get(method, ""), "turns": "encoder.turns"}
        take = TAKE if table is None else TAKE_CORRECTED
        if table is not None:
            values = initialiser(subject.headers, "cgl_encoder_table_config", table, subject.precision)
            words |= {"table_config": values, "turns": CORRECTED_TURNS}
            words["before"] = "speed.omega" if method == "observer" else "omega_m"
            more |= {"correct": CORRECT} | (TABLE_AVERAGE if method == "average" else {})
            starts, states = [*starts, TABLE_START], states + TABLE_STATE
        words["take"] = Template(take).substitute(words)
    elif isinstance(position, Hall):
        words |= {"edges": str(position.edges), "timer": real(position.timer, subject.precision)}
        declarations, starts, text = HALL + TIMES, [HALL_START], HALL_DEFINITIONS
    if frequency is not None:
        starts, states = [*starts, FILTER_START], states + FILTER_STATE
    more |= {"states": states, "filter": "" if frequency is None else FILTER}
    words |= {key: Template(part).substitute(words) for key, part in more.items()}
    start = "".join(
        f"\n           && {Template(start_text).substitute(words)} == CGL_OK" for start_text in starts
    )
    return {
        "motion_includes": "".join(f'#include "cogless/{header}"\n' for header in motion_parts(subject)),
        "motion_declarations": Template(declarations).substitute(words),
        "motion_definitions": "\n" + Template(text).substitute(words),
        "motion_start": start,
        "motion_call": "    measure_motion(&now);\n",
    }


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

BEGIN_PART = """
/* Before each trial, with the rotor where it starts and the interrupt shut out. y_ref: theta_ref at the
 * ${samples} samples [rad], to be left alone until the next call. */
void ${name}_begin_trial(${name}_controller *controller, const cgl_real *y_ref)"""
BEGIN_BODY = """
{
    cgl_drive_reset(&controller->drive);
${begin_resets}    cgl_trial_begin(&controller->law, y_ref);
}
"""
END_PART = """
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

TRIAL_PART = {
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
CONVERT = "        cgl_current_reference_step(&controller->current_reference, drive);\n"
# Entries for the current reference that replace those of TRIAL_PART: the init function takes the drive in
# place of a period, and there is no state to reset.
CURRENT_PART = {
    "part_inits": TRIAL_PART["part_inits"].replace("${period}", "&controller->drive"),
    "part_resets": "",
}
ACTUATE = "cgl_drive_actuate(drive, out)"
ACTUATE_CURRENTS = "cgl_current_reference_actuate(&controller->current_reference, drive, out)"


def parts(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders for current reference and compensation of dead time.

    They are empty, except `actuate`, if the drive has neither part.
    """
    currents, dead_time = subject.current_reference_config, subject.dead_time_config
    texts = dict.fromkeys(TRIAL_PART, "")
    for part, config, more in (("current_reference", currents, CURRENT_PART), ("dead_time", dead_time, {})):
        if config is None:
            continue
        words = {
            "part": part,
            "name": subject.name,
            "period": real(1 / subject.rate, subject.precision),
            "values": initialiser(subject.headers, f"cgl_{part}_config", config, subject.precision),
        }
        for key, text in (TRIAL_PART | more).items():
            texts[key] += Template(text).substitute(words)
    return texts | {
        "convert": "" if currents is None else CONVERT,
        "actuate": ACTUATE if currents is None else ACTUATE_CURRENTS,
        "compensate": "" if dead_time is None else COMPENSATE,
    }


def extras(subject: Subject) -> dict[str, str]:
    """Texts that fill the templates' placeholders for calibration run and trials; empty for other laws."""
    texts = dict.fromkeys(
        ("more_declarations", "more_definitions", "more_rows", "example_declarations", "example_definitions"),
        "",
    )
    if subject.law.name == "anti-cogging":
        texts = {
            "more_declarations": f"{CALIBRATE};\n",
            "more_definitions": _without_comment(CALIBRATE) + CALIBRATE_BODY,
            "more_rows": CALIBRATE_ROW,
            "example_declarations": CALIBRATE_DECLARATIONS,
            "example_definitions": CALIBRATE_EXAMPLE,
        }
    elif subject.law.name == "trial":
        texts = {
            "more_declarations": f"{BEGIN_PART};\n{END_PART};\n",
            "more_definitions": _without_comment(BEGIN_PART)
            + BEGIN_BODY
            + _without_comment(END_PART)
            + END_BODY,
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
    return {key: Template(text).substitute(words) for key, text in texts.items()}


def _without_comment(declaration: str) -> str:
    """The declaration without its comment, as the beginning of the function's definition."""
    return "\n" + declaration.partition("*/\n")[2]
