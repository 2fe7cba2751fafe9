"""Other gains while a law runs: checked as by init, refused with nothing changed, what is learned kept."""

import math
import re
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from control_library import HEADERS, SOURCE, ControlLibrary, control_library
from laws import BY_STEM, OTHER_MEMORIES
from test_control_drive import CONFIG as DRIVE
from test_control_drive import FOC, MONITOR, QUALITY
from test_control_init import CONFIGS, init
from test_control_off import LAWS, WITHOUT_MEMORY, Law

from cogless.control_library import C_LAWS

PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
PARTS: dict[str, tuple[dict[str, Any], list[dict[str, Any]]]] = {
    "monitor": (
        MONITOR,
        [MONITOR | {"hold": -1.0}, MONITOR | {"omega_max": math.nan}, MONITOR | {"phases": 1}],
    ),
    "quality": (QUALITY, [QUALITY | {"span": -1.0}, QUALITY | {"longest": 1e-4}, QUALITY | {"outlier": 0.5}]),
    "drive": (
        DRIVE,
        [
            DRIVE | {"foc": FOC | {"kp_d": -1.0}},
            DRIVE | {"monitor": MONITOR | {"hold": -1.0}},
            DRIVE | {"monitor": MONITOR | {"phases": 2}},
            DRIVE | {"quality": QUALITY | {"span": -1.0}},
            DRIVE | {"pole_pairs": 0},
        ],
    ),
}
ALL = {name: both for name, both in CONFIGS.items() if name != "feedforward"} | PARTS
# what init would take, but decides about sizes or about what is learned
OTHERS: dict[str, tuple[dict[str, Any], ...]] = {
    **{stem: row.other_sizes for stem, row in BY_STEM.items()},
    "foc": ({"phases": 3},),
    "memory": tuple(OTHER_MEMORIES),
    "monitor": (),
    "quality": (),
    "drive": (
        {"pole_pairs": 5},
        {"divider": 9},
        {"foreign": True},
        {"foc": {"phases": 2}, "monitor": {"phases": 2}},
    ),
}


def halved(value: Any, name: str = "") -> Any:
    """A config with half of all its floats; denominators stay as they are."""
    if isinstance(value, dict):
        return {key: halved(inner, key) for key, inner in value.items()}
    if isinstance(value, list):
        return [halved(inner, name) for inner in value]
    return 0.5 * value if isinstance(value, float) and name not in ("a", "den") else value


def merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    inner = {key: merged(base[key], value) for key, value in change.items() if isinstance(value, dict)}
    return base | change | inner


class Running:
    """A part of the library that runs with half the gains of its config."""

    def __init__(self, library: ControlLibrary, name: str) -> None:
        self.library, self.name = library, name
        self.memory, pointer = library.array(np.zeros(200))
        half = halved(ALL[name][0])
        self.state = library.new(f"cgl_{name}")
        assert init(library, name, half, pointer, state=self.state) == library.lib.CGL_OK
        self.memory[:] = np.linspace(-0.01, 0.02, 200)

    def retune(self, config: dict[str, Any]) -> int:
        new = self.library.new(f"cgl_{self.name}_config", **config)
        return int(getattr(self.library.lib, f"cgl_{self.name}_retune")(self.state, new))

    def bytes(self) -> bytes:
        return bytes(self.library.ffi.buffer(self.state)) + self.memory.tobytes()


def test_every_law_and_every_part_of_the_drive_is_here() -> None:
    assert {law.config.removeprefix("cgl_").removesuffix("_config") for law in C_LAWS.values()} <= ALL.keys()
    assert ALL.keys() == OTHERS.keys()
    declared = re.findall(
        r"cgl_error cgl_(\w+)_retune\(", "".join((SOURCE / "cogless" / h).read_text() for h in HEADERS)
    )
    with_tests_of_their_own = {"angle_observer", "dead_time", "encoder_table", "low_pass", "microstepping"}
    assert with_tests_of_their_own <= set(declared)
    assert set(declared) - with_tests_of_their_own == ALL.keys()


@PRECISIONS
@pytest.mark.parametrize("name", ALL)
def test_what_init_refuses_is_refused_and_nothing_changes(name: str, precision: str) -> None:
    library = control_library(precision)
    running, (good, bad) = Running(library, name), ALL[name]
    before = running.bytes()
    for config in bad:
        assert running.retune(config) == library.lib.CGL_ERROR_CONFIG, config
        assert running.bytes() == before, config
    assert running.retune(good) == library.lib.CGL_OK
    assert running.bytes() != before


