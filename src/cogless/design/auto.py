"""The rule auto: every number of a learning law, from the design's own measures of stability.

The feedback is the PI, or the position feedback, of the rule phase-margin, by default at 45 degrees.
Learning must settle at the slowest and at the fastest speed of the law's scenarios, as told and in every
corner. Where a reference stops, a law that learns in angle rests below half of its top speed. A corner is an
inertia that is off by 50 % (K_t / J is then 1 / 1.5 or 2 times what the study tells), or one sample of delay
that the study doesn't tell. With X of learning_loop.py, per unit of the learning gain:

    period      the electrical one where all orders that are known are its multiples, else the mechanical one
    map         ten cells or more in a wave of the highest order that is known of motor and load
    gain        1 / max |X|: the frequency that answers most is learned in one period
    lead        the one with which learning settles up to the highest frequency, in the worst corner
    Q filter    the narrowest with which no frequency grows by more than `FACTOR_MOST` in a period

The gain is halved while no filter is enough. It is halved further, and the filter is widened, while the
design foresees that this leaves less ripple after `LEARNED` turns, because each period adds the noise of a
sensor's counts. docs/laws/auto.md has the laws one by one; the law harmonic has a rule of its own, in
harmonic.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.closed_loop import oscillation
from cogless.design.laws.adrc import bandwidths
from cogless.design.laws.anti_cogging import position_gain
from cogless.design.laws.periodic import LONGEST_LEAD, PeriodicLoop
from cogless.design.laws.pi_afc import OrderLoop
from cogless.design.laws.space import SpaceLoop
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop
from cogless.design.margins import Complex, Real
from cogless.design.ripple import ripple
from cogless.design.speed_loop import gains, phase_margin_pi, speed_loop, tuned, tuning_of
from cogless.design.verdict import WIDEST
from cogless.errors import StudyError
from cogless.study import AnyStudy, Study, changed
from cogless.study import load as load_study
from cogless.study.base import StudyBase
from cogless.study.laws.adrc import Adrc
from cogless.study.laws.anti_cogging import AntiCogging
from cogless.study.laws.harmonic import ORDER_ANGLE_MOST
from cogless.study.laws.law import SETTLING, Base
from cogless.study.laws.periodic import PiIlc, RobustIlc
from cogless.study.laws.pi_afc import PI_AFC_ORDERS, PiAfc
from cogless.study.laws.space import MECHANICAL, SpaceLearning, SpacePosition, SpaceSpeed
from cogless.study.messages import dotted
from cogless.study.reading import AStudy, Changes
from cogless.units import TURN

# As told, and each corner: true K_t / J over that of the study, and samples of delay that the study
# doesn't tell.
AS_TOLD = (1.0, 0)
CORNERS = (AS_TOLD, (1 / 1.5, 0), (2.0, 0), (1.0, 1))
CELLS = 10  # in a wave of the highest order
AUTO_CELLS_LEAST, AUTO_CELLS_MOST = 256, 8192
HALVINGS = 10
LEARNED = 10  # turns of the rotor after which the ripple that is left counts
FREQUENCIES = 1000
IN_PHASE = 0.02  # least cos arg X that counts as learning in the right direction
GAIN_MARGIN = 2.0  # of the gain on single orders, and of one in 1 / |omega| over a reference that stops

Values = dict[str, Any]


def load(study: str | Path, changes: Changes | None = None) -> AnyStudy:
    """Read a study, as `cogless.study.load`, and give the laws with the rule auto their numbers."""
    return filled(load_study(study, changes))


def filled(study: AStudy) -> AStudy:
    """The study with the numbers that the rule auto gives; keys that it gives itself stay."""
    found: Values = {}
    for name in missing(study):
        # only laws of speed have a tuning rule
        values, given = automatic(cast(Study, study), name), study.source.tables["controller"][name]
        found |= {dotted(("controller", name, key)): v for key, v in values.items() if key not in given}
    return changed(study, found) if found else study


def unfilled(study: Study, name: str) -> Study:
    """The study without the numbers that the rule auto gave a controller; `filled` computes them anew.

    All numbers stay if one of them differs from what the rule gives.
    """
    law, source = study.controller[name], study.source
    controllers = source.tables["controller"]
    of_rule = law.AUTOMATIC.keys() & controllers[name].keys() if is_auto(law) else set()
    if not of_rule:
        return study
    table = {key: value for key, value in controllers[name].items() if key not in of_rule}
    bare = changed(study, {"controller": {**controllers, name: table}})
    values = automatic(bare, name)
    return bare if all(values[key] == controllers[name][key] for key in of_rule) else study


def missing(study: StudyBase) -> list[str]:
    """Names of the controllers whose numbers the rule auto has still to give."""
    tables = study.source.tables["controller"]
    return [
        name
        for name, law in study.controller.items()
        if is_auto(law) and not law.AUTOMATIC.keys() <= tables[name].keys()
    ]


def is_auto(law: Base) -> bool:
    """Whether a controller's tuning rule is auto."""
    tuning = getattr(law, "tuning", None)
    return tuning is not None and tuning.is_auto


