"""A result folder is one set of files, whatever happens to the run that writes it."""

import errno
import json
import os
import random
import shutil
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import netCDF4
import pytest
from commands import cogless, forked

import studies
from cogless import StudyError
from cogless.files import replacing
from cogless.results import folder as folders
from cogless.results.folder import hashes, locked_folder, new_set

OURS = [folders.NEW, folders.OLD, folders.SET, folders.LINK_NAME]


def write(folder: Path, text: str, names: tuple[str, ...] = ("a", "maps/low/b.bin")) -> None:
    """Write a set whose files all have this text."""
    with locked_folder(folder), new_set(folder) as stage:
        for name in names:
            (stage / name).parent.mkdir(parents=True, exist_ok=True)
            (stage / name).write_text(text)
        index = json.dumps({"text": text, "files": hashes(stage)})
        (stage / "results.json").write_text(index)


def content(folder: Path) -> dict[str, str]:
    """What a reader finds in a folder: names and texts, those of hidden folders aside."""
    names = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    texts = {name: (folder / name).read_text() for name in names if not name.startswith(".cogless-")}
    if "results.json" in texts:
        texts["results.json"] = json.loads(texts["results.json"])["text"]
    return texts


OLD = {"a": "old", "maps/low/b.bin": "old", "results.json": "old", "mine.txt": "mine"}
NEW = {"a": "new", "c": "new", "results.json": "new", "mine.txt": "mine"}


def test_a_set_replaces_the_one_before_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    write(tmp_path, "old")
    assert content(tmp_path) == OLD
    write(tmp_path, "new", ("a", "c"))
    assert content(tmp_path) == NEW
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "c", "mine.txt", "results.json"]
    assert not any(p.is_symlink() for p in tmp_path.iterdir())


def test_a_file_that_was_changed_since_stays(tmp_path: Path) -> None:
    write(tmp_path, "old")
    (tmp_path / "maps/low/b.bin").write_text("tuned by hand")
    write(tmp_path, "new", ("a",))
    assert (tmp_path / "maps/low/b.bin").read_text() == "tuned by hand"


@pytest.mark.parametrize("name", ["../outside", "/etc/hostname", "a/../../outside"])
def test_names_that_no_run_wrote_remove_nothing(tmp_path: Path, name: str) -> None:
    folder, outside = tmp_path / "out", tmp_path / "outside"
    folder.mkdir()
    outside.write_text("outside")
    index = {"files": {name: folders._hash(outside)}}
    (folder / "results.json").write_text(json.dumps(index))
    write(folder, "new")
    assert outside.read_text() == "outside"


def planted(folder: Path, links: dict[str, str], files: tuple[str, ...]) -> None:
    """A folder as it may come from elsewhere."""
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("planted")
    for name, target in links.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).symlink_to(target)


PLANTED: list[tuple[dict[str, str], tuple[str, ...]]] = [
    ({".cogless-new": "../victim"}, ()),
    ({".cogless-old": "../victim"}, ()),
    ({".cogless-new": "../victim", ".cogless-set": ".cogless-new"}, ()),
    ({".cogless-old": "../victim", ".cogless-set": ".cogless-old"}, ()),
    ({".cogless-set": "../victim"}, ()),
    ({".cogless-set": "../victim"}, (".cogless-old/a",)),
    ({".cogless-link": "../victim"}, ()),
    ({".cogless-try-x": "../victim"}, ()),
    ({"maps": "../victim"}, ()),
    ({"maps/low": "../../victim"}, ()),
    ({"maps": "../victim", ".cogless-set": ".cogless-new"}, (".cogless-new/maps/b.bin",)),
    ({"maps": "../victim", ".cogless-set": ".cogless-new"}, (".cogless-old/maps/link",)),
    ({".cogless-new/maps": "../../victim", ".cogless-set": ".cogless-new"}, ()),
    ({"a": "../victim/b.bin"}, ()),
    ({"results.json": "../victim/b.bin"}, ()),
    ({}, (".cogless-new", ".cogless-old", ".cogless-set", ".cogless-link")),
]


