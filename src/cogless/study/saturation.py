"""Flux linkages of a motor over its currents, by tables: saturation of L_d, L_q and of the magnets' flux.

Temperatures of a motor's winding and magnets, which change resistance and flux.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise, product
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationInfo, model_validator

from cogless.study.csv_table import rising
from cogless.study.table import (
    Current,
    File,
    FluxAmplitude,
    HeatCapacity,
    Inductance,
    Many,
    Table,
    Temperature,
    TemperatureCoefficient,
    ThermalResistance,
    check_one,
    excluded,
    invalid,
)
from cogless.units import CURRENT, FLUX_LINKAGE, INDUCTANCE, Dimension

START_DIFFERENCE_MOST = 0.1  # relative difference of a table's inductance at zero current from L_d or L_q
Points = tuple[tuple[float, ...], tuple[float, ...]]  # currents (A) and flux linkages (Wb)


class CurrentFile(Table):
    """Values over a current, here or in a CSV file with the same columns."""

    current: Many[Current] = ()  # A
    """Currents of the table, rising. In `d` and `q`: from zero on if the axis is alike for both directions of
    the current (cogless then mirrors the table); otherwise negative currents, zero and positive currents. In
    `magnet`: values of $i_q$ from zero on."""
    flux: Many[FluxAmplitude] | None = None  # Wb
    """Flux linkage at each current of the table, zero at zero current. In `d` the slope at zero current may
    differ from `L_d` by at most 10 %, in `q` from `L_q`. In `magnet`: change of the magnets' flux linkage by
    the current, negative if the motor saturates."""
    file: File | None = None
    """CSV file that replaces `current` and `flux` (in `d` and `q` also `inductance`): it has columns of these
    names, with their units in the first line."""

    def _with_file(self, info: ValidationInfo, columns: Mapping[str, Dimension]) -> Self:
        """The table with the values of its file, if it has one."""
        if self.file is None or not info.context:
            return self
        for name in ("current", *columns):
            if getattr(self, name):
                raise excluded("file", name)
        column = rising(Path(info.context["folder"]) / self.file, ("current", CURRENT), columns)
        return self.model_copy(update={"current": tuple(column.along), column.name: tuple(column.value)})

    def _check(self, value: tuple[float, ...], name: str) -> None:
        """Refuse currents that do not rise or lack zero, another number of values, flux at zero current."""
        current = self.current
        if len(current) < 3 or any(b <= a for a, b in pairwise(current)) or 0.0 not in current:
            raise invalid("expected three or more values that rise, zero among them", self._named("current"))
        if len(value) != len(current):
            raise invalid(f"expected {len(current)} values, as many as current has", name)
        if name == "flux" and value[current.index(0.0)] != 0.0:
            raise invalid("expected zero at zero current", self._named(name))

    def _named(self, name: str) -> str:
        """The key that an error names: the value's own key, or "file" if the values are from a file."""
        return name if self.file is None else "file"


class OverCurrent(CurrentFile):
    """Flux linkage of an axis over its own current, without the magnets': `flux`, or `inductance`.

    Currents from zero mean that the axis is alike in both directions. Between points it is monotone and
    smooth, beyond the last it is straight.
    """

    inductance: Many[Inductance] | None = None  # H
    """Apparent inductance at each current of the table: flux linkage divided by current, not the slope of the
    flux linkage. Give `flux` or `inductance`."""

    @model_validator(mode="after")
    def _shape(self, info: ValidationInfo) -> Self:
        self = self._with_file(info, {"flux": FLUX_LINKAGE, "inductance": INDUCTANCE})
        check_one(self, ("flux", "inductance"), "expected either flux or inductance")
        name = "inductance" if self.flux is None else "flux"
        self._check(self.flux or self.inductance or (), name)
        if any(L <= 0 for L in self.inductance or ()):
            raise invalid("expected inductances above zero", self._named("inductance"))
        _, flux = self.points()
        if any(b <= a for a, b in pairwise(flux)):
            raise invalid("expected a flux linkage that grows with the current", self._named(name))
        return self

    def points(self) -> Points:
        """Points over both directions of the current."""
        flux = self.flux
        if flux is None:
            flux = tuple(L * i for L, i in zip(self.inductance or (), self.current, strict=True))
        if self.current[0] < 0:
            return self.current, flux
        return mirrored(self.current, flux, -1)


