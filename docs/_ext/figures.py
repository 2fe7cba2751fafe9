"""Pictures of the docs, each made by a command that the page shows below it.

`run-figure` has a study's name and runs of one scenario, which are drawn as by `cogless run --plots`. Its
text is the caption. Each line of `:set:` is a change of the study.

    ```{run-figure} uomodri 1-rev-s/pi 1-rev-s/pi-ilc
    :set: controller.pi-ilc.gain = 0.02
    The ripple of the PI, and what learning leaves of it.
    ```
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from from_code import Parsed

FOLDER = "_build/figures"


class RunFigure(Parsed):
    required_arguments = 1
    final_argument_whitespace = True
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"set": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        from cogless import load, run_study
        from cogless.report import write_plots
        from cogless.study.reading import changes_from

        env = self.state.document.settings.env
        name, *only = self.arguments[0].split()
        sets = [line for line in self.options.get("set", "").splitlines() if line.strip()]
        words = ["cogless", "run", name, *(w for run in only for w in ("--only", run))]
        words += [word for change in sets for word in ("--set", change)]
        place = Path(env.srcdir) / FOLDER / env.docname / str(self.lineno)
        place.mkdir(parents=True, exist_ok=True)
        picture, *_ = write_plots(run_study(load(name, changes_from(sets)), only, jobs=2), place)
        caption = " ".join(self.content)
        return self.parse(
            [
                f"```{{figure}} /{picture.relative_to(env.srcdir)}",
                f":alt: {caption}",
                "",
                caption,
                "```",
                "",
                f"    {shlex.join([*words, '--plots'])}",
            ]
        )


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("run-figure", RunFigure)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
