"""A compiler's results are kept under build/tests: all processes that run tests share one result of the same
files."""

import fcntl
import hashlib
import os
import subprocess
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

BUILT = Path(__file__).parents[1] / "build" / "tests"


def kept(name: str, words: Iterable[object], files: Iterable[Path], make: Callable[[Path], object]) -> Path:
    """Path of a file whose name has a digest before its ending: of the words, and of the files' names and
    contents. If there is none with this digest, `make` makes it at the path that it gets."""
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
    """What a compiler prints as its version."""
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
