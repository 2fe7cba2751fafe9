"""The space-learning laws of the C library: agreement with the reference, and what they do."""

import dataclasses
import math

import numpy as np
import pytest
from control_library import control_library
from reference.memory import AngleMemory, DelayLine
from reference.motion import rounded
from reference.space_laws import PositionInput, SpacePosition, SpaceSpeed, theta_tg
from test_control_memory import TS, cells_needed, memory_config, varying

STEPS, RATIO = 1500, 4
TERMS = ("proportional", "integral", "alpha", "beta", "h")
PERIODS = [
    (1, 1),
    (4, 1),
    (2, 3),
    (1, 3),
    (12, 1),
]  # turns, parts; the last one: three mechanical revolutions
pytestmark = pytest.mark.filterwarnings("ignore:invalid value encountered")


class CLaw:
    """A C law, configured as its reference is."""

    def __init__(self, library, reference: SpacePosition | SpaceSpeed):
        self.name = "cgl_space_position" if isinstance(reference, SpacePosition) else "cgl_space_speed"
        self.library, lib = library, library.lib
        fields = [f.name for f in dataclasses.fields(reference)]
        config = {name: getattr(reference, name) for name in fields[: fields.index("memory")]}
        if "index" in config:
            config["index"] = {"reference": 0, "rotor": 1}[config["index"]]
        memory, ts = memory_config(library, reference.memory), config.pop("ts", TS)
        self.config = library.new(f"{self.name}_config", memory=memory, **config)
        self.state, length = library.new(self.name), cells_needed(reference.memory)
        self.cell, pointer = library.array(np.zeros(length))
        assert (
            getattr(lib, f"{self.name}_init")(self.state, self.config, library.loop(ts), pointer, length)
            == lib.CGL_OK
        )
        self.input, self.output = library.new("cgl_law_input"), library.new("cgl_law_output")
        self.c_step = getattr(lib, f"{self.name}_step")
        self.names = [name for name in TERMS if hasattr(self.state.terms, name)]

    def step(self, i: PositionInput) -> float:
        into = self.input
        into.theta_ref, into.omega_ref, into.alpha_ref, into.theta_m, into.omega_m, into.learn = i
        self.c_step(self.state, self.input, self.output)
        return self.output.i_q_ref

    @property
    def status(self) -> int:
        return self.output.status

    @property
    def terms(self) -> dict[str, float]:
        return {name: getattr(self.state.terms, name) for name in self.names}


# ---- agreement with the reference


def random_memory(rng, kind, real, channels):
    turns, parts = PERIODS[rng.integers(len(PERIODS))]
    limit = rounded([rng.uniform(0.5, 3), rng.uniform(0.01, 0.1), rng.uniform(0.001, 0.01)], real)
    sizes = {
        "turns": turns, "parts": parts, "q_half_width": int(rng.choice([0, 2, 7])),
        "limit": limit[:channels].tolist(),
        "ratio": RATIO, "real": float if real is np.float64 else real, "lead": int(rng.choice([0, 0, 3])),
    }  # fmt: skip
    if kind == "map":
        return AngleMemory(cells=int(rng.choice([16, 60, 256])), **sizes)
    ts, k_pp = rounded([TS, rng.uniform(1, 50)], real).tolist()
    return DelayLine(kind=kind, ts=ts, k_pp=k_pp, cells=int(rng.choice([120, 600, 3000])), **sizes)