@pytest.mark.skipif(os.name != "posix", reason="links")
@pytest.mark.parametrize(("links", "files"), PLANTED)
def test_no_link_in_a_folder_from_elsewhere_leads_out_of_it(
    tmp_path: Path, links: dict[str, str], files: tuple[str, ...]
) -> None:
    victim, folder = tmp_path / "victim", tmp_path / "out"
    for place in (victim, victim / "low"):
        place.mkdir()
        (place / "b.bin").write_text("old")
        (place / "link").symlink_to("b.bin")
    before = sorted(path.relative_to(victim) for path in victim.rglob("*"))
    planted(folder, links, files)
    index = {"files": {"maps/b.bin": folders._hash(victim / "b.bin")}}
    if "results.json" not in links:
        (folder / "results.json").write_text(json.dumps(index))
    refused = next((name for name in links if name.startswith("maps")), None)
    for _ in range(2):
        if refused is None:
            write(folder, "new")
            found = content(folder)
            assert found == {"a": "new", "maps/low/b.bin": "new", "results.json": "new"}
            assert not any(path.is_symlink() for path in folder.rglob("*"))
        else:
            with pytest.raises(StudyError) as error, locked_folder(folder, ["maps/low/b.bin"]):
                pytest.fail("not refused before the work")
            expected = "expected a directory of its own, or another directory for the results"
            link = "a symbolic link, which may lead anywhere"
            assert str(error.value) == f"{folder / refused}: {link}: {expected}"
    assert sorted(path.relative_to(victim) for path in victim.rglob("*")) == before
    assert {path.read_text() for path in victim.rglob("*.bin")} == {"old"}
    write(tmp_path / "another", "new")  # as it advises
    assert (tmp_path / "another" / "maps" / "low" / "b.bin").read_text() == "new"


ENDLESS = 200_000 * "["


@pytest.mark.parametrize(
    "index",
    [
        ENDLESS,
        '{"files": {"' + 300 * "x" + '": "y", "a\\u0000b": "y", "\\ud800": "y", "": "y", ".": "y"}}',
        '{"files": 5}',
        "null",
        "1" * 5000,
    ],
)
def test_an_index_that_is_none_lists_nothing(tmp_path: Path, index: str) -> None:
    (tmp_path / "results.json").write_text(index)
    (tmp_path / "mine.txt").write_text("mine")
    write(tmp_path, "new", ("a", "c"))
    assert content(tmp_path) == NEW


def occupied(folder: Path, name: str, directory: bool) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if directory:
        path.mkdir()
    else:
        path.touch()


@pytest.mark.parametrize(
    ("name", "directory", "place"),
    [
        ("traces.nc", True, "traces.nc"),
        ("report.html", True, "report.html"),
        ("results.json", True, "results.json"),
        ("maps", False, "maps"),
        ("maps/low", False, "maps/low"),
        ("maps/low/pi.bin", True, "maps/low/pi.bin"),
    ],
)
def test_what_is_in_the_place_of_a_file_is_told_before_the_runs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    directory: bool,
    place: str,
) -> None:
    monkeypatch.setattr("cogless.run.simulate.run_study", lambda *_, **__: pytest.fail("it ran"))
    out = tmp_path / "out"
    occupied(out, name, directory)
    before = sorted(out.rglob("*"))
    code, said, err = cogless(capsys, "run", studies.write(tmp_path), "-o", out)
    what = "a directory: expected a file" if directory else "a file: expected a directory of its own"
    assert (code, said, err) == (2, "", f"{out / place}: {what}, or another directory for the results\n")
    assert sorted(out.rglob("*")) == before
    with locked_folder(tmp_path / "another", [name]):  # as it advises
        pass


def test_a_name_that_no_file_can_have_is_told_before_the_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cogless.run.simulate.run_study", lambda *_, **__: pytest.fail("it ran"))
    long = 300 * "x"
    text = studies.BASE.replace("[controller.pi]", f"[controller.{long}]").replace('"pi"', f'"{long}"')
    text = text.replace(f'law = "{long}"', 'law = "pi"')
    out = tmp_path / "out"
    code, said, err = cogless(capsys, "run", studies.write(tmp_path, text), "-o", out)
    why = "file name too long: expected a name that can be written"
    assert (code, said, err) == (2, "", f"{out}/maps/low/{long}.bin: {why}\n")
    assert not out.exists()


