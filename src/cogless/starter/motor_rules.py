"""Rules of scale: unknown figures of a motor, from its known figures and a typical motor of its class.

If all lengths of a motor are multiplied by l, its torque T grows as l^3, and these change with it:

    copper loss at its rated torque   as its surface l^2:  R / K_t^2  as  T^(-4/3)
    electrical time constant L / R    as l^2:              T^(2/3)
    inertia of the rotor              as l^5:              T^(5/3)

Another winding in the same iron changes R and L as K_t^2. So the torque follows from a resistance, and a
resistance from the torque. Cogging and friction are shares of the torque. docs/guide/new.md has these rules.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cogless.starter.part_catalogue import Part, parts

LOSS_POWER = -4 / 3  # R / K_t^2 grows with this power of the torque
TIME_POWER = 2 / 3  # L / R grows with this power of the torque
INERTIA_POWER = 5 / 3  # inertia of the rotor, likewise
COGGING_PHASES = {"cogging": 0.0, "slot_cogging": 40.0, "pole_cogging": 110.0}  # deg, assumed; all different
SAMPLES_IN_A_WAVE, TURN_SAMPLES_MOST = 64, 1_000_003  # points at which a cogging is summed
KV_TO_TORQUE = math.sqrt(3) / 2  # K_t kv of sinusoidal currents, both SI


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of a motor, SI, per phase; None: unknown. `torque`: rated; a step motor's: holding."""

    torque_constant: float | None = None
    resistance: float | None = None
    torque: float | None = None
    current: float | None = None  # peak of a phase, at the rated torque


@dataclass(frozen=True, kw_only=True)
class Sized:
    """A motor's size, SI: torque constant, rated torque and current, and ratios to the motor of its class."""

    torque_constant: float
    torque: float
    current: float
    torque_ratio: float  # rated torque / the class's
    winding_ratio: float  # (torque constant / the class's)^2

    @property
    def resistance_factor(self) -> float:
        return self.winding_ratio * math.pow(self.torque_ratio, LOSS_POWER)

    @property
    def inductance_factor(self) -> float:
        return self.resistance_factor * self.time_factor

    @property
    def time_factor(self) -> float:
        return math.pow(self.torque_ratio, TIME_POWER)

    @property
    def inertia_factor(self) -> float:
        return math.pow(self.torque_ratio, INERTIA_POWER)


def class_constant(motor: Part) -> float:
    """Torque constant of the typical motor of a class, N*m per peak ampere of a phase."""
    if "kv" in motor.figures:
        return KV_TO_TORQUE / motor["kv"].typical
    return motor["rated_torque"].typical / peak_of_coil(motor["rated_current"].typical)


def peak_of_coil(rated: float) -> float:
    """Length of the current vector of a step motor with this current in both coils, A."""
    return math.sqrt(2) * rated


def sized(motor: Part, facts: Known) -> Sized:
    """The size of a motor: from the facts that are known, and from its class where they do not suffice."""
    own, usual = class_constant(motor), motor["rated_torque"].typical
    torque = facts.torque
    constant = facts.torque_constant
    if constant is None:
        constant = torque / facts.current if torque and facts.current else own
    if torque is None:
        torque = _torque(motor, facts, constant, usual)
    current = facts.current or torque / constant
    return Sized(
        torque_constant=constant,
        torque=torque,
        current=current,
        torque_ratio=torque / usual,
        winding_ratio=(constant / own) ** 2,
    )


def _torque(motor: Part, facts: Known, constant: float, usual: float) -> float:
    """The rated torque, N*m: from the current, else from the resistance, else that of the class."""
    if facts.current:
        return constant * facts.current
    if not facts.resistance:
        return usual
    loss = facts.resistance / constant**2
    ratio = loss / (motor["resistance"].typical / class_constant(motor) ** 2)
    return usual * math.pow(ratio, 1 / LOSS_POWER)


def layouts_for(motor: Part, pole_pairs: int | None) -> list[tuple[int, int]]:
    """Slots and poles that a motor may have, the likeliest first.

    Layouts of its class come first, then layouts of other classes, then up to three balanced windings with
    about as many slots as poles. Among these, odd numbers of slots come last: they pull the rotor to a side.
    """
    if pole_pairs is None:
        return list(motor.layouts)
    poles = 2 * pole_pairs
    sold = [*motor.layouts, *(layout for part in parts("motors").values() for layout in part.layouts)]
    fitting = [(slots, p) for slots, p in sold if p == poles]
    balanced = [s for s in range(3, 3 * poles + 1, 3) if s != poles and is_balanced(s, pole_pairs)]
    balanced.sort(key=lambda slots: (slots % 2, abs(math.log(slots / poles))))
    return list(dict.fromkeys([*fitting, *((slots, poles) for slots in balanced[:3])]))


def is_balanced(slots: int, pole_pairs: int) -> bool:
    """Whether a winding in these slots can have three equal phases, 120 degrees apart."""
    return slots % (3 * math.gcd(slots, pole_pairs)) == 0


def cogging_orders(slots: int, poles: int) -> dict[str, int]:
    """Orders of the cogging in a turn: main order, slots, poles; none that equals the main order."""
    orders = {"cogging": math.lcm(slots, poles), "slot_cogging": slots, "pole_cogging": poles}
    return {key: order for key, order in orders.items() if key == "cogging" or order != orders["cogging"]}


def half_peak_to_peak(amplitudes: Mapping[str, float], orders: Mapping[str, int]) -> float:
    """Half of peak to peak of the sum of a cogging's parts, each amplitude sin(order theta + phase).

    The result has the amplitudes' unit; the phases are those of `COGGING_PHASES`.
    """
    step = math.gcd(*orders.values())  # number of periods of the sum in a turn
    count = min(SAMPLES_IN_A_WAVE * max(orders.values()) // step + 1, TURN_SAMPLES_MOST)
    theta = math.tau * np.arange(count) / count
    torque = sum(
        amplitudes[key] * np.sin(order // step * theta + math.radians(COGGING_PHASES[key]))
        for key, order in orders.items()
    )
    return float(np.ptp(torque)) / 2
