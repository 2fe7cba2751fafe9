"""Data of a motor from datasheets: measured tables, and words for magnet and winding.

Measured cogging and back-EMF are CSV tables over a revolution, which become harmonics for the plant: the
orders that the study names, or else the largest ones. Without named orders, the orders that are left out must
be a small share of the table.

Words of datasheets for a motor's magnet, resistance and inductance are converted.

A word's name says how the number is measured: on a winding, from line to line or from line to star point
(phase), rms or peak. If a motor has several words for one quantity they must agree: datasheets are often
misread by a factor of 2, sqrt 2 or sqrt 3.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cogless import units
from cogless.study.csv_table import OverAngle, read
from cogless.study.table import AngularSpeed, Current, File, Many, Table, Torque, Voltage, invalid

MOST_ORDERS = 48  # largest number of orders from a table without named orders; each costs time in every step
LEFT_OUT = 0.02  # share of a table's rms that may be left out, without named orders
OFFSET_MOST = 0.1  # largest mean / rms
FUNDAMENTAL_LEAST = 0.1  # smallest fundamental / rms; with wrong pole pairs there is no fundamental
AGREEMENT_MOST = 0.05  # relative difference at which a stated size still agrees with the table

TableOrder = Annotated[int, Field(ge=1, le=10_000)]
Wave = tuple[int, complex]  # order n of the table and coefficient c: Re(c e^{j n angle})


class AngleFile(Table):
    """A CSV table over a revolution, mechanical or electrical. `orders`: of that revolution."""

    file: File
    """CSV file with a column `angle` and a column of values, with their units in the first line. For cogging,
    the values are a `torque`, or a `current`: the torque divided by $K_t$ (torque per peak ampere). For a
    back-EMF, they are a `voltage`, measured while the motor turns forwards; the rotor may have any position
    at the angle zero."""
    frame: Literal["mechanical", "electrical"]
    """Whether the table spans a mechanical or an electrical revolution. From a back-EMF over a mechanical
    revolution, cogless takes only orders that are multiples of `pole_pairs`."""
    orders: Many[TableOrder] | None = None
    """Orders to take from the table, in waves per revolution of its angle. Default: the orders with the
    largest amplitudes. All other orders together then have at most 2 % of the table's rms value."""
    _table: OverAngle = PrivateAttr()

    def _waves(
        self, needed: Iterable[int] = (), without_effect: int | None = None, key: tuple[str, ...] = ()
    ) -> list[Wave]:
        """The waves of the table that the plant gets.

        `needed`: orders that are always taken. Multiples of `without_effect` are never taken. `key`: key of
        this table in the validated table, for errors.
        """
        table = self._table
        highest = (len(table.angle) - 1) // 2
        all_ = [
            (n, cmath.rect(amplitude, phase - math.pi / 2))
            for n, (amplitude, phase) in enumerate(table.harmonics(highest))
        ]
        mean = all_[0][1].real
        rms = math.sqrt(sum(abs(c) ** 2 for _, c in all_[1:]) / 2)
        if abs(mean) > OFFSET_MOST * rms:
            raise invalid(
                f"expected a mean of zero, not {mean / rms:.3g} times the rms: perhaps the table contains "
                "friction or an offset",
                *key,
                "file",
            )
        waves = [(n, c) for n, c in all_[1:] if without_effect is None or n % without_effect]
        if self.orders is not None:
            orders = {*self.orders, *needed}
            if max(orders) > highest:
                raise invalid(
                    f"expected orders up to {highest}, half the points of the table", *key, "orders"
                )
            return [(n, c) for n, c in waves if n in orders]
        power = sum(abs(c) ** 2 for _, c in waves)
        taken, rest = list[Wave](), power
        for n, c in sorted(waves, key=lambda wave: (wave[0] not in needed, -abs(wave[1]))):
            if rest <= (LEFT_OUT**2) * power and not {*needed} - {n for n, _ in taken}:
                break
            taken.append((n, c))
            rest -= abs(c) ** 2
        if len(taken) > MOST_ORDERS:
            raise invalid(
                f"expected a table of which {MOST_ORDERS} orders or fewer hold all but {LEFT_OUT:.0%} of "
                f"the rms; this one needs {len(taken)}: choose orders with the key orders",
                *key,
                "file",
            )
        return sorted(taken)

    def _check_size(self, unit: str, start: str = "") -> None:
        """Refuse a stated peak that the table does not have. `start`: prefix of the keys that state peaks."""
        low, high = min(self._table.value), max(self._table.value)
        for key, size in ((f"{start}peak", max(-low, high)), (f"{start}peak_to_peak", high - low)):
            stated = getattr(self, key)
            if stated is None or math.isclose(stated, size, rel_tol=AGREEMENT_MOST):
                continue
            twice = any(
                math.isclose(stated, factor * size, rel_tol=2 * AGREEMENT_MOST) for factor in (2, 0.5)
            )
            why = "; peak and peak to peak differ by a factor of 2" if twice else ""
            raise invalid(f"expected about {size:.4g} {unit}, as the table has{why}", key)


