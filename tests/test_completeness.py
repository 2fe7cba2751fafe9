"""Every law, metric and sensor has all that belongs to it; what is missing is named."""

import ast
import functools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import pytest
from laws import ROWS

from cogless.control_library import C_LAWS, CLaw
from cogless.design.kinds import DESIGNS
from cogless.live.candidates import PAGE_KEYS
from cogless.live.description import BLOBS
from cogless.live.live_page import PAGES
from cogless.report import SECTIONS
from cogless.results.metrics import METRIC_FUNCTIONS
from cogless.results.runs import RESULTS
from cogless.run.carry_out import RUNS
from cogless.run.run_plan import PLANS
from cogless.study import load
from cogless.study.base import Kind, StudyBase
from cogless.study.laws import AnyController
from cogless.study.laws.trial import TrialLaw
from cogless.study.metric import EACH_PHASE, Metric
from cogless.study.position_sensor import PositionSensor
from cogless.study.reading import changes_from

ROOT = Path(__file__).parents[1]
CONTROL, LIBRARY = ROOT / "control", ROOT / "control" / "src" / "cogless"
FIELDS = [model.model_fields["law"] for model in get_args(AnyController)]
MODELS = {name for field in FIELDS for name in get_args(field.annotation)}
OF_TRIALS = "trial"  # has a study of its own, which says nothing of its gains: design does
FIGURE = re.compile(r"^```{run-figure} (\S+) (.+)\n(?::set:((?:.*\n)(?: .+\n)*))?", re.M)
STEP = re.compile(r"void (cgl_\w+_step)\(cgl_\w+ \*\w+,\s+const cgl_law_input")


@functools.cache
def text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def drawn(page: str) -> set[str]:
    """The laws whose runs a page of the docs shows, by their names in laws.def."""
    shown = set()
    for name, runs, changes in FIGURE.findall(page):
        study = load(name, changes_from(filter(str.strip, changes.splitlines())))
        laws = [study.controller.get(run.rpartition("/")[2]) for run in runs.split()]
        shown |= {OF_TRIALS if isinstance(law, TrialLaw) else law.law for law in laws if law}
    return shown


def missing(law: CLaw) -> list[str]:
    """What a law lacks, each as its place."""
    stem, header = law.stem, text(LIBRARY / law.header)
    reference = "".join(map(text, sorted((ROOT / "tests" / "reference").glob("*.py"))))
    class_name = "".join(word.capitalize() for word in stem.split("_"))
    map_of, init = text(LIBRARY / "map.h"), f"{law.state}_init("
    reset, retune = f"void {law.state}_reset({law.state} *", f"cgl_error {law.state}_retune("
    stored = text(ROOT / "tests" / "control" / "test_control_map_store.py")
    row, page = ROWS.get(law.name), text(ROOT / "docs" / "laws" / f"{law.name}.md")
    includes = text(LIBRARY / "laws.def").partition("#ifndef")[0]
    has = {
        f"control/src/cogless/{law.header}: {law.step}": law.step in STEP.findall(header),
        f"control/src/cogless/{stem}.c: {init}": init in text(LIBRARY / f"{stem}.c"),
        f'control/src/cogless/laws.def: #include "{law.header}"': f'"{law.header}"\n' in includes,
        f"control/src/cogless/{stem}.h: {reset}": reset in text(LIBRARY / f"{stem}.h"),
        f"control/src/cogless/{stem}.h: {retune}": retune in text(LIBRARY / f"{stem}.h"),
        f"control/src/cogless/map.h: {law.map}": law.cells is None or law.map in map_of,
        f"tests/reference/: class {class_name}": re.search(rf"^class {class_name}\b", reference, re.M)
        is not None,
        f"control/harness/{stem}.c: {init}": init in text(CONTROL / "harness" / f"{stem}.c"),
        f"control/proof/{stem}.c: {init}": init in text(CONTROL / "proof" / f"{stem}.c"),
        f'tests/laws.py: a row "{law.name}"': row is not None,
        f'tests/laws.py: its keys and a running config in the row "{law.name}"': (
            row is not None and (law.name == OF_TRIALS or bool(row.keys and row.running))
        ),
        f'tests/control/test_control_map_store.py: "{law.name}"': (
            law.cells is None or f'"{law.name}": ' in stored or law.map in stored
        ),
        f"control/README.md: `{stem}`": re.search(rf"^\| .*`{stem}`", text(CONTROL / "README.md"), re.M)
        is not None,
        f"docs/laws/{law.name}.md": bool(page),
        f"docs/laws/{law.name}.md: its run-figure": law.name in drawn(page),
        "src/cogless/study/laws: its model": law.name in (*MODELS, OF_TRIALS),
    }
    return [what for what, there in has.items() if not there]


@pytest.mark.parametrize("name", C_LAWS)
def test_a_law_has_all_that_belongs_to_one(name: str) -> None:
    lacking = "\n".join(missing(C_LAWS[name]))
    assert not lacking, f"{name} lacks\n{lacking}"


