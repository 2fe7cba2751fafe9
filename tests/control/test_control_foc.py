"""Field-oriented current control of the C library."""

import cmath
import dataclasses
import math

import numpy as np
import pytest
from control_library import control_library
from reference.foc import Foc
from reference.motion import rounded
from reference.transform import clarke, park

STEPS = 800


class CFoc:
    def __init__(self, library, reference: Foc):
        self.library = library
        fields = dataclasses.asdict(reference)
        fields = {name: value for name, value in fields.items() if name not in ("ts", "integral")}
        self.config = library.new("cgl_foc_config", **fields)
        self.state = library.new("cgl_foc")
        self.input, self.out = library.new("cgl_foc_input"), library.new("cgl_foc_output")
        assert library.lib.cgl_foc_init(self.state, self.config, reference.ts) == library.lib.CGL_OK

    def step(self, i_abc, theta_e, omega_e, u_dc, i_ref: complex):
        into = self.input
        into.i_abc, into.theta_e, into.omega_e, into.u_dc = i_abc, theta_e, omega_e, u_dc
        into.i_d_ref, into.i_q_ref = i_ref.real, i_ref.imag
        self.library.lib.cgl_foc_step(self.state, into, self.out)
        return self.out


def random_foc(rng, real, phases: int = 3) -> Foc:
    def draw(*ranges):
        return rounded([rng.uniform(*r) for r in ranges], real)

    kp_d, kp_q, ki_d, ki_q = draw((1, 30), (1, 30), (10, 3000), (10, 3000))
    ts, limit, advance, L_d, L_q, psi_f = draw(
        (5e-5, 1e-4), (1, 5), (0, 2), (1e-3, 3e-2), (1e-3, 3e-2), (0.01, 0.1)
    )
    return Foc(kp_d, ki_d, kp_q, ki_q, ts, limit, advance, bool(rng.integers(2)), L_d, L_q, psi_f, phases)


