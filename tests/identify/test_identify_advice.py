"""Each sentence that advises is followed, by the changes that it carries, and helps.

The plant is not the engine. It records the log that a sentence advises to record. A change of the file of
columns is made in that file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identify import bench
from identify.commissioned import write

from cogless.identify import command, config, diagnosis, findings, plan, voltage
from cogless.identify.advice import Advice, AdvisedError, advice_of, changed
from cogless.identify.estimate import CURE_LOGS, CURES, estimate_motor, not_told_apart
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate, Value, Wave
from cogless.identify.sessions import sentences, sessions

Logs = dict[str, dict[str, np.ndarray]]
KIND_LOGS = {  # runs of the bench that are logs of a kind
    "acceleration": ("sweep",),
    "constant-speed": ("both",),
    "slow-sweep": ("slow",),
    "load": ("drives", "brakes"),
}
ALL_LOGS = ("slow", "fast", "drives", "brakes", "sweep")


def identified(logs: Logs, tables: Mapping[str, Any] | None = None) -> Estimate:
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(dict(tables or bench.columns())), logs)
    known = config.load(folder / "id.toml")
    return command.standing_out(estimate_motor(known, load_logs(paths, known), lambda what, share: None))


def said(logs: Logs, tables: Mapping[str, Any] | None = None) -> tuple[list[str], Estimate | None]:
    """All sentences of `identify` on these logs, and the estimate; None without one."""
    try:
        made = identified(logs, tables)
    except AdvisedError as error:
        return list(error.mistakes), None
    return [*made.left_out, *made.remarks], made


def of_case(case: str, *names: str) -> Logs:
    return {name: dict(bench.logs()[case][name]) for name in names}


def inertia_off(made: Estimate | None) -> float:
    """Relative error of the estimated inertia; inf without an estimate."""
    if made is None or "j" not in made.values:
        return math.inf
    return abs(made.values["j"].value * made.K_t / bench.INERTIA - 1)


def advice(lines: list[str], part: str) -> Advice:
    """The only sentence with these words, which must advise."""
    (line,) = [line for line in lines if part in line]
    assert isinstance(line, Advice) and line.cures
    return line


def words(line: str) -> str:
    """The subject of a sentence, without numbers and advice."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", line.split(";")[0])


def recorded(cure: Mapping[str, Any], case: str) -> Logs:
    """The logs of these kinds."""
    if cure["record.kind"] == ("bridge-off",):
        return {"off": bench.phase_offsets(case)}
    return of_case(case, *(name for kind in cure["record.kind"] for name in KIND_LOGS[kind]))


def without(logs: Logs, *signals: str) -> Logs:
    return {name: {key: x for key, x in log.items() if key not in signals} for name, log in logs.items()}


# --- logs to record


POOR_LOGS = (
    ("drives",),
    ("drives", "fast"),
    ("slow", "drives"),
    ("slow", "fast"),
    ("fast", "brakes"),
    ("odd", "drives"),
    ("fast", "odd"),
    ("fast", "both", "drives"),
)


@pytest.mark.parametrize("names", POOR_LOGS)
@pytest.mark.parametrize("case", ["cogging", "encoder", "gain", "offset"])
def test_what_cannot_be_told_apart_is_told_with_the_log_that_is_advised(
    case: str, names: tuple[str, ...]
) -> None:
    """Each advised log helps by itself, and the values from an acceleration log are right."""
    logs = of_case(case, *names)
    before, made = said(logs)
    for line in advice_of(before):
        (cure,) = line.cures
        after, again = said({**logs, **recorded(cure, case)})
        assert words(line) not in map(words, after)
        if "acceleration" in cure["record.kind"]:
            assert inertia_off(again) < min(0.02, inertia_off(made))


def test_those_sentences_are_all_that_poor_logs_bring_forth() -> None:
    """The texts that an estimate may say, and the logs above that bring them forth."""
    brought = {
        words(line)
        for case in ("cogging", "encoder", "gain", "offset")
        for names in POOR_LOGS
        for line in advice_of(said(of_case(case, *names))[0])
    }
    for key, text in CURES.items():
        line = words(text.format("1")).replace("#", "")
        assert line in {each.replace("#", "") for each in brought}, key
    assert CURE_LOGS.keys() == CURES.keys()


