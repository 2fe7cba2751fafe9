"""A law begins with a map that was learned before, by itself or by any other law, or with a table."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogless import StudyError, load
from cogless.export.prepared import prepare, record
from cogless.maps import learned_map
from cogless.maps.stored_map import MapError, StoredMap
from cogless.run.simulate import Run, rollout, run_study, simulate
from cogless.study import Study
from studies import IDEAL, write

FEEDBACK = """kp = "0.8 A*s/rad"
ki = "20 A/rad"
"""
LAWS = {
    "pi": f'law = "pi"\n{FEEDBACK}',
    "pi-ilc": f'law = "pi-ilc"\n{FEEDBACK}gain = "0.6 A*s/rad"\ncells = 360\n',
    "electrical": f'law = "pi-ilc"\n{FEEDBACK}gain = "0.6 A*s/rad"\nperiod = "electrical"\ncells = 128\n',
    "coarse": f'law = "pi-ilc"\n{FEEDBACK}gain = "0.6 A*s/rad"\ncells = 200\nq_half_width = 1\n',
    "by-time": f'law = "pi-ilc"\n{FEEDBACK}gain = "0.6 A*s/rad"\nmemory = "time"\ncells = 2048\n',
    "pi-afc": f'law = "pi-afc"\n{FEEDBACK}gain = "10 A/rad"\norders = [6, 24]\n',
    "robust": """law = "robust-ilc"\nb = 480\nc = 24\ng = 0\neta = 360\nq = 1\nbeta_1 = 0\nbeta_2 = 300
gamma = 0\ncells = 360\n""",
    "space": """law = "space-speed"\nk = 0.8\neta_bar = 10\nmu_alpha = 0.6\ncells = 256
q_half_width = 0
period = { of = "mechanical" }\n""",
    "with-speed": """law = "space-speed"\nk = 0.8\neta_bar = 10\nmu_alpha = 0.6\nmu_beta = 0.0001\ncells = 256
q_half_width = 0
period = { of = "mechanical" }\n""",
}
MORE = """
[scenario]
turns = {{ duration = "{duration} s", reference = "120 rpm", initial_speed = "120 rpm" }}
[[metric]]
name = "first"
kind = "ripple-rms"
signal = "omega_m"
window = ["0.5 s", "1 s"]
[[metric]]
name = "last"
kind = "ripple-rms"
signal = "omega_m"
last = "0.5 s"
"""
FIRST, LAST = "first_rad_s", "last_rad_s"


def study(folder: Path, law: str, duration: int = 1, more: str = "", **changes: Any) -> Study:
    """The small drive with one law."""
    text = f'title = "A start"\n{IDEAL}{MORE.format(duration=duration)}[controller.law]\n{LAWS[law]}{more}'
    return load(write(folder, text), {key.replace("__", "."): value for key, value in changes.items()})


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The run in which a law learned, and its map in a file."""

    @cache
    def of(law: str) -> tuple[Run, Path]:
        folder = tmp_path_factory.mktemp(law)
        run = simulate(study(folder, law, 30), "turns", "law")
        assert run.map is not None
        (folder / "map.bin").write_bytes(bytes(run.map))
        return run, folder / "map.bin"

    return of


def from_map(path: Path, more: str = "") -> str:
    return f'start = {{ map = "{path}" }}\n{more}'


@pytest.mark.parametrize("law", ["pi-ilc", "electrical", "robust", "space", "pi-afc"])
def test_a_run_goes_on_where_the_one_before_ended(law: str, learned: Any, tmp_path: Path) -> None:
    before, path = learned(law)
    anew = simulate(study(tmp_path, "pi"), "turns", "law").metrics[FIRST]
    again = simulate(study(tmp_path, law, more=from_map(path)), "turns", "law").metrics[FIRST]
    assert before.metrics[LAST] < 0.5 * anew
    assert again < 1.2 * before.metrics[LAST] + 0.01 * anew


@pytest.mark.parametrize("by", ["pi-ilc", "electrical", "pi-afc", "space"])
@pytest.mark.parametrize("law", ["pi-ilc", "coarse", "robust", "space", "with-speed", "pi-afc"])
def test_a_law_begins_with_what_another_one_learned(by: str, law: str, learned: Any, tmp_path: Path) -> None:
    """Learning does not begin in this run: all that helps is the map."""
    before, path = learned(by)
    held = "learning_start = 100\n"
    anew = simulate(study(tmp_path, law, more=held), "turns", "law").metrics[FIRST]
    here = simulate(study(tmp_path, law, more=from_map(path, held)), "turns", "law").metrics[FIRST]
    assert here < 1.2 * before.metrics[LAST] + 0.1 * anew


