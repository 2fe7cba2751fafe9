"""The page's scripts in node, and the engine's module, if both are there."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

from cogless.live import engine
from cogless.live.compile import NAMES
from cogless.live.live_page import asset

NODE = shutil.which("node")
NO_NODE = "" if NODE else "needs node"


def missing_engines() -> str:
    """Which of the engine's modules are not compiled, as the reason to skip a test; empty if none."""
    missing = [precision for precision in NAMES if not engine.is_there(precision)]
    return f"needs the WebAssembly engine, {' and '.join(missing)}: make web" if missing else ""


NO_ENGINE = missing_engines()


def run_node(folder: Path, assets: tuple[str, ...], script: str, given: Any) -> Any:
    """Run a script in node; returns what it returns, or what it awaits. It sees `given` and these assets."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "given.json").write_text(json.dumps(given))
    read = 'const given = JSON.parse(require("fs").readFileSync(process.argv[2]));'
    body = f"(async () => {{ {script} }})().then((made) => console.log(JSON.stringify(made)));"
    text = "\n".join([*map(asset, assets), read, body])
    (folder / "script.cjs").write_text(text)
    done = subprocess.run(
        [NODE or "", str(folder / "script.cjs"), str(folder / "given.json")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def module_file(folder: Path, precision: str) -> str:
    """Write the engine's module to a file; returns the path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{precision}.wasm"
    path.write_bytes(engine.module(precision))
    return str(path)
