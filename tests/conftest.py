"""One thread for BLAS, since tests run side by side, and one folder for all that the tests write."""

import os
import tempfile

import pytest

# Threads of BLAS wait for each other on matrices of 4 x 4. NumPy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session", autouse=True)
def _temporary_files(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Put what helpers write by mkdtemp among pytest's own folders, which later runs remove."""
    tempfile.tempdir = os.environ["TMPDIR"] = str(tmp_path_factory.mktemp("temporary"))
