"""Learned maps of every law through the C store: round trips, the bytes that Python has, what is refused."""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from control_library import SOURCE, ControlLibrary, control_library
from flash import Flash

from cogless import load
from cogless.maps import stored_map
from cogless.maps.learned_map import memory_of
from cogless.maps.stored_map import StoredMap

PRECISIONS = ("float", "double")
PI = {"kp": 0.1, "ki": 1.0, "limit": 3.0}
MEMORY = {
    "channels": 1,
    "cells": 60,
    "turns": 1,
    "parts": 4,
    "q_half_width": 3,
    "forgetting": 0.99,
    "limit": [1.0],
}
SPACE = {
    "channels": 3,
    "cells": 50,
    "turns": 1,
    "parts": 1,
    "q_half_width": 4,
    "forgetting": 1.0,
    "limit": [1.0, 0.1, 0.01],
}


@dataclass
class Law:
    """One law of the library with a map that it has learned."""

    state: Any
    memory: Any  # of the caller
    map: Any  # cgl_map
    result: int  # of cgl_map_of_
    step: Callable[[float, bool], float]  # at an angle, learning or not: the output


def make(c: ControlLibrary, name: str, length: int, fields: dict[str, Any]) -> Law:
    config, state = c.new(f"cgl_{name}_config", **fields), c.new(f"cgl_{name}")
    memory, pointer = c.array(np.zeros(length))
    assert getattr(c.lib, f"cgl_{name}_init")(state, config, c.loop(1e-3), pointer, length) == 0
    cgl_map = c.new("cgl_map")
    result = getattr(c.lib, f"cgl_map_of_{name}")(state, cgl_map)
    out = c.new("cgl_law_output")

    def step(theta: float, learn: bool) -> float:
        in_ = c.new(
            "cgl_law_input",
            theta_m=theta,
            theta_ref=theta + 0.002 * np.cos(7 * theta),
            omega_m=20.0 + np.sin(12 * theta),
            omega_ref=20.0,
            alpha_ref=5.0,
            learn=learn,
        )
        getattr(c.lib, f"cgl_{name}_step")(state, in_, out)
        return float(out.i_q_ref)

    return Law(state, memory, cgl_map, result, step)


def pi_ilc(c: ControlLibrary, kind: int = 0) -> Law:
    memory = MEMORY | {"kind": kind}
    return make(c, "pi_ilc", 64, {"pi": PI, "gain": 0.04, "memory": memory})


def robust_ilc(c: ControlLibrary) -> Law:
    gains = {"b": 100.0, "c": 1.0, "g": 1.0, "eta": 1.0, "q": 0.3, "beta_1": 1.0, "beta_2": 0.4, "gamma": 5.0}
    fields = {**gains, "limit": 3.0, "memory": MEMORY | {"limit": [100.0]}}
    return make(c, "robust_ilc", 64, fields)


def anti_cogging(c: ControlLibrary, limit: float = 3.0) -> Law:
    law = make(
        c, "anti_cogging", 90, {"pi": PI | {"limit": limit}, "cells": 90, "speed": 1.0, "revolutions": 1}
    )
    law.memory[:] = 0.3 * np.sin(np.arange(90.0) ** 2)
    return law


def pi_afc(c: ControlLibrary) -> Law:
    orders = {"orders": 3, "order": [3, 12, 24], "gain": 4.0, "lead": 1e-3, "omega_min": 0.1, "limit": 1.0}
    return make(c, "pi_afc", 9, {"pi": PI, **orders})


def harmonic(c: ControlLibrary) -> Law:
    gains = {"b": 800.0, "base": 3, "orders": 3, "rate": 5.0, "rate_min": 1.0, "limit": 1.0}
    law = make(c, "harmonic", 15, {"pi": PI, **gains})
    law.memory = law.memory[:9]  # behind it are gains
    return law


def space_position(c: ControlLibrary, kind: int = 0) -> Law:
    gains = {"ratio": 50, "k_theta": 5.0, "k_omega": 0.1, "mu_alpha": 2.0, "mu_beta": 1e-3, "mu_h": 1e-3}
    space = SPACE | {"kind": kind, "method": 1, "k_pp": 10.0}
    fields = {**gains, "omega_min": 0.1, "limit": 5.0, "memory": space}
    return make(c, "space_position", (4 if kind == 2 else 3) * 55, fields)


