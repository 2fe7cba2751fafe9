"""What a compiler makes of the same files is made once, and kept under build/tests for all that run tests."""

import fcntl
import hashlib
import os
import subprocess
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

BUILT = Path(__file__).parents[1] / "build" / "tests"


def kept(name: str, words: Iterable[object], files: Iterable[Path], make: Callable[[Path], object]) -> Path:
    """A file of this name and ending, with a digest between: made by `make` at a path that it is given,
    unless there is one of the same words and of files with the same names and contents."""
    digest = hashlib.sha256(repr([str(word) for word in words]).encode())
    for file in files:
        digest.update(f"\n{file.name} {file.stat().st_size}\n".encode() + file.read_bytes())
    stem, dot, end = name.rpartition(".")
    path = BUILT / f"{stem}-{digest.hexdigest()[:16]}{dot}{end}"
    if not path.exists():
        BUILT.mkdir(parents=True, exist_ok=True)
        with (BUILT / f"{stem}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # one compiles it, others wait
            if not path.exists():
                made = BUILT / f"{os.getpid()}{dot}{end}"
                make(made)
                made.replace(path)
    return path


@cache
def version(compiler: str) -> str:
    """What a compiler says of itself."""
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
