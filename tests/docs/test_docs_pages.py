"""The built docs in Chromium: axe-core finds nothing serious, at the width of a desk and of a phone."""

from pathlib import Path

import axe
import pytest
from browser import MISSING, browser

BUILT = Path(__file__).parents[2] / "docs" / "_build"
ABSENT = MISSING or axe.MISSING or ("" if (BUILT / "index.html").is_file() else "needs the docs: make docs")
PAGES = ("index", "guide/my-motor", "guide/playground", "laws/harmonic", "laws/pi-ilc")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("chromium")) as shown:
        yield shown


@pytest.mark.skipif(bool(ABSENT), reason=ABSENT)
@pytest.mark.parametrize("width", [1300, 400])
@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_serious(chromium, name, width):
    chromium.open(BUILT / f"{name}.html", width)
    assert axe.findings(chromium) == []