def space_speed(c: ControlLibrary) -> Law:
    fields = {"k": 0.1, "mu_alpha": 2.0, "mu_beta": 1e-3, "mu_h": 1e-3, "eta_bar": 50.0, "omega_min": 0.1}
    return make(c, "space_speed", 3 * 55, {**fields, "limit": 5.0, "ratio": 4, "memory": SPACE})


ROTARY = {
    "pi-ilc": pi_ilc,
    "robust-ilc": robust_ilc,
    "anti-cogging": anti_cogging,
    "space-position": space_position,
    "space-speed": space_speed,
    "pi-afc": pi_afc,
    "harmonic": harmonic,
}


def turn(law: Law, learn: bool = True, steps: int = 2000) -> None:
    for n in range(steps):
        law.step((0.017 * n) % (2 * np.pi), learn)


def test_what_a_map_does_not_use_is_stored_as_zero() -> None:
    """A caller's struct may hold anything there."""
    c = control_library("float")
    law = pi_ilc(c)
    law.map.limit[1], law.map.limit[2] = 5.0, 7.0
    flash = Flash(c, motor=7)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    (found,) = stored_map.find(bytes(flash.slot[0]))
    assert isinstance(found.map, StoredMap)
    assert bytes(flash.slot[0]).startswith(bytes(found.map))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", ROTARY)
