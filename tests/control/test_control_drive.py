"""The whole controller of a drive in the C library: measurements, law, current loop."""

import math

import numpy as np
import pytest
from control_library import control_library

TS = 1e-4
PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
FOC = {
    "kp_d": 2.0, "ki_d": 800.0, "kp_q": 2.0, "ki_q": 800.0, "current_limit": 5.0, "advance": 1.5,
    "decoupling": True, "L_d": 1e-3, "L_q": 1e-3, "psi_f": 0.01, "phases": 3,
}  # fmt: skip
NO_INTEGRAL = FOC | {"ki_d": 0.0, "ki_q": 0.0}  # the currents of these tests don't answer
MONITOR = {
    "omega_max": 500.0, "speed_window": 2e-3, "stuck_angle": 0.5, "current_max": 10.0, "current_sum": 2.5,
    "bridge": 5e-3, "hold": 1e-2, "phases": 3,
}  # fmt: skip
QUALITY = {"span": 2 * math.pi, "longest": 60.0}
CONFIG = {"pole_pairs": 4, "divider": 10, "foc": FOC, "monitor": MONITOR, "quality": QUALITY}


class Controller:
    """The drive's tick with a law that asks for a constant current."""

    def __init__(self, precision, law=1.0, **changes):
        self.library = control_library(precision)
        self.lib = self.library.lib
        self.config = self.library.new("cgl_drive_config", **{**CONFIG, **changes})
        self.drive = self.library.new("cgl_drive")
        assert self.lib.cgl_drive_init(self.drive, self.config, TS) == self.lib.CGL_OK
        self.out = self.library.new("cgl_drive_output")
        self.law, self.theta, self.omega, self.busy = law, 0.5, 50.0, 0
        self.inputs: list[dict[str, float]] = []

    def tick(self, learn=True, omega_ref=50.0, i_d_ref=0.0, torque=False, i_q_ref=0.0, **measured):
        self.theta = (self.theta + self.omega * TS) % (2 * math.pi)
        now = {"i_abc": [0.2, -0.1, -0.1], "theta_m": self.theta, "omega_m": self.omega, "u_dc": 24.0}
        now |= measured
        reference = self.library.new(
            "cgl_reference", theta_ref=0.3, omega_ref=omega_ref, alpha_ref=7.0, i_d_ref=i_d_ref, learn=learn,
            torque=torque, i_q_ref=i_q_ref,
        )  # fmt: skip
        measurement = self.library.new("cgl_measurement", **now)
        if self.lib.cgl_drive_measure(self.drive, measurement, reference):
            law_input = getattr(self.drive, "in")
            names = ("theta_ref", "omega_ref", "alpha_ref", "theta_m", "omega_m", "i_q", "learn", "off")
            names += ("torque", "i_q_ref")
            self.inputs.append({name: getattr(law_input, name) for name in names})
            self.drive.command.i_q_ref = 0.0 if law_input.off else self.law
            self.drive.command.status = self.busy
        self.lib.cgl_drive_actuate(self.drive, self.out)
        return self.out

    def ticks(self, count, **changes):
        for _ in range(count):
            self.tick(**changes)
        return self.out

    def has(self, *names) -> bool:
        return all(self.out.status & getattr(self.lib, f"CGL_STATUS_{name}") for name in names)


@PRECISIONS
def test_the_law_is_due_at_every_tenth_period_from_the_first(precision):
    controller = Controller(precision)
    for n in range(1, 40):
        controller.tick()
        assert len(controller.inputs) == (n + 9) // 10
    controller.lib.cgl_drive_reset(controller.drive)
    controller.tick()
    assert len(controller.inputs) == 5


@PRECISIONS
def test_the_law_gets_the_reference_and_what_was_measured(precision):
    controller = Controller(precision)
    controller.ticks(11)
    now = controller.inputs[-1]
    assert now["theta_ref"] == pytest.approx(0.3)
    assert (now["omega_ref"], now["alpha_ref"], now["omega_m"]) == (50, 7, 50)
    assert now["theta_m"] == pytest.approx(controller.theta)
    assert now["i_q"] == pytest.approx(controller.drive.i_q, abs=0.1)
    assert now["i_q"] != 0
    assert (now["learn"], now["off"]) == (True, False)


def states(controller) -> list[bytes]:
    ffi, drive = controller.library.ffi, controller.drive
    return [bytes(ffi.buffer(ffi.addressof(drive, part))) for part in ("quality", "guard")]


