"""Pictures of the live page for the docs: `python docs/screenshots.py` renews them, in headless Chromium.

Each carries the hash of what the page is made of, so that `make docs` can tell a stale one without a browser.
"""

from __future__ import annotations

import base64
import hashlib
import io
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image
from PIL.PngImagePlugin import PngInfo

if TYPE_CHECKING:
    from browser import Browser

ROOT = Path(__file__).parents[1]
COMMAND = "python docs/screenshots.py"
STUDY = ROOT / "examples" / "my_motor.toml"
WIDTH, HEIGHT = 1300, 1150
COLOURS = 256  # of a palette: with fewer, small coloured texts become grey
STILL = {"name": "prefers-reduced-motion", "value": "reduce"}


def source() -> str:
    """Hash of what the pictures show: the study, and the page's assets."""
    found = hashlib.sha256(STUDY.read_bytes())
    for folder in ("live", "report"):
        for path in sorted((ROOT / "src" / "cogless" / folder / "assets").iterdir()):
            if path.suffix in (".css", ".html", ".js"):
                found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()[:16]


def picture(shown: Browser, page: Path) -> Image.Image:
    """A page as it opens, with its rotors at rest: the same picture each time."""
    shown.devtools("Emulation.setEmulatedMedia", features=[STILL])
    shown.devtools("Emulation.setScrollbarsHidden", hidden=True)
    shown.open(page, WIDTH, HEIGHT)
    while not shown.run("return window.cogless ? cogless.isIdle() : false"):
        time.sleep(0.1)
    taken = shown.devtools("Page.captureScreenshot")
    with Image.open(io.BytesIO(base64.b64decode(taken["data"]))) as image:
        return image.convert("RGB")


def main() -> None:
    sys.path.insert(0, str(ROOT / "tests"))
    from browser import browser

    from cogless import load
    from cogless.live import write

    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as shown:
        page = Path(folder) / "page.html"
        write(load(STUDY), page, "cogless run my_motor.toml")
        image = picture(shown, page)
    about = PngInfo()
    about.add_text("Source", source())
    small = image.quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(ROOT / "docs" / "images" / "live.png", pnginfo=about, optimize=True)


if __name__ == "__main__":
    main()
