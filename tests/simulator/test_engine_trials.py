"""Trials in the engine: the whole loop against a transcription, restarts, sensors, current loops, errors."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from engine import BASE, RIPPLE, TRIAL_LAW, config, drive_of, merged, signals, trial_config
from reference.trial import Trial
from scipy.linalg import expm
from scipy.signal import butter

from cogless import _simulator_f32, _simulator_f64

SAMPLES = 240
TICKS = 20 * SAMPLES  # of a trial
K_T = 0.37
PHASE = np.linspace(0.0, 2.0 * np.pi, SAMPLES)
THERE_AND_BACK = 2.0 * (1.0 - np.cos(PHASE))
# starts within a turn of zero, and goes through several turns below it
DOWNWARDS = 1.0 - 4.0 * (PHASE - np.sin(PHASE))
B, A = butter(2, 30.0, fs=400.0)
CONTROLLER: dict[str, Any] = {
    # (41)
    "feedforward": {
        "numerator": 3,
        "denominator": 1,
        "preview": 2,
        "num": [1 / 0.0028, -0.9564 / 0.0028, 0.2352 / 0.0028],
        "den": [1.0],
    },
    "q_filter": {"order": 2, "b": B.tolist(), "a": A.tolist()},
}


def phase(
    first: int, reference: Any, steps: list[tuple[int, float]] | None = None, **change: Any
) -> dict[str, Any]:
    load_steps = [{"sample": sample, "torque": torque} for sample, torque in steps or []]
    start = {"initial_angle": float(reference[0])}
    return {"from": first, "reference": reference, "load_steps": load_steps, **start, **change}


def changes() -> dict[str, Any]:
    """Changes of load, inertia and reference between trials."""
    loaded = {"load": {"torque": 0.1}, "initial_speed": 0.3}
    return trial_config(
        9,
        [
            phase(0, THERE_AND_BACK),
            phase(3, THERE_AND_BACK, [(80, 0.5), (160, -0.2)]),
            phase(5, THERE_AND_BACK, [(80, 0.5), (160, -0.2)], mechanics={"inertia": 1.2e-3}),
            phase(7, DOWNWARDS, [(30, 0.4), (30, 0.2)], **loaded),
        ],
        CONTROLLER,
    )


def trial_law(controller: dict[str, Any]) -> Trial:
    c = controller["config"]
    same = ("samples", "k_1", "k_2", "n", "c", "through_integrator", "k_3", "shift", "limit", "learned_limit")
    return Trial(
        **{key: c[key] for key in same},
        num=c["feedforward"]["num"],
        den=c["feedforward"]["den"],
        preview=c["feedforward"]["preview"],
        b=c["q_filter"]["b"],
        a=c["q_filter"]["a"],
        learning_matrix=controller["learning_matrix"],
    )


def phase_of(phases: list[dict[str, Any]], trial: int) -> dict[str, Any]:
    return [p for p in phases if p["from"] <= trial][-1]


def expected(settings: dict[str, Any]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The drive with perfect sensors and an ideal current loop, sampled exactly: signals by sample, and v."""
    trials, drive = settings["trials"], settings["drive"]
    law = trial_law(settings["controller"])
    names = ("theta_m", "omega_m", "theta_ref", "i_q", "tau_e", "tau_load", "learned")
    x: dict[str, list[float]] = {name: [] for name in names}
    for trial in range(trials["count"]):
        now = phase_of(trials["phases"], trial)
        inertia, viscous = now["mechanics"]["inertia"], now["mechanics"]["viscous_friction"]
        # of [theta, omega, torque], over a tick
        model = np.array([[0.0, 1.0, 0.0], [0.0, -viscous / inertia, 1.0 / inertia], [0.0, 0.0, 0.0]])
        over_tick = expm(model / drive["current_rate"])
        state = np.array([now["initial_angle"], now["initial_speed"]])
        load = now["load"]["torque"]
        law.begin(now["reference"])
        for p in range(trials["samples"]):
            for step in now["load_steps"]:
                load = step["torque"] if step["sample"] == p else load
            v = law.acting[p]
            i_q = law.step(state)
            row = (*state, now["reference"][p], i_q, K_T * i_q, load, v)
            for name, value in zip(names, row, strict=True):
                x[name].append(value)
            for _ in range(drive["speed_divider"]):
                state = (over_tick @ [*state, K_T * i_q - load])[:2]
        law.end()
    return {name: np.array(values) for name, values in x.items()}, law.v


