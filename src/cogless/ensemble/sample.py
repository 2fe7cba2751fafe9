"""Draw the variants of an ensemble: Sobol's sequence over the axes of `[vary]`, the same on every machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cogless.ensemble.axes import Axis, axes, together
from cogless.interrupts import deferred
from cogless.study import AnyStudy, TrialStudy
from cogless.study.error_messages import dotted

SEED = "seed"  # a study's key: of the sensors' noise
FRESH = 1 << 32  # between the seeds of an ensemble and those of a fresh one


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The variants of a study: `drawn` has the values of each varied key, as in the study's file.

    `places`: where a key is set, for each scenario. Motor, mechanics and drive vary as a scenario's override:
    the controllers are designed for the study, and don't know which variant they meet.
    """

    axes: tuple[Axis, ...]
    drawn: Mapping[str, list[Any]]
    count: int
    places: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def changes(self, variant: int, scenario: str | None = None) -> dict[str, Any]:
        """What differs from the study in a variant, by dotted key; of one scenario, or of all."""
        found = {}
        for key, values in self.drawn.items():
            places = self.places.get(key)
            if places is None:
                found[key] = values[variant]
            else:
                wanted = (
                    places.values() if scenario is None else [places[scenario]] if scenario in places else []
                )
                found |= dict.fromkeys(wanted, values[variant])
        return found

    def si(self, key: str) -> list[Any]:
        """The values of a varied key in SI; those that are no quantities unchanged."""
        axis = next((axis for axis in self.axes if axis.key == key), None)
        return self.drawn[key] if axis is None else [axis.si(value) for value in self.drawn[key]]


def seeds(study: AnyStudy, count: int, fresh: int = 0) -> list[int]:
    """A seed of the sensors' noise for each variant."""
    first = study.seed + 1 + fresh * FRESH
    return [(first + variant) % 2**64 for variant in range(count)]


def draw(study: AnyStudy, count: int, fresh: int = 0) -> Ensemble:
    """Draw `count` variants; the first of a longer ensemble are the same. StudyError: a mistake in [vary].

    `fresh`: a number above zero draws others than any ensemble with another number.
    """
    from scipy.stats import qmc

    found = axes(study)
    assert study.vary is not None
    drawn: dict[str, list[Any]] = {}
    if found:
        generator = np.random.default_rng([study.seed, fresh])
        with deferred() as requests:  # SciPy's compiled code drops the exception, and draws equal variants
            sequence = qmc.Sobol(len(found), scramble=True, rng=generator)
            shares = sequence.random_base2(max(0, count - 1).bit_length())[:count]
        if requests.count:
            raise KeyboardInterrupt
        columns = together(shares, found, study).T
        drawn = {axis.key: axis.values(column) for axis, column in zip(found, columns, strict=True)}
    if study.vary.seeds:
        drawn[SEED] = seeds(study, count, fresh)
    return Ensemble(tuple(found), drawn, count, _places(study, drawn))


def _places(study: AnyStudy, keys: Iterable[str]) -> dict[str, dict[str, str]]:
    """The overrides that set a key of the plant, by scenario; a scenario that has its own value keeps it."""
    of_plant = (
        ("motor.", "mechanics.") if isinstance(study, TrialStudy) else ("motor.", "mechanics.", "drive.")
    )
    return {
        key: {
            name: dotted(("scenario", name, "override", key))
            for name, scenario in study.scenario.items()
            if key not in (scenario.override or {})
        }
        for key in keys
        if key.startswith(of_plant)
    }
