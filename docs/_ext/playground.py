"""`playground`: the live pages of shipped studies, made with the docs.

    ```{playground} uomodri gimbal
    :motor: ../../examples/my_motor.toml
    :set: controller.harmonic.base=1
    ```

`motor` names a study, relative to the page, whose motor the reader makes his own; `set` are changes to it.
The pages need the engine as WebAssembly. Without it, a line says how to get it, and nothing else is missing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from from_code import Parsed

FOLDER = "playground"


class Playground(Parsed):
    required_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar = {"motor": str, "set": str}

    def run(self) -> list[nodes.Node]:
        from cogless import load
        from cogless.live import engine, write
        from cogless.study.reading import changed, parse_change

        studies = [load(name) for name in self.arguments[0].split()]
        commands = [f"cogless run {study.name}" for study in studies]
        own = self.options.get("motor")
        if own is not None:
            file, change = Path(self.env_source()).parent / own, self.options["set"]
            studies.insert(0, changed(load(file), dict([parse_change(change)])))
            commands.insert(0, f"cogless run {file.name} --set {change}")
        if not all(engine.is_there(study.precision) for study in studies):
            return self.parse(
                ["*These docs were made without the engine for live pages: `make web docs` adds them.*"]
            )
        folder = Path(self.state.document.settings.env.app.outdir) / FOLDER
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for n, (study, command) in enumerate(zip(studies, commands, strict=True)):
            write(study, folder / f"{study.name}.html", command, for_own_motor=own is not None and n == 0)
            laws = ", ".join(study.label(name) for name in study.controller)
            up = "../" * self.env_docname().count("/")
            rows += [f'- <a href="{up}{FOLDER}/{study.name}.html">{study.title}</a>: {laws}']
        return self.parse(rows)

    def env_source(self) -> str:
        return str(self.state.document.settings.env.doc2path(self.env_docname()))

    def env_docname(self) -> str:
        return str(self.state.document.settings.env.docname)


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("playground", Playground)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