def test_a_fast_log_tells_the_error_of_an_encoder() -> None:
    cure = not_told_apart("encoder", 1).cures[0]
    after, made = said({**of_case("encoder", "slow"), **recorded(cure, "encoder")})
    assert made is not None and not any("the encoder's error and cogging" in line for line in after)
    sizes = {wave.order: wave.size.value for wave in made.encoder}
    assert sizes[1] == pytest.approx(math.radians(0.6), rel=0.1)


def test_a_feedback_law_is_told_from_a_plant_by_an_acceleration_log() -> None:
    logs = of_case("cogging", "slow", "fast")
    for log in logs.values():
        log["i_q"] = -0.05 * np.roll(log["omega"] - np.mean(log["omega"]), 2)
    before, made = said(logs)
    assert "In all logs of a turning motor i_q only follows the feedback law" in " ".join(before)
    for line in advice_of(before):
        if "feedback law" in line:
            assert line.cures == ({"record.kind": ("acceleration",)},)
    _, again = said({**logs, **of_case("cogging", "sweep")})
    assert inertia_off(again) < 0.02 < inertia_off(made)


@pytest.mark.parametrize(("signal", "part"), [("theta", "no angle"), ("i_q", "no current")])
def test_a_signal_that_is_missing_is_recorded(signal: str, part: str) -> None:
    logs = of_case("cogging", "slow", "sweep")
    before, _ = said({**logs, "sweep": without(logs, signal)["sweep"]})
    line = advice(before, part)
    assert line.cures[0] == {"record.signal": signal, "record.log": "sweep.npz"}
    after, made = said(logs)
    assert words(line) not in map(words, after) and inertia_off(made) < 0.02


def test_a_coast_down_needs_no_current() -> None:
    """The second advice on a log without current: declare it a coast-down."""
    coasting = {"cogging": bench.CASES["cogging"]}
    run = bench.Run(((0, 40.0), (1.5, 40.0)), driven=False)
    (log,) = bench.simulated([(coasting["cogging"], run)])
    log = {key: x[log["true_omega"] > 3] for key, x in log.items()}
    logs = {**of_case("cogging", "sweep"), "coast": {key: log[key] for key in ("t", "theta", "omega")}}
    before, _ = said(logs)
    cure = advice(before, "coast.npz: no current").cures[1]
    assert cure == {"record.kind": "coast-down", "record.log": "coast.npz"}
    tables = bench.columns()
    tables["log"] = [{"file": cure["record.log"], "kind": cure["record.kind"]}, *tables["log"]]
    after, made = said(logs, tables)
    assert not any("coast.npz" in line for line in after) and made is not None
    assert "coast.npz" in {log.name for log in made.logs}
    assert made.values["c"].value * bench.K_T == pytest.approx(bench.COULOMB, rel=0.02)


def test_a_log_with_the_bridge_off_that_coasts_says_so() -> None:
    run = bench.Run(((0, 40.0), (1.5, 40.0)), driven=False)
    (log,) = bench.simulated([(bench.CASES["cogging"], run)])
    log = {key: x[log["true_omega"] > 3] for key, x in log.items()}
    off = {**{key: log[key] for key in ("t", "theta")}, "i_a": 0 * log["t"], "i_b": 0 * log["t"]}
    logs = {**of_case("cogging", "sweep"), "off": off}
    before, made = said(logs)
    line = advice(before, "it is not known what turns the rotor")
    tables = bench.columns()
    tables["log"] = [{"file": "off*", "kind": line.cures[0]["record.kind"]}, *tables["log"]]
    _, again = said(logs, tables)
    assert made is not None and again is not None
    assert {log.name for log in again.logs} - {log.name for log in made.logs} == {"off.npz"}


