"""Stored maps in Python: the bytes, what is refused and why, the command line, maps of runs."""

import os
import struct
from dataclasses import replace
from math import radians
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from commands import cogless
from hypothesis import given, settings
from hypothesis import strategies as st

import studies
from cogless import StudyError, load, run_study
from cogless.maps import learned_map, stored_map
from cogless.maps.stored_map import MapError, StoredMap, decode
from cogless.run.run_plan import plan
from cogless.run.simulate import simulate

EXAMPLE = StoredMap(
    values=np.array([[0.5, -1.0, 0.25, 0.0]], dtype=np.float32),
    units=(1,),
    limits=(3.0,),
    law=1,
    turns=1,
    parts=4,
    motor=0x1F2E3D4C,
    sequence=5,
    write_size=16,
)
# What SPEC.md prints.
EXAMPLE_BYTES = bytes.fromhex(
    "43474c4d 0100 4000 05000000 4c3d2e1f 00000000 01 01 1000 04000000 01000000 04000000 0100 01 01 0000 0000"
    "00004040 00000000 00000000"
)


def test_the_bytes_are_those_of_the_specification() -> None:
    image = bytes(EXAMPLE)
    assert image[:56] == EXAMPLE_BYTES
    entries = struct.pack("<4f", 0.5, -1.0, 0.25, 0.0)
    assert image[56:60] == struct.pack("<I", crc32(entries))
    crc = crc32(image[:60])
    assert image[60:64] == struct.pack("<I", crc)
    assert image[64:80] == entries
    assert image[80:] == struct.pack("<I", ~crc & 0xFFFFFFFF) + b"DONE" + b"\xff" * 8
    spec = (Path(__file__).parents[2] / "control" / "SPEC.md").read_text(encoding="utf-8")
    printed = spec.partition("## Example")[2].partition("```")[2].partition("```")[0]
    assert bytes.fromhex("".join(line.partition("|")[0] for line in printed.splitlines()[1:])) == image


@pytest.mark.parametrize("write_size", [1, 2, 4, 8, 16, 32, 256])
def test_round_trip(write_size: int) -> None:
    stored = replace(
        EXAMPLE, values=np.ones((3, 7)), units=(1, 2, 3), limits=(1.0, 2.0, 3.0), write_size=write_size
    )
    again = decode(b"before" + bytes(stored) + b"after", 6)
    np.testing.assert_array_equal(again.values, stored.values)
    assert bytes(again) == bytes(stored)


def test_every_flipped_bit_is_refused() -> None:
    image = bytes(EXAMPLE)
    for bit in range(8 * len(image)):
        damaged = bytearray(image)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(MapError):
            decode(bytes(damaged))


def test_every_cut_is_refused() -> None:
    image, header = bytes(EXAMPLE), stored_map.HEADER_BYTES
    for length in range(len(image)):
        cut = f"cut short: expected {header} bytes of header, got {length}$"
        if length >= header:
            cut = f"cut short: expected {len(image)} bytes, got {length}$"
        with pytest.raises(MapError, match="no map" if length < 4 else cut):
            decode(image[:length])


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200), st.integers(0, 60), st.binary(min_size=1, max_size=8))
def test_anything_is_a_map_or_refused(tail: bytes, place: int, change: bytes) -> None:
    """Also a header with any field in it and a CRC that is right."""
    header = bytearray(bytes(EXAMPLE)[:60])
    header[place : place + len(change)] = change
    data = bytes(header[:60]) + struct.pack("<I", crc32(header[:60])) + tail
    for piece in (data, b"CGLM" + tail):
        try:
            decode(piece)
        except MapError as error:
            assert "\n" not in str(error)


def refusal(image: bytes) -> str:
    with pytest.raises(MapError) as error:
        decode(image)
    return str(error.value)


