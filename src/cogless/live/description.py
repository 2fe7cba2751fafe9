"""The engine's description of a run as flat bytes, and the place of each number in the bytes.

simulator/packed_value.hpp reads these bytes. The description of a page's run also has a table "page", with
the numbers that the page itself reads.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from cogless.c_layout import control_layout
from cogless.control_library import C_LAWS
from cogless.design.kinds import DESIGNS
from cogless.design.trials.from_study import retuned
from cogless.run.drive_config import engine_config
from cogless.run.run_plan import plan
from cogless.run.simulate import Pair
from cogless.run.trial_config import engine_config as trial_config
from cogless.study import AnyStudy, Study, TrialStudy
from cogless.study.base import Kind

NONE, BOOL, INTEGER, NATURAL, REAL, TEXT, NUMBERS, LIST, TABLE, MATRIX = range(10)
STRUCTS = {
    "drive.control": "cgl_drive_config",
    "drive.current_reference": "cgl_current_reference_config",
    "drive.encoder_table": "cgl_encoder_table_config",
    "drive.dead_time": "cgl_dead_time_config",
}
SPARE_ORDERS = 3  # number of cogging orders that a page can add
REAL_VALUE = struct.Struct("<IId")
POINTER_BYTES = 4  # bytes of a pointer in WebAssembly


class Number(NamedTuple):
    """A number in the bytes. `format`: as Python's struct module names it."""

    path: str
    offset: int
    format: str

    def read(self, data: bytes) -> float:
        return float(struct.unpack_from(f"<{self.format}", data, self.offset)[0])

    def write(self, data: bytearray, value: float) -> None:
        """Write the value, rounded if the number's format is a whole one."""
        struct.pack_into(f"<{self.format}", data, self.offset, value if self.format in "df" else round(value))


@dataclass(frozen=True)
class Packed:
    """A description as bytes. `numbers`: all numbers in it. `shape`: all else, such as keys and lengths."""

    data: bytes
    numbers: tuple[Number, ...]
    shape: tuple[str, ...]


Place = tuple[str, str, str]  # scenario, controller, "run" or "learn"
PackedRuns = Mapping[Place, Packed]


def pack(description: Mapping[str, Any], precision: str) -> Packed:
    """Pack a description. TypeError: a value has a type that can't be packed."""
    law = C_LAWS.get(description["controller"]["law"])
    structs = STRUCTS | ({"controller.config": law.config} if law else {})
    packer = _Packer(precision, structs)
    packer.value(description, "")
    return Packed(bytes(packer.data), tuple(packer.numbers), tuple(packer.shape))


@lru_cache(maxsize=256)
def _numbers_of_struct(precision: str, name: str, path: str, begin: int) -> list[Number]:
    leaves = control_layout(precision, POINTER_BYTES).leaves(name)
    return [Number(f"{path}.{leaf.path}", begin + leaf.offset, leaf.format) for leaf in leaves]


@lru_cache(maxsize=256)
def _numbers_of_row(path: str, begin: int, count: int) -> list[Number]:
    return [Number(f"{path}.{n}", begin + 8 * n, "d") for n in range(count)]


def _padded(text: bytes) -> bytes:
    return text + bytes(-len(text) % 8)


@cache
def _key_bytes(key: str) -> bytes:
    return struct.pack("<Q", len(key.encode())) + _padded(key.encode())