def test_phase_currents_of_the_bridge_off_tell_the_offsets() -> None:
    off = bench.phase_offsets("offset")
    logs = of_case("offset", "slow", "sweep")
    line = advice(said({**logs, "off": {"t": off["t"], "theta": off["theta"]}})[0], "no phase currents")
    assert line.cures == ({"record.signal": ("i_a", "i_b"), "record.log": "off.npz"},)
    after, made = said({**logs, "off": off})
    assert made is not None and made.offsets == pytest.approx(bench.CASES["offset"].offsets)
    assert not any("no phase currents" in line for line in after)


def test_rows_that_are_too_few_are_as_many_as_is_advised() -> None:
    logs = of_case("gain", "slow", "sweep", "fast")
    seldom = {name: {key: x[::25] for key, x in log.items()} for name, log in logs.items()}
    line = advice(said(seldom)[0], "may also cog at order")
    rate, speed = (cure for cure in line.cures)
    every = math.floor(1000 / rate["record.rate"])
    assert 1 <= every < 25
    name = rate["record.log"].split(".")[0]
    more = {**seldom, name: {key: x[::every] for key, x in logs[name].items()}}
    assert words(line) not in map(words, said(more)[0])
    (slower,) = bench.simulated(
        [(bench.CASES["gain"], bench.steady(speed["record.speed"] / bench.TURN, 12.0))]
    )
    more = {**seldom, name: {key: x[::25] for key, x in slower.items()}}
    assert words(line) not in map(words, said(more)[0])


STICKING = bench.Drive(cogging=((30, 12e-3, 0.5),))


@cache
def slipping(turns_per_second: float) -> dict[str, np.ndarray]:
    return bench.simulated([(STICKING, bench.both_ways(turns_per_second, 4.0))])[0]


def test_a_rotor_that_sticks_turns_at_the_speed_at_which_it_slips() -> None:
    logs = {"sweep": bench.simulated([(STICKING, bench.RUNS["sweep"])])[0]}
    before, _ = said({**logs, "slow": slipping(0.02)})
    line = advice(before, "slow.npz: the rotor stands still")
    (cure,) = line.cures
    assert "the rotor sticks and slips" in line and cure["record.rate"] <= 1000
    after, made = said({**logs, "slow": slipping(cure["record.speed"] / bench.TURN)})
    assert not any("stands still" in line for line in after)
    assert made is not None
    (main,) = [wave for wave in made.cogging if wave.order == 30]
    assert main.size.value * bench.K_T == pytest.approx(12e-3, rel=0.05)


def test_a_rotor_that_stands_still_turns_faster() -> None:
    """The rotor stands still for two of five seconds."""
    logs = of_case("cogging", "sweep")
    t = 1e-3 * np.arange(5000)
    step = bench.TURN / bench.COUNTS
    theta = np.floor(3 * np.maximum(0.0, t - 2) / step) * step
    waits = {"t": t, "theta": theta, "omega": np.gradient(theta, t), "i_q": 0.04 + 0 * t}
    line = advice(said({**logs, "waits": waits})[0], "turn faster, or with higher feedback gains")
    assert line.cures == ({"record.kind": "constant-speed", "record.log": "waits.npz"},)
    after, made = said({**logs, "waits": of_case("cogging", "both")["both"]})
    assert not any("stands still" in line for line in after) and inertia_off(made) < 0.02


def test_orders_beside_a_larger_one_are_the_encoder_s_in_a_faster_log() -> None:
    drive = bench.Drive(cogging=((30, 2e-3, 0.5),), encoder=((1, math.radians(0.3), 0.4),))
    runs = {"slow": bench.both_ways(0.5, 8.0), "quick": bench.both_ways(1.0, 4.0), "both": bench.RUNS["both"]}
    made = dict(zip(runs, bench.simulated([(drive, run) for run in runs.values()]), strict=True))
    waves = tuple(Wave(n, Value(size, 0.0), Value(0.0, 0.0)) for n, size in ((29, 1e-3), (30, 2e-2)))
    unknown: Any = SimpleNamespace(encoder=())
    (line,) = findings._without_sidebands(unknown, waves)[1]
    assert isinstance(line, Advice)
    assert line.cures == ({"record.kind": ("constant-speed",)},)
    _, told = said(made)
    assert told is not None and {wave.order for wave in told.cogging} == {30}
    (error,) = [wave for wave in told.encoder if wave.order == 1]
    assert error.size.value == pytest.approx(math.radians(0.3), rel=0.1)


