"""Whether a position sensor's edges come often enough for the loop around them.

docs/theory/sensors.md#few-edges derives it. Let edges come every T_e, longer than a sample T. A speed timed
from edge to edge is then T_e late, where pi.py assumes T / 2. This costs w_c (T_e - T / 2) of the phase
margin at the crossover w_c. A speed from counts over a fixed time then consists of single counts. If w_c T_e
is above one, the rotor coasts from one count to the next.
"""

from __future__ import annotations

import math

import numpy as np

from cogless.design.feedback import feedback_of
from cogless.design.margins import Real
from cogless.design.pi import speed_loop
from cogless.design.position import position_margins
from cogless.design.ripple import sampled
from cogless.study import Study, for_scenario
from cogless.study.motion import Course, course
from cogless.study.position_sensor import Counted
from cogless.study.spoken import speed_text

SHARE = 0.05  # of the time in motion: speeds that are lower only for less time than this are ignored
SPENT = 0.5  # of the phase margin
COASTS = 1.0  # rad
MOST = 0.5  # counts in a speed sample: with fewer, most samples have none


def slow_warning(study: Study, name: str) -> str | None:
    """Warning that edges come too rarely at the slowest speed that a controller holds; None if they don't."""
    found = (_warning(study, name, key) for key in study.scenarios_of(name))
    return next((line for line in found if line is not None), None)


def _warning(study: Study, name: str, scenario: str) -> str | None:
    omega, loop = held(study, scenario), speed_loop(study, scenario)
    source, feedback = sampled(study, scenario), feedback_of(study, name, omega)
    if not omega or source is None or feedback is None:
        return None
    margins = position_margins(loop, feedback)
    if not margins.stable or math.isnan(margins.crossover):
        return None
    edge, w_c = source.count / omega, margins.crossover
    comes = f"at {speed_text(study, omega)} an edge comes every {1e3 * edge:.2g} ms"
    around = f"the crossover is {w_c / math.tau:.3g} Hz"
    if not source.timed:
        if w_c * edge <= COASTS:
            return None
        needed = w_c * source.count / omega / COASTS
        return f"{comes}, {around}: the rotor coasts from count to count; {_helps(needed, w_c)}"
    late = edge - loop.period / 2
    lost = w_c * late / margins.phase_margin
    if lost <= SPENT:
        return None
    allowed = SPENT * margins.phase_margin / w_c + loop.period / 2
    high = "; where it stops and goes it reads high, by 10 % if every other edge takes twice as long"
    costs = f"the speed is {1e3 * late:.2g} ms late, which costs {math.degrees(w_c * late):.0f} deg"
    costs += f" of {math.degrees(margins.phase_margin):.0f} deg of phase margin"
    return f"{comes}, {around}: {costs}{high if lost > 1 else ''}; {_helps(edge / allowed, w_c)}"


def reads_zero(study: Study, scenario: str) -> str | None:
    """Warning that most samples of a counted speed are zero at the slowest speed; None if they aren't."""
    omega, source = held(study, scenario), sampled(study, scenario)
    sensor = for_scenario(study, scenario).drive.position_sensor
    if not (omega and source and isinstance(sensor, Counted)) or sensor.speed_method not in ("M", "average"):
        return None
    if source.counts(omega) >= MOST:
        return None
    comes = f"at {speed_text(study, omega)} {source.told(omega)}"
    reads = f"most read 0, others {speed_text(study, source.count / source.window)}"
    timed = '"MT" times the edges, ' if sensor.kind == "encoder" else ""
    return f'{comes}: {reads}; speed_method = {timed}"observer" smooths'


def held(study: Study, scenario: str) -> float:
    """The slowest speed at which a scenario's reference spends some time, rad/s; 0 if it stands still.

    Within a count of where the reference stops or turns back, the sensor sees no motion: that counts as rest.
    """
    sampling, source = course(study.scenario[scenario]), sampled(study, scenario)
    omega, count = np.abs(sampling.omega), source.count if source else 0.0
    moving = omega[(omega > 0) & (_from_rest(sampling) >= count)]
    return float(np.quantile(moving, SHARE)) if len(moving) else 0.0


def _from_rest(sampling: Course) -> Real:
    """The way from each sample to the nearest rest of a reference, rad; infinite if it never rests."""
    direction = np.sign(sampling.omega)
    way = np.cumsum(np.abs(sampling.omega)) * sampling.step
    turns = np.concatenate(([False], direction[1:] * direction[:-1] < 0))
    rests = (direction == 0) | turns
    before = np.maximum.accumulate(np.where(rests, way, -np.inf))
    after = np.minimum.accumulate(np.where(rests, way, np.inf)[::-1])[::-1]
    return np.asarray(np.minimum(way - before, after - way))


def _helps(factor: float, w_c: float) -> str:
    return f"{factor:.2g} times the counts would do, or a crossover of {w_c / math.tau / factor:.2g} Hz"