class MagnetOverCurrent(CurrentFile):
    """Flux linkage that the q axis' current takes from or gives to the d axis; alike in both directions."""

    @model_validator(mode="after")
    def _shape(self, info: ValidationInfo) -> Self:
        self = self._with_file(info, {"flux": FLUX_LINKAGE})
        self._check(self.flux or (), "flux")
        if self.current[0] < 0:
            raise invalid("expected currents from zero on", self._named("current"))
        return self

    def points(self) -> Points:
        """Points over both directions of the current."""
        return mirrored(self.current, self.flux or (), 1)


def mirrored(current: tuple[float, ...], flux: tuple[float, ...], sign: int) -> Points:
    """Points over both directions, from points for currents from zero on.

    At the current -i the flux is `sign` times the flux at i.
    """
    below = tuple(-i for i in reversed(current[1:])), tuple(sign * f for f in reversed(flux[1:]))
    return (*below[0], *current), (*below[1], *flux)


class Saturation(Table):
    """Saturation of the two axes and of the magnets' flux; what is left out stays as in [motor].

    lambda_d = psi_f + d(i_d) + magnet(i_q), lambda_q = q(i_q) + i_d magnet'(i_q).
    """

    d: OverCurrent | None = None
    """Flux linkage of the d axis over the current $i_d$, without the magnets' flux linkage. Default: $L_d
    i_d$."""
    q: OverCurrent | None = None
    """Flux linkage of the q axis over the current $i_q$. Default: $L_q i_q$."""
    magnet: MagnetOverCurrent | None = None
    """Change of the magnets' flux linkage with the current $i_q$. It reduces the torque constant at high
    current. Default: no change."""

    def engine_config(self) -> dict[str, Any]:
        """The tables as the engine reads them: points, and the slopes there of a monotone cubic."""
        names = {"d": self.d, "q": self.q, "cross": self.magnet}
        return {name: _curve(*table.points()) for name, table in names.items() if table is not None}

    def check(self, L_d: float, L_q: float) -> None:
        """Refuse tables whose slope at zero current isn't L_d or L_q, or with a negative inductance."""
        for axis, table, L in (("d", self.d, L_d), ("q", self.q, L_q)):
            if table is None:
                continue
            curve = _curve(*table.points())
            start_slope = curve["slope"][curve["current"].index(0.0)]
            if not math.isclose(start_slope, L, rel_tol=START_DIFFERENCE_MOST):
                raise invalid(
                    f"expected {L:.4g} H at zero current, as L_{axis}, not {start_slope:.4g} H",
                    "saturation",
                    axis,
                )
        if self.magnet is not None:
            self._check_definite(L_d, L_q)

    def _check_definite(self, L_d: float, L_q: float) -> None:
        from scipy.interpolate import CubicHermiteSpline

        tables = self.engine_config()
        d, q, cross = (
            CubicHermiteSpline(t["current"], t["flux"], t["slope"]) if t else None
            for t in (tables.get(name) for name in ("d", "q", "cross"))
        )
        assert cross is not None
        reach = tables.get("d", tables["cross"])["current"]
        # the second derivative is linear between points and jumps there: its extremes are beside the points
        sides = [i * (1 + side) for i in tables["cross"]["current"] for side in (-1e-9, 1e-9)]
        for i_d, i_q in product((reach[0], 0.0, reach[-1]), sides[1:-1]):
            l_dd, l_qq = (L if s is None else float(s(i, 1)) for L, s, i in ((L_d, d, i_d), (L_q, q, i_q)))
            l_qq += i_d * float(cross(i_q, 2))
            if l_dd * l_qq <= float(cross(i_q, 1)) ** 2:
                where = f"i_d = {i_d:.3g} A, i_q = {i_q:.3g} A"
                raise invalid(
                    f"expected less curvature: the inductance is not above zero at {where}",
                    "saturation",
                    "magnet",
                )

    @property
    def smallest(self) -> float:
        """Smallest differential inductance at points of the d and q tables, H; infinite without both."""
        curves = [_curve(*table.points()) for table in (self.d, self.q) if table is not None]
        return min((min(curve["slope"]) for curve in curves), default=math.inf)


