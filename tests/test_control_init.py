"""Every init refuses every field outside its stated range, and memory that is missing or too small."""

import math
from typing import Any

import pytest
from control_library import ControlLibrary, control_library

NOT_NEGATIVE: list[Any] = [-1.0, -1e-30, math.nan, math.inf, -math.inf]
POSITIVE = [0.0, *NOT_NEGATIVE]
FINITE = [math.nan, math.inf, -math.inf]
PI = {"kp": 0.1, "ki": 1.0, "ts": 1e-3, "limit": 2.0}
BAD_PI = {"kp": NOT_NEGATIVE, "ki": NOT_NEGATIVE, "ts": POSITIVE, "limit": POSITIVE}
MEMORY = {
    "kind": 0,
    "cells": 64,
    "periods_per_rev": 4,
    "q_half_width": 3,
    "lead": 16,
    "forgetting": 1.0,
    "limit": 2.0,
    "ts": 1e-3,
}
BAD_MEMORY = {
    "kind": [2, 77, 0xFFFFFFFF],
    "cells": [0, 3, 6, 65536, 0xFFFFFFFF],
    "periods_per_rev": [0, 65536, 0xFFFFFFFF],
    "q_half_width": [32, 65535, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF],
    "lead": [17, 65535, 0xFFFFFFFF],
    "forgetting": [1.0000002, *POSITIVE],
    "limit": POSITIVE,
    "ts": POSITIVE,
}
FOC = {"kp_d": 1.0, "ki_d": 1.0, "kp_q": 1.0, "ki_q": 1.0, "ts": 1e-4, "current_limit": 5.0, "advance": 1.5,
       "decoupling": True, "L_d": 1e-3, "L_q": 1e-3, "psi_f": 0.01}  # fmt: skip
BAD_FOC = {k: NOT_NEGATIVE for k in FOC if k != "decoupling"} | {"ts": POSITIVE, "current_limit": POSITIVE}
ROBUST = {"b": 400.0, "c": 5.0, "g": 50.0, "eta": 180.0, "q": 0.1, "beta_1": 0.1, "beta_2": 0.1, "gamma": 3.0,
          "viscous": 0.0, "coulomb": 0.0, "ts": 1e-3, "limit": 2.0}  # fmt: skip
BAD_ROBUST = {k: NOT_NEGATIVE for k in ROBUST} | {"b": POSITIVE, "ts": POSITIVE, "limit": POSITIVE}
BAD_ROBUST |= {"viscous": FINITE, "coulomb": FINITE}
ANTI_COGGING = {"cells": 64, "speed": 0.2, "revolutions": 1, "position_gain": 5.0, "lead": 1e-4}
BAD_ANTI_COGGING = {
    "cells": [0, 3, 65536, 0xFFFFFFFF],
    "speed": POSITIVE,
    "revolutions": [0, 101, 0xFFFFFFFF],
    "position_gain": NOT_NEGATIVE,
    "lead": NOT_NEGATIVE,
}


def cases(good: dict[str, Any], bad: dict[str, list[Any]]):
    return [good | {name: value} for name, values in bad.items() for value in values]


CONFIGS = {
    "pi": (PI, cases(PI, BAD_PI)),
    "foc": (FOC, cases(FOC, BAD_FOC)),
    "memory": (MEMORY, cases(MEMORY, BAD_MEMORY)),
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
    "anti_cogging": (
        ANTI_COGGING | {"pi": PI},
        [c | {"pi": PI} for c in cases(ANTI_COGGING, BAD_ANTI_COGGING)]
        + [ANTI_COGGING | {"pi": p} for p in cases(PI, BAD_PI)],
    ),
}
# entries that the good config needs
WITH_MEMORY = {"memory": 68, "pi_ilc": 68, "robust_ilc": 68, "anti_cogging": 64}


def init(library: ControlLibrary, law: str, config: dict[str, Any], pointer=None, length=100) -> int:
    arguments = [library.new(f"cgl_{law}_config", **config), library.new(f"cgl_{law}")]
    if law in WITH_MEMORY:
        memory = library.array([0.0] * 100)[1] if pointer is None else pointer
        arguments += [memory, length]
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
@pytest.mark.parametrize("law", WITH_MEMORY)
def test_refuses_missing_or_short_memory(law, precision):
    library = control_library(precision)
    good, needed = CONFIGS[law][0], WITH_MEMORY[law]
    assert init(library, law, good, length=needed) == library.lib.CGL_OK
    assert init(library, law, good, length=needed - 1) == library.lib.CGL_ERROR_MEMORY
    assert init(library, law, good, pointer=library.ffi.NULL) == library.lib.CGL_ERROR_MEMORY


@pytest.mark.parametrize("law", CONFIGS)
def test_the_test_knows_every_field(law):
    """A new field in a config must come with its range here."""
    library = control_library("double")
    fields = {name for name, _ in library.ffi.typeof(f"cgl_{law}_config").fields}
    assert fields == set(CONFIGS[law][0])


def test_robust_ilc_refuses_an_acceleration_that_overflows():
    library = control_library("float")
    config = CONFIGS["robust_ilc"][0] | {"b": 1e30, "limit": 1e30}
    assert init(library, "robust_ilc", config) == library.lib.CGL_ERROR_CONFIG