def automatic(study: Study, name: str) -> Values:
    """The numbers of a controller's keys, SI, by the rule auto. StudyError: there are none that settle."""
    law = study.controller[name]
    rules: dict[type, Callable[[Study, str, Any], Values]] = {
        PiIlc: _pi_ilc,
        RobustIlc: _robust_ilc,
        PiAfc: _pi_afc,
        AntiCogging: _anti_cogging,
        SpaceSpeed: _space_speed,
        SpacePosition: _space_position,
        Adrc: _adrc,
    }
    rule = rules.get(type(law))
    return {} if rule is None else rule(study, name, law)


def _pi_ilc(study: Study, name: str, law: PiIlc) -> Values:
    return _periodic(study, name, law, lambda gain: {"gain": gain})


def _robust_ilc(study: Study, name: str, law: RobustIlc) -> Values:
    """The linear part is as near to the PI as two real roots come; switching is twice the sensors' noise."""
    assert law.tuning is not None
    b = study.K_t / study.mechanics.stiff.inertia
    pi = _phase_margin_pi(study, name, law)
    half, both = b * pi[0] / 2, b * pi[1]
    apart = math.sqrt(max(half**2 - both, 0.0))  # two real roots, or a double one: ki as near as these come
    given = {"b": b, "c": half - apart, "eta": half + apart, "q": 1.0, "beta_1": 0.0, "gamma": 0.0}
    given["g"] = 2 * b * study.drive.current_sensors.noise
    given |= _by_hand(study, name)
    with_it = _with(study, name, given)
    return given | _periodic(with_it, name, law, lambda gain: {"beta_2": gain * given["b"]})


def _pi_afc(study: Study, name: str, law: PiAfc) -> Values:
    """Orders that are known and can settle in every corner, the largest first; one lead, one gain for all."""
    found = known_orders(study, name)
    held = [n for n in found if _settles(study, name, n)] or found[:1]
    by_hand = _by_hand(study, name)
    orders = list(by_hand.get("orders", sorted(held[:PI_AFC_ORDERS]) or [1]))
    T = speed_loop(study).period
    loops = list(_loops(OrderLoop, _with(study, name, {"orders": tuple(orders), "gain": 1.0}), name))

    def in_phase(n: int) -> float:
        return min(float(np.min(_cosine(loop, loop.frequencies, n), initial=1.0)) for loop in loops)

    lead = by_hand.get("lead", max(range(LONGEST_LEAD + 1), key=in_phase) * T)
    kp, ki = gains(study, name)
    gain = (ki or kp / T) / len(orders)
    for _ in range(2 * HALVINGS):
        tried = _with(study, name, {"orders": tuple(orders), "gain": GAIN_MARGIN * gain, "lead": lead})
        if all(loop.worst().factor <= FACTOR_MOST for loop in _loops(OrderLoop, tried, name)):
            return {"orders": orders, "gain": gain, "lead": lead}
        gain /= 2
    raise _no_gain(study, name)


def _settles(study: Study, name: str, order: int) -> bool:
    """Whether a lead exists with which the order is learned at all speeds and corners.

    An order that turns by more than ORDER_ANGLE_MOST in a sample looks almost like its image: it is left out.
    """
    loops = list(_loops(OrderLoop, _with(study, name, {"orders": (order,), "gain": 1.0}), name))
    turned = max(order * abs(loop.omega_m) * loop.plant.period for loop in loops)
    if turned > ORDER_ANGLE_MOST:
        return False
    leads = range(LONGEST_LEAD + 1)
    return any(all(np.all(_cosine(loop, loop.frequencies, n) > IN_PHASE) for loop in loops) for n in leads)