def test_reasons() -> None:
    image = bytearray(bytes(EXAMPLE))
    image[4] = 2
    image[60:64] = struct.pack("<I", crc32(image[:60]))
    assert refusal(bytes(image)) == "version 2 of the format: expected 1"
    image = bytearray(bytes(EXAMPLE))
    image[70] ^= 1
    assert refusal(bytes(image)).startswith("damaged: the map stores the CRC 0x")
    image = bytearray(bytes(EXAMPLE))
    image[80:] = b"\xff" * 16
    assert refusal(bytes(image)) == "damaged: no mark at the end: the map was not saved completely"
    too_large = replace(EXAMPLE, limits=(0.75,))
    assert refusal(bytes(too_large)) == "entry 1 of channel 1 is -1: expected a number within +-0.75"
    infinite = replace(EXAMPLE, values=np.array([[0.0, np.nan, np.inf]]))
    assert refusal(bytes(infinite)) == "entry 1 of channel 1 is nan: expected a number within +-3"


@pytest.mark.parametrize(
    ("place", "kind", "value"),
    [
        (6, "H", 65),  # the header's length
        (21, "B", 2),  # type of its numbers
        (22, "H", 0),  # write size
        (22, "H", 3),
        (22, "H", 512),
        (24, "I", 0),  # cells
        (24, "I", (1 << 24) + 1),
        (28, "I", 0),  # turns, without parts
        (32, "I", 0),
        (36, "H", 0),  # ratio
        (38, "B", 0),  # channels
        (38, "B", 4),
        (42, "H", 1),  # zero
    ],
)
def test_a_header_that_no_firmware_writes(place: int, kind: str, value: int) -> None:
    image = bytearray(bytes(EXAMPLE))
    struct.pack_into(f"<{kind}", image, place, value)
    image[60:64] = struct.pack("<I", crc32(image[:60]))
    assert refusal(bytes(image)) == "a header that is not valid in version 1, though its CRC is right"


def test_a_map_s_entries_are_no_map() -> None:
    """Entries that read as the first bytes of a map are none; a map that begins within them is found."""
    values = np.frombuffer(b"CGLM" * 3, "<f4")
    image = bytes(replace(EXAMPLE, values=values, limits=(3e8,)))
    found = stored_map.find(b"CGLM" + image + bytes(EXAMPLE))
    assert [place.offset for place in found] == [0, 4, 4 + len(image)]


def test_codes_that_are_not_known_are_shown() -> None:
    names = [replace(EXAMPLE, law=law).law_name for law in (0, len(stored_map.LAWS), 127, 128, 255)]
    assert names == ["other", str(len(stored_map.LAWS)), "127", "own law 128", "own law 255"]
    last = len(stored_map.CHANNEL_UNITS)
    assert replace(EXAMPLE, units=(last - 1,)).unit(0) == ("order", "", "order")
    assert replace(EXAMPLE, units=(last,)).unit(0) == (f"unit {last}", "", f"unit_{last}")


# halfway round neither of two is newer
@pytest.mark.parametrize(
    ("one", "other", "wanted"),
    [
        (1, 2, 2), (2, 1, 2), (2**32 - 1, 0, 0), (0, 2**32 - 1, 0), (7, 7, 7), (0, 2**31 - 1, 2**31 - 1),
        (0, 2**31, 0),
    ],
)  # fmt: skip
def test_the_newest_of_a_dump(one: int, other: int, wanted: int) -> None:
    slots = [bytes(replace(EXAMPLE, sequence=n)).ljust(512, b"\xff") for n in (one, other)]
    found = stored_map.find(b"".join(slots))
    newest = stored_map.newest(found)
    assert newest is not None
    assert [place.offset for place in found] == [0, 512]
    assert newest.map.sequence == wanted


# the command line


def test_map_shows_writes_and_exports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dump = tmp_path / "dump.bin"
    broken = bytearray(bytes(replace(EXAMPLE, sequence=6)))
    broken[66] ^= 8
    dump.write_bytes(bytes(EXAMPLE).ljust(256, b"\xff") + bytes(broken))
    one, table = tmp_path / "one.bin", tmp_path / "table.csv"
    code, out, err = cogless(capsys, "map", dump, "--csv", table, "-o", one, "--motor", "0xABCD")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "At byte 0: a valid map, the newest"
    assert lines[1].split() == ["learned", "by", "pi-ilc"]
    assert lines[2].split() == ["motor", "0x1F2E3D4C"]
    assert lines[4].split(maxsplit=1)[1] == "1/4 of a mechanical revolution, 90 deg"
    assert lines[6].split(maxsplit=1)[1] == "rms 0.5728, peak 1, limit 3 A"
    assert lines[7].startswith("At byte 256: damaged: ")
    assert bytes(decode(one.read_bytes())) == bytes(replace(EXAMPLE, motor=0xABCD))
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert table.read_text().splitlines()[0] == "theta_m_rad,current_A"
    np.testing.assert_allclose(rows[:, 0], np.arange(4) * np.pi / 8)
    np.testing.assert_array_equal(rows[:, 1], EXAMPLE.values[0])
    code, out, _ = cogless(capsys, "map", dump, "--csv", "-")
    assert (code, out) == (0, table.read_text())


