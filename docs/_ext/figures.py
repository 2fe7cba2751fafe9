"""Pictures of the docs, each made by a command that the page shows below it.

`run-figure` has a study's name and runs of one scenario, which are drawn as by `cogless run --plots`. Its
text is the caption. Each line of `:set:` is a change of the study. `:kind:` chooses the picture: "waveforms"
or another at the end of its file's name; default is the first. `:copy:` names a picture that is kept for
a page that nothing builds, such as the README: if it shows other numbers, there is a warning, an error of
`make docs`, with the command that renews it.

    ```{run-figure} uomodri 1-rev-s/pi 1-rev-s/pi-ilc
    :set: controller.pi-ilc.gain = 0.02
    The ripple of the PI, and what learning leaves of it.
    ```

`shell-figure` has the picture that commands leave. The commands of a page share a folder, which begins with
`:file:`, from the examples.

    ```{shell-figure} first/slow-waveforms.png
    :file: my_motor.toml
    $ cogless run my_motor.toml -o first --plots
    The ripple of the PI.
    ```

`drive-figure` has a drive's motor without its table and with it, by docs/drive_pictures.py.

    ```{drive-figure} moteus
    The speed at 30 r/min.
    ```

`screenshot` has a picture that `python docs/screenshots.py` keeps in docs/images; there is a warning if the
page that it shows is made of other files today.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from from_code import Parsed
from PIL import Image
from sphinx.util import logging

log = logging.getLogger(__name__)
FOLDER = "_build/figures"
SAME = 0.01  # relative difference of the ends of curves that are the same


class Pictured(Parsed):
    final_argument_whitespace = True
    has_content = True

    @property
    def env(self) -> Any:
        return self.state.document.settings.env

    def place(self, *parts: str) -> Path:
        """A folder for the page's pictures, below that of all."""
        folder = Path(self.env.srcdir, FOLDER, self.env.docname, *parts)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def shown(self, picture: Path, caption: str, commands: list[str]) -> list[nodes.Node]:
        """The picture with its caption and its commands."""
        figure = [f"```{{figure}} /{picture.relative_to(self.env.srcdir)}", f":alt: {caption}", "", caption]
        return self.parse([*figure, "```", "", *(f"    {command}" for command in commands)])


class RunFigure(Pictured):
    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = dict.fromkeys(("set", "copy", "kind"), directives.unchanged)

    def run(self) -> list[nodes.Node]:
        from cogless import load, run_study
        from cogless.report import write_plots
        from cogless.study.reading import changes_from

        name, *only = self.arguments[0].split()
        sets = [line for line in self.options.get("set", "").splitlines() if line.strip()]
        words = ["cogless", "run", name, *(w for run in only for w in ("--only", run))]
        words += [word for change in sets for word in ("--set", change)]
        results = run_study(load(name, changes_from(sets)), only, jobs=2)
        drawn = write_plots(results, self.place(str(self.lineno)))
        kind = self.options.get("kind", "")
        picture = next(path for path in drawn if path.stem.endswith(kind))
        if "copy" in self.options:
            kept = Path(self.env.srcdir) / self.options["copy"]
            if not same(picture, kept):
                log.warning(
                    "%s is stale: cp %s %s", kept, picture, kept, location=(self.env.docname, self.lineno)
                )
        return self.shown(picture, " ".join(self.content), [shlex.join([*words, "--plots"])])


class ShellFigure(Pictured):
    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"file": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        folder = self.place("shell")
        if "file" in self.options:
            given = Path(self.env.srcdir).parent / "examples" / self.options["file"]
            self.env.note_dependency(str(given))
            shutil.copy(given, folder)
        commands = [line.removeprefix("$ ") for line in self.content if line.startswith("$ ")]
        for command in commands:
            _, *words = shlex.split(command)
            done = subprocess.run(
                [sys.executable, "-m", "cogless", *words], cwd=folder, capture_output=True, text=True
            )
            if done.returncode:
                raise self.error(f"{command}: {done.stderr}")
        caption = " ".join(line for line in self.content if not line.startswith("$ "))
        return self.shown(folder / self.arguments[0], caption, commands)


class DriveFigure(Pictured):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        from drive_pictures import drawn

        drive = self.arguments[0]
        picture, ripples = drawn(drive, self.place(drive))
        caption = (
            f"{' '.join(self.content)} Ripple (rms): {ripples['none']:.3g} r/min without the table, "
            f"{ripples['table']:.3g} with it."
        )
        return self.shown(picture, caption, [f"python docs/drive_pictures.py {drive} FOLDER"])


class Screenshot(Pictured):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        from screenshots import COMMAND, source

        kept = Path(self.env.srcdir) / "images" / self.arguments[0]
        known = ""
        if kept.is_file():
            with Image.open(kept) as image:
                known = image.info.get("Source", "")
        if known != source():
            log.warning("%s is stale: %s", kept, COMMAND, location=(self.env.docname, self.lineno))
        return self.shown(kept, " ".join(self.content), [COMMAND])


def same(one: Path, other: Path) -> bool:
    """Whether two pictures show the same numbers."""
    return other.is_file() and alike(numbers(one), numbers(other))


def numbers(picture: Path) -> list[list[float]]:
    """The ends of each curve, as cogless writes them into its pictures; none in another's picture."""
    with Image.open(picture) as image:
        return json.loads(image.info.get("Series", "[]"))


def alike(one: list[list[float]], other: list[list[float]]) -> bool:
    def close(a: list[float], b: list[float]) -> bool:
        size = max(abs(x) for x in (*a, *b))
        return all(abs(x - y) <= SAME * size for x, y in zip(a, b, strict=True))

    return bool(one) and len(one) == len(other) and all(map(close, one, other))


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("run-figure", RunFigure)
    app.add_directive("shell-figure", ShellFigure)
    app.add_directive("drive-figure", DriveFigure)
    app.add_directive("screenshot", Screenshot)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