def test_a_map_comes_back_and_acts_as_before(name: str, precision: str) -> None:
    c = control_library(precision)
    law, again = ROTARY[name](c), ROTARY[name](c)
    assert law.result == again.result == c.lib.CGL_MAP_OK
    turn(law)
    law.step(0.0, False)
    c.lib.cgl_map_centre(law.map)  # else a load takes the mean out
    flash = Flash(c, motor=7)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    assert flash.load(again.map) == c.lib.CGL_MAP_OK
    (found,) = stored_map.find(bytes(flash.slot[0]))
    assert isinstance(found.map, StoredMap)
    assert found.map.law_name == name
    rows, cells = found.map.channels, found.map.cells
    kept = law.memory.reshape(rows, -1)[:, :cells]
    assert np.max(np.abs(kept)) > 1e-4
    np.testing.assert_array_equal(found.map.values, kept.astype(np.float32))
    np.testing.assert_array_equal(
        again.memory.reshape(rows, -1)[:, :cells].astype(np.float32), kept.astype(np.float32)
    )
    # with the same integrals both give the same
    getattr(c.lib, f"cgl_{name.replace('-', '_')}_reset")(again.state)
    assert flash.load(again.map) == c.lib.CGL_MAP_OK
    fresh = ROTARY[name](c)
    fresh.memory[:] = law.memory
    for n in range(300):
        theta = (0.1 * n) % (2 * np.pi)
        assert again.step(theta, False) == pytest.approx(fresh.step(theta, False), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("write_size", [1, 4, 8, 16, 256])
@pytest.mark.parametrize("name", ROTARY)
def test_c_and_python_write_the_same_bytes(name: str, write_size: int, precision: str) -> None:
    c = control_library(precision)
    law = ROTARY[name](c)
    turn(law, steps=500)
    law.step(0.0, False)
    c.lib.cgl_map_centre(law.map)
    flash = Flash(c, motor=0xFEDCBA98, motion=3, write_size=write_size)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    stored = stored_map.decode(bytes(flash.slot[0]))
    image = bytes(stored)
    assert flash.slot[0] == image.ljust(len(flash.slot[0]), b"\xff")
    assert (stored.motor, stored.motion, stored.write_size) == (0xFEDCBA98, 3, write_size)
    # and C takes what Python made
    learned = [[0.5 if unit != stored_map.ORDER_CODE else 1.0] for unit in stored.units]
    other = np.float32(learned) * stored.values
    flash.slot[0][: len(image)] = bytes(replace(stored, values=other, write_size=2, sequence=9))
    again = ROTARY[name](c)
    assert flash.load(again.map) == c.lib.CGL_MAP_OK
    taken = again.memory.reshape(stored.channels, -1)[:, : stored.cells]
    np.testing.assert_array_equal(taken.astype(np.float32), other)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_trial_comes_back(precision: str) -> None:
    c = control_library(precision)
    samples = 40
    y_ref, y_pointer = c.array(np.sin(np.linspace(0, np.pi, samples)))

    def trial() -> Law:
        gains = {"k_1": [-1.0], "n": 1.0, "c": [1.0], "k_3": 0.5, "limit": 10.0, "learned_limit": 2.0}
        config = c.new("cgl_trial_config", samples=samples, states=1, shift=1, unguarded=True, **gains)
        state, cgl_map = c.new("cgl_trial"), c.new("cgl_map")
        length = 3 * samples + 16
        memory, pointer = c.array(np.zeros(length))
        assert c.lib.cgl_trial_init(state, config, pointer, length) == 0
        result = c.lib.cgl_map_of_trial(state, cgl_map)
        return Law(state, memory, cgl_map, result, lambda theta, learn: 0.0)

    law, again = trial(), trial()
    assert law.result == c.lib.CGL_MAP_OK
    out = c.new("cgl_trial_output")
    c.lib.cgl_trial_begin(law.state, y_pointer)
    for n in range(samples):
        in_ = c.new("cgl_trial_input", x=[0.5 * y_ref[n]], learn=True)
        c.lib.cgl_trial_step(law.state, in_, out)
    assert c.lib.cgl_trial_end(law.state)
    flash = Flash(c, motion=77)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    assert flash.load(again.map) == c.lib.CGL_MAP_OK
    learned = law.memory[:samples].astype(np.float32)
    assert np.max(np.abs(learned)) > 0.1
    np.testing.assert_array_equal(again.memory[:samples].astype(np.float32), learned)
    stored = stored_map.decode(bytes(flash.slot[0]))
    assert (stored.turns, stored.law_name, stored.motion, stored.angle) == (0, "trial", 77, None)
    other = Flash(c, motion=78)
    other.slot[:] = flash.slot
    assert other.load(again.map) == c.lib.CGL_MAP_OTHER_MOTION


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_angles_are_those_of_the_law(precision: str) -> None:
    """What a law does at the angle of an entry, is that entry."""
    c = control_library(precision)
    for name in [name for name in ROTARY if name not in ("pi-afc", "harmonic")]:
        law = ROTARY[name](c)
        flash = Flash(c)
        law.memory[:] = 0.0
        rows = law.memory.reshape(law.map.channels, -1)
        rows[0, 5] = 0.5
        assert flash.save(law.map) == c.lib.CGL_MAP_OK
        angle = stored_map.decode(bytes(flash.slot[0])).angle
        assert angle is not None
        without = ROTARY[name](c)
        without.memory[:] = 0.0
        theta = float(angle[5])
        # of position laws the reference counts, which `step` puts beside the angle
        while name == "space-position" and abs(theta + 0.002 * np.cos(7 * theta) - angle[5]) > 1e-12:
            theta = float(angle[5]) - 0.002 * np.cos(7 * theta)
        added = law.step(theta, False) - without.step(theta, False)
        wanted = -0.5 / 100.0 if name == "robust-ilc" else 0.5
        assert added == pytest.approx(wanted, rel=2e-3), name


@pytest.mark.parametrize("precision", PRECISIONS)
def test_amplitudes_of_other_orders_are_refused(precision: str) -> None:
    c = control_library(precision)
    law, flash = pi_afc(c), Flash(c)
    turn(law, steps=500)
    law.step(0.0, False)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    for orders in ([3, 12, 25], [2, 12, 24]):
        fields = {"pi": PI, "orders": 3, "order": orders, "omega_min": 0.1, "limit": 1.0}
        other = make(c, "pi_afc", 9, fields)
        assert flash.load(other.map) == c.lib.CGL_MAP_OTHER_LAYOUT
        assert other.memory.tolist() == [0] * 6 + orders


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_map_of_a_users_law_is_loaded_where_it_fits(precision: str) -> None:
    """Its number isn't asked for: a current over the angle, or amplitudes of these orders, serve any law."""
    c = control_library(precision)
    afc, ilc, flash = pi_afc(c), pi_ilc(c), Flash(c)
    orders = StoredMap([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [3, 12, 24]], (6, 7, 8), (3, 3, 65535), law=130)
    flash.slot[0][: len(bytes(orders))] = bytes(orders)
    assert flash.load(ilc.map) == c.lib.CGL_MAP_OTHER_LAYOUT
    assert flash.load(afc.map) == c.lib.CGL_MAP_OK
    assert afc.memory.tolist() == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 3, 12, 24])
    for entry, expected in ((0.5, c.lib.CGL_MAP_OK), (2.0, c.lib.CGL_MAP_BAD_VALUE)):  # its limit is 1 A
        ripple = entry * np.cos(2 * np.pi * np.arange(60) / 60)
        current = StoredMap(ripple, (1,), (3.0,), law=255, parts=4)
        flash.slot[0][: len(bytes(current))] = bytes(current)
        assert flash.load(ilc.map) == expected
        np.testing.assert_allclose(ilc.memory[:60], ripple / entry / 2, atol=1e-6)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", [name for name in ROTARY if name not in ("pi-afc", "harmonic")])