def random_inputs(rng, real, u_dc, phases=3):
    """Currents that follow a random reference half-way, so that some steps saturate and some do not."""
    omega = np.repeat(rng.uniform(-600, 600, STEPS // 50), 50)
    theta = (rng.uniform(0, 6) + np.cumsum(omega) * 7e-5) % (2 * math.pi)
    refs = np.repeat(rng.normal(0, 2, (STEPS // 50, 2)), 50, axis=0)
    i = np.zeros((STEPS, 2))
    for n, noise in enumerate(rng.normal(0, 0.03, (STEPS, 2))):
        i[n] = 0.95 * i[n - 1] + 0.05 * refs[n] + noise  # from zero
    apart = 2 * np.pi / 3 if phases == 3 else np.pi / 2
    along = theta[:, None] - apart * np.arange(3)
    waves = i[:, :1] * np.cos(along) - i[:, 1:] * np.sin(along)
    if phases == 2:
        waves[:, 2] = np.nan  # is not measured
    columns = [rounded(x, real).tolist() for x in (waves, theta, omega, np.full(STEPS, u_dc), refs)]
    return [(*others, complex(*i_ref)) for *others, i_ref in zip(*columns, strict=True)]


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("phases", [3, 2])
@pytest.mark.parametrize("seed", range(5))
def test_equals_the_reference(precision, phases, seed):
    """In single, the integrals walk at random as in the PI (see there), by ki ts / kp of a step; back
    calculation pulls the walk back. The voltage is scaled by kp times currents and the speed voltage."""
    rng = np.random.default_rng(seed)
    library = control_library(precision)
    reference = random_foc(rng, library.real, phases)
    law = CFoc(library, reference)
    u_dc = rng.uniform(10, 60)
    scale = u_dc + (reference.kp_d + reference.kp_q + 600 * (reference.L_d + reference.L_q)) * 5
    share = max(reference.ki_d / reference.kp_d, reference.ki_q / reference.kp_q) * reference.ts
    saturated = 0
    for n, inputs in enumerate(random_inputs(rng, library.real, u_dc, phases)):
        bound = 1e-12 if precision == "double" else library.eps * (8 + 2 * share * math.sqrt(n))
        got, expected = law.step(*inputs), reference.step(*inputs)
        assert abs(complex(got.i_d, got.i_q) - expected.i_dq) <= bound * 10
        assert abs(complex(got.u_d, got.u_q) - expected.u_dq) <= bound * scale
        assert max(abs(np.array(list(got.duty)) - expected.duty)) <= bound * scale / u_dc
        assert abs(complex(law.state.integral_d, law.state.integral_q) - reference.integral) <= bound * scale
        if precision == "double":
            assert got.status == (library.lib.CGL_STATUS_SATURATED if expected.saturated else 0)
        saturated += expected.saturated
    assert 0 < saturated < STEPS


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize(
    "field, value",
    [(f, v) for f in ("i_a", "theta_e", "omega_e", "u_dc") for v in (math.nan, math.inf, -math.inf)]
    + [("u_dc", 0.0), ("u_dc", -1.0), ("theta_e", 1e5), ("omega_e", 1e30), ("i_a", 3e38)],
)
def test_a_bad_measurement_gives_zero_voltage_and_holds_the_integrals(precision, field, value):
    library = control_library(precision)
    law = CFoc(library, Foc(10.0, 1000.0, 10.0, 1000.0, 1e-4, 5.0, 1.5, True, 1e-3, 1e-3, 0.01))
    good = {"i_a": 0.1, "theta_e": 1.0, "omega_e": 100.0, "u_dc": 48.0}
    for _ in range(10):
        law.step([0.1, 0.0, -0.1], 1.0, 100.0, 48.0, 1 + 1j)
    before = law.state.integral_d, law.state.integral_q
    bad = good | {field: value}
    out = law.step([bad["i_a"], 0.0, -0.1], bad["theta_e"], bad["omega_e"], bad["u_dc"], 1 + 1j)
    if (field, value) == ("i_a", 3e38) and precision == "double":
        assert out.status == library.lib.CGL_STATUS_SATURATED  # finite, and far within a double's range
        return
    assert list(out.duty) == [0.5, 0.5, 0.5]
    assert out.status == library.lib.CGL_STATUS_FAULT
    assert (law.state.integral_d, law.state.integral_q) == before


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("i_ref", [3e30 + 4e30j, -1e37 + 0j, complex(3e-3, 4e37), 30 - 40j])
def test_a_reference_of_any_size_is_shortened_to_the_limit(precision, i_ref):
    """Read from u = kp (reference - 0), with a bus that never limits."""
    library = control_library(precision)
    law = CFoc(library, Foc(2.0, 0.0, 2.0, 0.0, 1e-4, 5.0, 0.0, False, 0.0, 0.0, 0.0))
    out = law.step([0.0, 0.0, 0.0], 0.0, 0.0, 1000.0, i_ref)
    assert abs(complex(out.u_d, out.u_q) - 10.0 * i_ref / abs(i_ref)) < 30 * library.eps
    assert out.status == library.lib.CGL_STATUS_SATURATED
    assert abs(complex(out.i_d_ref, out.i_q_ref) - 5.0 * i_ref / abs(i_ref)) < 30 * library.eps


@pytest.mark.parametrize("precision", ["float", "double"])
def test_shortening_lengthens_no_component(precision):
    """By no rounding either, which is one in some hundred cases of a small i_q beside an i_d at the limit."""
    library, rng = control_library(precision), np.random.default_rng(0)
    law = CFoc(library, Foc(2.0, 10.0, 2.0, 10.0, 1e-4, 5.0, 0.0, False, 0.0, 0.0, 0.0))
    for share in 10 ** rng.uniform(-8, 0, 3000):
        limit = float(library.real(share + rng.uniform(0, 50)))
        law.state.config.current_limit = limit
        wanted = limit, float(library.real(share * limit))
        for d, q in (wanted, wanted[::-1]):
            out = law.step([0.0, 0.0, 0.0], 0.0, 0.0, 1000.0, complex(d, q))
            assert 0 <= out.i_d_ref <= d and 0 <= out.i_q_ref <= q


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("limit", [5.0, 3.3, 0.1, 2e-20])
@pytest.mark.parametrize("angle", [1, 1j, -1, -1j])
def test_a_reference_at_the_limit_is_not_saturated(precision, limit, angle):
    """So a law with the same limit says for itself when it is there."""
    library = control_library(precision)
    limit = float(library.real(limit))
    law = CFoc(library, Foc(2.0, 10.0, 2.0, 10.0, 1e-4, limit, 0.0, False, 0.0, 0.0, 0.0))
    assert law.step([0.0, 0.0, 0.0], 0.0, 0.0, 1000.0, limit * angle).status == 0
    more = float(np.nextafter(library.real(limit), library.real(1e9))) * (1 + 4 * library.eps)
    out = law.step([0.0, 0.0, 0.0], 0.0, 0.0, 1000.0, more * angle)
    assert out.status == library.lib.CGL_STATUS_SATURATED


@pytest.mark.parametrize("precision", ["float", "double"])
def test_two_phases_reach_the_whole_bus_in_any_direction(precision):
    """Each H-bridge gives u_dc (2 duty - 1): a vector as long as the bus, no longer."""
    library = control_library(precision)
    law = CFoc(library, Foc(1.0, 0.0, 1.0, 0.0, 1e-4, 1000.0, 0.0, False, 0.0, 0.0, 0.0, phases=2))
    for theta in np.linspace(0, 6.2, 50).astype(library.real).astype(float):
        out = law.step([0.0, 0.0, math.nan], float(theta), 0.0, 24.0, 30 + 40j)
        u = complex(*(24.0 * (2 * out.duty[x] - 1) for x in range(2)))
        assert abs(u - 24.0 * (0.6 + 0.8j) * cmath.exp(1j * theta)) < 24 * 20 * library.eps
        assert out.duty[2] == 0.5
        assert out.status == library.lib.CGL_STATUS_SATURATED
    assert law.step([0.0, math.nan, 0.0], 0.0, 0.0, 24.0, 1j).status == library.lib.CGL_STATUS_FAULT


@pytest.mark.parametrize("precision", ["float", "double"])
def test_no_phases_given_means_three(precision):
    """A config from before there were two."""
    library = control_library(precision)
    rng = np.random.default_rng(11)
    first = random_foc(rng, library.real)
    a, b = CFoc(library, first), CFoc(library, dataclasses.replace(first, phases=0))
    for inputs in random_inputs(rng, library.real, 30.0):
        one, other = a.step(*inputs), b.step(*inputs)
        assert list(one.duty) == list(other.duty)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_holds_the_current_of_a_motor_and_recovers_from_a_sagging_bus(precision):
    """R-L motor at speed, one period of computation delay; the bus is too low for a while, then returns."""
    library = control_library(precision)
    R, L, psi, ts, omega = 0.5, 1e-3, 0.02, 1e-4, 500.0
    bandwidth = 2 * math.pi * 500
    law = CFoc(
        library,
        Foc(bandwidth * L, bandwidth * R, bandwidth * L, bandwidth * R, ts, 20.0, 1.5, True, L, L, psi),
    )
    i, theta, u = 0j, 0.0, 0j
    history = []
    for n in range(3000):
        abc = [(i * cmath.exp(1j * (theta - 2 * math.pi / 3 * x))).real for x in range(3)]
        u_dc = 5.0 if 1000 <= n < 2000 else 48.0
        out = law.step(abc, theta, omega, u_dc, 0 + 4j)
        acts, u = u, clarke(np.array(list(out.duty))) * u_dc  # the voltage acts one period later
        for _ in range(10):
            theta += omega * ts / 10
            i += ts / 10 / L * (park(acts, theta - omega * ts / 20) - R * i - 1j * omega * (L * i + psi))
        theta %= 2 * math.pi
        history.append(i)
    assert abs(history[999] - 4j) < 0.02
    assert abs(history[1999] - 4j) > 1
    assert max(abs(h) for h in history[2000:]) < 1.3 * max(4, abs(history[1999]))
    assert abs(history[2100] - 4j) < 0.02


def test_rounding_holds_an_integral_only_where_the_current_is_right():
    """Terms of less than half of what a float tells apart are lost: at 20 V, of a current error of 4 mA here."""
    library, ts = control_library("float"), 50e-6
    R, L, bandwidth = 5.0, 5e-4, 20.0  # of a loop that is slower than anybody would want it
    ki = bandwidth * R
    law = CFoc(library, Foc(bandwidth * L, ki, bandwidth * L, ki, ts, 20.0, 0.5, False, 0.0, 0.0, 0.0))
    stalls = 2.0**-24 * 20.0 / (ki * ts)
    i = np.zeros(2)
    for _ in range(40_000):
        abc = [float(i @ [math.cos(x), math.sin(x)]) for x in (0.0, 2 * math.pi / 3, -2 * math.pi / 3)]
        out = law.step(abc, 0.0, 0.0, 48.0, 0 + 4j)
        u = clarke(np.array(list(out.duty))) * 48.0
        i += ts / L * (np.array([u.real, u.imag]) - R * i)
    assert stalls < 1e-3
    assert abs(i[1] - 4.0) < stalls + 2e-6  # the duty cycle's own rounding


@pytest.mark.parametrize("precision", ["float", "double"])
def test_other_gains_keep_the_integrals(precision):
    library = control_library(precision)
    law = CFoc(library, Foc(2.0, 100.0, 2.0, 100.0, 1e-4, 5.0, 0.0, False, 0.0, 0.0, 0.0))
    for _ in range(20):
        law.step([0.0] * 3, 0.0, 0.0, 100.0, 1 + 2j)
    before = law.state.integral_d, law.state.integral_q
    law.config.kp_d, law.config.ki_q = 1.0, 0.0
    assert library.lib.cgl_foc_retune(law.state, law.config) == library.lib.CGL_OK
    assert (law.state.integral_d, law.state.integral_q) == before != (0.0, 0.0)
    u_d = law.step([0.0] * 3, 0.0, 0.0, 100.0, 1 + 2j).u_d
    assert u_d == pytest.approx(1.0 * 1.0 + before[0], rel=10 * library.eps)
    assert law.state.integral_q == before[1]