@PRECISIONS
@pytest.mark.parametrize("name", ALL)
def test_other_sizes_are_refused_and_nothing_changes(name: str, precision: str) -> None:
    library = control_library(precision)
    running, good = Running(library, name), ALL[name][0]
    before = running.bytes()
    for change in OTHERS[name]:
        other = merged(good, change)
        assert init(library, name, other) == library.lib.CGL_OK, change
        assert running.retune(other) == library.lib.CGL_ERROR_CONFIG, change
        assert running.bytes() == before, change


DERIVED = ("config", "ts", "gain", "l1", "l2", "most", "row", "periods", "limits", "turned_square")


def constants(library: ControlLibrary, state: Any) -> dict[tuple[str, ...], bytes]:
    """The bytes of the config and of what init derives from it, in a state and its parts."""
    places = [(name,) for name in dir(state)]
    places += [
        (part, name)
        for part in ("pi", "memory")
        if hasattr(state, part)
        for name in dir(getattr(state, part))
    ]
    address = library.ffi.addressof
    return {
        place: bytes(library.ffi.buffer(address(state[0], *place)))
        for place in places
        if place[-1] in DERIVED
    }


@PRECISIONS
@pytest.mark.parametrize("name", [name for name in ALL if name != "drive"])
def test_the_values_taken_are_those_that_init_takes(name: str, precision: str) -> None:
    """A law of half the gains that is given the whole ones has the constants of a new law."""
    library = control_library(precision)
    running, good, new = Running(library, name), ALL[name][0], library.new(f"cgl_{name}")
    before = constants(library, running.state)
    assert running.retune(good) == library.lib.CGL_OK
    assert init(library, name, good, state=new) == library.lib.CGL_OK
    assert before != constants(library, running.state) == constants(library, new)


def run(law: Law, steps: int) -> list[float]:
    return [law.step()[0] for _ in range(steps)]


def retune(law: Law, config: dict[str, Any]) -> int:
    base = "cgl_pi" if law.name == "speed_pi" else f"cgl_{law.name}"
    return int(
        getattr(law.library.lib, f"{base}_retune")(law.state, law.library.new(f"{base}_config", **config))
    )


@pytest.mark.parametrize("name", LAWS)
def test_the_same_values_change_nothing(name: str) -> None:
    library = control_library("double")
    one, other = Law(library, name), Law(library, name)
    for law in (one, other):
        run(law, 900)
    assert retune(one, LAWS[name]) == library.lib.CGL_OK
    np.testing.assert_allclose(run(one, 900), run(other, 900), rtol=1e-9, atol=1e-12)


INTEGRALS = {
    "speed_pi": "integral",
    "adrc": "f",
    "pi_ilc": "pi.integral",
    "pi_afc": "pi.integral",
    "harmonic": "pi.integral",
    "anti_cogging": "pi.integral",
    "robust_ilc": "adapted",
    "space_position": "integral",
}


@PRECISIONS
@pytest.mark.parametrize("name", LAWS)
def test_what_is_learned_and_the_integrals_stay(name: str, precision: str) -> None:
    """With other gains: the law goes on from there, and otherwise than before."""
    library = control_library(precision)
    law, as_before = Law(library, name), Law(library, name)
    for one in (law, as_before):
        one.cell[:64] += np.sin(np.arange(64)) * (name == "anti_cogging")
        run(one, 900)
    learned = law.cell.copy()
    integral = attrgetter(INTEGRALS[name])(law.state) if name in INTEGRALS else None
    others = {"ki": 0.5, "c": 2.0, "k_i": 1.0, "k": 0.05, "omega_c": 30.0}
    change = {key: value for key, value in others.items() if key in LAWS[name]}
    change |= {"pi": LAWS[name]["pi"] | {"ki": 0.5}} if "pi" in LAWS[name] else {}
    assert change and retune(law, LAWS[name] | change) == library.lib.CGL_OK
    np.testing.assert_array_equal(law.cell, learned)
    assert learned.any() == (name not in WITHOUT_MEMORY)
    if integral is not None:
        assert integral != 0 and attrgetter(INTEGRALS[name])(law.state) == integral
    assert run(law, 200) != run(as_before, 200)