def test_a_load_leaves_out_the_mean_that_is_an_integrals(name: str, precision: str) -> None:
    """A map keeps its mean for a law without an integral, and for one that hands its integral over."""
    c = control_library(precision)
    law, flash = ROTARY[name](c), Flash(c)
    rows = law.memory.reshape(law.map.channels, -1)[:, : law.map.cells]
    ripple = 0.002 * np.cos(0.3 * np.arange(law.map.cells))
    rows[:] = 0.004 + ripple
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    assert flash.load(law.map) == c.lib.CGL_MAP_OK
    means = rows.mean(axis=1)
    if name in ("space-position", "space-speed"):
        assert law.map.centred == 0
        np.testing.assert_allclose(rows, np.tile(0.004 + ripple, (3, 1)), rtol=1e-6)
    else:
        assert law.map.centred == 1 and abs(means[0]) < 1e-6
        np.testing.assert_allclose(rows[0], ripple - ripple.mean(), atol=1e-6)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_orders_add_up_over_the_angle_as_the_law_adds_them(precision: str) -> None:
    c = control_library(precision)
    law, flash = pi_afc(c), Flash(c)
    law.memory[:6] = [0.1, -0.2, 0.05, 0.02, 0.1, -0.04]
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    stored = stored_map.decode(bytes(flash.slot[0]))
    assert stored.angle is None
    memory = memory_of(load("uomodri"), "1-rev-s", "pi", {"units": stored.units, "values": stored.values})
    assert memory["frame"] == "mechanical" and len(memory["angle"]) == 8 * 24
    for place in range(0, 192, 13):
        law.step(float(memory["angle"][place]), False)
        assert law.state.learned == pytest.approx(memory["current"][place], abs=1e-5)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_what_is_not_tied_to_an_angle_is_no_map(precision: str) -> None:
    c = control_library(precision)
    assert pi_ilc(c, kind=1).result == c.lib.CGL_MAP_BY_TIME
    assert space_position(c, kind=1).result == c.lib.CGL_MAP_BY_TIME


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", [n for n in ROTARY if n != "anti-cogging"])
def test_a_law_that_learns_is_to_be_frozen_first(name: str, precision: str) -> None:
    """Then none is written over a loaded map. In the last of 295 steps no law is held by its own limit."""
    c = control_library(precision)
    law = ROTARY[name](c)
    flash = Flash(c)
    turn(law, steps=295)
    assert flash.save(law.map) == flash.load(law.map) == c.lib.CGL_MAP_LEARNING
    law.step(295 * 0.017, False)
    c.lib.cgl_map_centre(law.map)
    assert flash.save(law.map) == c.lib.CGL_MAP_OK
    turn(law, steps=295)
    law.step(295 * 0.017, False)
    assert flash.load(law.map) == c.lib.CGL_MAP_OK
    stored = stored_map.decode(bytes(flash.slot[0]))
    turn(law, learn=False, steps=295)
    now = law.memory.reshape(stored.channels, -1)[:, : stored.cells]
    np.testing.assert_array_equal(now.astype(np.float32), stored.values)


