"""Code for the example: angle and speed from the study's encoder, by the parts that simulated them."""

from __future__ import annotations

from string import Template

from cogless.export.c.literals import real
from cogless.export.c.subject import Subject
from cogless.study.position_sensor import Encoder

HEADERS = {
    "M": "speed_count.h",
    "T": "speed_timed.h",
    "MT": "speed_timed.h",
    "observer": "angle_observer.h",
}
DECLARATIONS = "uint32_t board_counter(void); /* the encoder's: 16 bits, four counts a line */\n"
TIMES = """uint32_t board_edge_time(void); /* the timer as captured at the counter's last edge [ticks] */
uint32_t board_timer(void); /* the timer now [ticks] */
"""
STATES = {
    "M": """static const cgl_speed_count_config speed_config = {.counts = ${counts}U, .window = 1U};
static cgl_speed_count speed;
static uint32_t count_before[1];
""",
    "MT": """static const cgl_speed_timed_config speed_config = {
    .counts = ${counts}U, .timer = ${timer}${last_interval}};
static cgl_speed_timed speed;
static cgl_edges edges;
""",
    "observer": """static const cgl_angle_observer_config speed_config = {.bandwidth = ${bandwidth}};
static cgl_angle_observer speed;
""",
}
DEFINITIONS = """static const cgl_encoder_config encoder_config = {.counts = ${counts}U, .range = 65536U};
static cgl_encoder encoder;
${states}
/* The encoder's part of the measurements. Its zero is where it stood at the start: call cgl_encoder_index at
 * the index pulse, or cgl_encoder_place. */
static void measure_motion(cgl_measurement *now)
{
${due}    cgl_encoder_step(&encoder, board_counter());
    now->theta_m = cgl_radians(encoder.turns);
${speed}}
"""
DUE = """    static cgl_real omega_m;
    static uint32_t countdown; /* calls until the speed is due, with the law */
"""
WHEN_DUE = """    if (countdown == 0U) {
        countdown = ${NAME}_DIVIDER;
        omega_m = ${step};
    }
    --countdown;
    now->omega_m = omega_m;
"""
SPEED = {
    "M": WHEN_DUE.replace("${step}", "cgl_speed_count_step(&speed, encoder.count)"),
    "MT": "    cgl_edges_pass(&edges, encoder.count, board_edge_time());\n"
    + WHEN_DUE.replace("${step}", "cgl_speed_timed_step(&speed, &edges, board_timer())"),
    "observer": "    cgl_angle_observer_step(&speed, encoder.turns);\n    now->omega_m = speed.omega;\n",
}
STARTS = {
    "M": "cgl_speed_count_init(&speed, &speed_config, ${law_period}, count_before, 1U)",
    "MT": "cgl_speed_timed_init(&speed, &speed_config)",
    "observer": "cgl_angle_observer_init(&speed, &speed_config, ${period})",
}
START = """
           && cgl_encoder_init(&encoder, &encoder_config, board_counter()) == CGL_OK
           && ${start} == CGL_OK"""
EMPTY = dict.fromkeys(
    ("motion_includes", "motion_declarations", "motion_definitions", "motion_start", "motion_call"), ""
)


def sensor(subject: Subject) -> Encoder | None:
    """The study's encoder; None for another sensor."""
    drive = subject.study.drive
    found = drive.position_sensor if drive is not None else None
    return found if isinstance(found, Encoder) else None


def motion_parts(subject: Subject) -> list[str]:
    """Headers of the control library that the example needs for the study's sensor."""
    encoder = sensor(subject)
    return [] if encoder is None else ["encoder.h", HEADERS[encoder.speed_method]]


def motion(subject: Subject) -> dict[str, str]:
    """Texts that fill the example's placeholders for angle and speed; empty for a sensor without counts."""
    encoder = sensor(subject)
    if encoder is None:
        return EMPTY
    method = "MT" if encoder.speed_method == "T" else encoder.speed_method
    words = {
        "counts": str(4 * encoder.lines),
        "timer": real(encoder.timer, subject.precision),
        "last_interval": ", .last_interval = true" if encoder.speed_method == "T" else "",
        "bandwidth": real(encoder.bandwidth, subject.precision),
        "NAME": subject.name.upper(),
        "period": real(1 / subject.rate, subject.precision),
        "law_period": real(subject.divider / subject.rate, subject.precision),
    }
    parts = {
        "states": STATES[method],
        "due": "" if method == "observer" else DUE,
        "speed": SPEED[method],
        "start": STARTS[method],
    }
    words |= {key: Template(text).substitute(words) for key, text in parts.items()}
    return {
        "motion_includes": "".join(f'#include "cogless/{header}"\n' for header in motion_parts(subject)),
        "motion_declarations": DECLARATIONS + (TIMES if method == "MT" else ""),
        "motion_definitions": "\n" + Template(DEFINITIONS).substitute(words),
        "motion_start": Template(START).substitute(words),
        "motion_call": "    measure_motion(&now);\n",
    }
