"""Inputs and outputs of the NumPy transcriptions, as text files that the C tests of control/ read.
PYTHONPATH=tests python tests/golden_vectors.py writes control/tests/vectors anew. A file has only numbers:
first the number of cases, then the cases. A case is its config, the number of steps, a line of inputs and
outputs for each step, the number of entries learned in the end, and these entries. Configs and inputs are
numbers of 32 bits, so that both builds read the same ones."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from reference.anti_cogging import AntiCogging
from reference.foc import Foc
from reference.harmonic import Harmonic
from reference.memory import AngleMemory, DelayLine
from reference.monitor import Monitor
from reference.pi import Pi
from reference.pi_afc import PiAfc
from reference.pi_ilc import PiIlc
from reference.quality import Quality
from reference.robust_ilc import RobustIlc
from reference.space_laws import PositionInput, SpacePosition, SpaceSpeed
from reference.trial import Trial

FOLDER = Path(__file__).parents[1] / "control" / "tests" / "vectors"
BY_SPEED = PiIlc | RobustIlc | PiAfc | Harmonic
STATUS = {"FAULT": 2, "ANGLE_LOST": 16, "ANGLE_SHIFTED": 32, "ANGLE_STUCK": 64, "CURRENT": 128, "BUS": 256}
Numbers = Iterable[Any]


def single(x: Any) -> Any:
    """Numbers rounded to 32 bits."""
    return np.asarray(x, dtype=float).astype(np.float32).astype(float).tolist()


def case(config: Numbers, rows: list[list[float]], learned: Numbers = ()) -> list[list[float]]:
    entries = list(learned)
    return [[*config], [len(rows)], *rows, [len(entries)], *([entries] if entries else [])]


# ---- inputs


def way(rng: np.random.Generator, steps: int, ts: float, speeds: list[float]) -> list[tuple[float, float]]:
    """Angle within a revolution and speed of a rotor that takes one speed after the other."""
    omega = np.repeat(speeds, -(-steps // len(speeds)))[:steps] * (1 + 0.05 * np.sin(0.1 * np.arange(steps)))
    theta = (1.0 + np.cumsum(omega) * ts) % (2 * math.pi)
    return list(zip(single(theta), single(omega), strict=True))


def law_inputs(rng: np.random.Generator, steps: int, ts: float, back: bool) -> list[PositionInput]:
    """Inputs of a rotor that follows its reference, with ripple, faults, steps at which learning is
    forbidden, and an error that saturates."""
    rows = []
    speeds = [9.0, 14.0, -11.0, 0.0, 12.0] if back else [9.0, 14.0, 11.0, 12.0]
    for n, (theta, omega) in enumerate(way(rng, steps, ts, speeds)):
        error = 0.3 * math.sin(4 * theta) + rng.normal(0, 0.05) + (40.0 if n % 97 > 93 else 0.0)
        values = [theta, omega, 0.5 * math.cos(theta), theta + 0.01 * math.sin(theta), omega - error]
        if n % 83 == 50:
            values[n % 5] = math.nan
        rows.append(PositionInput(*single(values), learn=n % 61 > 2))
    return rows


def pi_config() -> tuple[float, float, float]:
    kp, ki, limit = single([0.3, 2.5, 2.0])
    return kp, ki, limit


def torque_mode(n: int) -> tuple[bool, float]:
    """Whether step n is in torque mode, and the current that torque mode asks for: once too large, once no
    number."""
    current = math.nan if n == 131 else 40.0 if n == 135 else 0.4 * math.cos(0.3 * n)
    return n % 45 > 38, single(current)


def stood_by(law: Any, i: PositionInput, current: float) -> tuple[float, int]:
    """Output and status of a step in torque mode."""
    by_speed = isinstance(law, BY_SPEED)
    out = law.torque(current, i.omega_ref, i.omega_m, i.theta_m) if by_speed else law.torque(i, current)
    limit = law.pi.limit if hasattr(law, "pi") else law.limit
    fault = not (math.isfinite(current) and math.isfinite(i.theta_m))
    return out, (abs(out) >= limit) + 2 * fault + 4


def saturated(law: Any) -> bool:
    return law.pi.saturated if hasattr(law, "pi") else law.saturated


# ---- the subjects: cases of each


def pi(rng: np.random.Generator) -> list:
    kp, ki, limit = pi_config()
    ts = single(1e-2)
    law = Pi(kp, ki, ts, limit)
    rows = []
    for n in range(200):
        error, ff = single([math.sin(0.05 * n) * (6.0 if n > 100 else 1.0), 0.2 * math.cos(0.3 * n)])
        rows.append([error, ff, law.step(error, ff), law.integral])
    return case([kp, ki, limit, ts], rows)


def foc(rng: np.random.Generator, phases: int) -> list:
    gains = single([2.0, 300.0, 2.5, 400.0, 4.0, 1.5])
    L_d, L_q, psi_f, ts = single([1.2e-3, 1.5e-3, 0.02, 1e-4])
    kp_d, ki_d, kp_q, ki_q, limit, advance = gains
    law = Foc(kp_d, ki_d, kp_q, ki_q, ts, limit, advance, True, L_d, L_q, psi_f, phases)
    rows = []
    for n in range(120):
        theta = (0.35 * n) % (2 * math.pi)
        i = 1.5 * np.cos(theta - 2 * math.pi / 3 * np.arange(3) + 0.4)
        i = i - i.mean() if phases == 3 else i
        inputs = single([*i, theta, 350.0 + n, 24.0, 0.2, 2.0 + 1.5 * math.sin(0.1 * n)])
        inputs[n % 3 if n % 50 == 40 else 6] = math.nan if n % 50 == 40 else inputs[6]
        out = law.step(np.array(inputs[:3]), *inputs[3:6], complex(inputs[6], inputs[7]))
        seen = [out.i_dq.real, out.i_dq.imag, out.u_dq.real, out.u_dq.imag]
        rows.append([*inputs, *out.duty.tolist(), *seen])
    return case([*gains, 1, L_d, L_q, psi_f, phases, ts], rows)


KINDS = {"angle": 0, "time": 1, "ode": 2, "inversion": 2}


def memory_config(m: AngleMemory | DelayLine) -> list[float]:
    line = m if isinstance(m, DelayLine) else None
    limit = [*m.limit, 0.0, 0.0, 0.0][:3]
    kind = line.kind if line else "angle"
    method = [float(kind == "inversion"), line.k_pp if line else 1.0]
    sizes = [KINDS[kind], len(m.limit), m.cells, m.turns, m.parts, m.q_half_width, m.lead]
    return [*sizes, m.forgetting, *limit, *method]


def memory(rng: np.random.Generator, m: AngleMemory | DelayLine, speeds: list[float], ts: float) -> list:
    rows = []
    for n, (theta, omega) in enumerate(way(rng, 300, ts, speeds)):
        theta, learn = math.nan if n == 205 else theta, n % 71 > 1
        change = single([0.2 * math.sin((3 + c) * theta) + 0.05 * rng.normal() for c in range(len(m.limit))])
        change[0] = math.inf if n == 240 else change[0]
        values, learned = m.step(theta, omega, learn, change)
        rows.append([theta, omega, learn, *change, *values, learned])
    held = isinstance(m, AngleMemory) and m.cells < 1000
    entries = [cell[0] for cell in m.map] if held else []
    return case([*memory_config(m), ts, m.ratio], rows, entries)


def steady_inputs(steps: int, ts: float, omega: float) -> list[PositionInput]:
    """Inputs of a rotor whose angle has ripple of orders 6 and 24 under an eccentric sensor; one angle is
    missing."""
    rows = []
    for n in range(steps):
        turned = 1.0 + omega * ts * n
        turned += 2e-4 * math.cos(6 * turned) + 5e-5 * math.sin(24 * turned)
        seen = turned + 0.01 * math.cos(turned)
        values = [
            turned, omega, 0.0, math.nan if n == 900 else seen % math.tau, omega + 0.1 * math.sin(6 * turned),
        ]  # fmt: skip
        rows.append(PositionInput(*single(values), learn=n % 700 < 695))
    return rows


def law(
    rng: np.random.Generator,
    law: Any,
    config: list[float],
    ts: float,
    back: bool,
    inputs: list[PositionInput] | None = None,
) -> list:
    """The case of a law of speed or position that has a memory or learns by orders."""
    rows = []
    for n, i in enumerate(inputs or law_inputs(rng, 300, ts, back)):
        torque, current = torque_mode(n) if not inputs else (n % 1000 > 990, 0.0)
        if torque:
            rows.append([*i[:5], i.learn, torque, current, *stood_by(law, i, current)])
            continue
        by_speed = isinstance(law, BY_SPEED)
        out = law.step(i.omega_ref, i.omega_m, i.theta_m, i.learn) if by_speed else law.step(i)
        read = [i.omega_ref, i.omega_m, i.theta_m] if by_speed else list(i[:5])
        fault = not all(map(math.isfinite, read if not isinstance(law, SpaceSpeed) else i[1:5]))
        status = saturated(law) + 2 * fault + 4 * (not law.learning)
        rows.append([*i[:5], i.learn, torque, current, out, status])
    learned = [*law.a, *law.b] if isinstance(law, PiAfc) else []
    if isinstance(law, Harmonic):
        learned = [*law.a, *law.sines]
    held = getattr(law, "memory", None)
    if isinstance(held, AngleMemory):
        learned = [cell[0] for cell in held.map]
    return case([*config, *(memory_config(held) if held else []), ts], rows, learned)


def map_of(channels: int, **sizes: Any) -> AngleMemory:
    return AngleMemory(limit=single([1.5, 0.1, 0.02])[:channels], **sizes)


def line_of(kind: str, channels: int, ts: float, **sizes: Any) -> DelayLine:
    limit = single([1.5, 0.1, 0.02])[:channels]
    return DelayLine(kind=kind, ts=ts, k_pp=20.0, limit=limit, **sizes)


def anti_cogging(rng: np.random.Generator) -> list:
    kp, ki, limit = pi_config()
    ts, lead = single([1e-3, 2e-3])
    law = AntiCogging(Pi(kp, ki, ts, limit), 16, 1.0, 1, 5.0, lead)
    law.table = np.array(single(rng.uniform(-0.5, 0.5, 16)))
    rows = []
    for n, (theta, omega) in enumerate(way(rng, 200, ts, [30.0, -40.0])):
        omega_ref, omega, theta = single([omega + 0.2 * math.sin(0.1 * n), omega, theta - 4.0])
        theta = math.nan if n == 120 else theta
        torque, current = torque_mode(n)
        out = law.torque(current, omega, theta) if torque else law.step(omega_ref, omega, theta, 0.0)
        rows.append([omega_ref, omega, theta, torque, current, out])
    return case([kp, ki, limit, 16, 1.0, 1, 5.0, lead, ts, *law.table], rows)


def trial(rng: np.random.Generator, through: bool, observes: bool = False) -> list:
    """Three trials of 40 samples on a plant of numbers."""
    k_1, c = single([-0.6, -0.4]), single([1.0, 0.1])
    k_2, n, k_3, limit, learned_limit = single([0.0 if observes else 0.15, 0.8, 0.5, 1.2, 2.0])
    response, pole = single([0.15, 0.5] if observes else [0.0, 0.0])
    law = Trial(
        40,
        k_1,
        k_2,
        n,
        c,
        through,
        k_3,
        2,
        limit,
        learned_limit,
        response=response,
        pole=pole,
        unguarded=True,
    )
    y_ref = single(np.sin(0.2 * np.arange(40)) ** 2)
    rows = []
    for _ in range(3):
        law.begin(np.array(y_ref))
        x = [0.0, 0.0]
        for _ in range(40):
            x = single(x)
            u = law.step(np.array(x))
            rows.append([*x, u, law.saturated])
            x = [x[0] + 0.3 * x[1], 0.7 * x[1] + 0.5 * u]
        law.end()
    config = [*k_1, k_2, n, *c, through, k_3, 2, limit, learned_limit, response, pole]
    return case([*config, *y_ref], rows, law.v)


def quality(rng: np.random.Generator) -> list:
    span, longest, outlier, floor, ts = single([1.53, 0.505, 4.0, 0.01, 1e-2])
    q = Quality(span, longest, outlier, floor, ts)
    rows = []
    for n in range(300):
        error = 0.1 * rng.normal() * (1 - n / 600) + (3.0 if n % 90 in (80, 81, 82, 83, 84) else 0.0)
        error, omega = single([math.nan if n == 33 else error, 5.0 if n < 200 else 1.0])
        refused = q.step(error, omega, n > 100)
        rows.append([error, omega, n > 100, refused, q.residual, q.progress])
    return case([span, longest, outlier, floor, ts], rows)


def monitor(rng: np.random.Generator) -> list:
    names = ["omega_max", "angle_step", "speed_window", "stuck_angle", "stuck_time", "current_max"]
    names += ["current_sum", "bridge", "hold"]
    values = single([200.0, 2e-3, 5e-4, 0.05, 1e-3, 6.0, 0.5, 5e-4, 4e-4])
    ts = single(1e-4)
    m = Monitor(**dict(zip(names, values, strict=True)), ts=ts, phases=3)
    rows, theta = [], 6.0
    for n in range(300):
        omega = 60.0 + 0.1 * n
        theta += omega * ts if not 200 <= n < 250 else 0.0
        measured = math.nan if n in (40, 41) or 150 <= n < 160 else theta + (0.5 if 80 <= n < 110 else 0.0)
        i = [2.0, -1.0, -1.0] if n != 270 else [4.0, -1.0, -1.0]
        full = 205 <= n < 240 and n != 212
        row = single([*i, measured % (2 * math.pi), omega if n != 130 else 900.0, 24.0, omega, full])
        said = m.step(row[:3], *row[3:7], full)
        status = sum(STATUS[name] for name in said)
        rows.append([*row, m.theta, m.omega, status, m.trusted])
    return case([*values, 3, ts], rows)


def subjects() -> dict[str, Callable[[], list[list]]]:
    """For each file's name, a function that makes the file's cases."""

    def rng() -> np.random.Generator:
        return np.random.default_rng(11)

    ts = single(4e-3)
    mu = single([0.8, 1e-3, 1e-4])
    kp, ki, limit = pi_config()
    ilc_gain = single(0.05)
    robust = single([400.0, 4.0, 10.0, 120.0, 0.3, 2.0, 1.0, 30.0, 1.0, 8.0])
    speed = single([0.3, *mu, 3.0, 1.0, 3.0])
    position = single([5.0, 0.1, 0.05, 0.01, 1e-5, 2.0, *mu])

    def maps() -> list:
        return [
            (
                map_of(2, cells=50, parts=3, q_half_width=3, forgetting=single(0.9)),
                [30.0, 55.0, -20.0, 0.0, 25.0],
            ),
            (map_of(1, cells=41, turns=3, parts=2, lead=2, q_half_width=1), [60.0, 40.0, -50.0, 60.0]),
            (map_of(3, cells=33, ratio=7, parts=1), [3.0, 5.0, -4.0, 4.0]),
            (map_of(1, cells=65535, q_half_width=2, parts=655), [0.05, -0.05]),
            (map_of(1, cells=24, lead=5), [20.0, 12.0, 35.0]),
        ]

    def lines() -> list:
        return [
            (
                line_of("time", 2, ts, cells=120, q_half_width=2, forgetting=single(0.8)),
                [18.0, 25.0, 16.0, 5.0, 20.0],
            ),
            (line_of("time", 1, ts, cells=90, parts=2, lead=3), [12.0, 14.0, 11.0]),
            (line_of("ode", 2, ts, cells=150, q_half_width=1), [20.0, 24.0, 18.0]),
            (line_of("inversion", 1, ts, cells=150, turns=2, lead=4), [40.0, 44.0, 38.0]),
        ]

    def memories(which: list) -> list[list]:
        return [memory(rng(), m, speeds, ts) for m, speeds in which]

    def ilc() -> list[list]:
        laws = [PiIlc(Pi(kp, ki, ts, limit), ilc_gain, map_of(1, cells=60, parts=4, q_half_width=2)),
                PiIlc(Pi(kp, ki, ts, limit), ilc_gain,
                      line_of("time", 1, ts, cells=200, lead=3))]  # fmt: skip
        return [law(rng(), one, [kp, ki, limit, ilc_gain], ts, True) for one in laws]

    def sliding() -> list[list]:
        memories = [AngleMemory(cells=60, parts=4, lead=2, limit=[100.0], forgetting=single(0.95)),
                    AngleMemory(cells=60, parts=4, q_half_width=2, limit=[100.0])]  # fmt: skip
        return [law(rng(), RobustIlc(*robust, ts, 2.5, m), [*robust, 2.5], ts, True) for m in memories]

    def space_speed() -> list[list]:
        memories = [
            map_of(3, cells=60, parts=4, q_half_width=2, ratio=2),
            line_of("inversion", 1, ts, cells=150, ratio=2),
        ]
        return [law(rng(), SpaceSpeed(*speed, 2, m), [*speed, 2], ts, n == 0) for n, m in enumerate(memories)]

    def space_position() -> list[list]:
        made = []
        for n, m in enumerate(
            [map_of(2, cells=60, q_half_width=1, ratio=4), line_of("ode", 1, ts, cells=90, ratio=4)]
        ):
            ramp, omega_min, hand_over = single(0.2), 1.0, n == 0
            index = ["reference", "rotor"][n]
            one = SpacePosition(4, *position, hand_over, ramp, omega_min, index, ts, 3.0, m)
            made.append(law(rng(), one, [4, *position, hand_over, ramp, omega_min, n, 3.0], ts, n == 0))
        return made

    def afc() -> list[list]:
        orders = np.array([2, 5, 12])
        gain, lead = single([1.5, 1e-3])
        one = PiAfc(Pi(kp, ki, ts, limit), orders, gain, lead, 1.0, 0.75)
        return [law(rng(), one, [kp, ki, limit, 3, *orders, gain, lead, 1.0, 0.75], ts, True)]

    def harmonics() -> list[list]:
        ts = single(1e-3)
        numbers = single([800.0, 0.4e-3])
        rates = single([8.0, 1.0, 1.5])
        held = single([0.1, 0.14, 0.28, 0.32, 0.0, 0.0, 0.0, 0.0])  # at first the second order and the fifth
        step = single(1e-3)

        def at(omega: float, base: int, steps: int) -> list:
            one = Harmonic(
                Pi(kp, ki, ts, limit), *numbers, base, 5, *rates, tuple(held), sensor_step=step, fast=4
            )
            config = [kp, ki, limit, 0.0, *numbers, step, base, 2, 5, 4, *rates, *held]
            return law(rng(), one, config, ts, True, steady_inputs(steps, ts, omega))

        return [at(10.0, 6, 1500), at(single(30.0), 12, 400)]  # slow orders; one slow and three quick ones

    return {
        "pi": lambda: [pi(rng())],
        "foc": lambda: [foc(rng(), 3), foc(rng(), 2)],
        "memory": lambda: memories(maps()),
        "delay_line": lambda: memories(lines()),
        "pi_ilc": ilc, "robust_ilc": sliding, "space_speed": space_speed, "space_position": space_position,
        "pi_afc": afc, "harmonic": harmonics,
        "anti_cogging": lambda: [anti_cogging(rng())],
        "trial": lambda: [trial(rng(), True), trial(rng(), False), trial(rng(), False, observes=True)],
        "quality": lambda: [quality(rng())],
        "monitor": lambda: [monitor(rng())],
    }  # fmt: skip


def text(cases: list[list]) -> str:
    lines = [[len(cases)], *(line for one in cases for line in one)]
    return "".join(" ".join(repr(float(x)).removesuffix(".0") for x in line) + "\n" for line in lines)


if __name__ == "__main__":
    for name, cases in subjects().items():
        (FOLDER / f"{name}.txt").write_text(text(cases()))