def test_sessions_that_differ_are_right_by_themselves() -> None:
    """Four logs have two frictions. With sessions, each session gets its friction."""
    runs = {"slow": bench.RUNS["slow"], "sweep": bench.RUNS["sweep"]}
    frictions = {"cold": 3e-3, "warm": 2e-3}
    made = bench.simulated(
        [(bench.Drive(friction=size), run) for size in frictions.values() for run in runs.values()]
    )
    names = [f"{session}-{name}" for session in frictions for name in runs]
    logs = dict(zip(names, made, strict=True))
    line = advice(said(logs)[0], "Sessions differ: friction")
    low, high = (cure["record.logs"] for cure in line.cures)
    assert low[0].startswith("warm") and high[0].startswith("cold")
    tables = bench.columns()
    tables["log"] = [{"file": f"{s}*", "session": s} for s in frictions] + tables["log"]
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(tables), logs)
    known = config.load(folder / "id.toml")
    both = sessions(estimate_motor(known, load_logs(paths, known), lambda *of: None))
    (again,) = [line for line in sentences(both) if "friction" in line]
    assert isinstance(again, Advice)
    assert {cure["record.session"] for cure in again.cures} == set(frictions)
    for session, size in frictions.items():
        alone = {name: log for name, log in logs.items() if name.startswith(session)}
        after, one = said(alone)
        assert one is not None and not any("Sessions differ" in line for line in after)
        assert one.values["c"].value * bench.K_T == pytest.approx(size, rel=0.02)


def test_an_index_that_is_found_before_each_log_has_cogging_in_one_place() -> None:
    logs = of_case("cogging", "slow", "sweep", "fast")
    turned = {**logs["slow"], "theta": logs["slow"]["theta"] + 0.07}
    before, made = said({**logs, "slow": turned})
    line = advice(before, "the encoder's index has slipped")
    assert line.cures == ({"record.index": True, "record.log": "sweep.npz"},)
    after, again = said(logs)
    assert made is not None and again is not None
    assert not any("index" in line for line in after)
    assert made.cogging == () and {wave.order for wave in again.cogging} == {18, 30}


def test_a_slow_log_shows_the_orders_that_fast_ones_hide() -> None:
    drive = bench.CASES["cogging"]
    up = tuple((0.3 * n, bench.TURN * (18.0 if n % 2 else 26.0)) for n in range(14))
    runs = {"both": bench.both_ways(20.0, 2.0), "up": bench.Run(up)}
    logs = dict(zip(runs, bench.simulated([(drive, run) for run in runs.values()]), strict=True))
    line = advice(said(logs)[0], "may also cog at order")
    (speed,) = [cure["record.speed"] for cure in line.cures if "record.speed" in cure]
    assert speed < 20 * bench.TURN
    (slower,) = bench.simulated([(drive, bench.both_ways(speed / bench.TURN, 2.0))])
    after, made = said({**logs, "both": slower})
    assert words(line) not in map(words, after) and made is not None
    assert {wave.order for wave in made.cogging} == {18, 30} and inertia_off(made) < 0.02


def test_a_hold_map_alone_asks_for_logs_that_turn_and_for_loads() -> None:
    angle = np.repeat(bench.TURN * np.arange(1000) / 1000, 2)
    direction = np.tile([1.0, -1.0], 1000)
    (cogging,) = bench.waves([[(30, 2e-3, 0.5)]])[1:2]
    current = direction * bench.COULOMB - float(cogging[0, 0]) * np.sin(30 * angle + 0.5)
    held = {"theta": angle, "i_q": current / bench.K_T, "direction": direction}
    tables = bench.columns()
    tables["columns"]["direction"] = "direction"
    tables["log"] = [{"file": "held*", "kind": "hold"}, *tables["log"]]
    logs = {"held": held}
    before, _ = said(logs, tables)
    turning, loads = advice(before, "No log of a turning motor"), advice(before, "Order 30 is six times")
    drive = bench.Drive(cogging=((30, 2e-3, 0.5),))
    names = [
        name for line in (turning, loads) for kind in line.cures[0]["record.kind"] for name in KIND_LOGS[kind]
    ]
    recordings = bench.simulated([(drive, bench.RUNS[name]) for name in names])
    after, made = said({**logs, **dict(zip(names, recordings, strict=True))}, tables)
    assert not {words(turning), words(loads)} & set(map(words, after)) and made is not None
    assert inertia_off(made) < 0.02
    (main,) = [wave for wave in made.cogging if wave.order == 30]
    assert main.size.value * bench.K_T == pytest.approx(2e-3, rel=0.03)


