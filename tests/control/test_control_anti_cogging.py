"""The anti-cogging table of the C library: agreement with the reference, and what a calibration finds."""

import math

import numpy as np
import pytest
from control_library import control_library
from reference.anti_cogging import AntiCogging
from reference.limits import is_angle
from reference.motion import rounded
from reference.pi import Pi


class CAntiCogging:
    def __init__(self, library, r: AntiCogging):
        self.library, lib = library, library.lib
        pi = {"kp": r.pi.kp, "ki": r.pi.ki, "limit": r.pi.limit}
        self.config = library.new("cgl_anti_cogging_config", pi=pi, cells=r.cells, speed=r.speed,
                                  revolutions=r.revolutions, position_gain=r.position_gain,
                                  lead=r.lead)  # fmt: skip
        self.state = library.new("cgl_anti_cogging")
        self.table, pointer = library.array(np.ones(r.cells))
        assert (
            lib.cgl_anti_cogging_init(self.state, self.config, library.loop(r.pi.ts), pointer, r.cells)
            == lib.CGL_OK
        )
        self.input, self.output = library.new("cgl_law_input"), library.new("cgl_law_output")

    def calibrate(self):
        self.library.lib.cgl_anti_cogging_calibrate(self.state)

    def step(self, omega_ref, omega_m, theta_m, i_q, learn=True):
        i = self.input
        i.omega_ref, i.omega_m, i.theta_m, i.i_q, i.learn = omega_ref, omega_m, theta_m, i_q, learn
        self.library.lib.cgl_anti_cogging_step(self.state, i, self.output)
        return self.output.i_q_ref

    @property
    def calibrating(self):
        return bool(self.output.status & self.library.lib.CGL_STATUS_BUSY)

    @property
    def friction(self):
        return self.state.friction


class Motor:
    """Inertia, cogging, Coulomb friction and a constant load, in amperes; current as commanded in the step
    before."""

    def __init__(
        self, ts, b=200.0, friction=0.05, load=0.0, cogging=((6, 0.1, 0.3), (24, 0.05, 1.0)), theta=1.0
    ):
        self.ts, self.b, self.friction, self.load, self.cogging = ts, b, friction, load, cogging
        self.theta, self.omega, self.i = theta, 0.0, 0.0

    def cogs(self, theta, sine=np.sin):
        return sum([a * sine(n * theta + phase) for n, a, phase in self.cogging])

    def move(self, i, parts=2):
        self.i = i
        h = self.ts / parts
        for _ in range(parts):
            driving = i - self.cogs(self.theta, math.sin) - self.load
            if self.omega == 0 and abs(driving) <= self.friction:
                continue
            sense = math.copysign(1, self.omega or driving)
            omega = self.omega + h * self.b * (driving - sense * self.friction)
            self.omega = 0.0 if omega * sense < 0 else omega  # sticks before it turns back
            self.theta += h * self.omega

    def measured(self, real):
        return (*rounded([self.omega, self.theta % (2 * math.pi), self.i], real),)


def law(ts=2e-3, cells=256, speed=0.2, revolutions=1, limit=2.0, real=np.float64) -> AntiCogging:
    kp, ki, ts, speed, position_gain, limit, lead = rounded([1.0, 8.0, ts, speed, 5.0, limit, 3e-3], real)
    return AntiCogging(Pi(kp, ki, ts, limit), cells, speed, revolutions, position_gain, lead)


def calibrated(one, motor, real=np.float64, steps=200_000):
    one.calibrate()
    for _ in range(steps):
        omega, theta, i = motor.measured(real)
        motor.move(one.step(0.0, omega, theta, i))
        if not one.calibrating:
            return one
    raise AssertionError("the calibration does not end")


