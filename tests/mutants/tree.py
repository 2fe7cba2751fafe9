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
from shutil import rmtree
from typing import NamedTuple

TOOLS = Path(sys.executable).parent
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
            self._configure("control", library, double, "-DCOGLESS_SANITIZE=ON", "-DCMAKE_BUILD_TYPE=Debug")
        if not self.build():
            raise RuntimeError(f"{root}: does not build\n{self.said}")
        self.unchanged = self._machine_code()

    def read(self, file: str) -> str:
        return (self.root / file).read_text()

    def write(self, file: str, text: str) -> None:
        self._put(self.root / file, text.encode())

    def build(self) -> bool:
        """Build and install what has changed; return whether that succeeded."""
        sources = self.root / "src" / "cogless"
        for source in sources.rglob("*"):
            if source.is_file():
                self._put(self.site / "cogless" / source.relative_to(sources), source.read_bytes())
        built = all(self._ran("cmake", "--build", folder) for folder in (self.module, *self.libraries))
        return built and self._ran("cmake", "--install", self.module, "--prefix", self.site)

    def takes(self, file: str, text: str) -> bool:
        """Build with another text of a file; return whether it compiles, to other machine code than
        before."""
        self.write(file, text)
        if not file.endswith(".py"):
            return self.build() and self._machine_code() != self.unchanged
        try:
            compile(text, file, "exec")
        except SyntaxError:
            return False
        return self.build()

    def hits(self, jobs: int) -> Path:
        """Run all tests, side by side; return the folder in which mutants.hits notes who executed what."""
        folder = self.root / "hits"
        rmtree(folder, ignore_errors=True)
        folder.mkdir()
        self.build()
        self._tested("-n", str(jobs), "--dist", "loadfile")
        return folder

    def judge(self, file: str, turns: list[list[str]]) -> Verdict:
        """Run tests, one list after the other, until one fails; for a file of the C library its own tests
        run first."""
        if file.startswith("control"):
            for library in self.libraries:
                if not self._ran("ctest", "--test-dir", library, "--timeout", str(LONGEST_TEST)):
                    return Verdict("killed", "control/tests")
        for some in turns:
            code, output = self._tested("-x", *some) if some else (0, "")
            if code in (4, 5):  # usage error, or no tests found: not a failing test
                raise RuntimeError(output)
            if code != 0:
                outcome = "time-out" if "Timeout (" in output else "killed"
                return Verdict(outcome, _first_failure(output))
        return Verdict("survived", "")

    def stop(self) -> None:
        """End the running process, from another thread; the thread that waits for it gets an
        InterruptedError."""
        self.stopped = True
        if self.process is not None:
            _end(self.process)

    def failing(self, tests: list[str]) -> list[str]:
        """Those of these tests that fail in the unchanged tree."""
        _, output = self._tested(*tests)
        return re.findall(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)

    def _tested(self, *arguments: str) -> tuple[int, str]:
        limits = ["-o", f"faulthandler_timeout={LONGEST_TEST}", "-o", "faulthandler_exit_on_timeout=true"]
        pytest = ["prlimit", f"--data={MEMORY}", sys.executable, "-m", "pytest"]
        command = [*pytest, "-v", "--tb=no", "-p", "no:cacheprovider", *limits, *arguments]
        done = self._start(*command)
        return done.returncode, done.stdout

    def _ran(self, tool: str, *arguments: str | Path) -> bool:
        done = self._start(TOOLS / tool, *arguments)
        self.said = done.stdout
        return done.returncode == 0

    def _configure(self, source: str, folder: Path, *options: str) -> None:
        ninja = ["-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={TOOLS / 'ninja'}"]
        done = self._start(TOOLS / "cmake", "-S", source, "-B", folder, *ninja, *options)
        if done.returncode:
            raise RuntimeError(done.stdout)

    def _machine_code(self) -> dict[Path, bytes]:
        return {path: sha256(path.read_bytes()).digest() for path in self.module.rglob("*.o")}

    def _start(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        """Run a command in the copy, and end all processes that it leaves running."""
        path = f"{self.site}{os.pathsep}{self.root / 'tests'}"
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
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


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and all processes that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _first_failure(output: str) -> str:
    """The first test that failed, or the one that never ended."""
    failed = re.search(r"^(\S+::.*?) (?:FAILED|ERROR)|^ERROR (\S+)", output, re.MULTILINE)
    if failed:
        return failed[1] or failed[2]
    begun = re.findall(r"^(tests/\S+::\S+)", output, re.MULTILINE)
    return begun[-1] if begun else output.strip()[-200:]
