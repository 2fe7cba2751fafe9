"""The C control library, compiled for float and for double and opened from Python, for the tests.

The declarations come out of the headers by the C preprocessor, so that structs here are always those of the
source.
"""

import functools
import math
import re
import runpy
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from kept import kept, version

SOURCE = Path(__file__).parents[1] / "control" / "src"
HEADERS = sorted(h.name for h in (SOURCE / "cogless").glob("*.h"))
FLAGS = ["-std=c99", "-O1", "-ffp-contract=off"]  # more takes longer, and rounds alike
# in this unit the inline functions of the headers become ordinary ones, which a library can export
EXPORTS = """#include <stdbool.h>
#define static
#define inline
#include "cogless/transform.h"
#include "cogless/turns.h"
#include "cogless/pi.h"
"""


@dataclass(frozen=True)
class ControlLibrary:
    """One build. `eps` is the rounding of its numbers."""

    ffi: Any
    lib: Any
    real: type
    _kept: list[Any] = field(default_factory=list)

    @property
    def eps(self) -> float:
        return float(np.finfo(self.real).eps)

    def new(self, name: str, **fields: Any) -> Any:
        """A pointer to a new struct; the fields not given are zero.

        Of a list of reals that is shorter than its array, the rest is NaN: no code may read beyond its count.
        """
        made = self.ffi.new(f"{name} *", fields)
        self._spoil_rest(made, fields)
        return made

    def _spoil_rest(self, struct: Any, fields: dict[str, Any]) -> None:
        for name, value in fields.items():
            if not isinstance(value, dict | list):
                continue
            member = getattr(struct, name)
            if isinstance(value, dict):
                self._spoil_rest(member, value)
            elif self.ffi.typeof(member).item.cname in ("float", "double"):
                for n in range(len(value), len(member)):
                    member[n] = math.nan

    def loop(self, ts: float, **fields: Any) -> Any:
        """A loop that steps a law; without other fields it leaves every config: any current, and no guard."""
        return self.new("cgl_loop", ts=ts, **{"current_limit": float(np.finfo(self.real).max), **fields})

    def array(self, values: Any) -> tuple[Any, Any]:
        """A NumPy copy in the library's numbers, and a pointer to it that lives as long as the library."""
        copy = np.array(values, dtype=self.real)
        self._kept.append(copy)
        return copy, self.ffi.cast("cgl_real *", copy.ctypes.data)


def declarations(flags: list[str], scratch: Path) -> str:
    """What the headers declare, without system headers and bodies, as cffi reads it."""
    for name in ("stdbool.h", "stdint.h", "stddef.h"):
        (scratch / name).touch()
    text = "\n".join(f'#include "cogless/{name}"' for name in HEADERS)
    command = [
        "cc", "-E", "-P", "-nostdinc", f"-I{scratch}", f"-I{SOURCE}", "-Dstatic=", "-Dinline=", *flags, "-",
    ]  # fmt: skip
    plain = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    return re.sub(r"\)\s*\{.*?\n\}", ");", plain, flags=re.DOTALL)


@functools.cache
def control_library(precision: str) -> ControlLibrary:
    """The library computing in "float" or "double", compiled once for all that run tests side by side."""
    double = ["-DCOGLESS_DOUBLE"] if precision == "double" else []
    sources = sorted((SOURCE / "cogless").glob("*.c"))
    flags = [*FLAGS, *double, "-shared", "-fPIC", f"-I{SOURCE}"]
    read = [Path(__file__), *sorted((SOURCE / "cogless").iterdir())]

    def parse(made: Path) -> None:
        with tempfile.TemporaryDirectory() as empty:
            ffi = cffi.FFI()
            ffi.set_source("parsed", None)
            ffi.cdef(declarations(double, Path(empty)))
            ffi.emit_python_code(str(made))

    def compiled(made: Path) -> None:
        with tempfile.TemporaryDirectory() as folder:
            exports = Path(folder) / "exports.c"
            exports.write_text(EXPORTS)
            subprocess.run(["cc", *flags, "-o", made, exports, *sources], check=True)

    parsed = kept(f"{precision}.py", [], read, parse)
    library = kept(f"{precision}.so", [version("cc"), *flags], read, compiled)
    ffi = runpy.run_path(str(parsed))["ffi"]
    return ControlLibrary(ffi, ffi.dlopen(str(library)), np.float64 if double else np.float32)