class _Packer:
    def __init__(self, precision: str, structs: Mapping[str, str]) -> None:
        self.precision, self.structs, self.data = precision, structs, bytearray()
        self.numbers: list[Number] = []
        self.shape: list[str] = []

    def value(self, of: Any, path: str) -> None:
        put = _put(of.__class__)
        if put is None:
            raise TypeError(f"{path}: {type(of).__name__}: expected a plain value")
        put(self, of, path)

    def none(self, _: None, path: str) -> None:
        self._head(NONE, 0, path)

    def boolean(self, of: bool, path: str) -> None:
        self.numbers.append(Number(path, len(self.data) + 4, "I"))
        self.data += struct.pack("<II", BOOL, of)
        self.shape.append(f"{path} bool")

    def integer(self, of: int, path: str) -> None:
        signed = -(2**63) <= of < 2**63
        self._head(INTEGER if signed else NATURAL, 0, path)
        self._number(path, "q" if signed else "Q", of)

    def real(self, of: float, path: str) -> None:
        self.numbers.append(Number(path, len(self.data) + 8, "d"))
        self.data += REAL_VALUE.pack(REAL, 0, of)
        self.shape.append(path)

    def string(self, of: str, path: str) -> None:
        self._head(TEXT, len(of.encode()), f"{path}={of}")
        self.data += _padded(of.encode())

    def struct(self, of: bytes, path: str) -> None:
        name = self.structs[path]
        ours, theirs = control_layout(self.precision), control_layout(self.precision, POINTER_BYTES)
        if ours.size(name) != theirs.size(name):
            of = theirs.pack(name, ours.decode(name, of))
        self._head(TEXT, len(of), path)
        self.numbers += _numbers_of_struct(self.precision, name, path, len(self.data))
        self.data += _padded(of)

    def table(self, of: Mapping[str, Any], path: str) -> None:
        self._head(TABLE, len(of), path)
        for key, value in of.items():
            self.data += _key_bytes(key)
            self.value(value, f"{path}.{key}" if path else key)

    def matrix(self, of: Any, path: str) -> None:
        if of.ndim == 1:
            self.items(of.tolist(), path)
            return
        rows, columns = of.shape
        self._head(MATRIX, rows, f"{path} {rows}x{columns}")
        self.data += struct.pack("<Q", columns)
        self._row(of.ravel(), path)

    def items(self, of: Any, path: str) -> None:
        items = list(of)
        if items and all(type(item) is float for item in items):
            self._head(NUMBERS, len(items), path)
            self._row(items, path)
            return
        self._head(LIST, len(items), path)
        for n, item in enumerate(items):
            self.value(item, f"{path}.{n}")

    def _head(self, kind: int, count: int, shape: str) -> None:
        self.data += struct.pack("<II", kind, count)
        self.shape.append(f"{shape} {kind} {count}")

    def _row(self, values: Any, path: str) -> None:
        self.numbers += _numbers_of_row(path, len(self.data), len(values))
        self.data += np.asarray(values, "<f8").tobytes()

    def _number(self, path: str, format: str, value: float) -> None:
        self.numbers.append(Number(path, len(self.data), format))
        self.data += struct.pack(f"<{format}", value)


PACKERS: tuple[tuple[type | tuple[type, ...], Callable[[_Packer, Any, str], None]], ...] = (
    (type(None), _Packer.none),
    (bool, _Packer.boolean),
    ((int, np.integer), _Packer.integer),
    ((float, np.floating), _Packer.real),
    (str, _Packer.string),
    (bytes, _Packer.struct),
    (Mapping, _Packer.table),
    (np.ndarray, _Packer.matrix),
    ((list, tuple), _Packer.items),
)


@cache
def _put(kind: Any) -> Callable[[_Packer, Any, str], None] | None:
    """The packer's method for values of a class; None: such values can't be packed."""
    return next((put for base, put in PACKERS if issubclass(kind, base)), None)


def page_runs(study: AnyStudy) -> list[Pair]:
    """The runs that a page can hold: all but those of the laws that `left_out` names."""
    return [pair for pair in every(study) if not study.once(why_not, pair[1])]


def left_out(study: AnyStudy) -> list[str]:
    """The controllers that a page leaves out and why, a sentence for each."""
    return [f"{study.label(name)}: {why}." for name in study.controller if (why := study.once(why_not, name))]


