"""A header for a SimpleFOC sketch that plays the motions of a plan and prints what identify needs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cogless.drives.adapter import Motions, ramped
from cogless.drives.script_motions import SPEED_MARGIN
from cogless.study.messages import toml

MONITOR_NAME, SKETCH_NAME = "monitor.toml", "record_simplefoc.h"

SKETCH_TEXT = """\
// Plays motions and prints a row for cogless identify every 2 ms, by cogless. In the sketch:
//
//     Serial.begin(1000000);                    // rows of some 45 characters, 500 a second
//     motor.controller = MotionControlType::velocity;
//
//     void loop() {{
//         motor.loopFOC();
//         motor.move(record_target(motor, micros()));
//     }}
//
// Nothing moves until y is sent over the serial port; any other character stops. The motor must be free to
// turn. Save what is printed to a file:
//
//     cogless identify log.txt --drive simplefoc --drive-config {monitor} -o found
#ifndef RECORD_SIMPLEFOC_H
#define RECORD_SIMPLEFOC_H

#include <math.h>
#include <stdint.h>

struct RecordPoint {{
    float time; // s
    float speed; // rad/s
}};

{motions}

struct RecordMotion {{
    const RecordPoint *points;
    int count;
}};

static const RecordMotion record_motions[] = {{
{list}
}};
static const int record_motion_count = {count};
static const float record_speed_limit = {speed_limit:.6g}f; // rad/s: the motor is stopped beyond
static const uint32_t record_row_us = 2000;

// The speed that the sketch asks for now, rad/s. Prints rows: part, time_us, Iq in mA, velocity, angle.
template <typename Motor> float record_target(Motor &motor, uint32_t now_us)
{{
    static int part = -1; // -1: waits for y
    static uint32_t start_us, row_us;
    if (Serial.available()) {{
        part = Serial.read() == 'y' ? 0 : -1;
        start_us = row_us = now_us;
    }}
    if (part < 0) {{
        return 0.0f;
    }}
    if (!(fabsf(motor.shaft_velocity) < record_speed_limit)) {{
        part = -1;
        Serial.println("stopped: too fast");
        return 0.0f;
    }}
    const RecordMotion &motion = record_motions[part];
    const float t = 1e-6f * (float)(now_us - start_us);
    if (t >= motion.points[motion.count - 1].time) {{
        start_us = row_us = now_us;
        if (++part == record_motion_count) {{
            part = -1;
            Serial.println("done");
        }}
        return 0.0f;
    }}
    if ((int32_t)(now_us - row_us) >= 0) {{
        row_us += record_row_us;
        Serial.print(part);
        Serial.print('\\t');
        Serial.print((unsigned long)now_us);
        Serial.print('\\t');
        Serial.print(1000.0f * motor.current.q, 2);
        Serial.print('\\t');
        Serial.print(motor.shaft_velocity, 4);
        Serial.print('\\t');
        Serial.println(motor.shaft_angle, 5);
    }}
    int n = 1;
    while (t >= motion.points[n].time) {{
        n++;
    }}
    const RecordPoint &a = motion.points[n - 1], &b = motion.points[n];
    return a.speed + (b.speed - a.speed) * (t - a.time) / (b.time - a.time);
}}

#endif
"""


def write_script(motions: Motions, configuration: Path | None) -> dict[str, str]:
    """The header, and the file that says what it prints, with the study's motor and drive."""
    del configuration
    arrays, names, top = [], [], 0.0
    for name, points in motions.speeds.items():
        identifier = f"record_{name.replace('-', '_')}"
        pairs = ", ".join(f"{{{t:.6f}f, {speed:.6f}f}}" for t, speed in ramped(points))
        arrays.append(f"static const RecordPoint {identifier}[] = {{{pairs}}};")
        names.append(f"    {{{identifier}, {len(ramped(points))}}},")
        top = max([top, *(abs(speed) for _, speed in points)])
    sketch = SKETCH_TEXT.format(
        monitor=MONITOR_NAME,
        motions="\n".join(arrays),
        list="\n".join(names),
        count=len(names),
        speed_limit=SPEED_MARGIN * top,
    )
    lines = [
        f"# What {SKETCH_NAME} prints; motor and drive are those of the plan's study.",
        'monitor = ["part", "time_us", "Iq", "velocity", "angle"]',
    ]
    for room in ("motor", "drive"):
        table: Mapping[str, object] = motions.tables[room]
        lines += ["", f"[{room}]", *(f"{key} = {toml(value)}" for key, value in table.items())]
    return {SKETCH_NAME: sketch, MONITOR_NAME: "\n".join(lines) + "\n"}