def test_a_table_needs_no_commissioning_run_if_it_has_a_start(learned: Any, tmp_path: Path) -> None:
    before, path = learned("pi-ilc")
    table = f'law = "anti-cogging"\n{FEEDBACK}cells = 360\n'
    LAWS["table"] = table
    plain = simulate(study(tmp_path, "pi"), "turns", "law").metrics[FIRST]
    run = simulate(study(tmp_path, "table", more=from_map(path)), "turns", "law")
    assert run.metrics[FIRST] < 0.2 * plain
    learned_ripple = before.map.values - before.map.values.mean()
    assert run.map is not None
    np.testing.assert_allclose(run.map.values, learned_ripple, atol=1e-7)
    with pytest.raises(StudyError, match=r"tuning = .* or a start"):
        study(tmp_path, "table")
    with pytest.raises(StudyError, match="expected no such key, since calibration is given"):
        both = 'calibration = { speed = "1 rad/s", position_gain = 0 }\n'
        study(tmp_path, "table", more=from_map(path, both))


def test_variants_in_step_and_exports_start_from_it_too(learned: Any, tmp_path: Path) -> None:
    _, path = learned("pi-ilc")
    made = study(tmp_path, "pi-ilc", more=from_map(path))
    alone = simulate(made, "turns", "law")
    beside = [one.runs[0] for one in rollout([made, made, made], jobs=1)]
    assert beside[0].lanes > 1
    for run in beside:
        np.testing.assert_array_equal(run.trace.data, alone.trace.data)
    prepared = prepare(made, "turns", "law")
    assert prepared.memory.any()
    recording = record(prepared, prepared.ticks)
    assert alone.map is not None
    np.testing.assert_array_equal(recording.memory[:360], alone.map.values[0])


def test_a_file_is_looked_for_beside_the_study_before_the_first_run(learned: Any, tmp_path: Path) -> None:
    _, path = learned("pi-ilc")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "mine.bin").write_bytes(path.read_bytes())
    run_study(study(tmp_path, "pi-ilc", more='start = { map = "maps/mine.bin" }\n'))
    with pytest.raises(StudyError, match=r'controller\.law\.start\.map: "other\.bin": expected a file at '):
        run_study(study(tmp_path, "pi-ilc", more='start = { map = "other.bin" }\n'))


OWN = {"units": (1,), "limits": [3.0], "turns": 1, "parts": 1, "ratio": 1, "values": np.zeros((1, 64))}
AFC = {
    "units": (6, 7, 8),
    "limits": [3.0, 3.0, 65535.0],
    "turns": 1,
    "parts": 1,
    "ratio": 1,
    "values": np.array([[0.0, 0.0], [0.0, 0.0], [2.0, 9.0]]),
}
ANGLE = 2 * np.pi / 64 * np.arange(64)
WAVE = 0.5 * np.cos(2 * ANGLE) - 0.2 * np.sin(9 * ANGLE)


def stored(values: Any, units: tuple[int, ...] = (1,), **other: Any) -> StoredMap:
    rows = np.atleast_2d(values)
    return StoredMap(rows, units, (1e6,) * len(rows), **other)


def test_orders_stay_when_the_cells_change() -> None:
    """Of both kinds: cells to cells, cells to amplitudes, and back, within the float of the stored map."""
    finer = learned_map.entries(stored(WAVE), {**OWN, "values": np.zeros((1, 90))}, 1.0)
    angle = 2 * np.pi / 90 * np.arange(90)
    np.testing.assert_allclose(finer[0], 0.5 * np.cos(2 * angle) - 0.2 * np.sin(9 * angle), atol=1e-7)
    coarser = learned_map.entries(stored(finer[0]), {**OWN, "values": np.zeros((1, 21))}, 1.0)
    np.testing.assert_allclose(learned_map.resampled(coarser[0], 64), WAVE, atol=1e-7)
    waves = learned_map.entries(stored(WAVE), AFC, 1.0)
    np.testing.assert_allclose(waves, [[0.5, 0.0], [0.0, -0.2], [2.0, 9.0]], atol=1e-7)
    np.testing.assert_allclose(learned_map.entries(stored(waves, (6, 7, 8)), OWN, 1.0)[0], WAVE, atol=1e-7)
    np.testing.assert_array_equal(learned_map.entries(stored(waves, (6, 7, 8)), AFC, 1.0), np.float32(waves))
    halves = stored([[1.0, 0.0], [0.0, 0.0], [1.0, 2.0]], (6, 7, 8), parts=2)  # orders of half a revolution
    found = learned_map.entries(
        halves, {**AFC, "values": np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 2.0]])}, 1.0
    )
    np.testing.assert_allclose(found[:2], [[0.0, 1.0], [0.0, 0.0]], atol=1e-7)