def _adrc(study: Study, name: str, law: Adrc) -> Values:
    """Loop and observer as fast as the phase margin allows."""
    b = study.K_t / study.mechanics.stiff.inertia

    def rule(study: Study) -> tuple[float, float]:
        return bandwidths(speed_loop(study).rigid, b, tuning_of(study, name).phase_margin)

    omega_c, omega_o = tuned(study, name, rule)
    return {"b": b, "omega_c": omega_c, "omega_o": omega_o}


def _anti_cogging(study: Study, name: str, law: AntiCogging) -> Values:
    """The table is read ahead by the delay to the torque.

    The commissioning run is so slow that its position loop follows the highest order.
    """
    pi = gains(study, name)
    loop = replace(speed_loop(study).rigid, window=0, bandwidth=0.0, delay=0.0, low_pass=0.0)
    w = np.array([1e-3 * math.pi / loop.period])
    lead = max(0.0, -float(np.angle(1j * loop.plant(w)[0][0])) / float(w[0]))
    follows = position_gain(speed_loop(study).rigid, pi)
    highest = max([*known_orders(study, name), 1])
    speed = follows / highest
    turns = 1 + SETTLING
    run = {"speed": speed, "revolutions": 1, "position_gain": follows}
    cells = min(_cells(study, name), int(TURN * turns / speed / loop.period))
    return {"cells": cells, "lead": lead, "calibration": run}


def _space_speed(study: Study, name: str, law: SpaceSpeed) -> Values:
    """k is the PI's kp; learning pauses while the error alone asks for all the current that there is."""
    k = _phase_margin_pi(study, name, law)[0]
    given = {"k": k, "eta_bar": study.drive.current_loop.current_limit / k} | _by_hand(study, name)
    return given | _in_angle(_with(study, name, given), name)


def _space_position(study: Study, name: str, law: SpacePosition) -> Values:
    """The integral stays beside what is learned: a load may change at any angle."""
    given = {"frame": "mechanical", "hand_over": False} | _by_hand(study, name)
    return given | _in_angle(_with(study, name, given), name)