def _folder(info: ValidationInfo) -> Path:
    return Path(info.context["folder"]) if info.context else Path()


class CoggingTable(AngleFile):
    """Measured cogging: torque, or the current that is it over K_t, over the angle."""

    sign: Literal["on-rotor", "holding"]
    """Meaning of the table's values. `on-rotor`: the cogging torque on the rotor. `holding`: the opposite
    torque, which holds the rotor at its angle."""
    peak: Torque | None = None  # N*m
    """Largest magnitude of the cogging torque that the datasheet states. cogless refuses a table whose peak
    differs by more than 5 %. Default: no check."""
    peak_to_peak: Torque | None = None  # N*m
    """Peak-to-peak cogging torque that the datasheet states. cogless refuses a table whose peak-to-peak
    torque differs by more than 5 %. Default: no check."""
    current_peak: Current | None = None  # A
    """Largest magnitude of the cogging current that the datasheet states, for a table with the column
    `current`. cogless refuses a table whose peak differs by more than 5 %. Default: no check."""
    current_peak_to_peak: Current | None = None  # A
    """Peak-to-peak cogging current that the datasheet states, for a table with the column `current`. cogless
    refuses a table whose peak-to-peak current differs by more than 5 %. Default: no check."""

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> Self:
        columns = {"torque": units.TORQUE, "current": units.CURRENT}
        self._table = read(_folder(info) / self.file, columns)
        of_current = self._table.name == "current"
        for key in ("peak", "peak_to_peak"):
            if getattr(self, key if of_current else f"current_{key}") is not None:
                other, name = (f"current_{key}", "current") if of_current else (key, "torque")
                wrong = key if of_current else f"current_{key}"
                raise invalid(f'expected the key "{other}" instead, since the table has a {name}', wrong)
        self._check_size("A" if of_current else "N*m", "current_" if of_current else "")
        self._waves()
        return self

    @property
    def points(self) -> int:
        """Points of the table."""
        return len(self._table.angle)

    def highest(self, pole_pairs: int) -> int:
        """The highest mechanical order that the points of the table resolve."""
        return (self.points - 1) // 2 * (pole_pairs if self.frame == "electrical" else 1)

    def harmonics(self, K_t: float, pole_pairs: int) -> list[tuple[int, float, float]]:
        """Mechanical order, torque (N*m) and phase (rad) of each harmonic; `K_t` in N*m/A."""
        turns = pole_pairs if self.frame == "electrical" else 1
        factor = (K_t if self._table.name == "current" else 1.0) * (-1 if self.sign == "holding" else 1)
        return [(n * turns, factor * abs(c), cmath.phase(c) + math.pi / 2) for n, c in self._waves()]