@PRECISIONS
def test_in_torque_mode_references_follow_the_rotor_and_nothing_is_judged(precision):
    """A speed of 50 rad/s is no error beside a reference of -300, and a rotor held still is not stuck."""
    controller = Controller(precision, foc=NO_INTEGRAL)
    controller.ticks(3000)
    before = states(controller)
    controller.ticks(20, torque=True, i_q_ref=0.4, omega_ref=-300.0)
    now = controller.inputs[-1]
    assert (now["theta_ref"], now["omega_ref"], now["alpha_ref"]) == (now["theta_m"], now["omega_m"], 0)
    assert (now["torque"], now["learn"], now["i_q_ref"]) == (True, False, pytest.approx(0.4))
    controller.omega = 0.0
    controller.ticks(5000, torque=True, i_q_ref=0.4, omega_ref=-300.0)
    assert controller.out.status == 0
    assert states(controller) == before
    controller.law = -5.0
    controller.ticks(5000, omega_ref=-300.0)
    assert controller.has("ANGLE_STUCK")


@PRECISIONS
def test_the_current_loop_is_that_of_foc(precision):
    """Bit for bit what cgl_foc_step gives with the electrical angle and speed."""
    controller, rng = Controller(precision), np.random.default_rng(3)
    library, lib = controller.library, controller.lib
    foc, out = library.new("cgl_foc"), library.new("cgl_foc_output")
    config = library.new("cgl_foc_config", **FOC)
    lib.cgl_foc_init(foc, config, TS)
    for _ in range(200):
        i = [float(x) for x in rng.normal(0, 0.5, 3) - np.array([0, 0, 0.1])]
        got = controller.tick(i_abc=i, i_d_ref=-0.5)
        real = library.real
        inputs = library.new(
            "cgl_foc_input", i_abc=i, theta_e=float(real(4) * real(controller.theta)), omega_e=200.0,
            u_dc=24.0, i_d_ref=-0.5, i_q_ref=1.0,
        )  # fmt: skip
        lib.cgl_foc_step(foc, inputs, out)
        assert list(got.duty) == list(out.duty)
        assert (got.i_d, got.i_q, got.u_d, got.u_q) == (out.i_d, out.i_q, out.u_d, out.u_q)
        assert (got.i_d_ref, got.i_q_ref) == (-0.5, 1.0)


@PRECISIONS
def test_a_safe_output_is_no_voltage_and_starts_anew(precision):
    controller = Controller(precision)
    controller.ticks(300)
    assert controller.drive.foc.integral_q != 0
    out = controller.tick(u_dc=math.nan)
    assert list(out.duty) == [0.5] * 3
    assert (out.u_d, out.u_q, out.i_q_ref) == (0, 0, 0)
    assert controller.has("FAULT", "BUS", "OFF")
    assert (controller.drive.foc.integral_d, controller.drive.foc.integral_q) == (0, 0)
    controller.ticks(100)
    assert list(controller.out.duty) == [0.5] * 3
    assert controller.inputs[-1]["off"]
    controller.ticks(20)
    assert controller.out.status == 0
    assert controller.out.i_q_ref == 1
    assert not controller.inputs[-1]["off"]


@PRECISIONS
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    "law, changes, status, stuck",
    [
        (4.9, {}, 0, True),  # somebody's own law, which says nothing
        (4.0, {}, 0, False),
        (4.0, {}, 1, True),  # the law's own limit is lower
        (-4.9, {}, 1, False),  # full current the other way
        (7.0, {}, 0, True),  # cut to 5 A
        (2.0, {"foreign": True, "foc": {}, "monitor": MONITOR | {"phases": 0}}, 0, False),
        (2.0, {"foreign": True, "foc": {}, "monitor": MONITOR | {"phases": 0}}, 1, True),
    ],
)
def test_a_rotor_at_rest_is_stuck_only_under_full_current_the_way_it_is_asked(
    precision, law, changes, status, stuck, sign
):
    controller = Controller(precision, law=sign * law, **({"foc": NO_INTEGRAL} | changes))
    controller.omega, controller.busy, safe = 0.0, status, []
    for _ in range(1000):
        controller.tick(omega_ref=sign * 50.0)
        safe.append(controller.has("ANGLE_STUCK", "OFF"))
    assert any(safe) == stuck


@PRECISIONS
def test_full_voltage_is_all_that_a_drive_can_do(precision):
    controller = Controller(precision, law=1.0)
    controller.omega, safe = 0.0, []
    for _ in range(1000):  # 1 A that does not come: the integral rises to the bus voltage
        controller.tick(omega_ref=50.0, i_abc=[0.0, 0.0, 0.0])
        safe.append(controller.has("ANGLE_STUCK", "OFF"))
    assert any(safe)
    assert not any(safe[:100])