def test_entries_of_a_double_that_a_float_rounds_up_are_within_their_limit() -> None:
    c = control_library("double")
    law = anti_cogging(c, limit=0.1)  # float32: 0.1 + 1.5e-9
    assert law.result == c.lib.CGL_MAP_OK
    law.memory[:] = np.where(np.arange(90) % 2, 0.1, -0.1)
    flash = Flash(c)
    assert flash.save(law.map) == flash.load(law.map) == c.lib.CGL_MAP_OK
    np.testing.assert_array_equal(np.abs(law.memory), 0.1)


@pytest.mark.parametrize("limit", [1e39, 1e-50])
def test_limits_that_a_float_does_not_hold_are_refused(limit: float) -> None:
    c = control_library("double")
    law = anti_cogging(c, limit)
    assert law.result == c.lib.CGL_MAP_INVALID
    assert Flash(c).save(law.map) == c.lib.CGL_MAP_INVALID


def test_ram_of_a_map_of_1024_entries() -> None:
    """In float on a 32-bit processor below 5 kB, pointers counted as 4 bytes of these 8."""
    c = control_library("float")
    entries = 4 * (1024 + 1)  # CGL_MEMORY_LENGTH
    state = c.ffi.sizeof("cgl_map_store") + c.ffi.sizeof("cgl_map") + c.ffi.sizeof("cgl_pi_ilc") + 64
    assert entries + state < 5000


BOARD = """
#include <stdbool.h>
#include <stdint.h>
bool board_erase_sector(uint32_t slot);
bool board_program(uint32_t slot, uint32_t offset, const uint8_t *bytes, uint32_t count);
void board_read(uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count);
uint32_t board_motor_identity(void);
bool maps_start(void);
void maps_background(bool save_wanted);
"""


def test_the_firmware_of_the_guide_compiles(tmp_path: Path) -> None:
    guide = (SOURCE.parents[1] / "docs" / "guide" / "stored-maps.md").read_text(encoding="utf-8")
    (tmp_path / "board.h").write_text(BOARD)
    code = tmp_path / "maps.c"
    code.write_text(guide.partition("```c\n")[2].partition("```")[0])
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror"]
    command = [
        "cc",
        "-std=c99",
        *warnings,
        f"-I{SOURCE}",
        f"-I{tmp_path}",
        "-c",
        "-o",
        "/dev/null",
        str(code),
    ]
    subprocess.run(command, check=True)


def test_stored_lengths_and_steps_are_those_of_the_guide() -> None:
    c = control_library("float")
    guide = (SOURCE.parents[1] / "docs" / "guide" / "stored-maps.md").read_text(encoding="utf-8")
    config = c.new("cgl_pi_ilc_config", pi=PI, gain=0.04, memory=MEMORY | {"cells": 1024, "q_half_width": 0})
    law, cgl_map = c.new("cgl_pi_ilc"), c.new("cgl_map")
    memory, pointer = c.array(np.zeros(1025))
    assert c.lib.cgl_pi_ilc_init(law, config, c.loop(1e-3), pointer, 1025) == 0
    assert c.lib.cgl_map_of_pi_ilc(law, cgl_map) == c.lib.CGL_MAP_OK
    memory[:] = 0.1
    flash = Flash(c)
    assert flash.save(cgl_map) == c.lib.CGL_MAP_OK
    stored = len(bytes(stored_map.decode(bytes(flash.slot[0]))))
    map_of_guide = "for a map with one channel, 1024 cells and a write size of 8 bytes"
    assert f"{stored} bytes {map_of_guide}" in " ".join(guide.split())
    for length, words in (
        (32, "about {} calls of `cgl_map_store_step` with a `buffer` of 32 bytes"),
        (256, "about {} with 256 bytes"),
    ):
        buffer = c.ffi.new("uint8_t[]", length)
        assert c.lib.cgl_map_store_init(flash.store, flash.config, buffer, length) == 0
        memory[:] += 0.1
        assert flash.save(cgl_map) == c.lib.CGL_MAP_OK  # both slots have a map from here on
        memory[:] += 0.1
        assert c.lib.cgl_map_store_begin(flash.store, cgl_map) == c.lib.CGL_MAP_OK
        steps = 1
        while c.lib.cgl_map_store_step(flash.store) == c.lib.CGL_MAP_BUSY:
            steps += 1
        assert words.format(round(steps, -1)) in " ".join(guide.split()), steps
