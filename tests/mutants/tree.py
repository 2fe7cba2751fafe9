"""A copy of the source tree in which mutants are built and tested."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from shutil import rmtree, which
from typing import NamedTuple

TOOLS = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
LONGEST_TEST = 300  # s; a test that takes longer counts as failed
MEMORY = 12 << 30  # bytes of data; a limit of address space would stop a browser, which reserves much


class Verdict(NamedTuple):
    outcome: str  # "killed", "time-out", "survived"
    by: str  # the test that noticed


class Tree:
    def __init__(self, original: Path, root: Path) -> None:
        self.root, self.site, self.module = root, root / "site", root / "module"
        self.libraries = [root / "library" / real for real in ("OFF", "ON")]  # double or not
        self.process: subprocess.Popen[str] | None = None
        self.stopped, self.said = False, ""
        self.avoided: list[str] = []  # tests that fail without a mutant
        self.chosen = 0  # number of the mutant in the C and C++, where several are built together
        self.unchanged: dict[Path, bytes] = {}
        listed = ["git", "-C", str(original), "ls-files", "-co", "--exclude-standard"]
        for name in subprocess.run(listed, check=True, capture_output=True, text=True).stdout.splitlines():
            if (original / name).is_file():
                self._put(root / name, (original / name).read_bytes())
        nanobind = [sys.executable, "-m", "nanobind", "--cmake_dir"]
        found = subprocess.run(nanobind, check=True, capture_output=True, text=True).stdout.strip()
        module = ["-DCMAKE_BUILD_TYPE=Release", "-DCOGLESS_IPO=OFF", f"-Dnanobind_DIR={found}"]
        self._configure(".", self.module, *module, f"-DPython_EXECUTABLE={sys.executable}")
        for library in self.libraries:
            double = f"-DCOGLESS_DOUBLE={library.name}"
            self._configure("control", library, double, "-DCMAKE_BUILD_TYPE=Release")

    def read(self, file: str) -> str:
        return (self.root / file).read_text()

    def write(self, file: str, text: str) -> None:
        self._put(self.root / file, text.encode())

    def build(self) -> str:
        """Build and install what has changed; return what the compilers said if that failed."""
        self.install_python()
        for folder in (self.module, *self.libraries):
            if not self._ran("cmake", "--build", folder, "--", "-k", "0"):
                return self.said
        return "" if self._ran("cmake", "--install", self.module, "--prefix", self.site) else self.said

    def install_python(self) -> None:
        sources = self.root / "src" / "cogless"
        for source in sources.rglob("*"):
            if source.is_file() and "__pycache__" not in source.parts:
                self._put(self.site / "cogless" / source.relative_to(sources), source.read_bytes())

    def plain(self, texts: dict[str, str]) -> None:
        """Build without any mutant; `texts`: those of the files that had some."""
        for file, text in texts.items():
            self.write(file, text)
        self.chosen = 0
        if said := self.build():
            raise RuntimeError(f"{self.root}: does not build\n{said}")
        self.unchanged = self._machine_code()

    def takes(self, file: str, text: str) -> bool:
        """Install with another text of a file; return whether it compiles, C and C++ to other machine code
        than before."""
        self.write(file, text)
        if not file.endswith(".py"):
            return not self.build() and self._machine_code() != self.unchanged
        try:
            compile(text, file, "exec")
        except SyntaxError:
            return False
        self.install_python()
        return True

    def hits(self, jobs: int, tests: list[str]) -> tuple[Path, list[str]]:
        """Run tests, side by side; return the folder in which mutants.hits notes what they execute, and those
        that fail."""
        folder = self.root / "hits"
        rmtree(folder, ignore_errors=True)
        folder.mkdir()
        _, output = self._tested("-p", "mutants.hits", "-n", str(jobs), "--dist", "loadfile", *tests)
        return folder, failures(output)

    def judge(self, file: str, turns: list[list[str]], beside_c: bool = True) -> Verdict:
        """Run tests, one list after the other, until one fails; for a file of the C library its own tests
        run first, where they are wanted."""
        if file.startswith("control") and beside_c and not self.passes_beside_c():
            return Verdict("killed", "control/tests")
        for some in turns:
            code, output = self._tested("-x", *some) if some else (0, "")
            if code == 5 and self.avoided:  # all tests there are avoided
                continue
            if code in (4, 5) and not failures(output):  # usage error, or no tests found: nothing has failed
                raise RuntimeError(output)
            if code != 0:
                outcome = "time-out" if "Timeout (" in output else "killed"
                return Verdict(outcome, _first_failure(output))
        return Verdict("survived", "")

    def passes_beside_c(self) -> bool:
        """Run the C library's own tests, in float and in double, with as few random configs as they take."""
        programs = [folder / name for folder in self.libraries for name in ("learn", "cogless_control_tests")]
        return all(self._ran("timeout", str(LONGEST_TEST), program, "0") for program in programs)

    def stop(self) -> None:
        """End the running process, from another thread; the thread that waits for it gets an
        InterruptedError."""
        self.stopped = True
        if self.process is not None:
            _end(self.process)

    def failing(self, tests: list[str]) -> list[str]:
        """Those of these tests that fail in the unchanged tree."""
        _, output = self._tested(*tests)
        return failures(output)

    def _tested(self, *arguments: str) -> tuple[int, str]:
        limits = ["-o", f"faulthandler_timeout={LONGEST_TEST}", "-o", "faulthandler_exit_on_timeout=true"]
        pytest = ["prlimit", f"--data={MEMORY}", sys.executable, "-m", "pytest"]
        command = [*pytest, "-v", "--tb=no", "-p", "no:cacheprovider", *limits]
        command += [word for test in self.avoided for word in ("--deselect", test)] + [*arguments]
        done = self._start(*command)
        return done.returncode, done.stdout

    def _ran(self, tool: str, *arguments: str | Path) -> bool:
        done = self._start(_tool(tool), *arguments)
        self.said = done.stdout
        return done.returncode == 0

    def _configure(self, source: str, folder: Path, *options: str) -> None:
        ninja = ["-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={_tool('ninja')}"]
        done = self._start(_tool("cmake"), "-S", source, "-B", folder, *ninja, *options)
        if done.returncode:
            raise RuntimeError(done.stdout)

    def _machine_code(self) -> dict[Path, bytes]:
        return {path: sha256(path.read_bytes()).digest() for path in self.module.rglob("*.o")}

    def _start(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        """Run a command in the copy, and end all processes that it leaves running."""
        path = f"{self.site}{os.pathsep}{self.root / 'tests'}"
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        environment["COGLESS_MUTANT"] = str(self.chosen)
        process = subprocess.Popen(
            [str(part) for part in command], cwd=self.root, env=environment, text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        self.process = process
        output, _ = process.communicate()
        _end(process)
        if self.stopped:
            raise InterruptedError
        return subprocess.CompletedProcess(process.args, process.returncode, output)

    def _put(self, path: Path, content: bytes) -> None:
        """Write a file only if its content changes, so that not everything is built again.

        Its .pyc files are removed, since Python compares times only to the second.
        """
        if not path.is_file() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            for compiled in path.parent.glob(f"__pycache__/{path.stem}.*.pyc"):
                compiled.unlink()


def _tool(name: str) -> str:
    """Path of a program; the one next to this Python comes first."""
    found = which(name, path=TOOLS)
    if found is None:
        raise RuntimeError(f"no {name} on the PATH")
    return found


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and all processes that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def failures(output: str) -> list[str]:
    """Tests, or files of them, that pytest says in the end to have failed."""
    found = re.findall(r"^(?:FAILED|ERROR) (\S+?(?:\[.*?\])?)(?: - .*)?$", output, re.MULTILINE)
    return list(dict.fromkeys(found))


def _first_failure(output: str) -> str:
    """The first test that failed, or the one that never ended."""
    failed = re.search(r"^(\S+::.*?) (?:FAILED|ERROR)|^ERROR (\S+)", output, re.MULTILINE)
    if failed:
        return failed[1] or failed[2]
    begun = re.findall(r"^(tests/\S+::\S+)", output, re.MULTILINE)
    return begun[-1] if begun else output.strip()[-200:]