def rows(engine: Any, state: Any, ticks: int, decimation: int = 20) -> np.ndarray:
    recorder = _simulator_f64.Recorder(engine, decimation)
    engine.advance(state, recorder, ticks)
    return recorder.take()


def test_the_whole_loop_is_the_exactly_sampled_one() -> None:
    settings = changes()
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 9 * TICKS, decimation=20)
    wanted, _ = expected(settings)
    for name, signal in wanted.items():
        assert x[name] == pytest.approx(signal, abs=1e-9 * np.abs(signal).max()), name
    assert np.array_equal(x["trial"], np.repeat(np.arange(1, 10), SAMPLES))
    assert x["time"] == pytest.approx(np.arange(9 * SAMPLES) / 400.0, abs=1e-12)
    terms = sum(x[f"term_{name}"] for name in ("feedback", "integral", "feedforward", "learned"))
    assert x["i_q_ref"] == pytest.approx(terms, abs=1e-9)
    assert np.abs(wanted["i_q"]).max() < 20.0
    # it learned: the last trial of a phase is better than its first
    error = np.abs(wanted["theta_ref"] - wanted["theta_m"]).reshape(9, SAMPLES).max(axis=1)
    assert error[4] < 0.6 * error[3]


def test_in_single_precision_it_is_the_same_to_rounding() -> None:
    settings = changes()
    x = signals(drive_of(_simulator_f32, settings), _simulator_f32, 9 * TICKS, decimation=20)
    wanted, _ = expected(settings)
    # the current is the small difference of large terms
    rounding = 20 * np.finfo(np.float32).eps * np.abs(x["term_feedback"]).max()
    for name, signal in wanted.items():
        share = {"i_q": 1.0, "tau_e": K_T, "learned": 1 / 99.4}
        tolerance = share[name] * rounding if name in share else 2e-4 * np.abs(signal).max()
        assert np.abs(x[name] - signal).max() <= tolerance, name
    assert not np.array_equal(x["i_q"], wanted["i_q"])


def test_memory_is_the_learned_signal() -> None:
    settings = changes()
    drive = drive_of(_simulator_f64, settings)
    state = drive.start()
    assert np.array_equal(drive.stored(state)["values"], np.zeros((1, SAMPLES)))
    rows(drive, state, 9 * TICKS)
    _, learned = expected(settings)
    assert drive.stored(state)["values"][0] == pytest.approx(learned, abs=1e-9)


def test_the_learned_signal_changes_between_trials_only() -> None:
    drive = drive_of(_simulator_f64, changes())
    state = drive.start()
    rows(drive, state, TICKS - 1)
    assert not np.any(drive.stored(state)["values"][0])
    rows(drive, state, 1)
    learned = drive.stored(state)["values"][0]
    assert np.any(learned)
    x = dict(zip([name for name, _ in drive.signals], rows(drive, state, TICKS).T, strict=True))
    assert np.array_equal(x["learned"], learned)


def test_an_angle_of_several_turns_is_measured_without_jumps() -> None:
    settings = trial_config(2, [phase(0, DOWNWARDS + 50.0)], CONTROLLER)
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 2 * TICKS, decimation=20)
    assert np.ptp(x["theta_m"]) > 4.0 * np.pi
    assert x["theta_measured"] == pytest.approx(x["theta_m"], abs=1e-12)


