"""Forks the workers of a sweep: users get spawned workers, but each of these would import all anew."""

import multiprocessing
from types import SimpleNamespace

import pytest

from cogless.ensemble import workers


@pytest.fixture(autouse=True)
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    here = SimpleNamespace(get_context=lambda kind: multiprocessing.get_context("fork"))
    monkeypatch.setattr(workers, "multiprocessing", here)
