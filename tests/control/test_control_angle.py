"""Sine, cosine, transforms and modulation of the C library."""

import math

import numpy as np
import pytest
from control_library import ControlLibrary, control_library
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import modulation
from reference.transform import clarke, clarke_inverse, park, park_inverse

ANGLE_MAX = 1.0e5


@pytest.fixture(params=["float", "double"])
def library(request) -> ControlLibrary:
    return control_library(request.param)


def pair(library, function, *arguments):
    out = library.ffi.new("cgl_real[2]")
    function(*arguments, out, out + 1)
    return out[0], out[1]


def test_sine_and_cosine_over_the_whole_range(library):
    """All binades of the range, dense around the corners of the quadrants, where the reduction is worst."""
    rng = np.random.default_rng(1)
    corners = np.arange(-63000, 63000, 41) * (np.pi / 4)
    theta = np.concatenate(
        [
            np.linspace(-ANGLE_MAX, ANGLE_MAX, 20001)[1:-1],
            rng.choice([-1, 1], 20000) * 10.0 ** rng.uniform(-30, 4.9999, 20000),
            corners,
            np.nextafter(corners.astype(library.real), library.real(0)),
        ]
    ).astype(library.real)
    got = np.array([pair(library, library.lib.cgl_sincos, t) for t in theta.tolist()])
    exact = theta.astype(np.longdouble)
    error = np.maximum(abs(got[:, 0] - np.sin(exact)), abs(got[:, 1] - np.cos(exact)))
    assert error.max() < (1e-15 if library.real is np.float64 else 1.5e-7)
    assert abs(got).max() <= 1 + library.eps


@pytest.mark.parametrize("theta", [math.nan, math.inf, -math.inf, ANGLE_MAX, -ANGLE_MAX, 1e30])
def test_no_angle_gives_the_zero_angle(library, theta):
    assert pair(library, library.lib.cgl_sincos, theta) == (0.0, 1.0)


@settings(deadline=None, max_examples=100)
@given(
    x=st.floats(-1e9, 1e9, exclude_min=True, exclude_max=True), precision=st.sampled_from(["float", "double"])
)
def test_fraction_is_within_zero_and_one(x, precision):
    library = control_library(precision)
    x = float(library.real(x))
    got = library.lib.cgl_fraction(x)
    assert 0 <= got < 1
    assert abs((got - x) - round(got - x)) <= library.eps / 2


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf, 1e9, -1e9, 1e38])
def test_fraction_of_no_plausible_number_is_zero(library, x):
    assert library.lib.cgl_fraction(x) == 0.0


def test_transforms_equal_their_complex_form(library):
    rng = np.random.default_rng(2)
    lib, ffi = library.lib, library.ffi
    for _ in range(500):
        abc = rng.uniform(-5, 5, 3).astype(library.real).astype(float)
        theta = float(library.real(rng.uniform(-7, 7)))
        bound = 20 * library.eps
        alpha_beta = complex(*pair(library, lib.cgl_clarke, ffi.new("cgl_real[3]", abc.tolist())))
        assert abs(alpha_beta - clarke(abc)) < bound
        sine, cosine = pair(library, lib.cgl_sincos, theta)
        dq = complex(*pair(library, lib.cgl_park, alpha_beta.real, alpha_beta.imag, sine, cosine))
        assert abs(dq - park(clarke(abc), theta)) < bound
        back = complex(*pair(library, lib.cgl_park_inverse, dq.real, dq.imag, sine, cosine))
        assert abs(back - alpha_beta) < bound
        assert abs(back - park_inverse(dq, theta)) < bound
        phases = ffi.new("cgl_real[3]")
        lib.cgl_clarke_inverse(alpha_beta.real, alpha_beta.imag, phases)
        assert max(abs(np.array(list(phases)) - clarke_inverse(clarke(abc)))) < bound
        assert max(abs(np.array(list(phases)) - (abc - abc.mean()))) < bound  # without the zero sequence


def duties(library, u: complex, u_dc: float) -> np.ndarray:
    out = library.ffi.new("cgl_real[3]")
    library.lib.cgl_modulate(u.real, u.imag, u_dc, out)
    return np.array(list(out))


@settings(deadline=None, max_examples=100)
@given(
    length=st.floats(0, 3),
    angle=st.floats(-math.pi, math.pi),
    u_dc=st.floats(1, 800),
    precision=st.sampled_from(["float", "double"]),
)
def test_modulation_equals_the_sector_form_and_realises_the_voltage(length, angle, u_dc, precision):
    library = control_library(precision)
    u_dc = float(library.real(u_dc))
    u = length * u_dc / math.sqrt(3) * complex(math.cos(angle), math.sin(angle))
    u = complex(library.real(u.real), library.real(u.imag))
    duty = duties(library, u, u_dc)
    assert max(abs(duty - modulation.modulate(u, u_dc))) < 12 * library.eps * max(1, length)
    assert duty.min() >= 0 and duty.max() <= 1
    if abs(u) <= u_dc / math.sqrt(3):
        assert abs(clarke(duty) * u_dc - u) < 8 * library.eps * u_dc
        assert abs(duty.max() + duty.min() - 1) < 4 * library.eps  # centred


@pytest.mark.parametrize(
    ("u", "u_dc"),
    [(1 + 1j, 0.0), (1 + 1j, -10.0), (1 + 1j, math.nan), (1 + 1j, math.inf), (complex(math.nan, 0), 10.0)],
)
def test_modulation_without_sense_is_zero_voltage(library, u, u_dc):
    assert duties(library, u, u_dc).tolist() == [0.5, 0.5, 0.5]


@pytest.mark.parametrize("u", [1e30 + 0j, complex(0, -3e38), complex(-1e38, 1e38)])
def test_modulation_of_any_voltage_stays_a_duty_cycle(library, u):
    duty = duties(library, u, 1e-30)
    assert duty.min() >= 0 and duty.max() <= 1