@pytest.mark.parametrize("seed", range(4))
def test_double_equals_the_reference(seed):
    """A whole calibration on the motor, with lost samples, some not to be learned from, a rotor that is held
    and pushed over cells; then a run."""
    rng = np.random.default_rng(seed)
    reference = law(
        cells=int(rng.choice([4, 61, 200])), speed=rng.uniform(4, 8), revolutions=int(rng.choice([1, 3]))
    )
    c = CAntiCogging(control_library("double"), reference)
    motor = Motor(2e-3, theta=rng.uniform(0, 6))
    c.calibrate()
    reference.calibrate()
    scale = (
        reference.pi.limit + reference.pi.kp * reference.position_gain * 2 * math.pi * reference.revolutions
    )
    after, learn, seen, lib = 0, True, 0, c.library.lib
    for n in range(30_000):
        omega, theta, i = motor.measured(float)
        if rng.random() < 0.01:
            omega, theta, i = rng.permutation([omega, rng.choice([math.nan, math.inf]), i])
        if rng.random() < 0.003:
            motor.theta += rng.uniform(-0.3, 0.3)
        omega_ref = math.nan if n % 777 == 0 else math.sin(n / 300)
        learn = rng.random() > (0.002 if learn else 0.1)
        recording = reference.calibrating
        got = c.step(omega_ref, omega, theta, i, learn)
        expected = reference.step(omega_ref, omega, theta, i, learn)
        assert abs(got - expected) <= 1e-12 * scale, n
        known = is_angle(theta) and math.isfinite(omega + (i if recording else omega_ref))
        assert c.output.status == (
            lib.CGL_STATUS_SATURATED * reference.pi.saturated
            | lib.CGL_STATUS_FAULT * (not known)
            | lib.CGL_STATUS_FROZEN * (not (recording and learn))
            | lib.CGL_STATUS_BUSY * reference.calibrating
        ), n
        seen |= c.output.status
        motor.move(got)
        after += not c.calibrating
        if after == 500:
            break
    assert after == 500
    assert seen == 15
    assert max(abs(c.table - reference.table)) <= 1e-12
    assert abs(c.friction - reference.friction) <= 1e-12


def test_single_stays_within_rounding():
    """Replayed with the float build's own measurements: a sample at a cell's edge may fall on either side,
    which moves a mean by one sample's share of the current's change within a cell; the rest is rounding of
    the mean."""
    library = control_library("float")
    reference = law(speed=0.5, real=np.float32)
    c = CAntiCogging(library, reference)
    motor = Motor(2e-3)
    c.calibrate()
    reference.calibrate()
    previous = c.output.i_q_ref
    while True:
        measured = motor.measured(np.float32)
        previous = c.step(0.0, *measured)
        reference.step(0.0, *measured)
        motor.move(previous)
        if not c.calibrating:
            break
    assert not reference.calibrating
    per_cell = 2 * math.pi / 256 / 0.5 / 2e-3
    change = 24 * 0.05 * 2 * math.pi / 256 + 0.02
    assert max(abs(c.table - reference.table)) < change / per_cell + library.eps * per_cell
    assert abs(c.friction - reference.friction) < change / per_cell / math.sqrt(256)


@pytest.mark.parametrize("load", [0.0, 0.3, -0.2])
def test_finds_friction_exactly_on_an_ideal_run(load):
    """The rotor moves as the path does, four samples a cell: friction comes out to rounding, the load stays
    out, and an entry is the mean of the cogging over its cell: smaller by sin(x) / x, x = half a cell times
    the order."""
    cells, per_cell, ts = 64, 4, 1e-3
    step = 2 * math.pi / cells / per_cell
    one = CAntiCogging(control_library("double"), law(ts=ts, cells=cells, speed=step / ts))
    one.calibrate()
    theta, sense = 1.0 + step / 2, 1
    for _ in range(10_000):
        current = 0.2 * math.sin(6 * theta + 0.4) + sense * 0.07 + load
        one.step(0.0, sense * step / ts, theta, current)
        if not one.calibrating:
            break
        sense = 1 if one.state.stage == one.library.lib.CGL_ANTI_COGGING_FORWARD else -1
        theta = (theta + sense * step) % (2 * math.pi)
    assert not one.calibrating
    assert abs(one.friction - 0.07) < 1e-12
    assert abs(one.table.mean()) < 1e-15
    fitted = 2 * np.mean(one.table * np.exp(-6j * 2 * np.pi * np.arange(cells) / cells)) * 1j
    x = 6 * math.pi / cells
    sampled = math.sin(x) / (per_cell * math.sin(x / per_cell))  # the mean of four samples, spread evenly
    assert abs(abs(fitted) - 0.2 * sampled) < 2e-3 * 0.2
    exact = 0.2 * np.sin(6 * 2 * np.pi * np.arange(cells) / cells + 0.4)
    assert np.abs(one.table - exact).max() < 0.2 * (x**2 / 6 + x / per_cell)