def test_a_log_that_cannot_be_simulated_is_left_out() -> None:
    """The file of columns has the bench's law, and the reference of every log but one."""
    logs = of_case("cogging", "slow", "sweep", "fast")
    kp = bench.SPEED_BANDWIDTH * bench.INERTIA / bench.K_T
    tables = bench.columns()
    tables["controller"] = {
        "pi": {"law": "pi", "kp": f"{kp} A*s/rad", "ki": f"{kp * bench.SPEED_BANDWIDTH / 4} A/rad"}
    }
    tables["log"] = [
        {
            "file": f"{name}*",
            "controller": "pi",
            "reference": {
                "profile": [[f"{time} s", f"{speed} rad/s"] for time, speed in bench.RUNS[name].points]
            },
        }
        for name in ("slow", "sweep")
    ]

    def played(names: tuple[str, ...]) -> Estimate:
        folder = Path(mkdtemp())
        paths = write(folder, plan.to_toml(tables), {name: logs[name] for name in names})
        return command.identified(paths, folder / "id.toml", lambda *of: None).estimate

    line = advice(list(played(tuple(logs)).remarks), "Not simulated: fast.npz")
    (cure,) = line.cures
    assert cure == {"record.logs": ("slow.npz", "sweep.npz")}
    made = played(tuple(name.removesuffix(".npz") for name in cure["record.logs"]))
    assert not any("Not simulated" in said for said in made.remarks)
    assert inertia_off(made) < 0.02


# --- changes of the file of columns


def mended(logs: Logs, tables: Mapping[str, Any], part: str) -> tuple[Advice, Estimate]:
    """The advice with these words, and the estimate after its change."""
    line = advice(said(logs, tables)[0], part)
    after, made = said(logs, changed(tables, line.cures[0]))
    assert made is not None and words(line) not in map(words, after)
    return line, made


def test_a_current_of_the_wrong_sign_is_turned() -> None:
    logs = of_case("cogging", "slow", "sweep")
    for log in logs.values():
        log["i_q"] = -log["i_q"]
    with pytest.raises(AdvisedError):
        identified(logs)
    line, made = mended(logs, bench.columns(), "as if the current braked the motor")
    assert line.cures == ({"columns.i_q.sign": -1},) and inertia_off(made) < 0.02


@pytest.mark.parametrize(
    ("signal", "factor", "key", "value"),
    [
        ("omega", 30 / math.pi, "columns.omega.unit", "rpm"),
        ("omega", 180 / math.pi, "columns.omega.unit", "deg/s"),
        ("theta", 180 / math.pi, "columns.theta.unit", "deg"),
        ("omega", 1 / bench.TURN, "columns.omega.unit", "rev/s"),
        ("theta", 1 / bench.TURN, "columns.theta.unit", "rev"),
        ("t", 1e3, "columns.t.unit", "ms"),
        ("t", 1e6, "columns.t.unit", "us"),
        ("omega", -1.0, "columns.omega.sign", -1),
        ("theta", bench.POLES, "columns.theta.scale", 1 / bench.POLES),
        ("i_q", 1e3, "columns.i_q.unit", "mA"),
    ],
)
def test_a_unit_that_does_not_fit_is_the_one_that_is_advised(
    signal: str, factor: float, key: str, value: Any
) -> None:
    logs = of_case("cogging", "slow", "sweep")
    for log in logs.values():
        log[signal] = factor * log[signal]
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(bench.columns()), logs)
    with pytest.raises(AdvisedError) as error:
        load_logs(paths, config.load(folder / "id.toml"))
    (line,) = error.value.mistakes
    assert isinstance(line, Advice)
    cure = next(cure for cure in line.cures if key in cure)
    assert cure[key] == pytest.approx(value) if isinstance(value, float) else cure[key] == value
    _, made = said(logs, changed(bench.columns(), cure))
    assert inertia_off(made) < 0.02


