"""Words of a drive engineer for a key, which a page shows in addition to the key's name in the study."""

from __future__ import annotations

import re
from typing import Any

from cogless.study import AnyStudy

# Patterns of a key's last parts, and words; the first pattern that fits counts.
KEY_WORDS = (
    (r"tuning\.phase_margin", "phase margin of the speed loop"),
    (r"learning_start", "learning begins at"),
    (r"forgetting", "share of the learned values that is kept"),
    (r"kp", "proportional gain of the speed loop"),
    (r"ki", "integral gain of the speed loop"),
    (r"gain", "learning gain"),
    (r"lead", "lead: time by which learning acts earlier"),
    (r"cells", "cells of the learned map"),
    (r"q_half_width", "cells on each side that the filter averages"),
    (r"cutoff|q_filter\.cutoff", "cutoff of the learning filter"),
    (r"shift", "samples by which learning acts earlier"),
    (r"K_3|K_ilc", "learning gain"),
    (r"pole", "pole of the observer"),
    (r"bandwidth", "bandwidth"),
    (r"omega_o", "bandwidth of the observer"),
    (r"base", "learned orders are multiples of"),
    (r"order", "times a revolution"),
    (r"torque", "amplitude"),
    (r"duration", "length of the run"),
    (r"reference", "speed"),
    (r"reference\.speed", "speed"),
    (r"reference\.ramp", "ramp of the speed"),
    (r"reference\.offset", "mean speed"),
    (r"reference\.amplitude", "swing of the speed"),
    (r"reference\.frequency", "frequency of the swing"),
    (r"load", "torque of the load"),
    (r"trials", "number of trials"),
    (r"mechanics\.viscous_friction", "friction that grows with the speed"),
    (r"mechanics\.breakaway_friction", "friction at rest"),
    (r"mechanics\.load_side\.inertia", "inertia behind the shaft"),
    (r"mechanics\.load_side\.stiffness", "stiffness of the shaft"),
    (r"mechanics\.load_side\.damping", "damping of the shaft"),
    (r"inertia", "inertia of all that turns"),
    (r"coulomb_friction", "dry friction"),
    (r"pole_pairs", "pole pairs"),
    (r"kv", "speed constant (KV)"),
    (r"K_t", "torque constant"),
    (r"psi_f", "flux of the magnets"),
    (r"R_s", "resistance of a phase"),
    (r"resistance_line_to_line", "resistance between two terminals"),
    (r"inductance_line_to_line", "inductance between two terminals"),
    (r"L_d", "inductance along the magnets"),
    (r"L_q", "inductance across the magnets"),
    (r"current_limit", "current limit"),
    (r"current_sensors\.noise", "noise of the current sensors"),
    (r"current_sensors\.bits", "bits of the current sensors"),
    (r"current_sensors\.offset\.(\d)", "offset of current sensor {1}"),
    (r"current_sensors\.gain_error\.(\d)", "gain error of current sensor {1}"),
    (r"position_sensor\.lines", "lines of the encoder"),
    (r"position_sensor\.bits", "bits of the position sensor"),
    (r"position_sensor\.latency", "delay of the position sensor"),
    (r"position_sensor\.eccentricity", "eccentricity of the position sensor"),
    (r"inverter\.dead_time", "dead time of the inverter"),
    (r"inverter\.bus_voltage", "bus voltage"),
)
OF_AN_ORDER = {
    "cogging": "cogging",
    "torque_ripple": "ripple of the torque constant",
    "flux_harmonics": "harmonic of the flux",
}


def key_words(study: AnyStudy, label: str) -> str:
    """Words for a key by the label that the page gives it; "" if there are none."""
    name, _, when = label.partition(", from trial ")
    if words := _of_order(study, name):
        return words
    for pattern, words in KEY_WORDS:
        if fit := re.search(rf"(?:^|\.)(?:{pattern})$", name):
            counted = words.replace("{1}", str(int(fit[1]) + 1) if fit.groups() else "")
            return f"{counted} from trial {when}" if when else counted
    return ""


def _of_order(study: AnyStudy, name: str) -> str:
    """Words for a value of a motor's order, such as "cogging, 72 times a revolution"."""
    fit = re.search(r"(cogging|torque_ripple|flux_harmonics)\.(\d+)\.(\w+)$", name)
    if fit is None:
        return ""
    rows: Any = study.source.tables.get("motor", {}).get(fit[1], [])
    order = rows[int(fit[2])].get("order") if int(fit[2]) < len(rows) else None
    if fit[3] == "order":
        return f"{OF_AN_ORDER[fit[1]]} {int(fit[2]) + 1}: times a revolution"
    which = f" along {fit[3]}" if fit[3] in "dq" else ""
    return f"{OF_AN_ORDER[fit[1]]}{which}, order {order:g}" if order is not None else OF_AN_ORDER[fit[1]]