def test_map_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut, other, good = tmp_path / "cut.bin", tmp_path / "other.bin", tmp_path / "good.bin"
    cut.write_bytes(bytes(EXAMPLE)[:70])
    other.write_text("no map at all")
    good.write_bytes(bytes(EXAMPLE))
    os.mkfifo(tmp_path / "pipe")
    for arguments, line in (
        ([tmp_path / "pipe"], f"{tmp_path / 'pipe'}: not a regular file: expected a stored map"),
        ([good, "-o", "."], ".: is a directory: expected a file that can be written"),
        ([cut], f"{cut}: at byte 0: cut short: expected 96 bytes, got 70"),
        ([other], f'{other}: no map: expected "CGLM" as the first bytes of a map'),
        ([tmp_path / "none"], f"{tmp_path / 'none'}: no such file or directory: expected a stored map"),
        ([good, "--motor", "1"], "--motor: expected --output, too"),
        ([good, "--motor", "x", "-o", cut], '--motor: "x": expected 32 bits, such as 0x1F2E3D4C'),
        (
            [good, "-o", tmp_path / "no" / "where"],
            f"{tmp_path / 'no' / 'where'}: no such file or directory: expected a file that can be written",
        ),
    ):
        code, out, err = cogless(capsys, "map", *arguments)
        assert (code, out, err) == (2, "", line + "\n")


# maps of runs

LAWS = """
[controller.ilc]
law = "pi-ilc"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
gain = "0.03 A*s/rad"
period = "electrical"
cells = 64
limit = "1 A"
[controller.robust]
law = "robust-ilc"
b = 1632
c = 50
g = 1
eta = 50
q = 0.3
beta_1 = 1
beta_2 = 2
gamma = 5
cells = 100
[controller.by-time]
law = "pi-ilc"
tuning = { rule = "phase-margin", phase_margin = "60 deg" }
gain = "0.03 A*s/rad"
memory = "time"
[controller.space]
law = "space-speed"
k = "0.1 A*s/rad"
eta_bar = "100 rad/s"
mu_alpha = 1
mu_beta = 0.001
q_half_width = 2
cells = 90
period = { of = "electrical", turns = 4 }
"""


TABLE = {
    "controller.table": {
        "law": "anti-cogging",
        "kp": "0.03 A/rpm",
        "ki": "0.6 A/rpm/s",
        "cells": 90,
        "calibration": {"speed": "30 rpm", "position_gain": "20 1/s"},
    }
}


