"""Encoders of the C library: registers to angles."""

import numpy as np
import pytest
from control_library import control_library

WRAP = 2**32


def encoder(reading: int = 0, **config: int):
    library = control_library("float")
    state = library.new("cgl_encoder")
    error = library.lib.cgl_encoder_init(state, library.new("cgl_encoder_config", **config), reading)
    return library, state, error


@pytest.mark.parametrize("bits", [8, 16, 24, 32])
@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("counts", [4, 1000, 20_000, 2**20, 3_000_000_019])
def test_a_counter_of_any_width_gives_the_angle(bits: int, backward: bool, counts: int) -> None:
    rng = np.random.default_rng(bits)
    moved = np.cumsum(rng.integers(1 - 2 ** (bits - 1), 2 ** (bits - 1), 400))  # up to half of its range
    readings = (77 + (-moved if backward else moved)) % 2**bits
    library, state, error = encoder(77 % 2**bits, counts=counts, range=2**bits % WRAP, backward=backward)
    assert error == library.lib.CGL_OK
    for reading, where in zip(readings, moved, strict=True):
        library.lib.cgl_encoder_step(state, int(reading))
        assert state.count == int(where) % WRAP
        assert state.position == int(where) % counts
        assert abs(state.turns - state.position * WRAP / counts) < 2
    assert not state.placed


def test_a_counter_that_reloads_at_a_revolution() -> None:
    library, state, _ = encoder(9_999, counts=10_000, range=10_000)
    library.lib.cgl_encoder_step(state, 3)
    assert (state.position, state.count) == (4, 4)
    library.lib.cgl_encoder_step(state, 10_000)  # it can't show this
    assert (state.position, state.count) == (4, 4)


@pytest.mark.parametrize("backward", [False, True])
def test_the_index_places_it_wherever_it_has_got_to(backward: bool) -> None:
    library, state, _ = encoder(65_000, counts=2_000, range=65_536, zero=150, backward=backward)
    way = -1 if backward else 1
    library.lib.cgl_encoder_step(state, (65_000 + 900 * way) % 65_536)
    library.lib.cgl_encoder_index(state, (65_000 + 700 * way) % 65_536)  # 200 counts ago
    assert state.placed
    assert state.position == 350
    assert state.count == 900  # the speed does not see it
    library.lib.cgl_encoder_place(state, 2_000)
    assert state.position == 350
    library.lib.cgl_encoder_place(state, 1_999)
    assert state.position == 1_999


@pytest.mark.parametrize("backward", [False, True])
def test_an_absolute_encoder_knows_where_it_is(backward: bool) -> None:
    library, state, _ = encoder(5, counts=2**14, range=2**14, zero=10, absolute=True, backward=backward)
    expected = {5: (-5) % 2**14, 10: 0, 2**14 - 1: 2**14 - 11}
    for word, position in expected.items():
        library.lib.cgl_encoder_step(state, word)
        assert state.position == ((-position) % 2**14 if backward else position)
        assert state.placed
    moved = sum((b - a + 2**13) % 2**14 - 2**13 for a, b in ((5, 10), (10, 2**14 - 1)))
    assert state.count == (-moved if backward else moved) % WRAP


@pytest.mark.parametrize(
    "config",
    [
        {"counts": 1},
        {"counts": 100, "range": 3},
        {"counts": 100, "zero": 100},
        {"counts": 100, "range": 101, "absolute": True},
    ],
)
def test_init_refuses(config: dict[str, int]) -> None:
    library, _state, error = encoder(**config)
    assert error == library.lib.CGL_ERROR_CONFIG


@pytest.mark.parametrize("precision", ["float", "double"])
def test_turns_as_radians_stay_below_a_turn(precision: str) -> None:
    lib = control_library(precision).lib
    for turns in (0, 1, 2**31, 2**32 - 1, 2**32 - 200, *range(WRAP - 4000, WRAP, 97)):
        x = lib.cgl_radians(turns)
        assert 0 <= x < (np.float32(2 * np.pi) if precision == "float" else 2 * np.pi)
        assert x == pytest.approx(turns * 2 * np.pi / WRAP, abs=1e-6)
