"""Search by Optuna's CMA-ES, with a journal, so that a killed search goes on."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cogless.errors import StudyError
from cogless.files import no_device, no_link, reason

Settings = Mapping[str, float]  # a share of each range, 0 to 1
SPREAD = 0.2  # of the first settings around the start, in shares of the ranges


def require() -> None:
    """StudyError unless what a search needs is installed."""
    if any(find_spec(name) is None for name in ("optuna", "cmaes", "tomlkit")):
        raise StudyError("tune: expected the extra: pip install 'cogless[tune]'")


class Search:
    """A search that begins at `start`, in a journal at `path`; `about` tells it from others."""

    def __init__(self, path: Path, about: Mapping[str, Any], start: Settings, seed: int) -> None:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        try:
            no_link(path)
            no_device(path)
        except OSError as error:
            raise StudyError(f"{path}: {reason(error)}: expected a file that can be written") from None
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._states = optuna.trial.TrialState
        self.start = dict(start)
        self.space = {key: optuna.distributions.FloatDistribution(0.0, 1.0) for key in start}
        short = seed % 2**32  # a study's has 64 bits
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of parts that Optuna may still change
            # CMA-ES needs two directions
            sampler: Any = optuna.samplers.TPESampler(seed=short)
            if len(start) > 1:
                sampler = optuna.samplers.CmaEsSampler(
                    x0=self.start, sigma0=SPREAD, seed=short, warn_independent_sampling=False
                )
            storage = JournalStorage(JournalFileBackend(str(path)))
            self.study = optuna.create_study(
                storage=storage, sampler=sampler, study_name="tune", load_if_exists=True
            )
        wanted = json.dumps(about, sort_keys=True)
        found = self.study.user_attrs.get("about", wanted)
        if found != wanted:
            raise StudyError(f"{path}: of another study or other keys: expected another directory")
        self.study.set_user_attr("about", wanted)

    @property
    def batch(self) -> int:
        """Settings that are tried at once: a generation of CMA-ES."""
        return 4 + int(3 * math.log(len(self.start)))

    def run(
        self,
        score: Callable[[Sequence[Settings]], list[float]],
        budget: int,
        progress: Callable[[int, float], None],
    ) -> Settings:
        """Try settings until there are `budget`, and return the best. `score`: values of several, less is
        better."""
        while (done := len(self._finished())) < budget:
            if not done:
                self.study.enqueue_trial(self.start)
            # the first alone, as CMA-ES goes on from what is finished
            trials = [
                self.study.ask(self.space) for _ in range(min(self.batch if done else 1, budget - done))
            ]
            for trial, value in zip(trials, score([trial.params for trial in trials]), strict=True):
                self.study.tell(trial, value)
            progress(len(self._finished()), self.study.best_value)
        return dict(self.study.best_params)

    def _finished(self) -> list[Any]:
        return list(self.study.get_trials(deepcopy=False, states=(self._states.COMPLETE,)))