class BackEmfTable(AngleFile):
    """Measured back-EMF over the angle, turning forwards at a constant speed.

    All phases are alike, a third of an electrical revolution apart. The fundamental says where the d axis is.
    """

    between: Literal["line-to-line", "phase"]
    """Where the voltage was measured. `line-to-line`: between two lines. `phase`: between a line and the star
    point."""
    speed: AngularSpeed  # rad/s
    """Mechanical speed at which the voltage was measured."""
    peak: Voltage | None = None  # V
    """Largest magnitude of the voltage that the datasheet states. cogless refuses a table whose peak differs
    by more than 5 %. Default: no check."""
    peak_to_peak: Voltage | None = None  # V
    """Peak-to-peak voltage that the datasheet states. cogless refuses a table whose peak-to-peak voltage
    differs by more than 5 %. Default: no check."""

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> Self:
        if self.speed <= 0:
            raise invalid("expected a speed above zero", "speed")
        self._table = read(_folder(info) / self.file, {"voltage": units.VOLTAGE})
        self._check_size("V")
        return self

    def flux(self, pole_pairs: int) -> tuple[float, list[tuple[int, float, float, float, float]]]:
        """psi_f of the star equivalent (Wb), and its harmonics: electrical order, d, q (Wb), their phases.

        An electrical order n of phase a, voltage per electrical speed Re(c e^{j n theta_e}), is c / (j n) of
        order n - 1 in psi_d + j psi_q if n is 1, 4, 7, ..., and the conjugate of order -(n + 1) if n is 2, 5,
        8, ... Multiples of 3 are alike in all phases and have no effect.
        """
        per_turn = pole_pairs if self.frame == "mechanical" else 1
        waves = self._waves((per_turn,), 3 * per_turn, ("back_emf_table",))
        rms, fundamental = math.hypot(*(abs(c) for _, c in waves)), abs(dict(waves)[per_turn])
        if fundamental <= FUNDAMENTAL_LEAST * rms:
            expected = (
                f"expected a fundamental (order {per_turn}) of more than {FUNDAMENTAL_LEAST:.0%} of the rms"
            )
            raise invalid(f"{expected}: perhaps pole_pairs or frame is wrong", "back_emf_table", "file")
        of_phase = {
            n // per_turn: c / (pole_pairs * self.speed) / self._difference(n // per_turn)
            for n, c in waves
            if n % per_turn == 0
        }
        zero = cmath.phase(of_phase[1]) - math.pi / 2  # minus the table's angle at which theta_e is zero
        linkage = dict[int, complex]()
        for n, c in of_phase.items():
            wave = c * cmath.exp(-1j * n * zero) / (1j * n)
            forward = n % 3 == 1
            order = n - 1 if forward else -(n + 1)
            linkage[order] = linkage.get(order, 0j) + (wave if forward else wave.conjugate())
        psi_f = linkage.pop(0).real
        harmonics = []
        for h in sorted({abs(order) for order in linkage}):
            plus, minus = linkage.get(h, 0j), linkage.get(-h, 0j).conjugate()
            d, q = plus + minus, plus - minus
            harmonics.append((h, abs(d), abs(q), cmath.phase(d), cmath.phase(q)))
        return psi_f, harmonics

    def _difference(self, n: int) -> complex:
        """Ratio of the table's voltage to the voltage of phase a, at electrical order n."""
        return 1 - cmath.exp(-2j * math.pi * n / 3) if self.between == "line-to-line" else 1.0


FACTOR_TOLERANCE = 0.03  # relative difference up to which a ratio counts as a known factor

# Ratio of K_t, torque per peak line current, to each back-EMF constant, for sinusoidal phases. Speed
# constants are the reciprocals of back-EMF constants.
PER_BACK_EMF = {
    "line_to_line_peak": math.sqrt(3) / 2,
    "line_to_line_rms": math.sqrt(1.5),
    "phase_peak": 1.5,
    "phase_rms": 1.5 * math.sqrt(2),
}
BACK_EMF = {f"K_e_{kind}": factor for kind, factor in PER_BACK_EMF.items()}
PER_SPEED_CONSTANT = {"kv": PER_BACK_EMF["line_to_line_peak"]} | {
    f"kv_{kind}": factor for kind, factor in PER_BACK_EMF.items() if kind != "line_to_line_peak"
}
OF_TWO_LINES = ("kv", "K_e_line_to_line_peak")
OF_A_PHASE = [word for word in (*BACK_EMF, *PER_SPEED_CONSTANT) if "phase" in word]
MAGNET = ("psi_f", "K_t", "K_t_rms", *PER_SPEED_CONSTANT, *BACK_EMF)  # the first that is given counts
RESISTANCE_KEYS = ("R_s", "resistance_line_to_line")
INDUCTANCE_KEYS = ("L_d", "L_q", "inductance_line_to_line")
STEP_MOTOR_WORDS = (("teeth", "step_angle"), ("L_m", "holding_torque"), ("L_f", "detent_torque"))

# words of datasheets, with the key that the study has in their place
OTHER_WORDS = {"torque_constant": "K_t", "J": "mechanics.inertia", "inertia": "mechanics.inertia"}