def _curve(current: tuple[float, ...], flux: tuple[float, ...]) -> dict[str, list[float]]:
    from scipy.interpolate import PchipInterpolator

    slope = PchipInterpolator(current, flux).derivative()(current)
    return {"current": list(current), "flux": list(flux), "slope": slope.tolist()}


COPPER_COEFFICIENT = 0.00393  # 1/K, at 20 degC
ABSOLUTE_ZERO = -273.15  # degC


class Heating(Table):
    """Winding and magnets as bodies that the copper loss heats; a path that is left out conducts nothing."""

    ambient: Temperature  # degC
    """Temperature of the surroundings, or of a housing whose temperature is constant."""
    winding_capacity: HeatCapacity  # J/K
    """Heat capacity of the winding."""
    magnet_capacity: HeatCapacity  # J/K
    """Heat capacity of the magnets."""
    winding_to_ambient: ThermalResistance | None = None  # K/W
    """Thermal resistance from the winding to the surroundings. Default: no heat flows this way."""
    winding_to_magnet: ThermalResistance | None = None  # K/W
    """Thermal resistance from the winding to the magnets. Default: no heat flows this way."""
    magnet_to_ambient: ThermalResistance | None = None  # K/W
    """Thermal resistance from the magnets to the surroundings. Default: no heat flows this way."""

    def paths(self) -> dict[str, float]:
        """Conductances between the bodies and the ambient, W/K."""
        names = ("winding_to_ambient", "winding_to_magnet", "magnet_to_ambient")
        return {name: 0.0 if (R := getattr(self, name)) is None else 1 / R for name in names}

    @property
    def fastest(self) -> float:
        """Upper bound of the rates at which the temperatures change, 1/s."""
        G = self.paths()
        winding = (G["winding_to_ambient"] + G["winding_to_magnet"]) / self.winding_capacity
        magnet = (G["magnet_to_ambient"] + G["winding_to_magnet"]) / self.magnet_capacity
        return 2 * max(winding, magnet)


class MotorTemperature(Table):
    """Temperatures of winding and magnets at the start. Without `heating` they stay there.

    Resistance and flux of [motor] are those at `reference`; that is what controllers and design assume.
    """

    reference: Temperature = 20.0  # degC
    """Temperature at which resistance and flux have the values in `[motor]`."""
    winding: Temperature  # degC
    """Temperature of the winding at the start of the run."""
    magnet: Temperature | None = None  # degC
    """Temperature of the magnets at the start of the run. Default: the temperature of the winding."""
    resistance_coefficient: TemperatureCoefficient = COPPER_COEFFICIENT
    """Change of the resistance per kelvin, relative to its value at `reference`. Default: the coefficient of
    copper for a `reference` of 20 degC."""
    flux_coefficient: TemperatureCoefficient = 0.0  # 1/K
    """Change of the magnets' flux per kelvin, relative to its value at `reference`, a negative number: about
    `"-0.0011 1/K"` for neodymium magnets, `"-0.002 1/K"` for ferrite. Cogging changes with the square of the
    flux."""
    heating: Heating | None = None
    """Heat capacities of winding and magnets, and thermal resistances between them and the surroundings.
    Default: the temperatures are constant."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for key in ("reference", "winding", "magnet"):
            value = getattr(self, key)
            if value is not None and value < ABSOLUTE_ZERO:
                raise invalid(f"expected {ABSOLUTE_ZERO} degC or more", key)
        for key, at in (("resistance_coefficient", self.winding), ("flux_coefficient", self.magnets)):
            if 1 + getattr(self, key) * (at - self.reference) <= 0:
                raise invalid(f"expected a coefficient that leaves a positive value at {at:g} degC", key)
        return self

    @property
    def magnets(self) -> float:
        """Temperature of the magnets at the start, degC."""
        return self.winding if self.magnet is None else self.magnet

    def engine_config(self) -> dict[str, Any]:
        """The temperatures as the engine reads them, in SI but degC."""
        start = {"winding": self.winding, "magnet": self.magnets}
        keys = ("reference", "resistance_coefficient", "flux_coefficient")
        config = {**start, **{key: getattr(self, key) for key in keys}, "drifts": self.heating is not None}
        if self.heating is None:
            return config
        bodies = ("ambient", "winding_capacity", "magnet_capacity")
        return {**config, **{key: getattr(self.heating, key) for key in bodies}, **self.heating.paths()}
