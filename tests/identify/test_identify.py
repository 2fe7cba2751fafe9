"""Motors of known truth come out of their own logs, with intervals that hold it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from identify.commissioned import MOTORS, commissioned, study_text, write

from cogless import load
from cogless.errors import StudyError
from cogless.identify import command, described, rehearsal, replay
from cogless.identify.result import Estimate, Value, Wave
from cogless.identify.write import compensation
from cogless.study.mechanics import Mechanics
from cogless.study.motor import Motor

DELAY = 1e-3  # s, of i_q in the logs: a row


@pytest.fixture(scope="module", params=["servo", "drone"])
def found(request, tmp_path_factory) -> tuple[str, Estimate]:
    """A motor and what its logs tell, i_q logged late."""
    folder = tmp_path_factory.mktemp(request.param)
    paths = write(folder, *commissioned(request.param, late=1))
    made = command.identified(paths, folder / "id.toml", lambda what, share: None)
    return request.param, made.estimate


def by_order(waves: tuple[Wave, ...]) -> dict[int, Wave]:
    return {wave.order: wave for wave in waves}


def turned(a: float, b: float) -> float:
    """The angle between two phases, deg."""
    return float(np.degrees(abs((a - b + np.pi) % (2 * np.pi) - np.pi)))


def test_inertia_and_friction_are_the_motors(found):
    name, made = found
    truth = Mechanics.model_validate(MOTORS[name]["mechanics"])
    for key, value, share in (
        ("j", truth.inertia, {"servo": 0.01, "drone": 0.03}[name]),  # 1 kHz see little of a law at 5 kHz
        ("c", truth.coulomb_friction, 0.01),
        ("b", truth.viscous_friction, 0.05),
    ):
        got = made.values[key].times(made.K_t)
        assert got.value == pytest.approx(value, rel=share), key
        assert 0 < got.error < 4 * share * value, key


def test_cogging_is_the_motors(found):
    name, made = found
    truth = Motor.model_validate(MOTORS[name]["motor"]).star()
    got = by_order(made.cogging)
    wanted = [c for c in truth.cogging if c.order != truth.pole_pairs]
    for harmonic in wanted:
        wave = got[harmonic.order]
        assert wave.size.value * made.K_t == pytest.approx(harmonic.torque, rel=0.03)
        assert turned(wave.phase.value, harmonic.phase) < 2
    assert set(got) == {harmonic.order for harmonic in wanted}  # and no order that the motor lacks


def test_ripple_of_the_torque_constant_is_told_apart_from_cogging_of_its_order(found):
    name, made = found
    truth = Motor.model_validate(MOTORS[name]["motor"]).star()
    (harmonic,), (wave,) = truth.flux_harmonics, made.ripple
    assert wave.order == harmonic.order * truth.pole_pairs
    share = harmonic.d / truth.psi_f
    assert wave.size.error < {"servo": 0.1, "drone": 0.25}[name] * share  # of the drone's, 1 kHz see little
    assert wave.size.value == pytest.approx(share, abs=wave.size.error)
    assert turned(wave.phase.value, harmonic.d_phase + np.pi / 2) < 6


def test_the_logs_delay_is_found(found):
    _, made = found
    assert made.values["delay"].value == pytest.approx(DELAY, abs=5e-5)


def test_eccentricity_is_the_encoders(found):
    name, made = found
    once = by_order(made.encoder).get(1)
    if name != "servo":
        assert once is None
        return
    assert once is not None
    assert np.degrees(once.size.value) == pytest.approx(0.1, rel=0.05)
    assert turned(once.phase.value, 0.0) < 3
    sensor = described.drive(made)["position_sensor"]
    assert sensor["eccentricity"] == f"{np.degrees(once.size.value):.5g} deg"
    assert sensor["eccentricity_phase"] == f"{np.degrees(once.phase.value):.5g} deg"
    assert set(by_order(made.encoder)) == {1}


@pytest.fixture
def doubtful(found) -> Estimate:
    """A false wave among 420 is at a chance of 1 % as large as 2.35 errors at 95 %: order 6 is larger."""
    _, made = found
    six, twelve, eighteen = (
        Wave(order, Value(size, 1.0), Value(0.0, 0.0)) for order, size in ((6, 2.4), (12, 0.05), (18, 2.3))
    )
    return replace(made, cogging=(six, twelve, eighteen), ripple=(six,), encoder=(), left_out=("Before.",))


def test_an_order_that_does_not_stand_out_of_its_error_is_left_out(doubtful):
    """One that may be larger than one that stays is named."""
    kept = command.standing_out(doubtful)
    six = doubtful.cogging[:1]
    assert (kept.cogging, kept.ripple, kept.encoder) == (six, six, ())
    assert kept.left_out == (
        "Before.",
        "Cogging of order 18 is too small to be identified from these logs and is left out. "
        f"It may be up to {3.3e3 * doubtful.K_t:.2g} mN*m.",
    )
    none = command.standing_out(replace(doubtful, cogging=doubtful.cogging[1:]))
    assert none.cogging == () and "Cogging of order 12, 18 is" in none.left_out[1]


def test_an_error_of_the_encoder_that_the_file_tells_is_always_told(found):
    name, made = found
    errors = tuple(Wave(order, Value(0.1, 1.0), Value(0.0, 0.0)) for order in (1, 2))
    kept = command.standing_out(replace(made, encoder=errors)).encoder
    assert kept == (errors[:1] if name == "servo" else ())


def test_orders_stand_out_of_their_errors_after_the_simulation_and_in_a_rehearsal(
    doubtful, monkeypatch, tmp_path
):
    monkeypatch.setattr(command, "estimate_motor", lambda *of: None)
    monkeypatch.setattr(command, "refined", lambda *of: (doubtful, {}))
    monkeypatch.setattr(command, "load_logs", lambda *of: [])
    (tmp_path / "id.toml").write_text(commissioned("servo", late=1)[0])
    made = command.identified([], tmp_path / "id.toml", lambda *of: None).estimate
    assert [wave.order for wave in made.cogging] == [6]
    monkeypatch.setattr(rehearsal, "estimate_motor", lambda *of: doubtful)
    monkeypatch.setattr(rehearsal, "load_logs", lambda *of: [])
    monkeypatch.setattr(rehearsal, "_under", lambda law, folder: (load(servo), None))
    monkeypatch.setattr(rehearsal, "write_netcdf", lambda *of: None)
    monkeypatch.setattr(rehearsal, "rollout", lambda studies: [SimpleNamespace(runs=[])])
    servo = tmp_path / "servo.toml"
    servo.write_text(study_text("servo"))
    said = rehearsal.expected(tmp_path, lambda *of: None)
    assert [line for line in said if line.startswith("cogging")] == [command.value_lines(made)[-2]]


@pytest.mark.parametrize(
    ("share", "turn", "said"),
    [
        (1.0, 0.0, []),
        (1.0, np.radians(59), []),
        (1.0, np.radians(61), ["72 (4 mN*m), identified from them, would be worse than no value,"]),
        (2.1, 0.0, ["72 (4 mN*m), identified from them, would be worse than no value,"]),
        (None, 0.0, ["would not show the study's cogging of order 72 (4 mN*m)."]),
    ],
)
def test_a_plan_whose_logs_mislead_says_so(tmp_path, share, turn, said):
    """Of two waves of one size, 60 deg apart, the difference has this size, too."""
    (tmp_path / "servo.toml").write_text(study_text("servo"))
    study = load(tmp_path / "servo.toml")
    cogging = tuple(
        Wave(one.order, Value(part * one.torque / 0.3, 0.0), Value(one.phase + by, 0.0))
        for one, part, by in zip(study.motor.star().cogging, (1.0, share), (0.0, turn), strict=True)
        if part is not None
    )
    made = SimpleNamespace(K_t=0.3, cogging=(*cogging, Wave(9, Value(1.0, 0.0), Value(0.0, 0.0))))
    found = rehearsal.missed(study, made)
    assert len(found) == len(said) and all(part in line for part, line in zip(said, found, strict=True))


def test_cogging_of_the_order_of_the_pole_pairs_is_left_out_with_a_cure(found):
    name, made = found
    said = [line for line in made.left_out if "is the number of pole pairs" in line]
    assert len(said) == (name == "drone")
    assert all("record currents with the bridge off" in line for line in said)


def test_known_loads_come_out(found):
    name, made = found
    limit = float(MOTORS[name]["drive"]["current_loop"]["current_limit"].split()[0])
    assert made.loads["load-forwards.npz"].value == pytest.approx(0.2 * limit, rel=0.01)
    assert made.loads["load-backwards.npz"].value == pytest.approx(-0.2 * limit, rel=0.01)


@pytest.mark.parametrize(("order", "cells"), [(24, 1024), (432, 3456)])
def test_a_table_resolves_its_highest_order(found, order, cells):
    """With eight cells a wave, or 1024 in all if that is more."""
    _, made = found
    table = compensation(replace(made, cogging=(replace(made.cogging[0], order=order),)))
    assert table.values.shape == (1, cells)


def test_logs_that_cannot_be_played_leave_the_estimate_and_say_so(found, monkeypatch):
    def refuses(made: Estimate, progress: replay.Progress, dead_time: float, more: float) -> None:
        raise StudyError("no such drive")

    _, made = found
    monkeypatch.setattr(replay, "played", refuses)
    kept, traces = replay.refined(made, lambda what, share: None)
    assert traces == {}
    for key, value in made.values.items():
        assert kept.values[key].value == value.value and kept.values[key].error >= value.error
    assert kept.remarks[-1].startswith(
        "The logs could not be simulated (no such drive). Without a simulation the delay is "
        "known only to half a period"
    )