def test_a_map_of_an_electrical_revolution_repeats_in_a_mechanical_one() -> None:
    electrical = stored(np.cos(ANGLE), parts=3)
    found = learned_map.entries(electrical, {**OWN, "units": (4,), "values": np.zeros((1, 192))}, -2.0)
    np.testing.assert_allclose(found[0], -2.0 * np.cos(3 * 2 * np.pi / 192 * np.arange(192)), atol=1e-6)
    short = {**OWN, "parts": 3}
    with pytest.raises(MapError, match="a map over a revolution: expected one over the law's period, 1/3"):
        learned_map.entries(stored(WAVE), short, 1.0)
    with pytest.raises(MapError, match="a map over 1/2 of a revolution: expected"):
        learned_map.entries(replace(electrical, parts=2), short, 1.0)


@pytest.mark.parametrize(
    ("given", "law", "expected"),
    [
        (stored(WAVE, turns=0, parts=0), OWN, "a trial's signal: expected a map over the angle"),
        (stored(8 * WAVE), OWN, "an entry of 5.6.*: expected at most the law's limit, 3$"),
        (
            stored(WAVE[:16]),
            AFC,
            "a map of 16 entries, which hold orders up to 7: expected orders up to the law's 9$",
        ),
        (
            stored(WAVE, (4,)),
            OWN,
            "a map of acceleration: expected a map of this law's kind, or of a current",
        ),
        (stored([WAVE, WAVE], (1, 2)), OWN, "a map of current and current per speed: expected a map"),
        (
            stored([WAVE, WAVE], (1, 2), ratio=4),
            {**OWN, "units": (1, 2), "limits": [3.0, 3.0], "values": np.zeros((2, 64))},
            "a map of current and current per speed: expected a map of this law's kind",
        ),
    ],
)
def test_what_says_nothing_about_a_law_is_refused(given: StoredMap, law: Any, expected: str) -> None:
    with pytest.raises(MapError, match=expected):
        learned_map.entries(given, law, 1.0)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "no map: expected"),
        (b"a text", "no map: expected"),
        (b"CGLM", "cut short"),
        (bytes(stored(WAVE))[:-1] + b"\0", "damaged"),
        (bytes(stored(WAVE, (4,))), "a map of acceleration"),
    ],
)
def test_a_bad_file_is_told_in_one_line(content: bytes, expected: str, tmp_path: Path) -> None:
    (tmp_path / "map.bin").write_bytes(content)
    with pytest.raises(StudyError, match=rf'controller\.law\.start\.map: "map\.bin": .*{expected}') as failed:
        simulate(study(tmp_path, "pi-ilc", more='start = { map = "map.bin" }\n'), "turns", "law")
    assert "\n" not in str(failed.value)


def test_a_memory_over_time_has_no_start(learned: Any, tmp_path: Path) -> None:
    _, path = learned("pi-ilc")
    with pytest.raises(StudyError, match=r"controller\.law\.start\.map: .*since the memory is over time"):
        simulate(study(tmp_path, "by-time", more=from_map(path)), "turns", "law")


# The current that holds the motor of IDEAL: its cogging is 4 mN*m sin(24 theta), and K_t 0.12 N*m/A.
TURN = np.arange(720) / 2
HOLDING = -4 / 120 * np.sin(np.deg2rad(24 * TURN))


def table(folder: Path, heading: str, angle: Any, value: Any) -> None:
    lines = [f"angle [deg],{heading}", *(f"{a:.9g},{v:.9g}" for a, v in zip(angle, value, strict=True))]
    (folder / "table.csv").write_text("\n".join(lines), encoding="utf-8")


