"""Every init refuses every field outside its stated range, and memory that is missing or too small."""

from typing import Any

import pytest
from control_library import ControlLibrary, control_library
from laws import (
    BAD_FEEDFORWARD,
    BAD_MEMORY,
    BAD_SPACE_MEMORY,
    BY_STEM,
    FEEDFORWARD,
    FINITE,
    MEMORY,
    NOT_NEGATIVE,
    OF_SPEED,
    POSITIVE,
    SPACE_MEMORY,
    cases,
)

from cogless.control_library import C_LAWS

FOC = {"kp_d": 1.0, "ki_d": 1.0, "kp_q": 1.0, "ki_q": 1.0, "current_limit": 5.0, "advance": 1.5,
       "decoupling": True, "L_d": 1e-3, "L_q": 1e-3, "psi_f": 0.01, "phases": 2}  # fmt: skip
BAD_FOC = {k: NOT_NEGATIVE for k in FOC if k != "decoupling"} | {"current_limit": POSITIVE}
BAD_FOC["phases"] = [1, 4, 0xFFFFFFFF]
CONFIGS = {
    **{stem: (row.good, row.bad) for stem, row in BY_STEM.items()},
    "foc": (FOC, cases(FOC, BAD_FOC)),
    "memory": (MEMORY, cases(MEMORY, BAD_MEMORY) + cases(SPACE_MEMORY, BAD_SPACE_MEMORY)),
    "feedforward": (FEEDFORWARD, cases(FEEDFORWARD, BAD_FEEDFORWARD)),
}
# pointers, which a table of values cannot give, and what goes only with other values
ELSEWHERE = {"trial": {"learning_matrix", "observer"}}
# entries that the good config needs
WITH_MEMORY = {"memory": 68, **{stem: row.entries for stem, row in BY_STEM.items() if row.entries}}


TIMELESS = {"feedforward", "trial"}  # these know samples only
LAWS = {C_LAWS[name].stem for name in OF_SPEED}


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
