"""Errors and noise of a fit, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify.fits import fit_of

from cogless.errors import StudyError
from cogless.identify.regression import _blocks, _noise, fit, inflation, solved
from cogless.identify.weak_form import Name, Rows


def test_what_a_loop_does_to_both_logs_is_in_no_error() -> None:
    """With the same blocks the differences of both logs count; else the errors of both add up."""
    rng = np.random.default_rng(0)
    common, own = rng.normal(size=(12, 1)), rng.normal(size=(12, 1))
    real = fit_of({("j",): 1.0}, 0.3, parts=common + own)
    error = real.beside(("j",), fit_of({("j",): 1.0}, parts=common))
    assert error == pytest.approx(math.sqrt(11 / 12 * np.sum((own - own.mean()) ** 2)))
    for other in (fit_of({("j",): 1.0}, parts=common[:7]), fit_of({("b",): 1.0}, parts=common)):
        assert real.beside(("j",), other) == pytest.approx(0.3 * math.sqrt(2))


@pytest.fixture
def rows() -> Rows:
    """A hundred rows of two columns, one with noise, and what they leave of y: 0.5 rms."""
    rng = np.random.default_rng(1)
    columns, left = rng.normal(size=(100, 2)), np.where(np.arange(100) % 2, 0.5, -0.5)
    y = columns @ [2.0, -1.0] + left
    noise = np.column_stack((np.full(100, 0.01), np.zeros(100)))
    log: Any = SimpleNamespace(name="a")
    return Rows(log, (("b",), ("j",)), columns, y, noise, np.zeros(100), np.zeros(100), np.arange(100.0))


def test_a_log_s_noise_is_what_its_fit_leaves(rows: Rows) -> None:
    names: tuple[Name, ...] = (("j",), ("c",), ("b",))
    blocks = _blocks(rows, names, 24)
    assert [block.rows for block in blocks] == [10] * 10  # of ten rows or more
    assert [block.rows for block in _blocks(rows, names, 3)] == [34, 33, 33]
    values = np.array([-1.0, 7.0, 2.0])  # of j, of c which is not there, and of b
    assert _noise(blocks, values) == pytest.approx(0.5)
    exact = replace(rows, y=rows.columns @ [2.0, -1.0], noise=0 * rows.noise)
    blocks = _blocks(exact, names, 24)
    assert solved(blocks, 3) == pytest.approx([-1.0, 0.0, 2.0])
    assert _noise(blocks, values) == pytest.approx(1e-6 * math.sqrt(np.mean(exact.y**2)), rel=1e-3)
    steps = sum(block.matrix for block in _blocks(rows, names, 24))[2, 2]
    assert steps == pytest.approx(
        np.sum(rows.columns[:, 0] ** 2) - 100 * 0.01
    )  # without the noise of its steps


def test_logs_are_cut_into_blocks_and_weigh_by_what_is_left_of_each(rows: Rows) -> None:
    """24 blocks in all, but at least four for each log, each of ten rows or more.

    The first coefficient is 2 in one log and 3 in the other, which has ten times the noise.
    """
    log: Any = SimpleNamespace(name="b")
    rough = replace(
        rows, log=log, y=rows.y + rows.columns @ [1.0, 0.0] + 9 * (rows.y - rows.columns @ [2.0, -1.0])
    )
    found = fit([rows, rough])
    assert [block.log for block in found.blocks] == ["a"] * 10 + ["b"] * 10
    assert found["b",] == pytest.approx(2.0 + 1 / 101, abs=0.05)  # by 1 / 0.5^2 and 1 / 5^2
    assert found.noise == {"a": pytest.approx(0.5, rel=0.1), "b": pytest.approx(5.0, rel=0.1)}
    names = [SimpleNamespace(name=name) for name in "abcdefgh"]
    many = fit([replace(rows, log=name) for name in names])
    assert len(many.blocks) == 8 * 4
    long = {
        key: np.tile(getattr(rows, key).T, 3).T for key in ("columns", "y", "noise", "theta", "omega", "at")
    }
    assert len(fit([replace(rows, **long)]).blocks) == 24
    few = {key: value[:19] for key, value in long.items()}
    assert len(fit([replace(rows, **few)]).blocks) == 1


def test_no_rows_are_refused_in_a_line() -> None:
    with pytest.raises(StudyError, match=r"^in no log the motor turns [^\n]*: expected longer logs$"):
        fit([])


def test_a_prediction_is_without_the_columns_that_were_not_fitted(rows: Rows) -> None:
    found = fit_of({("b",): 2.0})
    assert found.prediction(rows) == pytest.approx(2.0 * rows.columns[:, 0])


def test_columns_that_are_alike_inflate_their_errors_beyond_all_use(rows: Rows) -> None:
    alike = replace(rows, columns=np.repeat(rows.columns[:, :1], 2, axis=1), noise=0 * rows.noise)
    assert inflation(_blocks(alike, alike.names, 1)) == pytest.approx(np.full(2, 0.5 / 1e-12), rel=1e-6)