def test_what_is_no_law_of_a_drive_is_fuzzed_too() -> None:
    """run.sh builds each target: those of laws of drives by their harnesses, the others by a line."""
    run, own = text(CONTROL / "fuzz" / "run.sh"), {"map_store", "microstepping"}
    assert {path.stem for path in (CONTROL / "fuzz").glob("*.c")} == own | {"controller", "feed"}
    laws = {path.stem for path in (CONTROL / "harness").glob("*.c")} - {"harness"}
    assert laws == {law.stem for law in C_LAWS.values()} and "for law in control/harness/*.c; do" in run
    names = re.findall(r'^names="(.*)"$', run, re.MULTILINE)[0].split()
    for stem in own:
        assert re.search(rf'^build {stem} .*"\$here/{stem}\.c"$', run, re.MULTILINE) and stem in names
    fuzzed = text(CONTROL / "fuzz" / "microstepping.c")
    assert all(f"cgl_microstepping_{name}" in fuzzed for name in ("init", "retune", "reset(", "step("))


def test_what_is_missing_is_named() -> None:
    lacks = missing(CLaw("none", "none", "none.h", "cgl_none_step", "cell", "4U", ()))
    assert len(lacks) == 16 and "docs/laws/none.md" in lacks


@pytest.mark.parametrize(
    ("option", "keys"),
    [("", []), (":set: a.b = 1\n", ["a.b"]), (":set:\n  a.b = 1\n  c.d = x\n", ["a.b", "c.d"])],
)
def test_changes_of_a_figure_are_read(option: str, keys: list[str]) -> None:
    page = f"```{{run-figure}} uomodri 1-rev-s/pi\n{option}A caption.\n```\n"
    ((_, _, changes),) = FIGURE.findall(page)
    assert list(changes_from(filter(str.strip, changes.splitlines()))) == keys


def test_every_law_of_the_headers_has_a_row() -> None:
    steps = {step for header in LIBRARY.glob("*.h") for step in STEP.findall(text(header))}
    assert steps == {law.step for law in C_LAWS.values()}


def test_codes_of_stored_maps_are_in_the_order_of_the_rows() -> None:
    codes = re.findall(r"CGL_MAP_LAW_(\w+) = (\d+)", text(LIBRARY / "map.h"))
    stored = ["other", *(law.stem for law in C_LAWS.values() if law.cells)]
    assert [(name.lower(), int(code)) for name, code in codes] == [(s, n) for n, s in enumerate(stored)]


def lacks(name: str, places: dict[str, str]) -> list[str]:
    """The places that don't speak of a name."""
    return [place for place, words in places.items() if words.format(name) not in written(place)]


def written(place: str) -> str:
    """All texts of a file, or of those that a pattern of files stands for."""
    return "".join(map(text, sorted(ROOT.glob(place))))


@pytest.mark.parametrize("kind", METRIC_FUNCTIONS)
def test_a_kind_of_metric_has_all_that_belongs_to_one(kind: str) -> None:
    page, about = "trial-studies" if kind in EACH_PHASE else "metrics", METRIC_FUNCTIONS[kind].__doc__ or ""
    places = {f"docs/guide/{page}.md": "### `{}`", "tests/results/test_*metrics.py": '"{}"'}
    assert lacks(kind, places) == []
    assert re.search(r"signal's unit|no unit|Trials of|, (A|W|m|s)\b", about), "its docstring names no unit"
    assert kind in get_args(Metric.model_fields["kind"].annotation)


SENSORS = [one.model_fields["kind"].annotation for one in get_args(get_args(PositionSensor)[0])]


@pytest.mark.parametrize("kind", [get_args(annotation)[0] for annotation in SENSORS])
def test_a_position_sensor_has_all_that_belongs_to_one(kind: str) -> None:
    model = "IdealSensor" if kind == "ideal" else kind.title()
    places = {
        "simulator/config.cpp": '{{"{}", PositionSensorKind::',
        "simulator/position_sensor.hpp": "// {}: ",
        "tests/simulator/*.py": '"{}"',
        "docs/theory/sensors.md": "**{}**",
        "docs/reference/sensors.md": "study-table}} position_sensor." + model,
    }
    assert lacks(kind, places) == []


def test_a_kind_that_is_nowhere_is_missed() -> None:
    assert lacks("none-such", {"docs/guide/metrics.md": "### `{}`"}) == ["docs/guide/metrics.md"]


def is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)


def numbers_by_place(node: ast.ClassDef) -> list[str]:
    """The numbers of a dataclass that may be given by their place alone."""
    if any("kw_only=True" in ast.unparse(decorator) for decorator in node.decorator_list):
        return []
    fields = [part for part in node.body if isinstance(part, ast.AnnAssign)]
    last = next(
        (n for n, part in enumerate(fields) if ast.unparse(part.annotation) == "KW_ONLY"), len(fields)
    )
    return [
        ast.unparse(part.target) for part in fields[:last] if ast.unparse(part.annotation) in ("float", "int")
    ]


@pytest.mark.parametrize("table", [BLOBS, DESIGNS, PAGES, PAGE_KEYS, PLANS, RESULTS, RUNS, SECTIONS])
def test_a_room_knows_each_kind_of_study(table: Mapping[Kind, object]) -> None:
    assert sorted(table) == sorted(get_args(Kind)) == sorted(kind.kind for kind in StudyBase.__subclasses__())


def test_many_numbers_go_by_keyword() -> None:
    """Five in a row are not told apart by who reads them, nor by a type checker."""
    classes = [
        (path.relative_to(ROOT), node)
        for path in (ROOT / "src").rglob("*.py")
        for node in ast.walk(ast.parse(text(path)))
        if isinstance(node, ast.ClassDef) and is_dataclass(node)
    ]
    assert len(classes) > 100
    assert not [(str(path), node.name) for path, node in classes if len(numbers_by_place(node)) >= 5]