def test_a_run_leaves_the_maps_of_its_laws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = studies.write(tmp_path, studies.BASE + LAWS)
    code, _, err = cogless(capsys, "run", study, "-o", tmp_path / "out", "--only", "low/*")
    assert code == 0 and all(line.startswith("Warning: ") for line in err.splitlines())
    maps = {path.stem: decode(path.read_bytes()) for path in (tmp_path / "out" / "maps" / "low").iterdir()}
    assert set(maps) == {"ilc", "robust", "space"}
    loaded = load(study)
    identity = learned_map.motor_identity(loaded.motor.star())
    assert {m.motor for m in maps.values()} == {identity}
    about = {name: (m.law_name, m.turns, m.parts, m.cells, m.units, m.limits) for name, m in maps.items()}
    assert about["ilc"] == ("pi-ilc", 1, 4, 64, (1,), (1.0,))
    assert about["robust"] == ("robust-ilc", 1, 1, 100, (4,), (4896.0,))
    assert about["space"][:5] == ("space-speed", 1, 1, 90, (1, 2))
    runs = run_study(loaded, ["low/ilc", "low/robust"]).runs
    np.testing.assert_array_equal(maps["ilc"].values[0], np.float32(runs[0].memory["current"]))
    np.testing.assert_allclose(maps["robust"].values[0], -1632 * runs[1].memory["current"], rtol=1e-6)
    assert np.max(np.abs(maps["robust"].values)) > 0.1


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("name", ["ilc", "robust", "space", "table", "by-time", "pi"])
def test_the_stored_map_is_the_laws_own_memory(tmp_path: Path, name: str, precision: str) -> None:
    """To the bit: the control library says what its entries are, and nothing is worked out anew."""
    study = studies.study(tmp_path, {"drive.precision": precision, **TABLE}, studies.BASE + LAWS)
    run = simulate(study, "low", name)
    planned = plan(study, "low", name)
    drive, state = planned.drive, planned.start()
    drive.advance(state, planned.engine.Recorder(drive, 1000), planned.ticks)
    if name in ("by-time", "pi"):
        assert drive.stored(state) is None and run.map is None
        return
    assert run.map is not None and np.any(run.map.values)
    cells = np.float32(drive.law_memory(state)).reshape(run.map.channels, -1)[:, : run.map.cells]
    np.testing.assert_array_equal(run.map.values, cells)


@pytest.mark.parametrize(
    ("frame", "period", "ratio", "mechanical"),
    [
        ("electrical", {"of": "electrical"}, 4, (1, 4)),
        ("electrical", {"of": "electrical", "turns": 3}, 4, (3, 4)),
        ("mechanical", {"of": "mechanical"}, 1, (1, 1)),
        ("mechanical", {"of": "electrical", "turns": 3}, 1, (3, 4)),
    ],
)
def test_the_angle_of_a_position_law_is_the_rotors_times_its_ratio(
    tmp_path: Path, frame: str, period: dict[str, object], ratio: int, mechanical: tuple[int, int]
) -> None:
    """In the units of what is learned; the map's cells stand at mechanical angles."""
    law = {"law": "space-position", "k_theta": "5 1/s", "k_omega": 0.1, "mu_alpha": 5.0, "cells": 60,
           "frame": frame, "period": period}  # fmt: skip
    study = studies.study(tmp_path, {"controller": {"space": law}, "scenario.step.controllers": ["space"]})
    stored = simulate(study, "step", "space").map
    assert stored is not None
    assert decode(bytes(stored)).ratio == stored.ratio == ratio
    assert (stored.turns, stored.parts) == mechanical
    angle = stored.angle
    assert angle is not None
    assert angle[30] == pytest.approx(np.pi * mechanical[0] / mechanical[1])


@pytest.mark.parametrize(
    ("law", "frame", "revolutions"),
    [
        ({"period": {"of": "electrical"}}, "electrical", 1),
        ({"period": {"of": "mechanical"}}, "mechanical", 1),
        ({"period": {"of": "electrical", "turns": 2}}, "electrical", 2),
        ({"frame": "mechanical", "period": {"of": "electrical"}}, "mechanical", 1 / 4),
    ],
)
def test_currents_are_over_the_angle_that_the_law_counts(
    tmp_path: Path, law: dict[str, object], frame: str, revolutions: float
) -> None:
    """But over the rotor's where that makes the period its revolution."""
    law = {"law": "space-position", "k_theta": "5 1/s", "k_omega": 0.1, "mu_alpha": 5.0, "mu_beta": 0.1,
           "cells": 60, **law}  # fmt: skip
    study = studies.study(tmp_path, {"controller": {"space": law}, "scenario.step.controllers": ["space"]})
    run = simulate(study, "step", "space")
    assert run.map is not None
    assert set(run.memory) == {"frame", "angle", "current", "beta"}
    assert run.memory["frame"] == frame
    assert run.memory["angle"][30] == pytest.approx(np.pi * revolutions)
    for name, values in zip(("current", "beta"), run.map.values, strict=True):
        assert np.array_equal(run.memory[name], values) and values.any()