def why_not(study: AnyStudy, name: str) -> str:
    """Why a page leaves a controller out; "" if it doesn't."""
    if study.controller[name].NOT_ON_PAGE:
        return study.controller[name].NOT_ON_PAGE
    run = next((pair for pair in every(study) if pair[1] == name), None)
    refused = None if run is None else DESIGNS[study.kind].prepared(study, [run]).refused.get(run)
    return "" if refused is None else f"not designed: {refused.text_without(study.source.path)}"


def every(study: AnyStudy) -> Iterator[Pair]:
    return ((scenario, name) for scenario in study.scenario for name in study.controllers_in(scenario))


def blobs(study: AnyStudy, scenario: str, controller: str, like: AnyStudy | None = None) -> dict[str, Packed]:
    """The packed descriptions of a run: "run", and "learn" if a commissioning run comes before it.

    `like`: the study from which this one was changed. For trials, the designs of `like` are reused.
    StudyError or MisfitError: the study's values allow no run.
    """
    return BLOBS[study.kind](study, scenario, controller, like)


def _of_speed(study: Study, scenario: str, controller: str, like: Study | None) -> dict[str, Packed]:
    descriptions = {"run": _blob(study, scenario, controller)}
    run = study.controller[controller].commissioning
    if run is not None:
        description = engine_config(study, scenario, controller, "learn")
        # as long as plan.py waits for it
        longest = 3 * run.duration * study.drive.rates.current_loop
        descriptions["learn"] = _packed(
            study, _with_spares(description) | {"page": {"ticks": math.ceil(longest)}}
        )
    return descriptions


def _blob(study: Study, scenario: str, controller: str) -> Packed:
    law, timing, conditions = study.controller[controller], study.timing(scenario), study.conditions(scenario)
    page: dict[str, Any] = {
        "ticks": timing.ticks,
        "decimation": timing.decimation,
        "divider": timing.divider,
        "pole_pairs": conditions.pole_pairs,
        "R_s": conditions.R_s,
        "power_factor": conditions.power_factor,
        "speed_period": conditions.speed_period,
        "pwm_period": conditions.pwm_period,
        "events": list(conditions.events),
        "unit": float(np.float32(law.unit)) if study.precision == "single" else float(law.unit),
        "ratio": law.ratio(conditions.pole_pairs),
    }
    if law.begins_with is not None:
        learned = plan(study, scenario, controller).learned
        page["learned"] = np.asarray(learned, np.float64)
    return _packed(study, _with_spares(engine_config(study, scenario, controller)) | {"page": page})


def _with_spares(description: dict[str, Any]) -> dict[str, Any]:
    """The description with spare cogging orders, without torque, after the motor's own orders.

    A spare order repeats an order that the motor has already. A new order would change how the engine
    computes the other orders by multiplication, and so their last bits.
    """
    motor = description["motor"]
    order = motor["cogging"][0]["order"] if motor["cogging"] else motor["pole_pairs"]
    spare = [{"order": order, "torque": 0.0, "phase": 0.0}] * SPARE_ORDERS
    return description | {"motor": motor | {"cogging": [*motor["cogging"], *spare]}}


def _of_trials(
    study: TrialStudy, scenario: str, controller: str, like: TrialStudy | None
) -> dict[str, Packed]:
    run, timing, conditions = (scenario, controller), study.timing(scenario), study.conditions(scenario)
    design = retuned(study, run, study if like is None else like)
    page = {
        "trials": conditions.trials,
        "ticks": study.samples(scenario) * timing.divider,  # ticks of one trial
        "decimation": timing.decimation,
        "divider": timing.divider,
        "pole_pairs": conditions.pole_pairs,
        "starts": [int(start) for start in conditions.starts],
    }
    return {"run": _packed(study, trial_config(study, scenario, controller, design) | {"page": page})}


BLOBS: Mapping[Kind, Callable[..., dict[str, Packed]]] = {"speed": _of_speed, "trials": _of_trials}


def _packed(study: AnyStudy, description: dict[str, Any]) -> Packed:
    return pack(description, study.precision)