def test_a_wrong_k_t_is_the_one_that_the_voltage_says() -> None:
    """K_t is wrong by a fifth, more than warm magnets make. The change puts inertia and cogging right."""
    logs = of_case("cogging", "slow", "fast", "drives", "brakes", "sweep")
    tables = bench.columns()
    tables["motor"]["K_t"] = "0.06 N*m/A"
    assert inertia_off(said(logs, tables)[1]) > 0.15
    line, again = mended(logs, tables, "From the logged voltage, K_t is")
    assert line.cures[0].keys() == {"motor.K_t"}
    assert abs(again.K_t / bench.K_T - 1) < 0.02 and inertia_off(again) < 0.03
    by_kv = bench.columns()
    del by_kv["motor"]["K_t"]
    by_kv["motor"]["kv"] = f"{60 / bench.TURN * math.sqrt(3) / 2 / 0.06:.6g} rpm/V"
    assert (
        changed(by_kv, line.cures[0])["motor"].keys() >= {"K_t"}
        and "kv" not in changed(by_kv, line.cures[0])["motor"]
    )


def test_a_k_t_that_is_off_by_little_is_told_and_advises_nothing() -> None:
    """K_t differs by 3.3 %, as much as a voltage's gain or warm magnets make."""
    logs = of_case("cogging", "slow", "fast", "drives", "brakes", "sweep")
    for log in logs.values():
        log["u_q"] = 1.033 * log["u_q"]
    (line,) = [line for line in said(logs)[0] if line.startswith("From the logged voltage, K_t is")]
    assert not isinstance(line, Advice) and "it is open which value is right" in line


@pytest.mark.parametrize("shape", ["late", "soft", "direct"])
def test_what_the_voltage_says_of_k_t_holds_the_truth(shape: str) -> None:
    """The plant has a command 1.5 periods late, a bridge that loses less at small currents, and i_d."""
    speeds, currents = (
        np.array([30.0, -30.0, 90, -90, 250, -250, 60, 60]),
        np.array([0.04, -0.04, 0.05, -0.05, 0.07, -0.07, 1.0, -1.0]),
    )
    late = 1.5 / 10e3 if shape == "late" else 0.0
    direct = -0.5 * (np.abs(speeds) > 200) if shape == "direct" else np.zeros(8)
    band = 0.1 if shape == "soft" else 1e-9
    lost = 0.4 * np.clip(currents / band, -1, 1)
    electrical = bench.POLES * speeds
    u_q = bench.R_S * currents + electrical * (bench.PSI_F + bench.L_S * direct) + lost
    u_d = -electrical * bench.L_S * currents + bench.R_S * direct
    command = u_q * np.cos(electrical * late) + u_d * np.sin(electrical * late)
    t = 1e-3 * np.arange(4000)
    logs = {
        f"log{n}": {
            "t": t,
            "theta": w * t,
            "omega": w + 0 * t,
            "i_q": i + 0 * t,
            "i_d": d + 0 * t,
            "u_q": u + 0 * t,
        }
        for n, (w, i, d, u) in enumerate(zip(speeds, currents, direct, command, strict=True))
    }
    tables = bench.columns()
    tables["columns"]["i_d"] = "i_d"
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(tables), logs)
    known = config.load(folder / "id.toml")
    told = voltage.constants_from_voltage(known, load_logs(paths, known))
    assert told is not None
    assert abs(told[0].value - bench.K_T) < told[0].error < 0.25 * bench.K_T


