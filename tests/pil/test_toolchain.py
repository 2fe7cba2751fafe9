"""How the compilers for the emulated processor are found and called, without any of them."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from cogless.errors import StudyError
from cogless.pil import toolchain


@pytest.mark.parametrize("there", [("gcc", "zig"), ("gcc",), ("zig",)])
def test_gcc_comes_first_and_each_compiler_tells_its_version(
    there: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of both, floating point is the processor's own, and products and sums are not fused."""
    zig = (sys.executable, "-m", "ziglang")
    said = {(toolchain.GCC, "-dumpfullversion"): "12.2.1\n", (*zig, "version"): "0.17.1\n"}
    monkeypatch.setattr(shutil, "which", lambda name: name if "gcc" in there else None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: "zig" in there or None)
    monkeypatch.setattr(
        toolchain, "subprocess", SimpleNamespace(run=lambda line, **_: SimpleNamespace(stdout=said[line]))
    )
    found = toolchain.find()
    assert found == toolchain.find(there[0])
    for name in ("gcc", "zig"):
        if name not in there:
            with pytest.raises(StudyError, match="pil: no cross compiler"):
                toolchain.find(name)
    if found.name == "gcc 12.2.1":
        assert there[0] == "gcc"
        assert (found.command, found.libraries) == ((toolchain.GCC,), ("-nostdlib", "-lgcc"))
        assert {"-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"} < {*found.flags}
    else:
        assert (found.name, there[0]) == ("zig 0.17.1", "zig")
        assert (found.command, found.libraries) == ((*zig, "cc"), ())
        target = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp", "-fno-sanitize=all")
        assert found.flags[:4] == target
    assert {"-std=c99", "-O2", "-ffp-contract=off", "-ffreestanding"} < {*found.flags}


def test_a_compiler_s_first_error_is_told(tmp_path: Path) -> None:
    def build_with(*lines: str) -> None:
        tool = toolchain.Toolchain((sys.executable, "-c", "\n".join(lines)), "cc 1", (), ())
        tool.build([tmp_path / "a.c"], tmp_path / "image.ld", tmp_path / "image.elf", ["A=1", "B"])

    def error(first: str) -> str:
        return f"pil: cc 1: {first}: expected code that compiles for a Cortex-M4F"

    write = "import sys; open(sys.argv[-1], 'w').write(' '.join(sys.argv[1:]))"
    build_with(write)
    words = (tmp_path / "image.elf").read_text().split()
    assert words == [
        "-DA=1", "-DB", str(tmp_path / "a.c"), "-Wl,--gc-sections", "-Wl,--entry=pil_functions",
        f"-Wl,-T,{tmp_path / 'image.ld'}", "-o", str(tmp_path / "image.elf"),
    ]  # fmt: skip
    says = "sys.exit('warning: x\\na.c:1: error: y\\na.c:2: error: z')"
    with pytest.raises(StudyError) as told:
        build_with(write, says)
    assert str(told.value) == error("a.c:1: error: y")
    (tmp_path / "image.elf").unlink()
    with pytest.raises(StudyError) as told:
        build_with("")
    assert str(told.value) == error("no image")
