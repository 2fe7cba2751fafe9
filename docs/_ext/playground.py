"""`playground`: the live pages of shipped studies, made with the docs.

    ```{playground} uomodri gimbal
    ```

The pages need the engine as WebAssembly. Without it, a line says how to get it, and nothing else is missing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from from_code import Parsed

FOLDER = "playground"


class Playground(Parsed):
    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        from cogless import load
        from cogless.live import engine, write
        from cogless.live.blobs import precision

        studies = [load(name) for name in self.arguments[0].split()]
        if not all(engine.is_there(precision(study)) for study in studies):
            return self.parse(
                ["*These docs were made without the engine for live pages: `make web docs` adds them.*"]
            )
        folder = Path(self.state.document.settings.env.app.outdir) / FOLDER
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for study in studies:
            write(study, folder / f"{study.name}.html", f"cogless run {study.name}")
            laws = ", ".join(study.label(name) for name in study.controller)
            up = "../" * self.env_docname().count("/")
            rows += [f'- <a href="{up}{FOLDER}/{study.name}.html">{study.title}</a>: {laws}']
        return self.parse(rows)

    def env_docname(self) -> str:
        return str(self.state.document.settings.env.docname)


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("playground", Playground)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