RMS_AND_PEAK, PHASE_AND_LINES = "rms and peak", "phase and line to line"
MIXED_UP = (
    (math.sqrt(2), "sqrt(2)", RMS_AND_PEAK),
    (math.sqrt(3), "sqrt(3)", PHASE_AND_LINES),
    (math.sqrt(1.5), "sqrt(3/2)", "the peak value of a phase and the rms value from line to line"),
    (math.sqrt(6), "sqrt(6)", "the rms value of a phase and the peak value from line to line"),
    (2 / math.sqrt(3), "2/sqrt(3)", "K_t and 1/kv, which is 2/sqrt(3) K_t"),
    (1.5, "3/2", "one phase and all three"),
    (3.0, "3", "star and delta"),
    (2.0, "2", f"{PHASE_AND_LINES}, or poles and pole pairs"),
)


def replaced_by(key: str) -> frozenset[str]:
    """Other keys of [motor] that state the same quantity as `key`; a change of `key` removes them."""
    for words in (MAGNET, RESISTANCE_KEYS, *STEP_MOTOR_WORDS):
        if key in words:
            return frozenset(words) - {key}
    if key == "inductance_line_to_line":
        return frozenset(INDUCTANCE_KEYS) - {key}
    return frozenset(INDUCTANCE_KEYS[2:]) if key in INDUCTANCE_KEYS else frozenset()


def replaced_by_any(keys: Iterable[str]) -> frozenset[str]:
    """All keys of [motor] that a change of one of these keys removes."""
    return frozenset[str]().union(*map(replaced_by, keys))


def torque_constant(word: str, value: float, pole_pairs: int, flux_factor: float) -> float:
    """K_t of the star equivalent, N*m per peak A, from one of the words for the magnet.

    `flux_factor`: flux linkage of the star equivalent / flux linkage of a winding.
    """
    if word == "psi_f":
        return 1.5 * pole_pairs * flux_factor * value
    if word == "K_t_rms":
        return value / math.sqrt(2)
    if word in PER_SPEED_CONSTANT:
        return PER_SPEED_CONSTANT[word] / value
    return BACK_EMF[word] * value if word in BACK_EMF else value


def check_agreement(by_word: Mapping[str, float]) -> None:
    """Refuse words for one quantity that disagree. `by_word`: the quantity as computed from each word."""
    first, *others = by_word
    for other in others:
        if not math.isclose(by_word[other], by_word[first], rel_tol=AGREEMENT_MOST):
            why = _block_commutated(by_word, first, other) or _why(by_word[other], by_word[first])
            raise invalid(f"expected {first} and {other} to agree within {AGREEMENT_MOST:.0%}{why}", other)


def _block_commutated(by_word: Mapping[str, float], first: str, other: str) -> str:
    """Text that says which key to delete if K_t is a value of block commutation; "" in other cases.

    Block commutation has current in two phases at a time. Its torque per current is the back-EMF between two
    lines over the speed, 1 / kv. Three sinusoidal currents of the same peak give sqrt(3)/2 of that torque,
    which is K_t here (`PER_BACK_EMF`). So the back-EMF stays, and the datasheet's K_t goes.
    """
    if first != "K_t" or other not in OF_TWO_LINES:
        return ""
    if abs(by_word["K_t"] / by_word[other] * PER_BACK_EMF["line_to_line_peak"] - 1) > FACTOR_TOLERANCE:
        return ""
    return (
        "; K_t = 1/kv holds for block commutation, but with sinusoidal currents K_t is sqrt(3)/2 of "
        "1/kv: delete K_t"
    )


def _why(one: float, other: float) -> str:
    times = max(one, other) / min(one, other) if one and other else math.inf
    return mixed_up(times, FACTOR_TOLERANCE) or f"; they differ by a factor of {times:.3g}"


def mixed_up(times: float, near: float) -> str:
    """Text on what is mixed up if two values differ by about the factor `times`; "" for an unknown factor.

    `near`: largest relative difference from a known factor.
    """
    factor, name, mixed = min(MIXED_UP, key=lambda entry: abs(times / entry[0] - 1))
    if abs(times / factor - 1) > near:
        return ""
    return f"; the values differ by {name}, the factor between {mixed}"
