"""Each law in a row: as a study has it, as it runs in C, what init refuses, what retune must not take.

Tests of all laws go through these rows, so a new law has one of its own here and is in no other table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from cogless.control_library import C_LAWS

NOT_NEGATIVE: list[Any] = [-1.0, -1e-30, math.nan, math.inf, -math.inf]
POSITIVE = [0.0, *NOT_NEGATIVE]
FINITE = [math.nan, math.inf, -math.inf]
PI = {"kp": 0.1, "ki": 1.0, "limit": 2.0}
BAD_PI = {"kp": NOT_NEGATIVE, "ki": NOT_NEGATIVE, "limit": POSITIVE}
MEMORY = {
    "kind": 0,
    "channels": 1,
    "cells": 64,
    "turns": 1,
    "parts": 4,
    "q_half_width": 3,
    "lead": 16,
    "forgetting": 1.0,
    "limit": [2.0],
    "method": 0,
    "k_pp": 0.0,
}
BAD_MEMORY = {
    "kind": [3, 77, 0xFFFFFFFF],
    "channels": [4, 0xFFFFFFFF],
    "cells": [0, 3, 6, 65536, 0xFFFFFFFF],
    "turns": [65536, 0xFFFFFFFF],
    "parts": [65536, 0xFFFFFFFF],
    "q_half_width": [32, 65535, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF],
    "lead": [17, 65535, 0xFFFFFFFF],
    "forgetting": [1.0000002, *NOT_NEGATIVE],
    "limit": [[x] for x in POSITIVE],
}
ROBUST = {"b": 400.0, "c": 5.0, "g": 50.0, "eta": 180.0, "q": 0.1, "beta_1": 0.1, "beta_2": 0.1, "gamma": 3.0,
          "viscous": 0.0, "coulomb": 0.0, "limit": 2.0}  # fmt: skip
BAD_ROBUST = {k: NOT_NEGATIVE for k in ROBUST} | {"b": POSITIVE, "limit": POSITIVE}
BAD_ROBUST |= {"viscous": FINITE, "coulomb": FINITE}
ANTI_COGGING = {"cells": 64, "speed": 0.2, "revolutions": 1, "position_gain": 5.0, "lead": 1e-4}
BAD_ANTI_COGGING = {
    "cells": [0, 3, 65536, 0xFFFFFFFF],
    "speed": POSITIVE,
    "revolutions": [0, 101, 0xFFFFFFFF],
    "position_gain": NOT_NEGATIVE,
    "lead": NOT_NEGATIVE,
}
PI_AFC = {"orders": 3, "order": [6, 12, 18], "gain": 5.0, "lead": 1e-3, "omega_min": 0.1, "limit": 1.0}
BAD_PI_AFC = {
    "orders": [0, 17, 0x80000000, 0xFFFFFFFF],
    "order": [[0, 6, 12], [6, 6, 12], [12, 6, 18], [6, 12, 65536], [6, 0xFFFFFFFF, 12]],
    "gain": NOT_NEGATIVE,
    "lead": NOT_NEGATIVE,
    "omega_min": POSITIVE,
    "limit": POSITIVE,
}
HARMONIC = {"k_theta": 0.0, "b": 800.0, "delay": 1e-4, "step": 0.0, "base": 6, "bends": 2, "orders": 3,
            "fast": 2, "rate": 4.0, "rate_min": 1.0, "limit": 1.0,
            "held": [0.1, 0.2, *[0.0] * 6]}  # fmt: skip
BAD_HARMONIC = {
    "k_theta": NOT_NEGATIVE,
    "held": [[bad, *[0.0] * 7] for bad in NOT_NEGATIVE] + [[0.0] * 7 + [bad] for bad in NOT_NEGATIVE],
    "b": POSITIVE,
    "delay": NOT_NEGATIVE,
    "step": NOT_NEGATIVE,
    "base": [0, 65536, 30000, 0xFFFFFFFF],
    "bends": [3, 0xFFFFFFFF],
    "orders": [0, 129, 0x80000000, 0xFFFFFFFF],
    "fast": [4, 0x80000000, 0xFFFFFFFF],
    "rate": NOT_NEGATIVE,
    "rate_min": NOT_NEGATIVE,
    "limit": POSITIVE,
}
ADRC = {"b": 400.0, "omega_c": 60.0, "omega_o": 240.0, "limit": 5.0}
BAD_ADRC = {"b": POSITIVE, "omega_c": NOT_NEGATIVE, "omega_o": [2001.0, *POSITIVE], "limit": POSITIVE}
FEEDFORWARD = {"numerator": 3, "denominator": 2, "preview": 2, "num": [1.0, -0.5, 0.2], "den": [1.0, -0.5]}
BAD_FEEDFORWARD = {
    "numerator": [17, 0x80000000, 0xFFFFFFFF],
    "denominator": [0, 17, 0xFFFFFFFF],
    "preview": [65536, 0xFFFFFFFF],
    "num": [[1.0, x, 0.0] for x in FINITE],
    "den": [[0.0, 0.5], [2.0, 0.5], [1.0, -1.0], [1.0, 1.0], [1.0, 1.5], *([1.0, x] for x in FINITE)],
}
Q_FILTER = {"order": 1, "b": [0.25, 0.25], "a": [1.0, -0.5]}
BAD_Q_FILTER = {
    "order": [5, 0xFFFFFFFF],
    "b": [[0.25, x] for x in FINITE],
    "a": [[0.0, 0.5], [2.0, 0.5], [1.0, -1.0], [1.0, 1.0], [1.0, -1.5], *([1.0, x] for x in FINITE)],
}
TRIAL = {"samples": 20, "states": 2, "k_1": [-1.0, 0.5], "k_2": 0.1, "n": 1.0, "c": [1.0, 0.0],
         "through_integrator": True, "k_3": 0.5, "shift": 2, "filter_signal": False, "limit": 10.0,
         "learned_limit": 1.0, "unguarded": False}  # fmt: skip
OBSERVER = {"k_2": 0.0, "observer": {"response": 0.1, "pole": 0.4}}
BAD_OBSERVER = [
    *(OBSERVER | {"observer": {"response": x, "pole": 0.4}} for x in [*FINITE, -0.1]),
    *(OBSERVER | {"observer": {"response": 0.1, "pole": x}} for x in [*FINITE, -0.1, 1.0]),
    OBSERVER | {"k_2": 0.1},
    OBSERVER | {"shift": 1},
]
BAD_TRIAL = {
    "samples": [0, 1, 2, 6, 16777217, 0x80000000, 0xFFFFFFFF],  # 6: as many as the filter's extension
    "states": [0, 9, 0xFFFFFFFF],
    "k_1": [[0.0, x] for x in FINITE],
    "k_2": FINITE,
    "n": FINITE,
    "c": [[x, 0.0] for x in FINITE],
    "k_3": FINITE,
    "shift": [0, 20, 33, 0xFFFFFFFF],
    "limit": POSITIVE,
    "learned_limit": POSITIVE,
}
SPACE_MEMORY = MEMORY | {"kind": 2, "channels": 2, "cells": 12, "turns": 2, "parts": 3, "lead": 0,
                         "limit": [1.0, 0.1], "k_pp": 10.0}  # fmt: skip
BAD_SPACE_MEMORY = BAD_MEMORY | {
    "cells": [0, 3, 6, 16777217, 0xFFFFFFFF],
    "q_half_width": [6, 32768, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF],
    "limit": [[x, 0.1] for x in POSITIVE] + [[1.0, x] for x in POSITIVE],
    "method": [2, 0xFFFFFFFF],
    "k_pp": [1000.0, *NOT_NEGATIVE],
}
SPACE_GAINS = {"k_theta": 5.0, "k_omega": 5.0, "k_v": 0.0, "v_0": 0.0, "v_2": 0.0, "k_i": 50.0,
               "mu_alpha": 250.0, "mu_beta": 0.1, "mu_h": 0.1, "ramp": 1.0}  # fmt: skip
SPACE_POSITION = SPACE_GAINS | {"ratio": 50, "hand_over": True, "omega_min": 0.1, "index": 0, "limit": 15.0}
BAD_SPACE_POSITION = {k: NOT_NEGATIVE for k in SPACE_GAINS} | {
    "ratio": [65536, 0xFFFFFFFF],
    "omega_min": POSITIVE,
    "index": [2, 0xFFFFFFFF],
    "limit": POSITIVE,
}
SPACE_SPEED = {"k": 5.0, "mu_alpha": 1.0, "mu_beta": 1.0, "mu_h": 1.0, "eta_bar": 0.1, "omega_min": 0.1,
               "limit": 15.0, "ratio": 1}  # fmt: skip
BAD_SPACE_SPEED = {k: NOT_NEGATIVE for k in SPACE_SPEED}
BAD_SPACE_SPEED |= {
    "eta_bar": POSITIVE,
    "omega_min": POSITIVE,
    "limit": POSITIVE,
    "ratio": [65536, 0xFFFFFFFF],
}


def cases(good: dict[str, Any], bad: dict[str, list[Any]]):
    return [good | {name: value} for name, values in bad.items() for value in values]


# Laws as they run at 10 rad/s with an error that repeats each revolution.
RUNNING_PI = {"kp": 0.1, "ki": 2.0, "limit": 5.0}
RUNNING_MEMORY = {"channels": 1, "cells": 64, "turns": 1, "parts": 1, "q_half_width": 1, "forgetting": 1.0,
          "limit": [2.0]}  # fmt: skip
RUNNING_ROBUST = {
    "b": 400.0,
    "c": 5.0,
    "g": 0.0,
    "eta": 50.0,
    "q": 0.5,
    "beta_2": 5.0,
    "gamma": 200.0,
    "limit": 5.0,
}
RUNNING_POSITION = {"ratio": 1, "k_theta": 5.0, "k_omega": 0.1, "k_i": 2.0, "mu_alpha": 0.5, "omega_min": 0.1,
            "index": 1, "limit": 5.0}  # fmt: skip
RUNNING_SPEED = {"k": 0.1, "mu_alpha": 0.5, "eta_bar": 5.0, "omega_min": 0.1, "limit": 5.0, "ratio": 1}

# Laws as a study has them.
STUDY_PI = {"law": "pi", "kp": 0.1, "ki": 1.0}
STUDY_RUN = {"speed": "2 rpm", "revolutions": 1, "position_gain": 20.0}
STUDY_SPACE = {"mu_alpha": 1.0, "mu_beta": 0.1, "mu_h": 0.1, "cells": 1024, "period": {"of": "mechanical"}}

# What init would take, but decides about sizes or about what is learned.
OTHER_MEMORIES = [{"kind": 1}, {"cells": 65}, {"turns": 3}, {"parts": 1}, {"q_half_width": 2},
                  {"channels": 2, "limit": [2.0, 2.0]}]  # fmt: skip
SPACE = [{"kind": 0}, {"channels": 1}, {"cells": 13}, {"turns": 1}, {"parts": 1}, {"q_half_width": 2}]
IN_MEMORY = [{"memory": change} for change in OTHER_MEMORIES if "channels" not in change]  # one channel
IN_SPACE = [{"memory": change} for change in SPACE]


@dataclass(frozen=True)
class LawRow:
    """What tests know of a law. Configs are members of its C struct by name."""

    good: dict[str, Any]  # a config that init takes
    bad: list[dict[str, Any]]  # configs that it refuses: each field out of its range
    keys: dict[str, Any] = field(default_factory=dict)  # a table of a study; {}: a law of trials
    running: dict[str, Any] = field(default_factory=dict)  # a config with which it acts and learns
    integrals: tuple[str, ...] = ()  # members of its state that start anew after it was off
    other_sizes: tuple[dict[str, Any], ...] = ()  # changes of `good` that init takes and retune must not
    entries: int = 0  # entries of the caller's memory that `good` needs
    own_entries: int = 64  # entries of the running config's memory that stay as learned


ROWS = {
    "pi": LawRow(
        PI,
        cases(PI, BAD_PI),
        keys=STUDY_PI,
        running=RUNNING_PI,
        integrals=("integral",),
    ),
    "adrc": LawRow(
        ADRC,
        cases(ADRC, BAD_ADRC),
        keys={"law": "adrc", "b": 4000.0, "omega_c": 100.0, "omega_o": 400.0},
        running={"b": 400.0, "omega_c": 60.0, "omega_o": 240.0, "limit": 5.0},
    ),
    "pi-ilc": LawRow(
        {"pi": PI, "gain": 0.1, "memory": MEMORY},
        [
            *({"pi": PI, "gain": g, "memory": MEMORY} for g in NOT_NEGATIVE),
            *({"pi": p, "gain": 0.1, "memory": MEMORY} for p in cases(PI, BAD_PI)),
            *({"pi": PI, "gain": 0.1, "memory": m} for m in cases(MEMORY, BAD_MEMORY)),
        ],
        keys={**STUDY_PI, "law": "pi-ilc", "gain": 0.1},
        running={"pi": RUNNING_PI, "gain": 0.05, "memory": RUNNING_MEMORY},
        integrals=("pi.integral",),
        other_sizes=tuple(IN_MEMORY),
        entries=68,
    ),
    "robust-ilc": LawRow(
        ROBUST | {"memory": MEMORY},
        [
            *(c | {"memory": MEMORY} for c in cases(ROBUST, BAD_ROBUST)),
            *(ROBUST | {"memory": m} for m in cases(MEMORY, BAD_MEMORY)),
        ],
        keys={"law": "robust-ilc", "b": 4000.0, "c": 300.0, "g": 10.0, "eta": 300.0, "q": 1.0,
              "beta_1": 0.0, "beta_2": 10.0, "gamma": 10.0},
        running=RUNNING_ROBUST | {"memory": RUNNING_MEMORY | {"limit": [300.0]}},
        integrals=("error_integral", "adapted"),
        other_sizes=tuple(IN_MEMORY),
        entries=68,
    ),
    "anti-cogging": LawRow(
        ANTI_COGGING | {"pi": PI},
        [
            *(c | {"pi": PI} for c in cases(ANTI_COGGING, BAD_ANTI_COGGING)),
            *(ANTI_COGGING | {"pi": p} for p in cases(PI, BAD_PI)),
        ],
        keys={**STUDY_PI, "law": "anti-cogging", "calibration": STUDY_RUN},
        running={"pi": RUNNING_PI, "cells": 64, "speed": 1.0, "revolutions": 1},
        integrals=("pi.integral",),
        other_sizes=({"cells": 63},),
        entries=64,
    ),
    "space-position": LawRow(
        SPACE_POSITION | {"memory": SPACE_MEMORY},
        [
            *(c | {"memory": SPACE_MEMORY} for c in cases(SPACE_POSITION, BAD_SPACE_POSITION)),
            *(SPACE_POSITION | {"memory": m} for m in cases(SPACE_MEMORY, BAD_SPACE_MEMORY)),
        ],
        keys={**STUDY_SPACE, "law": "space-position", "k_theta": 5.0, "k_omega": 0.1},
        running=RUNNING_POSITION | {"memory": RUNNING_MEMORY},
        integrals=("integral",),
        other_sizes=(*IN_SPACE, {"ratio": 3}, {"index": 1}),
        entries=48,
    ),
    "space-speed": LawRow(
        SPACE_SPEED | {"memory": SPACE_MEMORY},
        [
            *(c | {"memory": SPACE_MEMORY} for c in cases(SPACE_SPEED, BAD_SPACE_SPEED)),
            *(SPACE_SPEED | {"memory": m} for m in cases(SPACE_MEMORY, BAD_SPACE_MEMORY)),
        ],
        keys={**STUDY_SPACE, "law": "space-speed", "k": 0.1, "eta_bar": "1 rad/s"},
        running=RUNNING_SPEED | {"memory": RUNNING_MEMORY},
        other_sizes=(*IN_SPACE, {"ratio": 3}),
        entries=48,
    ),
    "trial": LawRow(
        TRIAL | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER},
        [
            *(c | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER} for c in cases(TRIAL, BAD_TRIAL)),
            *(TRIAL | {"feedforward": f, "q_filter": Q_FILTER} for f in cases(FEEDFORWARD, BAD_FEEDFORWARD)),
            *(TRIAL | {"feedforward": FEEDFORWARD, "q_filter": q} for q in cases(Q_FILTER, BAD_Q_FILTER)),
            *(TRIAL | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER} | o for o in BAD_OBSERVER),
        ],
        other_sizes=({"samples": 21}, {"states": 1}, {"q_filter": {"order": 0}}),
        entries=80,
    ),
    "pi-afc": LawRow(
        PI_AFC | {"pi": PI},
        [
            *(c | {"pi": PI} for c in cases(PI_AFC, BAD_PI_AFC)),
            *(PI_AFC | {"pi": p} for p in cases(PI, BAD_PI)),
        ],
        keys={**STUDY_PI, "law": "pi-afc", "orders": [6, 24], "gain": 2.0},
        running={"pi": RUNNING_PI, "orders": 2, "order": [1, 3], "gain": 5.0, "omega_min": 0.1, "limit": 2.0},
        integrals=("pi.integral",),
        other_sizes=({"orders": 2}, {"order": [6, 12, 19]}),
        entries=9,
    ),
    "harmonic": LawRow(
        HARMONIC | {"pi": PI},
        [
            *(c | {"pi": PI} for c in cases(HARMONIC, BAD_HARMONIC)),
            *(HARMONIC | {"pi": p} for p in cases(PI, BAD_PI)),
        ],
        keys={**STUDY_PI, "law": "harmonic", "base": 6},
        running={"pi": RUNNING_PI, "b": 800.0, "base": 1, "orders": 2, "rate": 5.0, "limit": 2.0},
        integrals=("pi.integral",),
        other_sizes=({"orders": 2}, {"base": 3}),
        entries=15,
        own_entries=4,
    ),
}  # fmt: skip
BY_STEM = {C_LAWS[name].stem: row for name, row in ROWS.items()}
OF_SPEED = {name: row for name, row in ROWS.items() if row.keys}