@PRECISIONS
def test_a_safe_period_between_two_steps_of_the_law_turns_it_off_once(precision):
    controller = Controller(precision, monitor=MONITOR | {"hold": 0.0})
    controller.ticks(13)
    controller.tick(i_abc=[math.nan, 0.0, 0.0])
    assert controller.tick().i_q_ref == 0  # until the law speaks again
    controller.ticks(6)
    controller.tick()
    assert controller.inputs[-1]["off"]
    assert not controller.inputs[-1]["learn"]
    controller.ticks(10)
    assert not controller.inputs[-1]["off"]
    assert controller.inputs[-1]["learn"]


@PRECISIONS
@pytest.mark.parametrize("anyway", [False, True])
def test_learning_waits_while_the_current_loop_lacks_voltage(precision, anyway):
    controller = Controller(precision, foc=NO_INTEGRAL, learn_saturated=anyway)
    controller.ticks(25)
    assert [i["learn"] for i in controller.inputs] == [True, True, True]
    controller.tick(u_dc=0.5)  # in one period of the law's ten
    assert controller.has("SATURATED")
    controller.ticks(24)
    assert [i["learn"] for i in controller.inputs] == [True, True, True, anyway, True]


@PRECISIONS
def test_learning_waits_where_the_reference_forbids_or_the_angle_is_shifted(precision):
    controller = Controller(precision, foc=NO_INTEGRAL)
    controller.ticks(11, learn=False)
    assert [i["learn"] for i in controller.inputs] == [False, False]
    controller.ticks(10)
    assert controller.inputs[-1]["learn"]
    controller.theta += 1.0
    controller.ticks(40)
    assert controller.has("ANGLE_SHIFTED")
    assert not controller.inputs[-1]["learn"]
    assert controller.out.i_q_ref == 1  # torque goes on
    controller.lib.cgl_monitor_trust(controller.library.ffi.addressof(controller.drive, "monitor"))
    controller.ticks(20)
    assert controller.inputs[-1]["learn"]


@PRECISIONS
@pytest.mark.parametrize("anyway", [False, True])
def test_a_reference_that_is_cut_is_told_and_not_learned_from(precision, anyway):
    """The law's 4 A are within the limit of 5 A, but not beside 4 A of i_d."""
    controller = Controller(precision, law=4.0, foc=NO_INTEGRAL, learn_saturated=anyway)
    out = controller.ticks(25)
    assert (out.status, out.i_d_ref, out.i_q_ref) == (0, 0, 4)
    out = controller.ticks(20, i_d_ref=-4.0)
    assert controller.has("SATURATED")
    assert (out.i_d_ref, out.i_q_ref) == pytest.approx((-(12.5**0.5), 12.5**0.5), rel=1e-6)
    assert [i["learn"] for i in controller.inputs] == [True, True, True, True, anyway]
    controller.ticks(30)
    assert controller.out.status == 0
    assert controller.inputs[-1]["learn"]


@PRECISIONS
def test_a_law_at_the_current_limit_is_not_cut(precision):
    controller = Controller(precision, law=5.0, foc=NO_INTEGRAL | {"kp_q": 0.5})
    out = controller.ticks(40)
    assert (out.status, out.i_q_ref) == (0, 5)
    assert controller.inputs[-1]["learn"]


@PRECISIONS
def test_a_busy_law_follows_a_speed_of_its_own(precision):
    """The angle stands still, which says nothing beside a reference that the law ignores."""
    controller = Controller(precision, law=5.0, foc=NO_INTEGRAL)
    still = {"theta_m": 0.5, "omega_m": 0.0}
    controller.ticks(300, **still)
    assert controller.has("ANGLE_STUCK")
    controller.lib.cgl_drive_reset(controller.drive)
    controller.busy = controller.lib.CGL_STATUS_BUSY
    windows = controller.drive.quality.windows
    controller.ticks(3000, **still)
    assert controller.out.status == controller.busy
    assert controller.drive.quality.windows == windows
    controller.busy = 0
    controller.ticks(300, **still)
    assert controller.has("ANGLE_STUCK")


