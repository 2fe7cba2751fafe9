"""The causes of simulated logs are those they were simulated with; what can't be told apart is said."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from identify.commissioned import METRIC, MOTORS, PI, write
from typer.testing import CliRunner

from cogless import cli
from cogless.cli.logs import _print_remarks
from cogless.errors import StudyError
from cogless.identify import diagnosis, plan, speed_alone
from cogless.identify.causes import Cause, OrderCauses, candidates
from cogless.identify.diagnosis import Diagnosis
from cogless.identify.voltage import Agreement
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.reading import checked

Logs = dict[str, dict[str, np.ndarray]]


def profile(*points: tuple[float, float]) -> dict[str, Any]:
    """A scenario that goes through these times, s, and speeds, rad/s."""
    speeds = [[f"{time} s", f"{speed} rad/s"] for time, speed in points]
    first = speeds[0][1]
    return {"duration": f"{points[-1][0]} s", "reference": {"profile": speeds}, "initial_speed": first}


SCENARIOS: dict[str, dict[str, Any]] = {
    "slow": profile((0, 3), (4.4, 3), (4.8, -3), (9.2, -3)),
    "sweep": profile((0, 2), (0.4, 30), (1.2, -30), (2, 30), (2.8, -30), (3.6, 30), (4, 2)),
    "fast": {"duration": "2 s", "reference": "4 rev/s", "initial_speed": "4 rev/s"},
    "drives": {"duration": "3 s", "reference": "1 rev/s", "initial_speed": "1 rev/s", "load": "0.12 N*m"},
    "brakes": {"duration": "3 s", "reference": "1 rev/s", "initial_speed": "1 rev/s", "load": "-0.12 N*m"},
}
OFFSETS, GAINS = (0.03, -0.02, 0.0), (0.03, -0.03, 0.0)  # A; of the phases
COGGING = [{"order": 12, "torque": "6 mN*m", "phase": "30 deg"}]
WRONG: dict[str, dict[str, Any]] = {
    "cogging": {"motor": {"cogging": COGGING}},
    "ripple": {"motor": {"flux_harmonics": [{"order": 6, "d": "0.5 mWb", "d_phase": "20 deg"}]}},
    "dead time": {
        "drive": {
            "inverter": {"bus_voltage": "48 V", "dead_time": "5 us"},
            "position_sensor": {"lines": 65536},
            "current_loop": {"bandwidth": "150 Hz"},
        }
    },
    "offset": {"drive": {"current_sensors": {"offset": [f"{x} A" for x in OFFSETS]}}},
    "gain": {"drive": {"current_sensors": {"gain_error": list(GAINS)}}},
    "encoder": {"drive": {"position_sensor": {"eccentricity": "0.5 deg"}}},
    "unbalance": {"motor": {"cogging": [{"order": 1, "torque": "4 mN*m"}]}},
    "of 6 p": {"motor": {"cogging": [{"order": 42, "torque": "5 mN*m", "phase": "30 deg"}]}},
}
COLUMNS = ("t", "theta", "omega", "i_q", "i_q_ref", "i_d", "u_q")


@cache
def played(wrong: str) -> tuple[str, Logs]:
    """The file of columns, and logs of the gimbal with one thing wrong, as its drive measures them."""
    base = {key: dict(MOTORS["gimbal"][key]) for key in ("motor", "mechanics", "drive")}
    del base["motor"]["cogging"], base["motor"]["flux_harmonics"]
    actual = {
        room: {
            **table,
            **{key: _over(table.get(key), value) for key, value in WRONG[wrong].get(room, {}).items()},
        }
        for room, table in base.items()
    }
    study = {"title": wrong, **actual, "trace": {"rate": "1 kHz"}, "scenario": SCENARIOS}
    study |= {"controller": PI, "metric": [METRIC]}
    loaded = checked(Source(Path("wrong.toml"), study))
    assert isinstance(loaded, Study)
    (results,) = rollout([loaded], jobs=2)
    sensors = actual["drive"].get("current_sensors", {})
    gains = sensors.get("gain_error", (0, 0, 0))
    offsets = OFFSETS if "offset" in sensors else (0, 0, 0)
    logs: Logs = {}
    for run in results.runs:
        trace = run.trace
        theta = trace["theta_measured"]
        turned = [7 * theta - third * 2 * np.pi / 3 for third in range(3)]
        currents = [
            (1 + g) * trace[name] + o
            for name, g, o in zip(("i_a", "i_b", "i_c"), gains, offsets, strict=True)
        ]
        logs[run.scenario] = {
            "t": trace.time,
            "theta": theta,
            "omega": trace["omega_measured"],
            "i_q_ref": trace["i_q_ref"],
            "u_q": trace["u_q"],
            "i_q": -2 / 3 * sum(i * np.sin(x) for i, x in zip(currents, turned, strict=True)),
            "i_d": 2 / 3 * sum(i * np.cos(x) for i, x in zip(currents, turned, strict=True)),
        }
    kinds = {"drives*": "load", "brakes*": "load", "off*": "bridge-off"}
    known = {
        "columns": {name: name for name in (*COLUMNS, "i_a", "i_b", "i_c")},
        "motor": base["motor"],
        "drive": base["drive"],
        "log": [{"file": name, "kind": kind} for name, kind in kinds.items()],
    }
    return plan.to_toml(known), logs


def _over(table: Any, value: Any) -> Any:
    return {**table, **value} if isinstance(table, dict) else value


def diagnose(folder: Path, text: str, logs: Logs) -> Diagnosis:
    return diagnosis.diagnosed(write(folder, text, logs), folder / "id.toml", lambda what, share: None)


@cache
def of(wrong: str) -> Diagnosis:
    """The diagnosis of all logs of the gimbal with one thing wrong."""
    return diagnose(Path(mkdtemp()), *played(wrong))


def cause_of(made: Diagnosis, log: str, order: int) -> tuple[str, str]:
    """The first cause of an order, and how sure it is."""
    (found,) = [each for each in made.orders if each.log == f"{log}.npz" and each.order == order]
    return found.causes[0].name, found.confidence


@pytest.mark.parametrize(
    ("wrong", "log", "order", "cause", "confidence"),
    [
        ("cogging", "slow", 12, "cogging", "sure"),
        ("ripple", "drives", 42, "K_t ripple", "sure"),
        ("ripple", "brakes", 42, "K_t ripple", "sure"),
        ("dead time", "drives", 42, "dead time", "likely"),
        ("gain", "drives", 14, "current gain", "sure"),
        ("encoder", "fast", 1, "encoder", "sure"),
        ("unbalance", "fast", 1, "mechanics", "sure"),
        ("of 6 p", "slow", 42, "cogging", "sure"),
    ],
)
def test_the_cause_is_what_is_wrong(wrong, log, order, cause, confidence):
    assert cause_of(of(wrong), log, order) == (cause, confidence)


def test_nothing_else_is_blamed():
    made = of("cogging")
    assert diagnosis.answer(made).startswith("Most of the ripple is cogging: ")
    for log in made.whole:
        shares = made.causes(log)
        assert sum(shares.values()) == pytest.approx(1, abs=0.02)
        blamed = {name for name, share in shares.items() if share > 0.03}
        assert blamed <= {"cogging", "no order", "not explained"}


@pytest.mark.parametrize(("orders", "causes"), [
    ((1, 2), "encoder or mechanics"), ((3, 4, 6, 8, 12), "cogging or encoder"),
    ((7,), "cogging or current offset or encoder"), ((14,), "cogging or current gain or encoder"),
    ((21, 28), "cogging or dead time or encoder"),
    ((42, 84), "cogging or K_t ripple or dead time or encoder"),
])  # fmt: skip
def test_what_an_order_may_come_from(orders, causes):
    """With 7 pole pairs: once and twice a turn is a bad mounting, which has no more orders."""
    assert {candidates(order, 7) for order in orders} == {causes}


def test_an_order_of_the_pole_pairs_is_open_until_the_bridge_is_off(tmp_path):
    text, logs = played("offset")
    logs = {name: logs[name] for name in ("slow", "sweep")}
    made = diagnose(tmp_path, text, logs)
    assert cause_of(made, "slow", 7) == ("cogging or current offset", "cannot be told apart")
    assert any("record currents with the bridge off" in line for line in made.remarks)
    off = {"t": logs["slow"]["t"], "theta": logs["slow"]["theta"]}
    off |= {name: np.full(len(off["t"]), o) for name, o in zip(("i_a", "i_b", "i_c"), OFFSETS, strict=True)}
    (tmp_path / "again").mkdir()
    again = diagnose(tmp_path / "again", text, {**logs, "off": off})
    assert cause_of(again, "slow", 7) == ("current offset", "sure")


def test_cogging_of_order_6p_is_not_told_from_ripple_of_k_t_without_loads(tmp_path):
    text, logs = played("of 6 p")
    made = diagnose(tmp_path, text, {name: logs[name] for name in ("fast", "drives")})
    name, confidence = cause_of(made, "drives", 42)
    assert (name, confidence) == ("cogging or K_t ripple or dead time", "cannot be told apart")
    cure = "record logs with loads of both signs, and an acceleration log."
    assert f"Order 42: K_t ripple and cogging cannot be told apart; {cure}" in made.remarks


def test_without_references_dead_time_is_said_to_be_open(tmp_path):
    text, logs = played("dead time")
    without = {n: {k: x for k, x in logs[n].items() if k != "i_q_ref"} for n in ("slow", "drives", "brakes")}
    made = diagnose(tmp_path, text, without)
    assert not any(cause.name == "dead time" for each in made.orders for cause in each.causes)
    assert any("record the current's reference as i_q_ref" in line for line in made.remarks)


def test_speed_alone_says_what_it_can(tmp_path):
    text, logs = played("cogging")
    alone = {name: {key: logs[name][key] for key in ("t", "omega")} for name in ("slow", "fast")}
    made = diagnose(tmp_path, text, alone)
    assert next(each.order for each in made.orders if each.log == "slow.npz") == 12
    assert any("no angle" in line for line in made.remarks)
    assert any("no current" in line for line in made.remarks)
    eccentric = {
        name: {key: played("encoder")[1][name][key] for key in ("t", "omega")} for name in ("slow", "fast")
    }
    (tmp_path / "b").mkdir()
    made = diagnose(tmp_path / "b", text, eccentric)
    assert cause_of(made, "fast", 1) == ("encoder or mechanics", "cannot be told apart")


def test_the_command_answers_first_and_writes_a_report(tmp_path):
    paths = write(tmp_path, *played("cogging"))
    arguments = [
        "diagnose",
        *map(str, paths),
        "--config",
        str(tmp_path / "id.toml"),
        "-o",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(cli.app, arguments)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("Most of the ripple is cogging: ")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Most of the ripple is cogging" in page and "src=" not in page
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["orders"][0]["causes"][0].keys() == {"name", "share", "error"}


def test_the_command_in_eighty_columns(tmp_path, monkeypatch):
    paths = write(tmp_path, *played("cogging"))
    arguments = ["diagnose", *map(str, paths), "--config", str(tmp_path / "id.toml")]
    texts = []
    for columns in (80, 2000):
        monkeypatch.setattr("cogless.lines.terminal_columns", lambda *_, columns=columns: columns)
        texts.append(CliRunner().invoke(cli.app, arguments).stdout)
    narrow, wide = texts
    assert narrow.split() == wide.split() and narrow.startswith("Most of the ripple is cogging: ")
    assert max(map(len, narrow.splitlines())) <= 80


def said_of_k_t(made: Diagnosis) -> str:
    (said,) = [line for line in made.remarks if line.startswith("From the logged voltage, K_t is 0.0")]
    return said


def test_a_right_k_t_is_told_as_no_mistake(capsys):
    said = said_of_k_t(of("cogging"))
    assert said.endswith("as id.toml has it (0.08).")
    assert isinstance(said, Agreement)
    _print_remarks(["The inertia isn't in these logs."], ["A column is late.", said])
    assert capsys.readouterr().out.split("\n\n") == [
        "\nNot in these logs:\n! The inertia isn't in these logs.",
        "Problems:\n! A column is late.",
        f"Notes:\n{said}\n",
    ]


@pytest.mark.parametrize(
    ("K_t", "says"),
    [
        ("0.09", "id.toml has 0.09"),
        ("0.113137", "has 0.1131; the values differ by sqrt(2), the factor between rms and peak"),
    ],
)
def test_the_voltage_tells_a_wrong_k_t(tmp_path, K_t, says):
    text, logs = played("cogging")
    steady = {name: log for name, log in logs.items() if name != "sweep"}
    said = said_of_k_t(diagnose(tmp_path, text.replace('K_t = "0.08', f'K_t = "{K_t}'), steady))
    assert said.endswith(
        f"{says}: all torques are in proportion to K_t; correct motor.K_t, or K_t_rms if it is per rms "
        "ampere, or kv."
    )
    assert not isinstance(said, Agreement)


def test_the_voltage_tells_a_current_in_rms(tmp_path):
    assert not any("rms amperes" in line for line in of("cogging").remarks)
    text, logs = played("cogging")
    steady = {name: log for name, log in logs.items() if name != "sweep"}
    rms = {name: {**log, "i_q": log["i_q"] / math.sqrt(2)} for name, log in steady.items()}
    (said,) = [line for line in diagnose(tmp_path, text, rms).remarks if "rms amperes" in line]
    assert said.startswith("From the logged voltage, R is 7.")
    assert said.endswith(
        "ohm, sqrt(2) times that in id.toml (5). Either i_q is in rms amperes, and all torques "
        "are sqrt(2) times too small, or the winding is 105 K warmer; record i_a and i_b to decide this."
    )


def test_logs_that_never_turn_steadily_are_refused(tmp_path):
    text, logs = played("cogging")
    short = {"slow": {key: x[:200] for key, x in logs["slow"].items()}}
    with pytest.raises(StudyError, match="no log turns at a steady speed for a revolution"):
        diagnose(tmp_path, text, short)


def order_at(order: int, speed: float, *causes: Cause) -> OrderCauses:
    return OrderCauses(
        log=f"{speed:g}.npz",
        speed=speed,
        load=0.1,
        order=order,
        ripple=0.5,
        share=0.9,
        causes=causes or (Cause("cogging", 1.0, 0.1),),
    )


def test_one_frequency_at_two_speeds_may_be_chance_and_at_three_is_mechanics():
    two = [order_at(72, 1.0), order_at(12, 6.0)]
    (said,) = [line for line in speed_alone.sentences(two) if "Hz" in line]
    assert "which two speeds do not tell; record a third speed" in said
    (said,) = [line for line in speed_alone.sentences([*two, order_at(36, 2.0)]) if "Hz" in line]
    assert "mechanics, which swing at this frequency" in said


def test_causes_that_cancel_are_told_and_share_what_is_left():
    opposed = order_at(42, 1.0, Cause("cogging", 2.09, 0.1), Cause("K_t ripple", -1.09, 0.1))
    made = Diagnosis("x", (opposed,), {"1.npz": 1.0}, ())
    assert made.causes("1.npz") == pytest.approx({"cogging": 0.9, "no order": 0.1})
    (said,) = diagnosis._opposed((opposed,))
    assert said.startswith("Order 42 in 1.npz: cogging and K_t ripple oppose each other")


def test_a_log_that_only_accelerates_is_said_to_have_no_line(tmp_path):
    text, logs = played("cogging")
    made = diagnose(tmp_path, text, {name: logs[name] for name in ("slow", "sweep")})
    assert "sweep.npz" not in made.whole
    assert made.uses == {
        "sweep.npz": "the log has no turn at a steady speed, so it is used for inertia, friction and "
        "orders, not for shares"
    }
