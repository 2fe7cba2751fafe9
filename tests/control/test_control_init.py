"""Every init refuses every field outside its stated range, and memory that is missing or too small."""

import math
from typing import Any

import pytest
from control_library import ControlLibrary, control_library

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
FOC = {"kp_d": 1.0, "ki_d": 1.0, "kp_q": 1.0, "ki_q": 1.0, "current_limit": 5.0, "advance": 1.5,
       "decoupling": True, "L_d": 1e-3, "L_q": 1e-3, "psi_f": 0.01, "phases": 2}  # fmt: skip
BAD_FOC = {k: NOT_NEGATIVE for k in FOC if k != "decoupling"} | {"current_limit": POSITIVE}
BAD_FOC["phases"] = [1, 4, 0xFFFFFFFF]
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
SPACE_POSITION = SPACE_GAINS | {
    "ratio": 50,
    "hand_over": True,
    "omega_min": 0.1,
    "index": 0,
    "limit": 15.0,
}
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


CONFIGS = {
    "pi": (PI, cases(PI, BAD_PI)),
    "adrc": (ADRC, cases(ADRC, BAD_ADRC)),
    "foc": (FOC, cases(FOC, BAD_FOC)),
    "memory": (MEMORY, cases(MEMORY, BAD_MEMORY) + cases(SPACE_MEMORY, BAD_SPACE_MEMORY)),
    "pi_ilc": (
        {"pi": PI, "gain": 0.1, "memory": MEMORY},
        [{"pi": PI, "gain": g, "memory": MEMORY} for g in NOT_NEGATIVE]
        + [{"pi": p, "gain": 0.1, "memory": MEMORY} for p in cases(PI, BAD_PI)]
        + [{"pi": PI, "gain": 0.1, "memory": m} for m in cases(MEMORY, BAD_MEMORY)],
    ),
    "robust_ilc": (
        ROBUST | {"memory": MEMORY},
        [c | {"memory": MEMORY} for c in cases(ROBUST, BAD_ROBUST)]
        + [ROBUST | {"memory": m} for m in cases(MEMORY, BAD_MEMORY)],
    ),
    "space_position": (
        SPACE_POSITION | {"memory": SPACE_MEMORY},
        [c | {"memory": SPACE_MEMORY} for c in cases(SPACE_POSITION, BAD_SPACE_POSITION)]
        + [SPACE_POSITION | {"memory": m} for m in cases(SPACE_MEMORY, BAD_SPACE_MEMORY)],
    ),
    "space_speed": (
        SPACE_SPEED | {"memory": SPACE_MEMORY},
        [c | {"memory": SPACE_MEMORY} for c in cases(SPACE_SPEED, BAD_SPACE_SPEED)]
        + [SPACE_SPEED | {"memory": m} for m in cases(SPACE_MEMORY, BAD_SPACE_MEMORY)],
    ),
    "anti_cogging": (
        ANTI_COGGING | {"pi": PI},
        [c | {"pi": PI} for c in cases(ANTI_COGGING, BAD_ANTI_COGGING)]
        + [ANTI_COGGING | {"pi": p} for p in cases(PI, BAD_PI)],
    ),
    "pi_afc": (
        PI_AFC | {"pi": PI},
        [c | {"pi": PI} for c in cases(PI_AFC, BAD_PI_AFC)] + [PI_AFC | {"pi": p} for p in cases(PI, BAD_PI)],
    ),
    "harmonic": (
        HARMONIC | {"pi": PI},
        [c | {"pi": PI} for c in cases(HARMONIC, BAD_HARMONIC)]
        + [HARMONIC | {"pi": p} for p in cases(PI, BAD_PI)],
    ),
    "feedforward": (FEEDFORWARD, cases(FEEDFORWARD, BAD_FEEDFORWARD)),
    "trial": (
        TRIAL | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER},
        [c | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER} for c in cases(TRIAL, BAD_TRIAL)]
        + [TRIAL | {"feedforward": f, "q_filter": Q_FILTER} for f in cases(FEEDFORWARD, BAD_FEEDFORWARD)]
        + [TRIAL | {"feedforward": FEEDFORWARD, "q_filter": q} for q in cases(Q_FILTER, BAD_Q_FILTER)]
        + [TRIAL | {"feedforward": FEEDFORWARD, "q_filter": Q_FILTER} | o for o in BAD_OBSERVER],
    ),
}
# pointers, which a table of values cannot give, and what goes only with other values
ELSEWHERE = {"trial": {"learning_matrix", "observer"}}
# entries that the good config needs
WITH_MEMORY = {"memory": 68, "pi_ilc": 68, "robust_ilc": 68, "anti_cogging": 64, "pi_afc": 9, "trial": 80,
               "harmonic": 15, "space_position": 48, "space_speed": 48}  # fmt: skip


TIMELESS = {"feedforward", "trial"}  # these know samples only
LAWS = {
    "pi",
    "adrc",
    "pi_ilc",
    "robust_ilc",
    "anti_cogging",
    "pi_afc",
    "harmonic",
    "space_position",
    "space_speed",
}


def needed(law: str, config: dict[str, Any]) -> int:
    """Entries of the caller's memory that a config asks for; a trial takes more, too."""
    if law == "trial":
        return 200
    if law in ("anti_cogging", "pi_afc", "harmonic"):
        count, rows = {"anti_cogging": ("cells", 1), "pi_afc": ("orders", 3), "harmonic": ("orders", 5)}[law]
        return int(config[count]) * rows & 0xFFFFFFFF
    memory = config if law == "memory" else config["memory"]
    rows = (memory.get("channels") or 1) + (memory.get("kind", 0) == 2)
    return int(rows * (memory["cells"] + memory.get("q_half_width", 0) + 1)) & 0xFFFFFFFF