def test_each_trial_starts_afresh() -> None:
    """Without learning, all trials are the same: plant, load, sensors, filter, bus and current loop."""
    fresh: dict[str, Any] = {
        "motor": RIPPLE,
        "mechanics": {"coulomb_friction": 0.02, "breakaway_friction": 0.03},
        "load": {"torque": 0.1, "lag": 0.01, "time_table": {"time": [0.1, 0.4], "torque": [0.0, 0.3]}},
        "initial_speed": 0.7,
    }
    timed = {"kind": "encoder", "counts": 2000.0, "speed_method": "MT", "timer": 1e6}
    late = {"kind": "absolute", "counts": 2.0**14, "speed_method": "average", "window": 8, "latency": 3e-4}
    hall = {"kind": "hall", "counts": 24.0, "window": 6, "timer": 1e6, "placement": 6 * [0.0]}
    bus = {"delay_measured": 2e-3, "delay_command": 3e-3, "jitter": 0.0, "quantum": 1e-3}
    for sensor, loop in (
        (timed, {"ideal_current": True}),
        (timed, {"ideal_current": False}),
        (late, {"ideal_current": True, "speed_filter": 600.0, "bus": bus}),
        (hall, {"ideal_current": True}),
    ):
        settings = trial_config(
            3,
            [phase(0, THERE_AND_BACK, [(80, 0.4)], **fresh)],
            {**CONTROLLER, "k_3": 0.0},
            position_sensor={**sensor, "error": [{"order": 1, "amplitude": 1e-3, "phase": 0.0}]},
            **loop,
        )
        x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 3 * TICKS)
        for name in set(x) - {"time", "trial"}:
            first, second, third = x[name].reshape(3, TICKS)
            assert np.array_equal(first, second), name
            assert np.array_equal(first, third), name


def test_noise_goes_on_from_trial_to_trial() -> None:
    settings = trial_config(
        2,
        [phase(0, THERE_AND_BACK)],
        {**CONTROLLER, "k_3": 0.0},
        ideal_current=False,
        current_sensors={"noise": 0.05},
    )
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 2 * TICKS)
    first, second = x["i_q"].reshape(2, TICKS)
    assert not np.any(first[20:] == second[20:])


def test_load_steps_follow_a_lag_within_the_trial() -> None:
    load = {"torque": 0.1, "lag": 0.03}
    settings = trial_config(2, [phase(0, THERE_AND_BACK, [(80, 0.5)], load=load)], CONTROLLER)
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 2 * TICKS)
    since = np.maximum(np.arange(TICKS) / 8000 - 80 / 400, 0.0)
    assert x["tau_load"] == pytest.approx(np.tile(0.5 - 0.4 * np.exp(-since / 0.03), 2), abs=1e-12)


@pytest.mark.parametrize("speed", [3.3, -3.3])
def test_resolver_and_moving_average_are_the_papers(speed: float) -> None:
    """Sixteen-point moving average of the angle's difference at the current loop's rate, 14 bit."""
    start = {"initial_speed": speed, "initial_angle": 0.1}
    heavy = {"mechanics": {"inertia": 1e15, "viscous_friction": 0.0}, **start}
    sensor = {"kind": "resolver", "counts": 2.0**14, "speed_method": "average", "window": 16}
    reference = 0.1 + speed * np.arange(SAMPLES) / 400
    settings = trial_config(2, [{"from": 0, "reference": reference, **heavy}], position_sensor=sensor)
    x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 2 * TICKS)
    step, tick = 2.0 * np.pi / 2**14, np.arange(TICKS)

    def seen(at: np.ndarray) -> np.ndarray:
        return step * np.floor((0.1 + speed * at / 8000) / step)

    velocity = np.mean([seen(tick - n) - seen(tick - n - 1) for n in range(16)], axis=0) * 8000
    assert np.abs(x["omega_measured"] - np.tile(velocity, 2)).max() <= 1e-9
    at_sample = seen(tick)[::20]
    assert x["theta_measured"][::20] == pytest.approx(np.tile(at_sample, 2), abs=1e-9)
    assert np.ptp(velocity) == pytest.approx(step * 500)