def test_maps_of_an_earlier_run_go_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are for flashing: whoever takes one must not get that of another run."""
    study, out = studies.write(tmp_path, studies.BASE + LAWS), tmp_path / "out"
    cogless(capsys, "run", study, "-o", out, "--only", "low/robust", "--only", "low/ilc")
    mine = [out / "maps" / "low" / "mine.bin", out / "maps" / "low" / "pi.bin", out / "notes.txt"]
    for path in mine:
        path.write_text("mine")
    cogless(capsys, "run", study, "-o", out, "--only", "low/pi", "--only", "low/robust")
    assert {path.name for path in (out / "maps" / "low").iterdir()} == {"robust.bin", "mine.bin", "pi.bin"}
    cogless(capsys, "run", study, "-o", out, "--only", "low/pi")
    assert {path.read_text() for path in (out / "maps").rglob("*.bin")} == {"mine"} == {mine[2].read_text()}
    for path in mine[:2]:
        path.unlink()
    cogless(capsys, "run", study, "-o", out, "--only", "low/ilc")
    cogless(capsys, "run", study, "-o", out, "--only", "low/pi")
    assert not (out / "maps" / "low").exists()


def test_a_trial_leaves_its_signal(tmp_path: Path) -> None:
    from trial_studies import loaded

    study = loaded(tmp_path)
    scenario = next(iter(study.scenario))
    controller = next(name for name in study.controllers_in(scenario))
    (run,) = run_study(study, [f"{scenario}/{controller}"]).runs
    stored = run.map
    assert stored is not None
    assert (stored.turns, stored.law_name, stored.cells) == (0, "trial", study.samples(scenario))
    np.testing.assert_array_equal(stored.values[0], np.float32(run.memory["learned"]))
    _, last = study.scenario[scenario].phases[-1]
    reference = study.reference(scenario, last)
    assert stored.motion == learned_map.motion_identity(reference) != 0
    assert stored.motion != learned_map.motion_identity(2 * reference)
    assert decode(bytes(stored)).cells == stored.cells


FLUX = {"d": ["0 Wb", "30 mWb", "85 mWb"], "q": ["0 Wb", "30 mWb", "80 mWb"]}


def test_motors_differ_in_their_identity(tmp_path: Path) -> None:
    study = studies.study(tmp_path)
    identity = learned_map.motor_identity(study.motor.star())
    data = struct.pack("<II4d", 4, 3, 15.42, 0.03, 0.03, study.motor.star().psi_f)
    assert identity == crc32(data + struct.pack("<I2d", 24, 4e-3, 0.0))
    waves = {"order": 6, "d": "1 mWb", "q": "2 mWb", "d_phase": "10 deg", "q_phase": "20 deg"}
    saturation = {axis: {"current": ["0 A", "1 A", "3 A"], "flux": flux} for axis, flux in FLUX.items()}
    more = {
        "motor.flux_harmonics": [waves],
        "motor.saturation": saturation,
        "motor.torque_ripple": [{"order": 12, "percent": 1.5, "phase": "30 deg"}],
    }
    rich = learned_map.motor_identity(studies.study(tmp_path, more).motor.star())
    data += struct.pack("<I4d", 6, 1e-3, 2e-3, radians(10), radians(20))
    currents = -3.0, -1.0, 0.0, 1.0, 3.0
    data += struct.pack("<10d", *currents, -0.085, -0.03, 0.0, 0.03, 0.085)
    data += struct.pack("<10d", *currents, -0.08, -0.03, 0.0, 0.03, 0.08)
    data += struct.pack("<I2d", 12, 0.015, radians(30))
    assert rich == crc32(data + struct.pack("<I2d", 24, 4e-3, 0.0))
    for change in ({"motor.R_s": "15 ohm"}, {"motor.cogging": []}, {"motor.pole_pairs": 3}):
        other = studies.study(tmp_path, change)
        assert learned_map.motor_identity(other.motor.star()) != identity


def test_a_map_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="stored map"):
        StoredMap(np.zeros((4, 5)), (1, 1, 1, 1), (1.0,) * 4)
    for values, units, limits in ((np.zeros((1, 0)), 1, 1), (np.ones(4), 2, 1), (np.ones(4), 1, 2)):
        with pytest.raises(ValueError, match="stored map"):
            StoredMap(values, (1,) * units, (1.0,) * limits)
    with pytest.raises(StudyError):
        stored_map.read(tmp_path)