@pytest.mark.parametrize(("precision", "load"), [("float", 0.3), ("double", 0.0)])
def test_calibration_on_a_motor_and_the_ripple_after_it(precision, load):
    """Each harmonic of the table errs by the mean over a cell, (n pi / cells)^2 / 6, and by the current
    that accelerates: s^2 / (s^2 + b kp s + b ki) of it at s = j n speed, with the loop's other poles far
    above."""
    library = control_library(precision)
    speed, cells = 0.2, 256
    motor = Motor(2e-3, load=load)
    one = calibrated(
        CAntiCogging(library, law(speed=speed, cells=cells, real=library.real)), motor, library.real
    )
    tolerance = 0.0
    for n, amplitude, _ in motor.cogging:
        s = 1j * n * speed
        tolerance += amplitude * (
            (n * math.pi / cells) ** 2 / 6 + abs(s**2 / (s**2 + 200 * 1.0 * s + 200 * 13.0))
        )
    error = one.table - motor.cogs(2 * np.pi * np.arange(cells) / cells)
    assert abs(error).max() < tolerance + 0.002
    assert abs(one.friction - motor.friction) < 5e-4
    assert abs(one.table.mean()) < 1e-6

    def ripple(table):
        run = CAntiCogging(library, law(real=library.real))
        run.table[:] = table
        m = Motor(2e-3)
        speeds = []
        for _ in range(4000):
            m.move(run.step(1.0, *m.measured(library.real)))
            speeds.append(m.omega)
        return np.std(speeds[2000:])

    assert ripple(one.table) < 0.15 * ripple(0)


@pytest.mark.parametrize("precision", ["float", "double"])
def test_waits_and_says_so_while_an_input_is_not_finite(precision):
    library = control_library(precision)
    one = CAntiCogging(library, law(real=library.real))
    one.calibrate()
    busy = library.lib.CGL_STATUS_BUSY
    for bad in ((math.nan, 0.1, 0.1), (0.1, math.inf, 0.1), (0.1, 0.1, math.nan), (0.1, 1e6, 0.1)):
        assert one.step(0.0, *bad) == 0.0
        assert one.output.status == busy | library.lib.CGL_STATUS_FAULT
    one.step(0.0, 0.1, 0.1, 0.1)
    assert one.output.status & ~library.lib.CGL_STATUS_SATURATED == busy


@pytest.mark.parametrize("when", [100, 20_000])
def test_reset_drops_half_a_table_and_keeps_a_whole_one(when):
    library = control_library("double")
    one = CAntiCogging(library, law(speed=1.0))
    motor = Motor(2e-3)
    one.calibrate()
    for _ in range(when):
        motor.move(one.step(0.0, *motor.measured(float)))
    complete = not one.calibrating
    library.lib.cgl_anti_cogging_reset(one.state)
    one.step(0.0, 0.0, 0.0, 0.0)
    assert not one.calibrating
    assert one.table.any() == complete
    assert complete == (when > 10_000)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("revolutions", [1, 2])
def test_what_is_not_to_be_learned_is_recorded_when_the_rotor_comes_there_again(precision, revolutions):
    """A wrong current for a while in each direction: the table is as without it, a revolution each later."""
    library = control_library(precision)
    tables, lengths = [], []
    for spoils in (False, True):
        one = CAntiCogging(library, law(speed=2.0, real=library.real, revolutions=revolutions))
        motor = Motor(2e-3)
        one.calibrate()
        for n in range(30_000):
            omega, theta, i = motor.measured(library.real)
            spoilt = spoils and (1000 < n < 1150 or 0 < n - 2000 * (1 + revolutions) < 150)
            motor.move(one.step(0.0, omega, theta, 50.0 if spoilt else i, not spoilt))
            frozen = bool(one.output.status & library.lib.CGL_STATUS_FROZEN)
            assert frozen == (spoilt and one.calibrating)
            if not one.calibrating:
                break
        tables.append(one.table.copy())
        lengths.append(n)
    turn = 2 * math.pi / 2.0 / 2e-3
    assert lengths[1] - lengths[0] == pytest.approx(2 * turn, rel=0.02)
    assert np.max(np.abs(tables[1] - tables[0])) < 0.01
    assert np.max(np.abs(tables[0])) > 0.1