def test_a_fast_current_loop_comes_close_to_the_ideal_one() -> None:
    """The gap falls with the loop's bandwidth."""
    motor = {"L_d": 2e-3, "L_q": 2e-3, "R_s": 0.8}

    loaded = phase(0, THERE_AND_BACK, [(80, 0.5)], motor=motor)

    def angle(**loop: Any) -> np.ndarray:
        settings = trial_config(2, [loaded], CONTROLLER, current_rate=80000, speed_divider=200, **loop)
        x = signals(drive_of(_simulator_f64, settings), _simulator_f64, 10 * 2 * TICKS, decimation=200)
        return x["theta_m"]

    def real(bandwidth: float) -> np.ndarray:
        kp, ki = bandwidth * 2e-3, bandwidth * 0.8
        inverter = {"bus_voltage": 400.0, "computation_delay": 0}
        return angle(ideal_current=False, kp_d=kp, kp_q=kp, ki_d=ki, ki_q=ki, inverter=inverter)

    ideal = angle()
    gap = [np.abs(real(bandwidth) - ideal).max() for bandwidth in (4e3, 16e3)]
    assert gap[1] < 2e-3 * np.ptp(ideal)
    assert gap[1] < 0.35 * gap[0]


def test_odd_pieces_are_the_same_run() -> None:
    drive = drive_of(_simulator_f64, changes())
    whole = rows(drive, drive.start(), 9 * TICKS, decimation=3)
    state = drive.start()
    pieces = [rows(drive, state, n, decimation=3) for n in (1, 4798, 1, 1, 20003, 9599, 0)]
    assert state.tick == 34403
    pieces.append(rows(drive, state, 9 * TICKS - state.tick, decimation=3))
    assert np.array_equal(whole, np.vstack(pieces))


@pytest.mark.parametrize("at", [2 * TICKS, 2 * TICKS + 77])
def test_a_copied_state_goes_on_alike_and_alone(at: int) -> None:
    first, second = drive_of(_simulator_f64, changes()), drive_of(_simulator_f64, changes())
    state = first.start()
    rows(first, state, at)
    copy = state.copy()
    whole = rows(first, state, 9 * TICKS - at)
    learned = first.stored(state)["values"][0]
    del first, state  # a state does not lean on another, nor on the drive that made it
    assert copy.tick == at
    assert np.array_equal(whole, rows(second, copy, 9 * TICKS - at))
    assert np.array_equal(learned, second.stored(copy)["values"][0])


@pytest.mark.parametrize("module", [_simulator_f32, _simulator_f64])
def test_a_matrix_learns_in_place_of_a_gain(module: ModuleType) -> None:
    matrix = 0.5 * np.eye(SAMPLES, k=2) + 0.1 * np.eye(SAMPLES, k=1)
    settings = trial_config(2, [phase(0, THERE_AND_BACK)], CONTROLLER)
    settings = merged(settings, {"controller": {"learning_matrix": matrix}})
    drive = drive_of(module, settings)
    state = drive.start()
    recorder = module.Recorder(drive, 20)
    drive.advance(state, recorder, 2 * TICKS)
    _, learned = expected(settings)
    rounding = 1e-9 if module is _simulator_f64 else 1e-4
    assert drive.stored(state)["values"][0] == pytest.approx(learned, abs=rounding)


def test_signals_and_their_units() -> None:
    always = ["time", "trial", "theta_m", "omega_m", "theta_ref", "theta_measured", "omega_measured"]
    torques = ["tau_e", "tau_cogging", "tau_load", "status"]
    terms = ["term_feedback", "term_integral", "term_feedforward", "term_learned", "learned"]
    ideal = drive_of(_simulator_f64, changes())
    real = drive_of(_simulator_f64, merged(changes(), {"drive": {"ideal_current": False}}))
    phases = ["i_a", "i_b", "i_c", "u_d", "u_q"]
    assert [name for name, _ in ideal.signals] == [*always, "i_q", "i_q_ref", *torques, *terms]
    assert [name for name, _ in real.signals] == [*always, "i_d", "i_q", "i_q_ref", *phases, *torques, *terms]
    units = dict(ideal.signals)
    assert [units[name] for name in ("trial", "theta_ref", "term_learned", "learned")] == [
        "",
        "rad",
        "A",
        "rad",
    ]