def random_law(rng, law, kind, real):
    def draw(*ranges):
        return rounded([rng.uniform(*r) for r in ranges], real).tolist()

    memory = random_memory(rng, kind, real, int(rng.integers(1, 4)))
    mu = draw((0, 3), (0, 1e-3), (0, 1e-5))
    if law == "speed":
        k, omega_min, limit = draw((0.05, 0.5), (0.5, 3), (1, 4))
        return SpaceSpeed(k, *mu, draw((1, 4))[0], omega_min, limit, RATIO, memory)
    gains = draw((0, 20), (0.05, 0.2), (0, 0.1), (0, 0.02), (0, 1e-5), (0, 5))
    ramp, omega_min, limit = draw((0, 1), (0.5, 3), (1, 4))
    ramp *= int(rng.integers(4) > 0)  # now and then learning starts at once
    index = str(rng.choice(["reference", "rotor"]))
    ts = float(real(TS))
    return SpacePosition(RATIO, *gains, *mu, bool(rng.integers(2)), ramp, omega_min, index, ts, limit, memory)


def inputs(rng, memory, real, faults) -> list[PositionInput]:
    """A reference that turns, stops and reverses (before a delay line hardly), and a rotor close to it."""
    backward = -20.0 if isinstance(memory, AngleMemory) else -1.0
    speeds = [
        rng.choice([rng.uniform(backward, 20), *rng.uniform(8, 20, 4), 0.0]) for _ in range(STEPS // 100)
    ]
    t = TS * np.arange(STEPS)
    omega_ref = np.repeat(speeds, 100) * (1 + 0.1 * np.sin(2 * np.pi * 3 * t))
    alpha_ref = np.gradient(omega_ref, TS)
    theta_ref = np.cumsum(omega_ref) * TS
    error = 0.02 * np.sin(7 * t) + 0.01 * np.sin(31 * t)
    omega_m = omega_ref + np.gradient(error, TS) + rng.normal(0, 0.1, STEPS)
    omega_m += np.repeat(
        rng.choice([0.0, 0.0, 0.0, 25.0, -25.0], STEPS // 60), 60
    )  # into saturation and back
    wrapped = [x % (2 * np.pi) for x in (theta_ref, theta_ref + error)]

    def spoilt(x):
        hit = rng.random(STEPS) < faults
        return np.where(hit, rng.choice([np.nan, np.inf, -np.inf, 1e30], STEPS), x)

    columns = [spoilt(x) for x in (wrapped[0], omega_ref, alpha_ref, wrapped[1], omega_m)]
    learn = (rng.random(STEPS) >= 4 * faults).tolist()
    rows = zip(*(rounded(c, real).tolist() for c in columns), learn, strict=True)
    return [PositionInput(*row) for row in rows]


def status(library, reference) -> int:
    lib = library.lib
    return (
        lib.CGL_STATUS_SATURATED * reference.saturated
        | lib.CGL_STATUS_FROZEN * (not reference.learning)
        | lib.CGL_STATUS_FAULT * (not reference.plausible)
    )


@pytest.mark.parametrize("law", ["position", "speed"])
@pytest.mark.parametrize("kind", ["map", "ode", "inversion"])
@pytest.mark.parametrize("seed", range(5))
def test_double_equals_the_reference(law, kind, seed):
    rng = np.random.default_rng(seed)
    library = control_library("double")
    reference = random_law(rng, law, kind, np.float64)
    c = CLaw(library, reference)
    f = (1.0, 30 * RATIO, 8000 * RATIO)
    learned = 2 * sum(k * g for k, g in zip(reference.memory.limit, f, strict=False))
    seen = set()
    for n, one in enumerate(inputs(rng, reference.memory, np.float64, 0.002)):
        got, expected = c.step(one), reference.step(one)
        assert c.status == status(library, reference), n
        scale = max(reference.limit, learned, *(abs(x) for x in reference.terms.values()))
        assert abs(got - expected) <= 1e-11 * scale, n
        for name, value in c.terms.items():
            assert abs(value - reference.terms[name]) <= 1e-11 * scale, (n, name)
        if kind != "map":
            assert abs(c.state.memory.line.p_t - reference.memory.p_t) <= 1e-12, n
        seen.add(c.status & 5)
    assert {0, 4} <= seen or reference.memory.cells == 120  # in the shortest line the period seldom fits
    assert seen & {1, 5}


@pytest.mark.parametrize("law", ["position", "speed"])
@pytest.mark.parametrize("kind", ["map", "ode", "inversion"])
@pytest.mark.parametrize("seed", range(4))
def test_single_stays_within_rounding(law, kind, seed):
    """As for the other learning laws (test_control_speed_laws.py): eps a step, at random, for the integral;
    and what is learned rounds once a period. Where a decision lies within rounding the two part; that has to
    come late."""
    rng = np.random.default_rng(100 + seed)
    library = control_library("float")
    reference = random_law(rng, law, kind, np.float32)
    c = CLaw(library, reference)
    m = reference.memory
    # a place in a map is the same integer in both, and the filter's sum is off by its entries' rounding; in a
    # line the angle is known to eps of the period, and 8 rad/s say how many samples these are
    off = 16 + 4 * (2 * m.q_half_width + 1)
    if kind != "map":
        off += 8 * m.turns / (m.parts * RATIO) * 2 * math.pi / (8 * TS)
    compared = 0
    for n, one in enumerate(inputs(rng, m, np.float32, 0.0)):
        got, expected = c.step(one), reference.step(one)
        if c.status != status(library, reference):
            break
        f = [1.0, 30.0 * RATIO, 8000.0 * RATIO] if law == "position" else [1.0, 50.0, 8000.0]
        learned = sum(k * g for k, g in zip(m.limit, f, strict=False))
        scale = reference.limit + sum(abs(x) for x in reference.terms.values())
        bound = library.eps * (scale * (8 + 2 * math.sqrt(n)) + learned * off * math.sqrt(1 + n / 30))
        assert abs(got - expected) <= bound, n
        compared += 1
    assert compared > STEPS / 3


# ---- standstill, reversal, freezing, limits


def position_law(memory, **fields) -> SpacePosition:
    usual = dict(ratio=RATIO, k_theta=5.0, k_omega=0.1, k_v=0.0, v_0=0.0, v_2=0.0, k_i=1.0, mu_alpha=2.0,
                 mu_beta=0.0, mu_h=0.0,
                 hand_over=False, ramp=0.0, omega_min=0.5, index="reference", ts=TS, limit=10.0)  # fmt: skip
    return SpacePosition(**(usual | fields), memory=memory)


@pytest.mark.parametrize("kind", ["map", "inversion"])
def test_what_freezes_learning(kind):
    """Each alone: no permission, too slow, a fault, the limit. What was learned goes on acting."""
    library = control_library("double")
    lib = library.lib
    memory = (
        AngleMemory(cells=64, q_half_width=2, limit=[3.0], ratio=RATIO)
        if kind == "map"
        else DelayLine(kind=kind, ts=TS, k_pp=1.0, cells=900, q_half_width=2, limit=[3.0], ratio=RATIO)
    )
    c = CLaw(library, position_law(memory))
    theta = 0.0
    for _ in range(1500):
        theta += 0.002
        c.step(PositionInput(theta, 2.0, 0.0, theta + 1e-3 * math.sin(RATIO * theta), 2.0))
    assert c.status == 0
    usual = PositionInput(theta + 0.002, 2.0, 0.0, theta + 0.002, 2.0)
    for change, bits in [
        ({"learn": False}, 0),
        ({"omega_ref": 0.49}, 0),
        ({"omega_ref": -0.49}, 0),
        ({"alpha_ref": math.nan}, lib.CGL_STATUS_FAULT),
        ({"theta_m": 1e5}, lib.CGL_STATUS_FAULT),
        ({"theta_ref": math.inf}, lib.CGL_STATUS_FAULT),
    ]:
        before = c.cell.copy()
        c.step(usual._replace(**change))
        assert c.status == lib.CGL_STATUS_FROZEN | bits, change
        assert abs(c.state.terms.alpha) > 1e-4
        if kind == "map":
            assert np.array_equal(c.cell[:64], before[:64])
    c.step(usual._replace(omega_m=-500.0))
    assert c.status & lib.CGL_STATUS_SATURATED
    c.step(usual._replace(theta_ref=usual.theta_ref + 0.002))
    assert c.status == lib.CGL_STATUS_FROZEN  # the last output was at its limit
    c.step(usual._replace(theta_ref=usual.theta_ref + 0.004))
    assert c.status == 0


def test_a_line_shorter_than_the_filter_freezes():
    library = control_library("double")
    c = CLaw(
        library,
        position_law(
            DelayLine(kind="inversion", ts=TS, k_pp=1.0, cells=400, q_half_width=30, limit=[3.0], ratio=RATIO)
        ),
    )
    for n in range(300):
        theta = n * 2 * np.pi / 20 / RATIO
        c.step(PositionInput(theta % (2 * np.pi), 78.5, 0.0, theta % (2 * np.pi), 78.5))
    assert c.status == library.lib.CGL_STATUS_FROZEN


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("kind", ["map", "ode"])
def test_terms_sum_to_the_output(precision, kind):
    rng = np.random.default_rng(3)
    library = control_library(precision)
    for law in ("position", "speed"):
        c = CLaw(library, reference := random_law(rng, law, kind, library.real))
        for one in inputs(rng, reference.memory, library.real, 0.002):
            got, total = c.step(one), sum(c.terms.values())
            scale = reference.limit + sum(map(abs, c.terms.values()))
            assert abs(got - min(max(total, -reference.limit), reference.limit)) <= 4 * library.eps * scale


def test_the_angle_error_is_that_of_the_arctangent():
    library = control_library("double")
    rng = np.random.default_rng(8)
    c = CLaw(
        library,
        position_law(
            AngleMemory(cells=64, q_half_width=0, limit=[3.0], ratio=RATIO),
            k_theta=0.0,
            k_omega=0.0,
            k_i=0.0,
            k_v=1.0,
        ),
    )
    for theta, theta_ref in rng.uniform(-30, 30, (500, 2)):
        got = c.step(PositionInput(theta_ref, 0.0, 0.0, theta, 0.0))
        assert abs(-got - theta_tg(RATIO * theta, RATIO * theta_ref)) < 1e-12


def test_known_bounds_hold_where_the_error_never_ends():
    """Saturation of (6): sat of what is recalled, and the correction on top of it."""
    library = control_library("double")
    c = CLaw(
        library,
        position_law(
            AngleMemory(cells=32, q_half_width=0, limit=[0.7], ratio=RATIO),
            mu_alpha=40.0,
            k_omega=0.0,
            k_i=0.0,
            k_theta=0.0,
        ),
    )
    for n in range(4000):
        theta = 0.005 * n
        c.step(PositionInput(theta, 5.0, 0.0, theta, 4.9))
        assert c.state.terms.alpha <= 0.7 + 40.0 / 20 * 0.4 + 1e-12
    assert abs(c.cell[:32] - 0.7).max() < 1e-12
    assert c.state.terms.alpha > 1.4


@pytest.mark.parametrize("kind", ["map", "inversion"])
def test_the_hand_over_is_smooth(kind):
    """The ramp of learning and the fading of the integral: in no sample integral and learned part together
    change by more than the ramp's share of both, whatever the integral held."""
    library = control_library("double")
    memory = (
        AngleMemory(cells=64, q_half_width=1, limit=[5.0], ratio=RATIO)
        if kind == "map"
        else DelayLine(kind=kind, ts=TS, k_pp=1.0, cells=900, q_half_width=2, limit=[5.0], ratio=RATIO)
    )
    c = CLaw(library, position_law(memory, hand_over=True, ramp=0.5, k_i=20.0, k_omega=0.05, mu_alpha=0.5))
    omega = theta = 0.0
    learned, integrals = [], []
    for n in range(8000):
        t = n * TS
        i_q = c.step(PositionInput(2.0 * t, 2.0, 0.0, theta, omega, t >= 3.0))
        learned.append(c.state.terms.alpha)
        integrals.append(c.state.terms.integral)
        omega += TS * 30 * (i_q - 1.0 - 0.05 * omega - 0.3 * math.sin(RATIO * theta))
        theta += TS * omega
    both = np.array(learned) + np.array(integrals)
    assert integrals[2999] > 0.8
    assert abs(integrals[3501]) == 0.0
    steps = abs(np.diff(both))
    assert steps[2999:].max() < 3 * max(1.5 / 500, steps[2000:2990].max())


@pytest.mark.parametrize("ramp", [0.0, 0.5])
def test_nothing_is_handed_over_before_the_first_sample_that_learns(ramp):
    """Even where learning begins at once: until then the integral alone holds the load."""
    memory = AngleMemory(cells=64, q_half_width=1, limit=[5.0], ratio=RATIO)
    c = CLaw(control_library("double"), position_law(memory, hand_over=True, ramp=ramp, k_i=20.0))
    for n in range(100):
        c.step(PositionInput(2.0 * TS * n, 2.0, 0.0, 2.0 * TS * n - 0.01, 2.0, False))
    # the error of RATIO times 0.01 rad, times k_theta and k_i, for 100 samples
    assert c.state.terms.integral == pytest.approx(20.0 * 5.0 * RATIO * 0.01 * 100 * TS, rel=1e-6)
    assert c.state.terms.alpha == 0.0


# ---- what the laws do


def plant_run(c: CLaw, seconds: float, ts: float, learning_start: float) -> np.ndarray:
    """Section 5's mechanics with an ideal current loop: J, D, cogging of order 4 N_r, load N_T sin theta.
    Returns the errors of electrical speed."""
    J, K_t, D, N_T, N_r = 0.0733, 0.25, 0.002, 1.7201, 50
    theta_e = varying(ts, seconds)
    t = ts * np.arange(len(theta_e))
    omega_e = 15.0 + 5.0 * np.sin(2 * np.pi * t + np.sin(np.pi * t))
    alpha = np.gradient(omega_e, ts) / N_r
    theta, omega, errors = 0.0, omega_e[0] / N_r, np.zeros(len(theta_e))
    for n, (angle, speed) in enumerate(zip(theta_e / N_r, omega_e / N_r, strict=True)):
        errors[n] = N_r * (omega - speed)
        i_q = c.step(
            PositionInput(
                float(angle % (2 * np.pi)),
                speed,
                alpha[n],
                theta % (2 * np.pi),
                omega,
                n * ts >= learning_start,
            )
        )
        torque = K_t * i_q - D * omega - N_T * math.sin(theta) - 0.1766 * math.sin(4 * N_r * theta)
        omega += ts * torque / J
        theta += ts * omega
    return errors


def section_5(memory, ts) -> SpacePosition:
    return SpacePosition(
        50, 5.0, 5.0, 0.0, 0.0, 0.0, 50.0, 250.0, 0.1, 0.1, True, 1.0, 0.05, "reference", ts, 15.0, memory
    )


@pytest.mark.parametrize(("precision", "index"), [("float", "reference"), ("double", "rotor")])
@pytest.mark.parametrize("kind", ["map", "ode", "inversion"])
def test_learning_lowers_the_error_of_section_5(kind, precision, index):
    ts = 2e-4
    limit = [15.0, 1.0, 1.0]
    memory = (
        AngleMemory(cells=400, q_half_width=2, limit=limit, ratio=50)
        if kind == "map"
        else DelayLine(kind=kind, ts=ts, cells=4000, q_half_width=10, limit=limit, ratio=50)
    )
    law = dataclasses.replace(section_5(memory, ts), index=index)
    errors = plant_run(CLaw(control_library(precision), law), 7.5, ts, 2.5)
    before = np.ptp(errors[round(1.0 / ts) : round(2.5 / ts)])
    after = np.ptp(errors[round(6.0 / ts) :])
    assert after < 0.35 * before