@PRECISIONS
def test_a_reset_drive_does_as_a_new_one(precision):
    """Reset while a missing angle is bridged, after windows of another ripple and with grown integrals."""
    quality = QUALITY | {"span": 0.5, "outlier": 5.0}
    used, new = (Controller(precision, quality=quality) for _ in range(2))
    for n in range(500):
        used.tick(omega_ref=50 + n % 20)
    used.ticks(20, theta_m=math.nan)
    assert used.has("ANGLE_LOST") and used.drive.quality.windows > 1
    used.lib.cgl_drive_reset(used.drive)
    told, nothing = (getattr(c.drive, "in") for c in (used, new))
    assert all(getattr(told, name) == getattr(nothing, name) for name in dir(nothing))
    used.theta = new.theta
    for n in range(300):
        got, expected = (c.tick(omega_ref=50 + n % 7) for c in (used, new))
        assert (got.status, list(got.duty), got.u_q) == (expected.status, list(expected.duty), expected.u_q)
        kept, fresh = used.drive.quality, new.drive.quality
        assert (kept.windows, kept.ripple, kept.trend) == (fresh.windows, fresh.ripple, fresh.trend)


@PRECISIONS
def test_an_outlier_is_not_learned_from(precision):
    quality = QUALITY | {"span": 0.5, "outlier": 5.0, "floor": 1.0}
    controller = Controller(precision, foc=NO_INTEGRAL, quality=quality)
    for n in range(400):
        controller.tick(omega_ref=50.0 + 0.1 * (n % 20 < 10))
    assert controller.inputs[-1]["learn"]
    controller.tick(omega_ref=60.0)
    assert controller.has("OUTLIER")
    assert not controller.inputs[-1]["learn"]


@PRECISIONS
def test_a_foreign_current_loop_gets_the_laws_reference(precision):
    controller = Controller(precision, foreign=True, foc={}, monitor=MONITOR | {"phases": 0})
    out = controller.ticks(20, i_abc=[math.nan] * 3, u_dc=math.nan, i_d_ref=-0.25)
    assert (out.i_q_ref, out.i_d_ref, out.status) == (1, -0.25, 0)
    assert list(out.duty) == [0.5] * 3
    assert controller.inputs[-1]["i_q"] == 1
    out = controller.ticks(60, theta_m=math.nan)
    assert (out.i_q_ref, out.i_d_ref) == (0, 0)
    assert controller.has("ANGLE_LOST", "OFF")


@PRECISIONS
def test_a_d_axis_reference_that_is_no_number_is_none(precision):
    controller = Controller(precision)
    assert controller.ticks(5, i_d_ref=math.nan).i_d_ref == 0


@PRECISIONS
@pytest.mark.parametrize(
    "changes",
    [
        {"pole_pairs": 0}, {"pole_pairs": 10001}, {"divider": 0}, {"divider": 65536},
        {"foc": FOC | {"current_limit": 0.0}}, {"monitor": MONITOR | {"hold": -1.0}},
        {"quality": QUALITY | {"span": -1.0}}, {"foc": FOC | {"current_limit": 1e6}}, {"feed_forward": True},
        # parts that do not agree
        {"monitor": MONITOR | {"phases": 2}},
        {"foc": FOC | {"phases": 2}},
    ],
)  # fmt: skip
def test_init_refuses(precision, changes):
    library = control_library(precision)
    config = library.new("cgl_drive_config", **{**CONFIG, **changes})
    refused = library.lib.cgl_drive_init(library.new("cgl_drive"), config, TS)
    assert refused == library.lib.CGL_ERROR_CONFIG


@PRECISIONS
@pytest.mark.parametrize("ts", [0.0, -TS, math.nan, math.inf])
def test_init_refuses_a_period_that_is_none(precision, ts):
    library = control_library(precision)
    config = library.new("cgl_drive_config", **CONFIG)
    refused = library.lib.cgl_drive_init(library.new("cgl_drive"), config, ts)
    assert refused == library.lib.CGL_ERROR_CONFIG


@PRECISIONS
@pytest.mark.parametrize("ts", [1 / 15000, 1e-4, 1 / 3, 1e-9, 7.7e4])
@pytest.mark.parametrize("divider", [1, 3, 15, 4999])
@pytest.mark.parametrize("phases", [(3, 3), (0, 3), (2, 2)])
def test_the_law_has_divider_periods(precision, ts, divider, phases):
    library = control_library(precision)
    config = library.new(
        "cgl_drive_config", pole_pairs=4, divider=divider, foc=FOC | {"phases": phases[0]},
        monitor=MONITOR | {"phases": phases[1], "bridge": 0.0, "hold": 0.0, "speed_window": 0.0},
        quality=QUALITY | {"longest": divider * ts * 10},
    )  # fmt: skip
    drive = library.new("cgl_drive")
    assert library.lib.cgl_drive_init(drive, config, ts) == library.lib.CGL_OK
    assert drive.loop.ts == pytest.approx(divider * ts, rel=2 * library.eps)
    assert drive.quality.longest == 10