def test_energy_balance_within_each_trial() -> None:
    settings = trial_config(2, [phase(0, THERE_AND_BACK, [(80, 0.3)])], CONTROLLER, ideal_current=False)
    x = signals(drive_of(_simulator_f64, {**settings, "energy": True}), _simulator_f64, 2 * TICKS)
    out = x["energy_copper"] + x["energy_friction"] + x["energy_load"] + x["energy_stored"]
    assert x["energy_electrical"] == pytest.approx(out, abs=1e-4 * x["energy_electrical"].max())
    assert x["energy_electrical"][TICKS] == 0.0


def test_growth_beyond_all_numbers_names_the_trial() -> None:
    # viscous friction so strong for its step that integrating it grows
    stiff = {"mechanics": {"inertia": 1e-9, "viscous_friction": 1.0}, "initial_speed": 1.0}
    settings = trial_config(3, [phase(0, THERE_AND_BACK), phase(1, THERE_AND_BACK, **stiff)], CONTROLLER)
    drive = drive_of(_simulator_f64, settings)
    with pytest.raises(RuntimeError, match=r"^trial 2: .*beyond all numbers"):
        signals(drive, _simulator_f64, 2 * TICKS)


def test_there_are_no_more_trials_than_said() -> None:
    drive = drive_of(_simulator_f64, changes())
    state = drive.start()
    rows(drive, state, 9 * TICKS)
    with pytest.raises(ValueError, match="only 9 trials"):
        rows(drive, state, 1)


def many(first: int) -> dict[str, Any]:
    return phase(first, THERE_AND_BACK)


def with_trials(**change: Any) -> dict[str, Any]:
    settings = changes()
    return {**settings, "trials": {**settings["trials"], **change}}


def with_law(**change: Any) -> dict[str, Any]:
    return merged(changes(), {"controller": {"config": change}})


def with_matrix(matrix: Any) -> dict[str, Any]:
    return merged(changes(), {"controller": {"learning_matrix": matrix}})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (trial_config(5, [many(1)]), r"trials.phases.0.from: expected 0"),
        (trial_config(5, [many(0), many(3), many(3)]), r"trials.phases.2.from: expected more"),
        (trial_config(5, [many(0), many(5)]), r"trials.phases.1.from: expected less than the number"),
        (with_trials(phases=[]), r"trials.phases: expected one"),
        (with_trials(count=0), r"trials.count: expected 1"),
        (with_trials(samples=SAMPLES + 1), r"trials.phases.0.reference: expected 241 numbers"),
        (trial_config(1, [phase(0, [np.nan] * SAMPLES)]), r"reference: expected finite"),
        (trial_config(1, [phase(0, THERE_AND_BACK, [(SAMPLES, 1.0)])]), r"load_steps.0.sample"),
        (trial_config(1, [phase(0, THERE_AND_BACK, [(9, 1.0), (8, 1.0)])]), r"load_steps.1.sample"),
        (trial_config(1, [phase(0, [0.0, 0.0])]), r"trial: a gain is outside its range"),
        (trial_config(1, [phase(0, [0.0] * 9)], CONTROLLER), r"trial: a gain is outside its range"),
        (with_law(states=1), r"controller.config: expected 2 states"),
        (with_law(samples=SAMPLES + 1), r"controller.config: expected 240 samples"),
        (with_matrix(np.zeros((2, 3))), r"learning_matrix: expected 240 rows"),
        (with_matrix([1.0]), r"learning_matrix: wrong type"),
        (with_law(limit=-1.0), r"trial: a gain is outside its range"),
        (with_law(k_2=np.nan), r"trial: a gain is outside its range"),
        (
            merged(changes(), {"controller": BASE["controller"]}),
            r'law: expected "trial" or a law of your own',
        ),
        (
            config({"controller": merged(TRIAL_LAW, {"config": {"samples": 9}})}),
            r'law: .*"trial" only with',
        ),
        ({**changes(), "energy": True}, r"energy: not with an ideal current loop"),
        (merged(changes(), {"drive": {"current_limit": 0.0}}), r"current_limit: expected more than 0"),
    ],
)
def test_a_wrong_description_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        drive_of(_simulator_f64, settings)
