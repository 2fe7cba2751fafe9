"""The search for a cutoff, for made-up factors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from design_plants import Unseen

from cogless.design.trials import response
from cogless.design.trials.response import workable_cutoff


@pytest.mark.parametrize(
    ("worst", "grows_above", "cutoff"),
    [
        (100.0, 1000.0, 95.0),
        (1e4, 1000.0, 490.0),
        (100.0, 95.0 * 0.8**3, 95.0 * 0.8**3),
        (100.0, 95.0 * 0.8**9, 95.0 * 0.8**9),
        (100.0, 95.0 * 0.8**9.5, None),
        (1.0, 1000.0, None),
    ],
)
@pytest.mark.parametrize("K_3", [None, 0.7])
def test_a_workable_cutoff_leaves_at_most_95_percent_at_the_ends_of_a_trial_too(
    monkeypatch: pytest.MonkeyPatch, worst: float, grows_above: float, cutoff: float | None, K_3: float | None
) -> None:
    """The factor is here the cutoff over `worst` Hz. Cutoffs of 0.001 to 0.49 of the rate are tried."""
    monkeypatch.setattr(response, "Bundle", Unseen)
    monkeypatch.setattr(
        response, "butterworth", lambda cutoff, *_: SimpleNamespace(cutoff=cutoff, gain=lambda w: cutoff)
    )
    monkeypatch.setattr(response, "best_gain", lambda G, H: (5.0, H / worst))
    monkeypatch.setattr(response, "factor", lambda G, K, H, filtered: np.array([0.0, H / worst]))

    def growth(trial: Any) -> Any:
        assert (trial.K_3, trial.shift, trial.filtered) == (K_3 or 5.0, 2, "signal")
        assert trial.samples == 300
        return np.array([0.5, 0.96 if trial.q_filter.cutoff > grows_above else 0.95])

    monkeypatch.setattr(response, "growth", growth)
    found = workable_cutoff([], 2, 2, 1e-3, 300, K_3)
    assert found is None if cutoff is None else found == pytest.approx(cutoff, rel=7e-3)