def uneven(angle: Any) -> Any:
    return angle + 0.1 * np.sin(np.deg2rad(7 * angle))


@pytest.mark.parametrize("law", ["pi-ilc", "coarse", "robust", "space", "pi-afc"])
@pytest.mark.parametrize(
    ("heading", "scale", "more"),
    [
        ("current [mA]", 1e3, 'sign = "holding"'),
        ("torque [mN*m]", 120, 'sign = "holding"'),
        ("torque [N*m]", -0.12, 'sign = "cogging"'),
    ],
)
def test_a_table_of_somebody_else_is_a_start(
    law: str, heading: str, scale: float, more: str, tmp_path: Path
) -> None:
    """The friction-free motor keeps its speed: what is left is the samples' and the cells'."""
    held, begins = "learning_start = 100\n", f'start = {{ table = "table.csv", {more} }}\n'
    table(tmp_path, heading, TURN, scale * HOLDING)
    anew = simulate(study(tmp_path, law, more=held), "turns", "law").metrics[FIRST]
    here = simulate(study(tmp_path, law, more=begins + held), "turns", "law").metrics[FIRST]
    assert here < 0.35 * anew


def start_of(folder: Path, law: str, more: str) -> Any:
    made = study(folder, law, more=f'start = {{ table = "table.csv", {more} }}\n')
    prepared = prepare(made, "turns", "law")
    return prepared.drive.stored(prepared.start())


def test_the_entries_are_the_tables_at_the_cells_angles(tmp_path: Path) -> None:
    """Also where its angles begin elsewhere, or are not evenly spaced, and over an electrical revolution."""
    angle = uneven(TURN + 3.0)
    table(tmp_path, "current [A]", angle, np.interp(angle, TURN, HOLDING, period=360) + 0.01)
    found = start_of(tmp_path, "pi-ilc", 'sign = "holding"')
    np.testing.assert_allclose(found["values"][0], HOLDING[::2], atol=4e-4)  # the mean is the integral's
    table(tmp_path, "torque [N*m]", TURN, 0.12 * np.cos(np.deg2rad(TURN)))
    found = start_of(tmp_path, "pi-ilc", 'sign = "cogging", frame = "electrical"')
    np.testing.assert_allclose(found["values"][0], -np.cos(np.deg2rad(4 * TURN[::2])), atol=1e-6)
    found = start_of(tmp_path, "electrical", 'sign = "cogging", frame = "electrical"')
    np.testing.assert_allclose(found["values"][0], -np.cos(2 * np.pi / 128 * np.arange(128)), atol=1e-6)
    with pytest.raises(
        StudyError, match=r'start\.table: "table\.csv": a map over a revolution: expected one over the law'
    ):
        start_of(tmp_path, "electrical", 'sign = "cogging"')


def test_a_torque_is_divided_by_the_torque_constant_that_the_controller_assumes(tmp_path: Path) -> None:
    table(tmp_path, "torque [N*m]", TURN, 0.12 * np.cos(np.deg2rad(TURN)))
    changes = {"drive__belief": {"psi_f": "40 mWb"}}
    made = study(tmp_path, "pi-ilc", more='start = { table = "table.csv", sign = "holding" }\n', **changes)
    prepared = prepare(made, "turns", "law")
    found = prepared.drive.stored(prepared.start())["values"][0]
    np.testing.assert_allclose(found, 0.5 * np.cos(np.deg2rad(TURN[::2])), atol=1e-6)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("", "start: expected either map"),
        ('map = "map.bin", table = "table.csv", sign = "holding"', "start.table: .*, since map is given"),
        ('table = "table.csv"', 'start.sign: missing: expected "holding" for values'),
        ('map = "map.bin", sign = "holding"', "start.sign: .*expected no such key"),
        ('table = "other.csv", sign = "holding"', 'start.table: "other.csv": expected a readable file'),
        (
            'table = "table.csv", sign = "holding"',
            'start.table: "table.csv": line 5: "nan": expected a finite',
        ),
    ],
)
def test_a_start_that_cannot_be_read_is_told(given: str, expected: str, tmp_path: Path) -> None:
    table(tmp_path, "current [A]", TURN, [1, 1, 1, np.nan, *HOLDING[4:]])
    with pytest.raises(StudyError, match=expected) as failed:
        study(tmp_path, "pi-ilc", more=f"start = {{ {given} }}\n")
    assert "\n" not in str(failed.value)
