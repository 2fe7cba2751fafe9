"""The vectors that control/ carries with it are those of the transcriptions."""

import golden_vectors
import numpy as np
import pytest


@pytest.mark.parametrize("name", sorted(golden_vectors.subjects()))
def test_vectors_are_not_stale(name):
    """PYTHONPATH=tests python tests/golden_vectors.py makes them anew. Other versions of NumPy round
    otherwise."""
    stored = (golden_vectors.FOLDER / f"{name}.txt").read_text().split("\n")
    fresh = golden_vectors.text(golden_vectors.subjects()[name]()).split("\n")
    assert len(stored) == len(fresh)
    for line, (old, new) in enumerate(zip(stored, fresh, strict=True), 1):
        if old == new:
            continue
        read = [np.array(text.split(), dtype=float) for text in (old, new)]
        np.testing.assert_allclose(*read, rtol=1e-9, atol=1e-11, err_msg=f"{name}.txt:{line}")


def test_every_file_is_made_here():
    assert {path.stem for path in golden_vectors.FOLDER.glob("*.txt")} == set(golden_vectors.subjects())