def _periodic(study: Study, name: str, law: PiIlc | RobustIlc, keys: Callable[[float], Values]) -> Values:
    """Map, lead, gain and Q filter. `keys`: the keys of a learning gain in A*s/rad."""
    by_hand = _by_hand(study, name)
    period = by_hand.get("period", _shared_period(study, name))
    T, map_ = speed_loop(study).period, {"cells": _cells(study, name, period), "period": period}
    unit = list(_loops(PeriodicLoop, _with(study, name, map_ | keys(1.0)), name))
    slowest_period = min(1 / loop.periods_per_second for loop in unit) / T  # samples
    longest = max(1, min(LONGEST_LEAD, int(slowest_period / 4), map_["cells"] // 4))
    f = _grid(unit)
    gain = 1 / max(float(np.max(np.abs(loop.x(f, 0)))) for loop in unit)
    lead = max(range(1, longest + 1), key=lambda n: min(_reach(gain * loop.x(f, n), f) for loop in unit))

    def tried(gain: float) -> Values:
        return {**map_, **keys(gain), "lead": lead * T}

    return _filtered(study, name, PeriodicLoop, gain, tried)


def _in_angle(study: Study, name: str) -> Values:
    """Map, gain, Q filter and omega_min of a law that learns over the angle and has no lead.

    If learning is off, these numbers have no effect, and the study's own stay.
    """
    law = study.controller[name]
    if not law.learns:
        return {key: value for key, value in law.AUTOMATIC.items() if key in MECHANICAL}
    map_ = {"cells": _cells(study, name)} | _above(study, name)
    unit = list(_loops(SpaceLoop, _with(study, name, map_ | {"mu_alpha": 1.0}), name))
    f = _grid(unit)
    gain = 1 / max(float(np.max(np.abs(loop.x(f)))) for loop in unit)
    found = _filtered(study, name, SpaceLoop, gain, lambda gain: map_ | {"mu_alpha": gain})
    return found | map_ | {"period": {"of": "mechanical"}}


def _above(study: Study, name: str) -> Values:
    """omega_min where a reference stops: a gain in 1 / |omega| can't settle at every speed that it passes.

    Learning rests below 1 / GAIN_MARGIN of the top speed: a sine turns 87 % of its angle above, a move 83 %.
    """
    scenarios = [study.scenario[key] for key in _scenarios(study, name)]
    stop = [s.top_reference / GAIN_MARGIN for s in scenarios if s.top_reference and not s.slowest]
    if not stop or "omega_min" in study.source.tables["controller"][name]:
        return {}
    return {"omega_min": min([*stop, *(s.slowest for s in scenarios if s.slowest)])}


def _filtered(
    study: Study, name: str, kind: type[LearningLoop], gain: float, keys: Callable[[float], Values]
) -> Values:
    """A gain, halved until a Q filter lets learning settle, and on while half of it leaves less ripple.

    Each gain has the narrowest such filter, or a wider one while that leaves less. The ripple is the one that
    the design foresees after `LEARNED` turns: what is not learned yet or is filtered away, and the noise of a
    sensor's counts. Numbers set by hand count, unless nothing settles with them.
    """
    by_hand = _by_hand(study, name)
    for fixed in [by_hand, {}] if by_hand else [{}]:
        found: list[tuple[float, Values]] = []
        for n in range(HALVINGS):
            best = _filter(study, name, kind, keys(gain / 2**n) | fixed, fixed)
            if best is not None:
                found.append(best)
            if len(found) > 1 and found[-1][0] >= found[-2][0]:
                break
        if found:
            return min(found, key=lambda pair: pair[0])[1]
    raise _no_gain(study, name)


def _filter(
    study: Study, name: str, kind: type[LearningLoop], values: Values, fixed: Values
) -> tuple[float, Values] | None:
    """The least ripple, and the law's numbers with the Q filter that leaves it.

    The search begins with the narrowest filter and widens it as long as the ripple falls. None: learning
    settles with no filter.
    """
    best = None
    for width in _widths(list(_loops(kind, _with(study, name, values), name)), fixed):
        tried = values | {"q_half_width": width}
        left = _left(study, name, kind, tried)
        if best is not None and left >= best[0]:
            break
        best = (left, tried)
    return best


def _left(study: Study, name: str, kind: type[LearningLoop], values: Values) -> float:
    """Predicted ripple after LEARNED turns over that of the feedback alone, as the mean over scenarios."""
    tried, ratios = _with(study, name, values), []
    for key in _scenarios(study, name):
        speed = study.scenario[key].top_reference
        if speed:
            loop = kind(tried, name, speed, scenario=key)
            ratios.append(ripple(loop, LEARNED * math.tau / speed, settled=False).ratio)
    return sum(ratios) / len(ratios)


def _widths(loops: list[LearningLoop], fixed: Values) -> Iterator[int]:
    """Half widths of the Q filters with which learning settles in all loops, in rising order.

    A half width that the study fixes is the only one tried.
    """
    if any(loop.oscillation() is not None for loop in loops):
        return
    grow: list[tuple[LearningLoop, Real, Real]] = []
    for loop in loops:
        f = loop.frequencies
        without = loop.unfiltered(f)
        high = without > FACTOR_MOST
        grow.append((loop, f[high], without[high]))
    widest = min(WIDEST, *(loop.widest_filter for loop in loops))
    for n in (fixed["q_half_width"],) if "q_half_width" in fixed else range(widest + 1):
        if all(np.all(loop.q(f, n) * without <= FACTOR_MOST) for loop, f, without in grow):
            yield n


def _loops(kind: type[LearningLoop], study: Study, name: str) -> Iterator[LearningLoop]:
    """The law's learning loops at its scenarios' slowest and fastest speeds, in every corner.

    A corner in which the feedback alone is unstable is left out: no learning gain would help there.
    """
    scenarios, law = [study.scenario[key] for key in _scenarios(study, name)], study.controller[name]
    speeds = {speed for s in scenarios for speed in (s.slowest, s.top_reference)}
    if isinstance(law, SpaceLearning) and 0.0 in speeds:  # it stops or reverses, and learns above omega_min
        speeds |= {min(law.omega_min, max(speeds))}
    speeds -= {0.0}
    if not speeds:
        where = f"{study.source.path}: controller.{name}.tuning"
        raise StudyError(f"{where}: expected a scenario of this controller in which the rotor turns")
    T = speed_loop(study).period
    for speed, corner in product(sorted(speeds), CORNERS):
        loop = kind(study, name, speed, torque=corner[0], late=corner[1] * T)
        if corner == AS_TOLD or oscillation(loop.plant, loop.feedback) is None:
            yield loop


def _scenarios(study: Study, name: str) -> list[str]:
    """Names of the scenarios that a controller is tuned for: its own, or all if it runs in none."""
    return study.scenarios_of(name) or list(study.scenario)


def _with(study: Study, name: str, values: Values) -> Study:
    """The study with a controller that has other numbers."""
    law = study.controller[name].model_copy(update=values)
    return study.model_copy(update={"controller": {**study.controller, name: law}})


def _by_hand(study: Study, name: str) -> Values:
    """The numbers that the rule would give, but the study has itself, SI."""
    law, given = study.controller[name], study.source.tables["controller"][name]
    return {key: getattr(law, key) for key in law.AUTOMATIC if key in given}


def _grid(loops: Iterable[LearningLoop]) -> Real:
    """Frequencies from the slowest learning period's to half of the sampling rate, Hz."""
    loops = list(loops)
    low = min(loop.periods_per_second for loop in loops)
    return np.geomspace(low, 0.499 / loops[0].plant.period, FREQUENCIES)


def _cosine(loop: LearningLoop, f: Real, lead: int) -> Real:
    """cos arg of the closed loop from the learned current to the error, `lead` samples ahead."""
    x = loop.closed(f) * np.exp(2j * np.pi * f * lead * loop.plant.period)
    return np.asarray(np.real(x) / np.maximum(np.abs(x), 1e-300))


def _reach(x: Complex, f: Real) -> float:
    """The frequency up to which learning by X settles, Hz."""
    grows = np.flatnonzero(np.abs(1 - x) > FACTOR_MOST)
    return float(f[grows[0]]) if len(grows) else float(f[-1])


def known_orders(study: Study, name: str) -> list[int]:
    """Whole mechanical orders that are known of motor and load, those of the largest current first.

    Behind them come the electrical orders that every drive may have. Offsets of the current sensors make
    order 1, their gains order 2, dead time and the winding order 6.
    """
    current: dict[int, float] = {}
    for key in _scenarios(study, name):
        for n, wave in enumerate(functions_in(study, key).waves(study.scenario[key].top_reference)):
            current[n] = max(current.get(n, 0.0), float(wave))
    largest = max((wave for n, wave in current.items() if n), default=0.0)
    found = [n for n, wave in current.items() if n and wave > 1e-3 * largest and largest > 0]
    usual = [n * study.motor.pole_pairs for n in (1, 2, 6)]
    return list(dict.fromkeys([*sorted(found, key=lambda n: -current[n]), *usual]))


def _shared_period(study: Study, name: str) -> str:
    """The shortest period that contains all known orders.

    It is the electrical one, unless an order is not a multiple of the pole pairs, or a load has a shaft.
    """
    fits = all(n % study.motor.pole_pairs == 0 for n in known_orders(study, name))
    return "electrical" if fits and study.mechanics.load_side is None else "mechanical"


def _cells(study: Study, name: str, period: str = "mechanical") -> int:
    """Cells of a map over a period: a power of two, or set by hand."""
    by_hand = _by_hand(study, name)
    if "cells" in by_hand:
        return int(by_hand["cells"])
    periods = study.motor.pole_pairs if period == "electrical" else 1  # a revolution
    wanted = math.ceil(CELLS * max([*known_orders(study, name), 1]) / periods)
    return min(AUTO_CELLS_MOST, max(AUTO_CELLS_LEAST, 1 << (wanted - 1).bit_length()))


def _phase_margin_pi(study: Study, name: str, law: RobustIlc | SpaceSpeed) -> tuple[float, float]:
    """kp and ki that a PI in the law's place would have."""
    design = tuned(
        study, name, lambda study: phase_margin_pi(speed_loop(study).rigid, tuning_of(study, name))
    )
    return design.kp, design.ki


def _no_gain(study: Study, name: str) -> StudyError:
    where = f"{study.source.path}: controller.{name}.tuning"
    return StudyError(f"{where}: expected a loop in which some gain lets learning settle: none does here")