@PRECISIONS
@pytest.mark.parametrize("name", [name for name in LAWS if name == "speed_pi" or "pi" in LAWS[name]])
@pytest.mark.parametrize("kp", [0.0, 0.02, 0.3])
def test_another_proportional_gain_is_no_jump(name: str, kp: float, precision: str) -> None:
    """At the last error the output is what it was, less than the integral adds in two periods away."""
    library = control_library(precision)
    law, as_before = Law(library, name), Law(library, name)
    for one in (law, as_before):
        run(one, 900)
    config = LAWS[name]
    changed = config | {"kp": kp} if name == "speed_pi" else config | {"pi": config["pi"] | {"kp": kp}}
    assert retune(law, changed) == library.lib.CGL_OK
    for one in (law, as_before):
        one.n -= 1  # the same error again
    (now,), (then,) = run(law, 1), run(as_before, 1)
    assert abs(now - then) < 1e-5


@PRECISIONS
@pytest.mark.parametrize("name", [name for name in LAWS if name not in WITHOUT_MEMORY])
def test_a_smaller_limit_holds_for_what_is_learned_at_once(name: str, precision: str) -> None:
    library = control_library(precision)
    law, small = Law(library, name), 1e-3
    law.cell[:64] += np.sin(np.arange(64)) * (name == "anti_cogging")
    run(law, 1500)
    config = LAWS[name]
    smaller = {"pi": config["pi"] | {"limit": small}} if name == "anti_cogging" else {"limit": small}
    if "memory" in config:
        smaller = {"memory": config["memory"] | {"limit": [small]}}
    rows = law.cell[
        : 4 if name in ("pi_afc", "harmonic") else 64
    ]  # behind the map are orders, or entries of before
    assert np.abs(rows).max() > small
    assert retune(law, config | smaller) == library.lib.CGL_OK
    assert np.abs(rows).max() == library.real(small)


def test_the_share_of_learning_stays_with_another_ramp() -> None:
    library, config = control_library("double"), LAWS["space_position"] | {"ramp": 2.0}
    law = Law(library, "space_position", ramp=2.0)
    run(law, 500)
    learned = law.state.learning_samples
    assert 400 < learned < 2000
    for ramp in (8.0, 1.0):
        assert retune(law, config | {"ramp": ramp}) == library.lib.CGL_OK
        assert law.state.learning_samples * 1e-3 / ramp == pytest.approx(learned * 1e-3 / 2.0, abs=2e-3)


def test_a_calibration_keeps_its_revolutions() -> None:
    library = control_library("double")
    law, lib = Law(library, "anti_cogging"), library.lib
    more = LAWS["anti_cogging"] | {"revolutions": 2}
    lib.cgl_anti_cogging_calibrate(law.state)
    assert retune(law, more) == lib.CGL_ERROR_CONFIG
    assert retune(law, LAWS["anti_cogging"] | {"position_gain": 3.0}) == lib.CGL_OK
    lib.cgl_anti_cogging_reset(law.state)
    assert retune(law, more) == lib.CGL_OK


def test_only_init_and_retune_take_a_config() -> None:
    """So nobody can step a state with the config of another, which would write beyond its memory. Feedforward
    and the Q filter have their config in a trial's, and no memory."""
    takes_config = set()
    for header in HEADERS:
        text = re.sub(r"/\*.*?\*/", "", (SOURCE / "cogless" / header).read_text(), flags=re.DOTALL)
        for function in re.findall(r"(cgl_\w+)\(([^;{]*?const cgl_\w+_config \*[^;{]*?)\)[;\s]", text):
            takes_config.add(function[0])
    assert {"cgl_pi_ilc_init", "cgl_pi_ilc_retune", "cgl_drive_init"} <= takes_config
    helpers = {"cgl_delay_is_valid", "cgl_feedforward_reset", "cgl_feedforward_step", "cgl_zero_phase"}
    helpers |= {"cgl_trial_observer_step", "cgl_trial_observer_act"}
    helpers |= {"cgl_sum_of_squares"}  # it reads the number of phases alone
    assert {name for name in takes_config if not name.endswith(("_init", "_retune", "_bad_field"))} == helpers