def test_a_file_of_the_longest_name_is_written(tmp_path: Path) -> None:
    """Through a temporary one beside it, whose name is no longer."""
    path = tmp_path / (255 * "x")
    with replacing(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole" and list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name != "posix", reason="names of bytes")
def test_names_that_are_not_utf_8_are_told_before_the_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cogless.run.simulate.run_study", lambda *_, **__: pytest.fail("it ran"))
    study, name = studies.write(tmp_path), os.fsdecode(b"b\xff")
    code, said, err = cogless(capsys, "run", study, "-o", tmp_path / name)
    expected = "not UTF-8: expected a directory with a name in UTF-8"
    assert (code, said, err) == (2, "", f"{tmp_path}/b\\udcff: {expected}\n")
    other = study.rename(tmp_path / f"{name}.toml")
    code, said, err = cogless(capsys, "run", other, "-o", tmp_path / "out")
    expected = "not UTF-8: expected a study file with a name in UTF-8"
    assert (code, said, err) == (2, "", f"{tmp_path}/b\\udcff.toml: {expected}\n")
    assert sorted(os.listdir(tmp_path)) == [f"{name}.toml"]


class Killed(BaseException):
    """The process ends here: no clean-up happens."""


CALLS = ["link", "symlink", "replace", "mkdir", "unlink", "rmdir"]


def killed_at(monkeypatch: pytest.MonkeyPatch, number: int, error: BaseException) -> list[str]:
    """Let the call of this number that changes a folder fail, and all after it if the process is killed."""
    made: list[str] = []

    def watched(name):
        real = getattr(os, name)

        def call(*arguments, **options):
            made.append(name)
            if len(made) == number or (len(made) > number and isinstance(error, Killed)):
                raise error
            return real(*arguments, **options)

        return call

    for name in CALLS:
        monkeypatch.setattr(os, name, watched(name))
    return made


def old_sets(tmp_path: Path) -> Iterator[tuple[int, Path]]:
    """Numbers from 1, each with a folder that holds the old set and a file of the user's."""
    first = tmp_path / "first"
    first.mkdir()
    (first / "mine.txt").write_text("mine")
    write(first, "old")
    for number in range(1, 200):
        folder = tmp_path / str(number)
        shutil.copytree(first, folder)
        yield number, folder


@pytest.mark.skipif(os.name != "posix", reason="links")
def test_killed_at_any_step_of_the_switch_a_reader_finds_one_set(tmp_path: Path) -> None:
    """Each call that changes the folder is where the process ends, once; then the next run cleans."""
    outcomes = []
    for number, folder in old_sets(tmp_path):
        with pytest.MonkeyPatch.context() as patch:
            made = killed_at(patch, number, Killed())
            with suppress(Killed):
                write(folder, "new", ("a", "c"))
        found = content(folder)
        assert found in (OLD, NEW), number
        outcomes.append(found == NEW)
        with locked_folder(folder):
            assert content(folder) == found
        assert not [name for name in OURS if (folder / name).exists() or (folder / name).is_symlink()]
        if len(made) < number:
            break
    assert outcomes == sorted(outcomes) and outcomes.count(True) > 3 and outcomes.count(False) > 10


@pytest.mark.skipif(os.name != "posix", reason="links")
def test_no_room_for_the_links_leaves_the_old_set(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    seen = 0
    for number, folder in old_sets(tmp_path):
        with pytest.MonkeyPatch.context() as patch:
            made = killed_at(patch, number, full)
            try:
                write(folder, "new", ("a", "c"))
            except StudyError as error:
                seen += 1
                assert "no space left on device: expected" in str(error) and "\n" not in str(error)
        with locked_folder(folder):
            assert content(folder) in (OLD, NEW)
        if len(made) < number:
            break
    assert seen > 5


def test_without_links_the_files_are_replaced_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_, **__):
        raise OSError(errno.EPERM, "no links here")

    (tmp_path / "mine.txt").write_text("mine")
    write(tmp_path, "old")
    monkeypatch.setattr(os, "link", none)
    monkeypatch.setattr(os, "symlink", none)
    write(tmp_path, "new", ("a", "c"))
    assert content(tmp_path) == NEW


@pytest.mark.skipif(os.name != "posix", reason="locks")
def test_a_second_run_into_the_folder_is_refused(tmp_path: Path) -> None:
    for _ in range(2):  # the folder is free again when the first run is done
        with locked_folder(tmp_path):
            files = os.listdir("/dev/fd")
            with pytest.raises(StudyError) as error, locked_folder(tmp_path):
                pass
            assert os.listdir("/dev/fd") == files  # the refused one leaves none open
    expected = "another run is writing there: expected another directory"
    assert str(error.value) == f"{tmp_path}: {expected}"


def run_ids(folder: Path) -> set[str]:
    """The ids that the files of a result folder carry; its hashes are checked too."""
    index = json.loads((folder / "results.json").read_text())
    assert index["files"] == {name: folders._hash(folder / name) for name in index["files"]}
    with netCDF4.Dataset(folder / "traces.nc") as traces:
        ids = {index["run"], traces.run}
    page = (folder / "report.html").read_text()
    return ids | {page.partition('<meta name="run" content="')[2].partition('"')[0]}


SHORT = ("--only=low/*", "--set=trace.rate=1 kHz")


@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
def test_killed_at_random_moments_a_run_leaves_a_whole_set(tmp_path: Path) -> None:
    study, out, chance = studies.write(tmp_path), tmp_path / "out", random.Random(13)
    command = ("run", study, "-o", out, *SHORT)
    begun = time.monotonic()
    assert forked(tmp_path, *command, "--set=seed=0").end() == 0
    whole = time.monotonic() - begun
    for seed in range(1, int(os.environ.get("COGLESS_KILLS", "3")) + 1):
        run = forked(tmp_path, *command, f"--set=seed={seed}")
        time.sleep(whole * chance.uniform(0.3, 1.1))
        run.send(signal.SIGKILL)
        run.end()
        assert len(run_ids(out)) == 1
    assert forked(tmp_path, *command).end() == 0
    assert sorted(p.name for p in out.iterdir()) == ["report.html", "results.json", "traces.nc"]
