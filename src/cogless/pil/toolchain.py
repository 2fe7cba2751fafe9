"""The cross compiler: gcc for ARM from Debian, or else the one in ziglang from PyPI."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cogless.errors import StudyError

GCC = "arm-none-eabi-gcc"
COMMON = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-ffreestanding",
    "-ffunction-sections",
    "-fdata-sections",
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
)
FOR_GCC = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
# Without +vfp4d16sp, zig would silently compute floating point in software.
FOR_ZIG = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp", "-fno-sanitize=all")
LINK_FLAGS = ("-Wl,--gc-sections", "-Wl,--entry=pil_functions")


@dataclass(frozen=True)
class Toolchain:
    """A compiler for the Cortex-M4F: its command, its name and version, and flags."""

    command: tuple[str, ...]
    name: str
    flags: tuple[str, ...]
    libraries: tuple[str, ...]

    def build(self, sources: Sequence[Path], script: Path, image: Path, defines: Sequence[str]) -> None:
        """Compile and link an image; StudyError with the compiler's first error."""
        line = [
            *self.command,
            *self.flags,
            *(f"-D{define}" for define in defines),
            *map(str, sources),
            *LINK_FLAGS,
            f"-Wl,-T,{script}",
            *self.libraries,
            "-o",
            str(image),
        ]
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not image.is_file():
            errors = [text for text in done.stderr.splitlines() if "error" in text] or ["no image"]
            raise StudyError(f"pil: {self.name}: {errors[0]}: expected code that compiles for a Cortex-M4F")


def find(name: str | None = None) -> Toolchain:
    """The compiler `name`, "gcc" or "zig"; without a name, gcc if installed, else zig.

    StudyError: no such compiler is installed.
    """
    if name in (None, "gcc") and shutil.which(GCC):
        version = _command_output(GCC, "-dumpfullversion")
        return Toolchain((GCC,), f"gcc {version}", (*FOR_GCC, *COMMON), ("-nostdlib", "-lgcc"))
    if name in (None, "zig") and importlib.util.find_spec("ziglang") is not None:
        zig = (sys.executable, "-m", "ziglang")
        return Toolchain((*zig, "cc"), f"zig {_command_output(*zig, 'version')}", (*FOR_ZIG, *COMMON), ())
    debian = f"{GCC} (Debian: apt-get install gcc-arm-none-eabi)"
    pypi = "ziglang (pip install 'cogless[pil]')"
    ways = (pypi, debian) if name == "zig" else (debian, pypi)
    raise StudyError(f"pil: no cross compiler: expected {' or '.join(ways)}")


def _command_output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
