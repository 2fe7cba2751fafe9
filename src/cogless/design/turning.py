"""The current loop, and the torque that it gives, while the motor turns.

In the rotor's frame, which turns at the electrical speed w, the winding has J = [[0, -1], [1, 0]]

    L di/dt = -R i - w J L i + u,    L = diag(L_d, L_q)

and the inverter's voltage, which stays in the stator's frame for a period, turns backward: du/dt = -w J u. It
begins half a period ahead of its angle, since the controller turns it on by the delay and that half. The
controller's feedforward adds w J L i of the sampled currents, as old as all it gives. Where this voltage is
late by too large a part of a turn, it drives the current instead of holding it, although the loop at
standstill has every margin.

An angle that is late by tau turns currents and voltages alike, so no loop sees it. But a current that is
taken for i_q then is i_q cos(w tau), and the rest magnetises: torque is lost, and from a quarter of an
electrical turn on it has the wrong sign.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cogless.design.changes import SPEED_RESERVE, cure_words, first, helping, unit_text
from cogless.design.speed_loop import FASTER_FACTORS, current_loops, slower_loop
from cogless.design.trials.model import exponential
from cogless.study import Study, for_scenario
from cogless.study.base import speed_text
from cogless.study.position_sensor import Counted
from cogless.study.reading import Changes, Remark

J = np.array([[0.0, -1.0], [1.0, 0.0]])
SPEED_POINTS = 64  # between standstill and the top speed, to say where a loop becomes unstable
LATE_ANGLE_MOST = math.acos(0.75)  # rad, electrical; a quarter of the torque is lost
LATE_ANGLE_ADVISED = math.radians(20)  # rad, electrical; 6 % of the torque is lost


def growth(study: Study, scenario: str, omega_m: float) -> float:
    """The factor per period of an error of the current, at a mechanical speed in rad/s; 0: an ideal loop."""
    loops = current_loops(study, scenario)
    if not loops:
        return 0.0
    study_here, (d, q) = for_scenario(study, scenario), (loops["d"], loops["q"])
    belief = study_here.drive.belief.resolved(study.motor.star())
    w, T = study_here.motor.star().pole_pairs * omega_m, d.period
    L = np.diag([d.L, q.L])
    rates = np.zeros((4, 4))
    rates[:2, :2] = -np.linalg.solve(L, np.diag([d.R, q.R]) + w * J @ L)
    rates[:2, 2:] = np.linalg.inv(L)
    rates[2:, 2:] = -w * J
    period = exponential(rates * T)
    gain = -np.diag([d.kp, q.kp])
    if study_here.drive.current_loop.decoupling:
        gain = gain + w * J @ np.diag([belief.L_d, belief.L_q])
    ahead = math.cos(w * T / 2) * np.eye(2) + math.sin(w * T / 2) * J
    one, none = np.eye(2), np.zeros((2, 2))
    acts = period[:2, 2:] @ ahead
    integrates = -T * np.diag([d.ki, q.ki])
    if d.delay:  # current, integral, and the voltage that acts next
        step = np.block([[period[:2, :2], none, acts], [integrates, one, none], [gain, one, none]])
    else:
        step = np.block([[period[:2, :2] + acts @ gain, acts], [integrates, one]])
    return float(np.max(np.abs(np.linalg.eigvals(step))))


def unstable_turning(study: Study, scenario: str) -> Remark | None:
    """Warning of a current loop that is stable at standstill and not at a scenario's top speed."""
    top = study.scenario[scenario].top_reference
    speeds = np.linspace(0.0, top, SPEED_POINTS)
    if growth(study, scenario, 0.0) >= 1 or not top:  # standstill has its own warning
        return None
    lost = next((speed for speed in speeds if growth(study, scenario, speed) >= 1), None)
    if lost is None:
        return None

    def cured(other: Study) -> bool:
        reach = SPEED_RESERVE * other.scenario[scenario].top_reference
        return all(growth(other, scenario, speed) < 1 for speed in (*speeds, reach))

    study_here = for_scenario(study, scenario)
    samples = math.tau * study_here.drive.rates.current_loop / (study_here.motor.star().pole_pairs * lost)
    unstable = f"at {speed_text(study, lost, 2)} and above, the current loop is unstable"
    sentence = f"{unstable}: an electrical turn has only {samples:.2g} samples there"
    cures = tuple(cure for ways in _steadier(study) for cure in first(study, ways, cured))
    return Remark(sentence + cure_words(cures), cures)


def _steadier(study: Study) -> Iterator[list[Changes]]:
    """Lists of changes that steady a current loop at speed; each list begins with the smallest change."""
    rates, key = study.drive.rates, "drive.rates.current_loop"
    yield [{key: f"{factor * rates.current_loop / 1000:g} kHz"} for factor in FASTER_FACTORS]
    yield slower_loop(study)
    if study.drive.current_loop.decoupling:
        yield [{"drive.current_loop.decoupling": False}]


def late_angle(study: Study, scenario: str) -> Remark | None:
    """Warning of an angle that is so late at a scenario's top speed that a quarter of the torque is lost."""
    late, top = _late(study, scenario), study.scenario[scenario].top_reference
    if late <= LATE_ANGLE_MOST:
        return None
    degrees, torque_share = math.degrees(late), math.cos(late)
    costs = (
        f"leaves {100 * torque_share:.0f} % of the torque" if torque_share > 0.005 else "reverses the torque"
    )
    sentence = (
        f"at {speed_text(study, top)} the sampled angle is {degrees:.0f} deg (electrical) late, which {costs}"
    )
    sensor = for_scenario(study, scenario).drive.position_sensor
    assert isinstance(sensor, Counted)
    younger: Changes = {
        "drive.position_sensor.latency": unit_text(1e6 * sensor.latency * LATE_ANGLE_ADVISED / late, "us")
    }
    cures = helping(study, (younger,), lambda other: _late(other, scenario) <= LATE_ANGLE_MOST)
    return Remark(sentence + cure_words(cures), cures)


def _late(study: Study, scenario: str) -> float:
    """Electrical angle, rad, by which the sampled angle is late at a scenario's top speed."""
    study_here = for_scenario(study, scenario)
    sensor = study_here.drive.position_sensor
    latency = sensor.latency if isinstance(sensor, Counted) else 0.0
    return study_here.motor.star().pole_pairs * study.scenario[scenario].top_reference * latency
