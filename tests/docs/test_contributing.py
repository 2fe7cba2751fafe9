"""Files and names that contributing.md sends a new contributor to."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WALKS = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8").partition("## Follow a value")[2]
STEPS = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|", WALKS.partition("\n## ")[0], re.MULTILINE)


def test_the_walks_are_read() -> None:
    assert len(STEPS) == 14


@pytest.mark.parametrize(("file", "name"), STEPS, ids=lambda text: Path(text).name)
def test_a_step_of_a_walk_is_defined_where_the_page_says(file: str, name: str) -> None:
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^(def|class) {name}\b|^}} {name};|\b{name}\(typename", text, re.MULTILINE)


def test_a_walk_never_returns_to_a_room() -> None:
    for table in WALKS.partition("\n## ")[0].split("**A ")[1:]:
        rooms = [str(Path(file).parent) for file in re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)]
        changes = [room for room, before in zip(rooms, ["", *rooms], strict=False) if room != before]
        assert 2 <= len(changes) <= 5 and len(changes) == len(set(changes))
