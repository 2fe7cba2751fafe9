"""Temperatures of a motor's winding and magnets, and what they change."""

from __future__ import annotations

from typing import Any, Self

from pydantic import model_validator

from cogless.study.table import (
    HeatCapacity,
    Table,
    Temperature,
    TemperatureCoefficient,
    ThermalResistance,
    invalid,
)

COPPER = 0.00393  # 1/K, at 20 degC
NOTHING = -273.15  # degC


class Heating(Table):
    """Winding and magnets as bodies that the copper loss heats; a path that is left out conducts nothing."""

    ambient: Temperature  # degC
    winding_capacity: HeatCapacity  # J/K
    magnet_capacity: HeatCapacity  # J/K
    winding_to_ambient: ThermalResistance | None = None  # K/W
    winding_to_magnet: ThermalResistance | None = None  # K/W
    magnet_to_ambient: ThermalResistance | None = None  # K/W

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
    winding: Temperature  # degC
    magnet: Temperature | None = None  # degC; default: that of the winding
    resistance_coefficient: TemperatureCoefficient = COPPER
    flux_coefficient: TemperatureCoefficient = 0.0  # 1/K; cogging goes with the flux squared
    heating: Heating | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for key in ("reference", "winding", "magnet"):
            value = getattr(self, key)
            if value is not None and value < NOTHING:
                raise invalid(f"expected {NOTHING} degC or more", key)
        for key, at in (("resistance_coefficient", self.winding), ("flux_coefficient", self.magnets)):
            if 1 + getattr(self, key) * (at - self.reference) <= 0:
                raise invalid(f"expected one that leaves something at {at:g} degC", key)
        return self

    @property
    def magnets(self) -> float:
        """Temperature of the magnets at the start, degC."""
        return self.winding if self.magnet is None else self.magnet

    def engine_config(self) -> dict[str, Any]:
        """As the engine reads it."""
        start = {"winding": self.winding, "magnet": self.magnets}
        keys = ("reference", "resistance_coefficient", "flux_coefficient")
        found = {**start, **{key: getattr(self, key) for key in keys}, "drifts": self.heating is not None}
        if self.heating is None:
            return found
        bodies = ("ambient", "winding_capacity", "magnet_capacity")
        return {**found, **{key: getattr(self.heating, key) for key in bodies}, **self.heating.paths()}
