"""Search by Optuna's CMA-ES. A journal keeps what was tried, so that a killed search goes on.

This module also writes a study's file with changed values; all other text and the comments stay.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cogless.ensemble import sweep
from cogless.ensemble.sweep import Journal
from cogless.errors import StudyError
from cogless.study import AnyStudy
from cogless.study.messages import look_up
from cogless.study.named_files import named_files
from cogless.study.reading import put

Settings = Mapping[str, float]  # by key, the value's place in its range, 0 to 1
START_SPREAD = 0.2  # spread of the first settings around the start, in shares of the ranges


def require() -> None:
    """StudyError unless what a search needs is installed."""
    if any(find_spec(name) is None for name in ("optuna", "cmaes", "tomlkit")):
        raise StudyError("tune: expected more packages: pip install 'cogless[tune]'")


@contextmanager
def opened(path: Path, identity: Mapping[str, Any], start: Settings, seed: int) -> Iterator[Search]:
    """Open a search with its journal at `path`. StudyError: the journal has another `identity`."""
    with sweep.opened(path, identity) as journal:
        yield Search(journal, start, seed)


class Search:
    """A search that begins at `start`, or goes on from its journal. The journal has the parameters and value
    of each trial, and the attributes that Optuna keeps."""

    def __init__(self, journal: Journal, start: Settings, seed: int) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._states = optuna.trial.TrialState
        self._kept = journal
        self.start = dict(start)
        self.space = {key: optuna.distributions.FloatDistribution(0.0, 1.0) for key in start}
        short = seed % 2**32  # a study's seed has 64 bits
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Optuna warns of parts that it may still change
            # CMA-ES needs two parameters or more
            sampler: Any = optuna.samplers.TPESampler(seed=short)
            if len(start) > 1:
                sampler = optuna.samplers.CmaEsSampler(
                    x0=self.start, sigma0=START_SPREAD, seed=short, warn_independent_sampling=False
                )
            self.study = optuna.create_study(sampler=sampler)
            for _, (params, value, attributes) in sorted(journal.finished.items()):
                self.study.add_trial(
                    optuna.trial.create_trial(
                        params=params, distributions=self.space, value=value, system_attrs=attributes
                    )
                )

    @property
    def batch(self) -> int:
        """Number of settings that are tried at once: a generation of CMA-ES."""
        return 4 + int(3 * math.log(len(self.start)))

    def run(
        self,
        score: Callable[[Sequence[Settings]], list[float]],
        budget: int,
        progress: Callable[[int, float], None],
    ) -> Settings:
        """Try settings until `budget` are tried, and return the best. `score` returns a value for each of
        several settings; less is better."""
        while (done := len(self._finished())) < budget:
            if not done:
                self.study.enqueue_trial(self.start)
            # the start is tried alone, as CMA-ES proposes from finished trials
            trials = [
                self.study.ask(self.space) for _ in range(min(self.batch if done else 1, budget - done))
            ]
            for trial, value in zip(trials, score([trial.params for trial in trials]), strict=True):
                self.study.tell(trial, value)
                done_trial = self.study.get_trials(deepcopy=False)[trial.number]
                number = max(self._kept.finished, default=-1) + 1
                self._kept.add(number, [trial.params, value, done_trial.system_attrs])
            progress(len(self._finished()), self.study.best_value)
        return dict(self.study.best_params)

    def _finished(self) -> list[Any]:
        return list(self.study.get_trials(deepcopy=False, states=(self._states.COMPLETE,)))


def study_file_text(study: AnyStudy, changes: Mapping[str, Any], folder: Path, note: str) -> str:
    """The text of a study's file with `changes`, by dotted key. `note`: a comment for the first line.

    `folder`: where the file will be written; relative paths in the text are rewritten for that folder.
    """
    import tomlkit

    source = study.source.path
    document = tomlkit.parse(source.read_text(encoding="utf-8-sig"))
    for key, value in changes.items():
        put(document, key, value)
    for file in named_files(type(study), document):
        if not os.path.isabs(file.path):
            table = look_up(document, file.key[:-1])
            table[file.key[-1]] = os.path.relpath(study.source.folder / file.path, folder) + file.rest
    return f"# {note}\n{tomlkit.dumps(document)}"
