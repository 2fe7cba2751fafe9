"""The control library as others take it: CMake, Arduino, PlatformIO and Zephyr, on a bare processor."""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from kept import kept, version

ROOT = Path(__file__).parents[2]
CONTROL = ROOT / "control"
ARM, QEMU = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
SHIPPED = sorted(p for p in CONTROL.rglob("*") if p.is_file() and "build" not in p.relative_to(CONTROL).parts)
PATHS = [path.relative_to(CONTROL) for path in SHIPPED]  # a file that is moved is another package


def run(*command: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def cmake() -> str:
    found = shutil.which("cmake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if found is None:
        pytest.skip("no cmake")
    return found


def install(cmake: str, build: Path, prefix: Path) -> None:
    run(cmake, "-S", CONTROL, "-B", build, "-DCOGLESS_CONTROL_TESTS=OFF", "-DCMAKE_BUILD_TYPE=Debug")
    run(cmake, "--build", build, "-j2")
    run(cmake, "--install", build, "--prefix", prefix)


@pytest.fixture(scope="module")
def prefix(cmake: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library as `cmake --install` puts it."""
    folder = tmp_path_factory.mktemp("installed")

    def packed(made: Path) -> None:
        install(cmake, folder / "build", folder / "made")
        shutil.make_archive(str(made.with_suffix("")), "zip", folder / "made")

    archive = kept("installed.zip", [version(cmake), version("cc"), *PATHS], SHIPPED, packed)
    shutil.unpack_archive(archive, folder / "prefix")
    return folder / "prefix"


def turns(output: str) -> list[int]:
    """The ripple that the example prints turn by turn, mrad/s."""
    return [int(line.split("ripple")[1].split()[0]) for line in output.splitlines() if "ripple" in line]


def test_an_installed_library_is_found_and_the_example_learns(
    cmake: str, prefix: Path, tmp_path: Path
) -> None:
    licence = (prefix / "share" / "licenses" / "cogless-control" / "LICENSE").read_text()
    assert licence == (CONTROL / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    example = tmp_path / "example"
    run(cmake, "-S", CONTROL / "examples" / "cmake", "-B", example, f"-DCMAKE_PREFIX_PATH={prefix}")
    run(cmake, "--build", example)
    ripple = turns(run(example / "learn").stdout)
    assert len(ripple) == 12
    assert 0 < ripple[-1] < 0.1 * ripple[1]


def test_another_version_is_not_found(cmake: str, prefix: Path, tmp_path: Path) -> None:
    project = tmp_path / "project"
    project.mkdir()
    (project / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.18)\nproject(p C)\nfind_package(cogless-control 9 REQUIRED)\n"
    )
    command = [cmake, "-S", project, "-B", tmp_path / "b", f"-DCMAKE_PREFIX_PATH={prefix}"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode != 0 and "cogless-control" in done.stderr


def test_manifests_agree_with_the_header() -> None:
    header = (CONTROL / "src" / "cogless" / "version.h").read_text()
    number = int(re.findall(r"#define CGL_VERSION (\d+)U", header)[0])
    version = f"{number // 10000}.{number // 100 % 100}.{number % 100}"
    assert f"## {version}\n" in (CONTROL / "CHANGELOG.md").read_text()
    lines = (CONTROL / "library.properties").read_text().splitlines()
    arduino = dict(line.split("=", 1) for line in lines)
    platformio = json.loads((CONTROL / "library.json").read_text())
    assert arduino["version"] == platformio["version"] == version
    assert f"VERSION {version} " in (CONTROL / "CMakeLists.txt").read_text()
    needed = {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "architectures"}
    assert needed <= arduino.keys()
    for header in [arduino["includes"], *platformio["headers"]]:
        assert (CONTROL / "src" / header).is_file()
    for part in platformio["export"]["include"]:
        assert (CONTROL / part).exists(), part


def test_the_one_header_includes_all() -> None:
    """Those of the laws through laws.def."""
    text, laws = ((CONTROL / "src" / name).read_text() for name in ("cogless.h", "cogless/laws.def"))
    assert '#include "cogless/laws.def"' in text
    text += laws.replace('#include "', '#include "cogless/')
    inner = {
        "choice.h",
        "drive_parts.h",
        "duties.h",
        "foc_parts.h",
        "harmonic_parts.h",
        "law.h",
        "monitor_parts.h",
    }
    inner |= {"range.h", "real.h", "sine.h", "status.h"}
    missing = {
        header.name
        for header in (CONTROL / "src" / "cogless").glob("*.h")
        if f'"cogless/{header.name}"' not in text and header.name not in inner
    }
    assert not missing


SINE = """
#include <math.h>
#include "cogless/angle.h"
int main(void)
{
    for (double x = -1000.0; x < 1000.0; x += 0.0137) {
        cgl_real s, c;
        cgl_sincos((cgl_real)x, &s, &c);
        if (fabs((double)s - sin((double)(cgl_real)x)) > 1e-6) return 1;
    }
    return 0;
}
"""


@functools.cache
def macros(compiler: str) -> str:
    return run(compiler, "-dM", "-E", "-x", "c", os.devnull).stdout


@pytest.mark.parametrize("compiler", ["cc", "gcc", "clang"])
@pytest.mark.parametrize("real", ["float", "double"])
@pytest.mark.parametrize(
    "flags",
    ["-ffast-math", "-ffinite-math-only", "-funsafe-math-optimizations",
     "-fassociative-math -fno-signed-zeros -fno-trapping-math"],
)  # fmt: skip
def test_flags_that_break_arithmetic_are_refused_or_do_nothing(
    compiler: str, real: str, flags: str, tmp_path: Path
) -> None:
    """gcc tells of them since 12; clang can be told since 12."""
    found, usual = shutil.which(compiler), shutil.which("cc")
    if found is None or (compiler != "cc" and usual is not None and Path(found).samefile(usual)):
        pytest.skip(f"no {compiler}, or it is cc")
    mark = "__clang_major__" if "__clang__" in macros(compiler) else "__GNUC__"
    major = int(next(line.split()[-1] for line in macros(compiler).splitlines() if f" {mark} " in line))
    reorders = "fast" not in flags and "finite" not in flags
    if reorders and major < 12:
        pytest.skip("says nothing of such flags")
    program, sine = tmp_path / "sine", tmp_path / "sine.c"
    sine.write_text(SINE)
    sources = [sine, *(CONTROL / "src" / "cogless" / name for name in ("angle.c", "real.c"))]
    command = [compiler, "-O2", f"-I{CONTROL / 'src'}", *flags.split(), "-o", program, *sources, "-lm"]
    command += ["-DCOGLESS_DOUBLE"] if real == "double" else []
    built = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if reorders and mark == "__clang_major__":
        assert built.returncode == 0, built.stderr
        run(program)
    else:
        assert built.returncode != 0
        assert "compile without -f" in built.stderr


@pytest.mark.parametrize("double", [[], ["-DCOGLESS_DOUBLE"]])
def test_the_simplefoc_sketch_compiles(double: list[str], tmp_path: Path) -> None:
    sketch = CONTROL / "examples" / "simplefoc_feed_forward" / "simplefoc_feed_forward.ino"
    flags = ["-std=gnu++17", "-Wall", "-Wextra", "-Werror", *double]
    includes = [f"-I{CONTROL / 'src'}", f"-I{CONTROL / 'tests' / 'stand-ins'}"]
    run("c++", "-x", "c++", *flags, *includes, "-c", sketch, "-o", tmp_path / "sketch.o")


def test_the_zephyr_module_builds(cmake: str, tmp_path: Path) -> None:
    def built(made: Path) -> None:
        run(cmake, "-S", CONTROL / "tests" / "stand-ins" / "zephyr", "-B", tmp_path)
        run(cmake, "--build", tmp_path, "-j2")
        shutil.copy(tmp_path / "module" / "libcogless.a", made)

    kept("zephyr.a", [version(cmake), version("cc"), *PATHS], SHIPPED, built)


@pytest.mark.skipif(ARM is None, reason="no arm-none-eabi-gcc")
def test_the_readme_has_the_states_sizes(tmp_path: Path) -> None:
    rows = re.findall(r"^\| `([^|]*)` \|[^|]*\| (\d+) \|", (CONTROL / "README.md").read_text(), re.MULTILINE)
    sizes = {name.split("`")[0]: int(size) for name, size in rows if int(size)}
    assert len(sizes) >= 16
    lines = ['#include "cogless.h"', '#include "cogless/drive.h"', '#include "cogless/map_store.h"']
    lines += [f"typedef char {n}_size[sizeof(cgl_{n}) == {size} ? 1 : -1];" for n, size in sizes.items()]
    source = tmp_path / "sizes.c"
    source.write_text("\n".join(lines) + "\n")
    flags = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", f"-I{CONTROL / 'src'}"]
    run(str(ARM), *flags, "-fsyntax-only", source)


@pytest.mark.skipif(ARM is None, reason="no arm-none-eabi-gcc")
def test_the_bare_metal_example_learns_on_a_cortex_m4f(tmp_path: Path) -> None:
    shutil.copytree(CONTROL, tmp_path / "control", ignore=shutil.ignore_patterns("build"))
    folder = tmp_path / "control" / "examples" / "bare-metal"

    def linked(made: Path) -> None:
        run("make", cwd=folder)
        shutil.copy(folder / "learn.elf", made)

    shutil.copy(kept("learn.elf", [version(str(ARM)), *PATHS], SHIPPED, linked), folder / "learn.elf")
    if QEMU is None:
        pytest.skip("compiled; not run: no qemu-system-arm")
    ripple = turns(run("make", "-s", "run", cwd=folder).stdout)
    assert 0 < ripple[-1] < 0.1 * ripple[1]