def test_a_calibration_that_never_may_learn_does_not_end_and_writes_nothing():
    library = control_library("float")
    one, motor = CAntiCogging(library, law(speed=2.0, real=np.float32)), Motor(2e-3)
    one.calibrate()
    for _ in range(8000):  # five turns
        motor.move(one.step(0.0, *motor.measured(np.float32), False))
    assert one.calibrating
    assert not one.table.any()
    assert abs(motor.omega) > 1.5  # it turns on
    for _ in range(8000):
        motor.move(one.step(0.0, *motor.measured(np.float32)))
    assert not one.calibrating
    assert np.max(np.abs(one.table)) > 0.1


def test_friction_stays_within_a_limit_that_is_lowered_during_a_calibration():
    library = control_library("double")
    one, motor = CAntiCogging(library, law(speed=2.0)), Motor(2e-3)
    one.calibrate()
    while one.state.stage != library.lib.CGL_ANTI_COGGING_BACKWARD:
        motor.move(one.step(0.0, *motor.measured(float)))
    config = library.new("cgl_anti_cogging_config")
    library.ffi.memmove(
        config, library.ffi.addressof(one.state.config), library.ffi.sizeof("cgl_anti_cogging_config")
    )
    config.pi.limit = limit = 1e-3
    assert library.lib.cgl_anti_cogging_retune(one.state, config) == library.lib.CGL_OK
    theta, omega, i_q = motor.theta, -2.0, -2.0  # the rotor is driven back
    for _ in range(20_000):
        theta += omega * 2e-3
        one.step(0.0, omega, theta, i_q)
    assert not one.calibrating
    assert 0.0 < one.state.friction <= limit


@pytest.mark.parametrize("omega_ref", [0.0, 6.28, -60.0])
def test_a_calibration_in_a_drive_ends_whatever_the_reference_is(omega_ref):
    """The rotor stands between two counts for longer than the reference would turn it by the stuck angle."""
    counts = 400
    library = control_library("float")
    lib = library.lib
    one, motor = CAntiCogging(library, law(ts=1e-3, cells=64, speed=0.5, real=np.float32)), Motor(1e-3)
    config = library.new(
        "cgl_drive_config", pole_pairs=4, divider=2, foreign=True,
        monitor={"omega_max": 200.0, "angle_step": 2 * math.pi / counts, "stuck_angle": 0.5, "bridge": 5e-3,
                 "hold": 1e-2},
        quality={"span": 2 * math.pi, "longest": 60.0, "outlier": 3.0},
    )  # fmt: skip
    drive, out = library.new("cgl_drive"), library.new("cgl_drive_output")
    assert lib.cgl_drive_init(drive, config, 5e-4) == lib.CGL_OK
    one.calibrate()
    reference = library.new("cgl_reference", omega_ref=omega_ref, learn=True)
    now = library.new("cgl_measurement")
    inputs, command = (library.ffi.addressof(drive[0], name) for name in ("in", "command"))
    seen = 0
    for n in range(70_000):
        theta = math.floor(motor.theta / (2 * math.pi) * counts) * 2 * math.pi / counts
        now.theta_m, now.omega_m = theta % (2 * math.pi), motor.omega
        if lib.cgl_drive_measure(drive, now, reference):
            lib.cgl_anti_cogging_step(one.state, inputs, command)
        lib.cgl_drive_actuate(drive, out)
        seen |= out.status if n > 1 else 0  # before, the guard knows of no calibration
        if n % 2:
            motor.move(out.i_q_ref)
        if n > 4 and not out.status & lib.CGL_STATUS_BUSY:
            break
    assert n < 65_000
    assert not seen & (lib.CGL_STATUS_OFF | lib.CGL_STATUS_OUTLIER | lib.CGL_STATUS_FROZEN)
    angle = 2 * math.pi * np.arange(64) / 64
    assert np.max(np.abs(one.table - motor.cogs(angle))) < 0.05
