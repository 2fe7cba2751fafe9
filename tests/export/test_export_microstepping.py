"""The C of `microstepping`, a law without a drive: it repeats the engine's coil currents bit for bit."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import cogless
from test_export_c import ASKS, self_tested

from cogless import load
from cogless.export.c.export_c import export_c
from cogless.run.simulate import simulate

ROW = re.compile(r"^    \{0x(\w+)U, 0x(\w+)U, 0x(\w+)U, 0x(\w+)U, (\d+)U\},$", re.MULTILINE)
SHORT = {f"scenario.{name}.duration": "0.1 s" for name in ("20-mm-s", "50-mm-s-back")}
PERIODS = 400 + 2 * 256 + 3  # as simulated, a turn each way, faults


def exported(folder: Path, controller: str = "table", scenario: str | None = None, **changes: Any) -> Path:
    export_c(load("printer", {"metric": [], **SHORT, **changes}), controller, folder / "out", scenario)
    return folder / "out"


def periods(folder: Path) -> Any:
    """Rows of the self-test in double precision: theta_ref, omega_ref, i_a, i_b and the status."""
    text = (folder / "self_test_data.h").read_text()
    rows = [([int(word, 16) for word in words], int(status)) for *words, status in ROW.findall(text)]
    numbers = np.array([words for words, _ in rows], np.uint64).view(np.float64)
    return np.column_stack([numbers, [status for _, status in rows]])


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("controller", ["plain", "table"])
def test_the_self_test_repeats_the_simulation(tmp_path: Path, controller: str, precision: str) -> None:
    out = exported(tmp_path, controller, **{"drive.precision": precision})
    assert self_tested(out) == (0, f"{controller}: {PERIODS} periods, all bits equal\n")
    manifest = json.loads((out / "export.json").read_text())
    assert (manifest["scenario"], manifest["law"]) == ("20-mm-s", "microstepping")
    library = {path.stem for path in (out / "cogless").glob("*.h")}
    assert library == {"angle", "microstepping", "range", "real", "sine", "status"}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (".teeth = 50,", ".teeth = 100,"),
        (".current = 1.1313708498984762,", ".current = 1.1313708498984764,"),
        (".microsteps = 256,", ".microsteps = 128,"),
        ("{.order = 4, .magnitude = 0.0254, .phase = -", "{.order = 4, .magnitude = 0.0255, .phase = -"),
        (".phase = 0.767944870877505}", ".phase = 0.777944870877505}"),  # at negative speed
    ],
)
def test_the_self_test_finds_another_constant(tmp_path: Path, before: str, after: str) -> None:
    out = exported(tmp_path)
    source = out / "table_controller.c"
    text = source.read_text()
    assert text.count(before) == 1
    source.write_text(text.replace(before, after))
    code, told = self_tested(out)
    assert code == 1 and re.fullmatch(f"table: period \\d+ differs\n{ASKS}", told)


@pytest.mark.parametrize(("scenario", "direction"), [("20-mm-s", 1), ("50-mm-s-back", -1)])
def test_its_currents_are_those_of_the_run(tmp_path: Path, scenario: str, direction: int) -> None:
    """In the rotor's frame they are the current references of an ordinary run's trace."""
    rows = periods(exported(tmp_path, scenario=scenario))[:400]
    changes = {"metric": [], **SHORT, "trace.rate": "40 kHz"}
    trace = simulate(load("printer", changes), scenario, "table").trace
    i_a, i_b = rows[:, 2:4].T
    theta_e = 50 * trace["theta_measured"][:400]
    sine, cosine = np.sin(theta_e), np.cos(theta_e)
    np.testing.assert_allclose(i_a * cosine + i_b * sine, trace["i_d_ref"][:400], atol=1e-7)
    np.testing.assert_allclose(i_b * cosine - i_a * sine, trace["i_q_ref"][:400], atol=1e-7)
    np.testing.assert_allclose(rows[:, 0] % (2 * np.pi), trace["theta_ref"][:400] % (2 * np.pi), atol=1e-12)
    assert np.all(direction * rows[:, 1] > 0) and np.ptp(i_b) > 1


def test_the_self_test_has_a_turn_each_way_and_faults(tmp_path: Path) -> None:
    _, omega_ref, i_a, i_b, status = periods(exported(tmp_path))[400:].T
    for direction, turn in ((1, slice(0, 256)), (-1, slice(256, 512))):
        assert np.all(direction * omega_ref[turn] > 0)
        turned = np.unwrap(np.arctan2(i_b[turn], i_a[turn]))
        assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi * 255 / 256, abs=0.05)
    assert np.any(i_b[:256] != i_b[511:255:-1])  # friction's share
    assert list(status) == [0] * 512 + [2] * 3
    assert set(i_a[512:]) == {i_a[511]} and set(i_b[512:]) == {i_b[511]}


@pytest.mark.parametrize(
    ("controller", "changes", "told"),
    [
        ("plain", {}, "none"),
        ("table", {},
            "for 0.8 A rms: at a current I (rms) the correction leaves about abs(I / 0.8 A - 1) of the "
            "ripple"),
        ("table", {"controller.table.current": "1 A"},
            "for 0.8 A rms: at a current I (rms) the correction leaves about abs(I / 0.8 A - 1) of the "
            "ripple; the correction is for 0.8 A rms: at 1 A it leaves about 25% of the ripple"),
        ("table", {"controller.table.correction": {"forward": [{"order": 4, "magnitude": "0.02 rad"}]}},
            "for one current only, which the study does not state"),
    ],
)  # fmt: skip
def test_the_readme_tells_the_correction_s_current(
    tmp_path: Path, controller: str, changes: dict[str, Any], told: str
) -> None:
    readme = (exported(tmp_path, controller, **changes) / "README.md").read_text()
    assert f"\n| correction | {told} |\n" in readme


def test_an_fmu_needs_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = load("printer").source.path
    words = ("export", "printer", "--controller", "table", "--to")
    code, out, err = cogless(capsys, *words, "fmu", "-o", tmp_path / "fmus")
    assert (code, out) == (2, "") and not (tmp_path / "fmus").exists()
    assert err == (
        f'{path}: controller.table.law: "microstepping": has no drive around it: expected a law of a drive; '
        "`cogless export --to c` writes the law alone\n"
    )
    code, out, err = cogless(capsys, *words, "c", "-o", tmp_path / "firmware")
    assert (code, err) == (0, "") and out == f"Export: {tmp_path / 'firmware' / 'README.md'}\n"
