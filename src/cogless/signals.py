"""All signals of a run: those that the engine records (simulator/signals.def) and those derived from them."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache
from typing import Any

from cogless import units
from cogless.control_library import C_LAWS
from cogless.files import control_sources
from cogless.units import Dimension

SIGNAL_ROW = re.compile(r'^CGL_SIGNAL\("(\w+)", "(.*?)", "(.*?)", ([\w ]+), .*\)$', re.MULTILINE)


@dataclass(frozen=True)
class Recorded:
    """A signal that the engine records.

    `meaning`: its meaning. `when`: condition on the kinds of drive that have the signal, as in signals.def.
    """

    unit: str
    meaning: str
    when: str

    def exists(self, kinds: Collection[str]) -> bool:
        """Whether a drive of these kinds has the signal."""

        def holds(word: str) -> bool:
            return word == "true" or (word[4:] not in kinds if word.startswith("not ") else word in kinds)

        return any(all(map(holds, alternative.split(" and "))) for alternative in self.when.split(" or "))


@dataclass(frozen=True)
class Derived:
    """A signal that is computed from recorded signals: the function `of`, with the signals `needs`.

    `from_start`: the function needs the rows from a run's start on, not only those of the wanted times.
    """

    unit: str
    needs: tuple[str, ...]
    of: Callable[..., Any]
    from_start: bool = False


def _recorded() -> dict[str, Recorded]:
    text = (control_sources().parents[1] / "simulator" / "signals.def").read_text(encoding="utf-8")
    return {name: Recorded(*row) for name, *row in SIGNAL_ROW.findall(text)}


def _residual(electrical: Any, copper: Any, friction: Any, load: Any, stored: Any) -> Any:
    return electrical - (copper + friction + load) - (stored - stored[0])


def _length(d: Any, q: Any) -> Any:
    import numpy as np

    return np.hypot(d, q)


RECORDED = _recorded()
DERIVED = {
    "omega_error": Derived("rad/s", ("omega_ref", "omega_m"), operator.sub),  # reference minus true speed
    # error that the controller sees, and sensor error (measured minus true): their sum is the true error
    "omega_error_measured": Derived("rad/s", ("omega_ref", "omega_measured"), operator.sub),
    "omega_sensor_error": Derived("rad/s", ("omega_measured", "omega_m"), operator.sub),
    "i_amplitude": Derived("A", ("i_d", "i_q"), _length),  # length of the current vector
    # residual of the energy balance, which is the error of the numerical integration
    "energy_residual": Derived("J", tuple(n for n in RECORDED if n.startswith("energy_")), _residual, True),
    # torque of the motor on the rotor, including cogging
    "tau_motor": Derived("N*m", ("tau_e", "tau_cogging"), operator.add),
    "theta_error": Derived("rad", ("theta_ref", "theta_m"), operator.sub),  # reference minus true angle
    "theta_error_measured": Derived("rad", ("theta_ref", "theta_measured"), operator.sub),
    "theta_sensor_error": Derived("rad", ("theta_measured", "theta_m"), operator.sub),
    "y_error": Derived("", ("y_ref", "y"), operator.sub),  # error of a linear plant
}


def exists(name: str, kinds: Collection[str]) -> bool:
    """Whether a drive of these kinds (signals.def) has this recorded or derived signal."""
    return _exists(name, frozenset(kinds))


@cache
def _exists(name: str, kinds: frozenset[str]) -> bool:
    if name in DERIVED:
        return all(_exists(needed, kinds) for needed in DERIVED[name].needs)
    return name in RECORDED and RECORDED[name].exists(kinds)


def dimensions(kinds: Collection[str], laws: Collection[str]) -> dict[str, Dimension]:
    """Dimension of every signal of drives of these kinds, except time, and of these laws' recorded parts."""
    return dict(_dimensions(frozenset(kinds), tuple(laws)))


@cache
def _dimensions(kinds: frozenset[str], laws: tuple[str, ...]) -> dict[str, Dimension]:
    units_of = {name: signal.unit for name, signal in (RECORDED | DERIVED).items() if exists(name, kinds)}
    del units_of["time"]
    units_of |= {term.signal: term.unit for name in laws for term in C_LAWS[name].terms}
    return {name: units.dimension_of(unit) for name, unit in units_of.items()}