def init(
    library: ControlLibrary,
    law: str,
    config: dict[str, Any],
    pointer=None,
    length: int | None = None,
    ts: float = 1e-3,
    state=None,
) -> int:
    arguments = [state or library.new(f"cgl_{law}"), library.new(f"cgl_{law}_config", **config)]
    if law == "feedforward":
        arguments.reverse()
    if law not in TIMELESS:
        arguments.append(library.loop(ts) if law in LAWS else ts)
    if law == "memory":
        arguments.append(1)  # revolutions of its angle in one
    if law in WITH_MEMORY:
        memory = library.array([0.0] * 200)[1] if pointer is None else pointer
        arguments += [memory, min(needed(law, config), 200) if length is None else length]
    return int(getattr(library.lib, f"cgl_{law}_init")(*arguments))


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("law", CONFIGS)
def test_refuses_what_is_out_of_range(law, precision):
    library = control_library(precision)
    good, bad = CONFIGS[law]
    assert init(library, law, good) == library.lib.CGL_OK
    for config in bad:
        assert init(library, law, config) == library.lib.CGL_ERROR_CONFIG, config


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("law", sorted(CONFIGS.keys() - TIMELESS))
def test_refuses_a_period_that_is_none(law, precision):
    library = control_library(precision)
    for ts in POSITIVE:
        assert init(library, law, CONFIGS[law][0], ts=ts) == library.lib.CGL_ERROR_CONFIG, ts


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("law", WITH_MEMORY)
def test_refuses_memory_that_is_missing_misaligned_or_of_another_length(law, precision):
    """Also a length in bytes, as sizeof gives it, beside a config of so many more cells than there are."""
    library = control_library(precision)
    good, entries = CONFIGS[law][0], WITH_MEMORY[law]
    memory = library.array([0.0] * 200)[1]
    byte_later = library.ffi.cast("cgl_real *", library.ffi.cast("char *", memory) + 1)
    assert init(library, law, good, memory, entries) == library.lib.CGL_OK
    refused = [(memory, entries - 1), (library.ffi.NULL, entries)]
    if law != "trial":
        refused += [(memory, entries + 1), (memory, entries * library.real().nbytes), (byte_later, entries)]
    for pointer, length in refused:
        assert init(library, law, good, pointer, length) == library.lib.CGL_ERROR_MEMORY, length


@pytest.mark.parametrize("law", CONFIGS)
def test_the_test_knows_every_field(law):
    """A new field in a config must come with its range here."""
    library = control_library("double")
    fields = {name for name, _ in library.ffi.typeof(f"cgl_{law}_config").fields}
    assert fields == set(CONFIGS[law][0]) | ELSEWHERE.get(law, set())


@pytest.mark.parametrize("law", ["memory"])
@pytest.mark.parametrize(("kind", "most"), [(0, 65535), (1, 16777216), (2, 16777216)])
def test_a_delay_line_may_be_longer_than_a_map(law, kind, most):
    library = control_library("float")
    at_most, more = (
        CONFIGS[law][0] | {"kind": kind, "k_pp": 1.0, "cells": cells} for cells in (most, most + 1)
    )
    assert init(library, law, at_most) == library.lib.CGL_ERROR_MEMORY  # there is no more than that wrong
    assert init(library, law, more) == library.lib.CGL_ERROR_CONFIG


@pytest.mark.parametrize("kind", [0, 2])
def test_a_map_needs_no_room_for_the_angle_and_no_gain_for_p_t(kind):
    library = control_library("double")
    config = SPACE_MEMORY | {"kind": kind, "k_pp": -1.0}
    expected = library.lib.CGL_OK if kind == 0 else library.lib.CGL_ERROR_CONFIG
    assert init(library, "memory", config, length=32) == expected
    assert init(library, "memory", config | {"k_pp": 1.0}, length=32 + 8 * kind) == library.lib.CGL_OK


def test_space_memory_refuses_sums_that_overflow():
    library = control_library("float")
    assert init(library, "memory", SPACE_MEMORY | {"limit": [1e38, 0.1]}) == library.lib.CGL_ERROR_CONFIG


def test_robust_ilc_refuses_an_acceleration_that_overflows():
    library = control_library("float")
    config = CONFIGS["robust_ilc"][0] | {"b": 1e30, "limit": 1e30}
    assert init(library, "robust_ilc", config) == library.lib.CGL_ERROR_CONFIG


@pytest.mark.parametrize("bad", FINITE)
def test_trial_refuses_a_matrix_with_anything_not_finite(bad):
    library = control_library("float")
    matrix, pointer = library.array([[0.1] * 20] * 20)
    config = CONFIGS["trial"][0] | {"learning_matrix": pointer}
    assert init(library, "trial", config) == library.lib.CGL_OK
    matrix[19, 19] = bad
    assert init(library, "trial", config) == library.lib.CGL_ERROR_CONFIG


def test_trial_refuses_a_learned_part_that_overflows():
    library = control_library("float")
    config = CONFIGS["trial"][0] | {"n": 1e30, "learned_limit": 1e30}
    assert init(library, "trial", config) == library.lib.CGL_ERROR_CONFIG
