"""Files and names that contributing.md sends a new contributor to."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
WALKS = PAGE.partition("## Follow a value")[2]
FOLDERS = ("control", "docs", "motors", "parts", "simulator", "src", "studies", "tests")
FILES = [
    path for place in (ROOT.glob("*"), *((ROOT / name).rglob("*") for name in FOLDERS)) for path in place
]
LAW_FILES = re.findall(r"^\| [\d, ]+ \| `([^`]+)`", PAGE, re.MULTILINE)
STEPS = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|", WALKS.partition("\n## ")[0], re.MULTILINE)


def test_the_walks_are_read() -> None:
    assert len(STEPS) == 5


@pytest.mark.parametrize(("file", "name"), STEPS, ids=lambda text: Path(text).name)
def test_a_step_of_a_walk_is_defined_where_the_page_says(file: str, name: str) -> None:
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^(def|class) {name}\b|^}} {name};|\b{name}\(typename", text, re.MULTILINE)


def test_a_walk_never_returns_to_a_room() -> None:
    for table in WALKS.partition("\n## ")[0].split("**A ")[1:]:
        rooms = [str(Path(file).parent) for file in re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)]
        changes = [room for room, before in zip(rooms, ["", *rooms], strict=False) if room != before]
        assert 2 <= len(changes) <= 5 and len(changes) == len(set(changes))


@pytest.mark.parametrize(
    "name", sorted(set(re.findall(r"`([\w/.-]+\.(?:c|cpp|def|h|hpp|js|md|py|toml))`", PAGE)))
)
def test_a_file_that_the_page_names_exists(name: str) -> None:
    ending = re.compile("/" + re.escape(name).replace("NAME", r"[\w-]+") + "$")
    assert any(ending.search(path.as_posix()) for path in FILES)


@pytest.mark.parametrize("law", ["adrc", "harmonic"])
def test_a_law_has_each_file_of_the_table(law: str) -> None:
    assert len(LAW_FILES) == 10
    assert [name for name in LAW_FILES if not (ROOT / name.replace("NAME", law)).is_file()] == []


def test_a_name_on_the_page_is_one_of_the_code() -> None:
    """`NAME` stands for a law, and a word with a dot, a slash or a dash for a file, a key or a command."""
    texts = (path for path in FILES if path.suffix in (".c", ".cpp", ".def", ".h", ".hpp", ".js", ".py"))
    words = set(re.findall(r"\w+", " ".join(path.read_text(encoding="utf-8") for path in texts)))
    names = {name for name in re.findall(r"`([A-Za-z_]\w+)`", PAGE) if "NAME" not in name}
    assert len(names) > 50 and names - words == set()