def test_rms_amperes_are_told_by_the_phases_and_scaled() -> None:
    """The voltage can't decide on rms amperes. The advised phase currents decide, and `scale` mends it."""
    logs = of_case("cogging", "slow", "sweep")
    for log in logs.values():
        turned = bench.POLES * log["theta"]
        log["i_a"], log["i_b"] = (-log["i_q"] * np.sin(turned - k * bench.TURN / 3) for k in (0, 1))
        log["i_q"] = log["i_q"] / math.sqrt(2)
    open_line = voltage._of_r(config_of(logs), Value(math.sqrt(2) * bench.R_S, 0.02))[0]
    assert isinstance(open_line, Advice) and open_line.cures == ({"record.signal": "i_a"},)
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(bench.columns()), logs)
    with pytest.raises(AdvisedError) as error:
        load_logs(paths, config.load(folder / "id.toml"))
    (line,) = error.value.mistakes
    assert isinstance(line, Advice)
    _, made = said(logs, changed(bench.columns(), line.cures[0]))
    assert inertia_off(made) < 0.02


def config_of(logs: Logs) -> config.Identification:
    folder = Path(mkdtemp())
    write(folder, plan.to_toml(bench.columns()), logs)
    return config.load(folder / "id.toml")


# --- diagnose


def diagnosed(logs: Logs) -> diagnosis.Diagnosis:
    folder = Path(mkdtemp())
    paths = write(folder, plan.to_toml(bench.columns()), logs)
    return diagnosis.diagnosed(paths, folder / "id.toml", lambda *of: None)


@pytest.mark.parametrize(
    ("signal", "case", "cause"),
    [
        ("theta", "neighbours", "cogging"),
        ("i_q", "neighbours", "cogging"),
        ("i_q_ref", "dead time", "dead time"),
    ],
)
def test_a_signal_that_a_diagnosis_asks_for_tells_the_cause(signal: str, case: str, cause: str) -> None:
    logs = of_case(case, *ALL_LOGS)
    lines = diagnosed(without(logs, signal)).remarks
    asked = [line for line in advice_of(lines) if line.cures[0].get("record.signal") == signal]
    assert asked
    made = diagnosed(logs)
    assert not {words(line) for line in asked} & set(map(words, made.remarks))
    assert diagnosis.answer(made).startswith(f"Most of the ripple is {cause}: ")


def test_a_third_speed_tells_a_vibration_from_orders_that_meet() -> None:
    """A bench that swings at 24 Hz, which is order 24, 12 and 8 at three speeds."""
    t = 1e-3 * np.arange(6000)

    def swinging(turns_per_second: float) -> dict[str, np.ndarray]:
        theta = bench.TURN * turns_per_second * t + 2e-3 * np.sin(bench.TURN * 24 * t)
        return {"t": t, "theta": theta, "omega": np.gradient(theta, t)}

    two = {"one": swinging(1.0), "two": swinging(2.0)}
    (line,) = [line for line in advice_of(diagnosed(two).remarks) if "record a third speed" in line]
    assert line.cures == ({"record.kind": ("constant-speed",)},)
    three = diagnosed({**two, "three": swinging(3.0)}).remarks
    assert words(line) not in map(words, three)
    assert any(
        "24 Hz is" in said and "which swing at this frequency, or the supply" in said for said in three
    )


def test_an_order_that_grows_with_speed_is_told_by_the_current() -> None:
    logs = of_case("encoder", "odd", "fast", "slow", "sweep")
    lines = diagnosed(without(logs, "i_q")).remarks
    grows = [line for line in advice_of(lines) if " grows between " in line]
    assert grows and all(line.cures == ({"record.signal": "i_q"},) for line in grows)
    made = diagnosed(logs)
    assert diagnosis.answer(made).startswith("Most of the ripple is encoder: ")


def test_a_log_at_a_steady_speed_is_what_a_diagnosis_needs() -> None:
    logs = {"sweep": {key: x[:700] for key, x in bench.logs()["cogging"]["sweep"].items()}}
    with pytest.raises(AdvisedError) as error:
        diagnosed(logs)
    line = error.value.mistakes[-1]
    assert isinstance(line, Advice)
    made = diagnosed({**logs, **recorded(line.cures[0], "cogging")})
    assert set(made.whole) == {"both.npz"} and set(made.uses) == {"sweep.npz"}
