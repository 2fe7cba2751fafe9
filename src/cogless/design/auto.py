"""The rule auto: every number of a learning law, from the design's own measures of stability.

The feedback is the PI, or the position feedback, of the rule phase-margin, by default at 45 degrees.
Learning must settle at the slowest and at the fastest speed of the law's scenarios, with the study's values
and in every corner. Where a reference stops, a law that learns in angle rests below half of the top speed. A
corner is an inertia that is off by 50 % (K_t / J is then 1 / 1.5 or 2 times the study's), or one more sample
of delay than the study has. With X of learning_loop.py, per unit of the learning gain:

    period      the electrical one where all orders that are known are its multiples, else the mechanical one
    map         ten cells or more in a wave of the highest order that is known of motor and load
    gain        1 / max |X|: the frequency that answers most is learned in one period
    lead        the one with which learning settles up to the highest frequency, in the worst corner
    Q filter    the narrowest with which no frequency grows by more than `FACTOR_MOST` in a period

The gain is halved while no filter is enough. It is halved further, and the filter is widened, while the
design foresees that this leaves less ripple after `LEARNING_TURNS` turns, because each period adds the noise
of a sensor's counts. docs/laws/auto.md has the laws one by one; the law harmonic has a rule of its own, in
harmonic.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import cast

import numpy as np

from cogless.design.angle_functions import functions_in
from cogless.design.closed_loop import oscillation
from cogless.design.law_rules import Values, rules_of
from cogless.design.learning_loop import FACTOR_MOST, LearningLoop
from cogless.design.margins import Complex, Real
from cogless.design.ripple import ripple
from cogless.design.speed_loop import phase_margin_pi, speed_loop, tuned, tuning_of
from cogless.design.verdict import FILTER_WIDTH_MOST
from cogless.errors import StudyError
from cogless.study import AnyStudy, Study, changed
from cogless.study import load as load_study
from cogless.study.base import StudyBase
from cogless.study.messages import dotted
from cogless.study.reading import AStudy, Changes

# The study's own values, and each corner: true K_t / J over that of the study, and samples of delay that the
# study doesn't have.
AS_TOLD = (1.0, 0)
CORNERS = (AS_TOLD, (1 / 1.5, 0), (2.0, 0), (1.0, 1))
WAVE_CELLS = 10  # cells in a wave of the highest order
AUTO_CELLS_LEAST, AUTO_CELLS_MOST = 256, 8192  # cells of a map
GAIN_HALVINGS = 10  # a gain is halved no more often than this
LEARNING_TURNS = 10  # turns of the rotor after which the ripple that is left counts
LOOP_FREQUENCIES = 1000  # frequencies at which a corner's |X| is computed
IN_PHASE = 0.02  # least cos arg X that counts as learning in the right direction
GAIN_MARGIN = 2.0  # margin of the gain on single orders, and of a gain in 1 / |omega| where a reference stops


def load(study: str | Path, changes: Changes | None = None) -> AnyStudy:
    """Read a study by path or shipped name, and compute the numbers of laws with the rule auto.

    `changes` replace values by dotted key, such as {"controller.pi.kp": 0.02}. A plain number takes the unit
    of the text that it replaces. StudyError lists the mistakes in the study, one per line.
    """
    return filled(load_study(study, changes))


def filled(study: AStudy) -> AStudy:
    """The study with the numbers that the rule auto gives; keys that the study has itself stay."""
    changes: Values = {}
    for name in missing(study):
        # only laws of speed have a tuning rule
        values, own_keys = automatic(cast(Study, study), name), study.source.tables["controller"][name]
        changes |= {dotted(("controller", name, key)): v for key, v in values.items() if key not in own_keys}
    return changed(study, changes) if changes else study


def unfilled(study: Study, name: str) -> Study:
    """The study without the numbers that the rule auto gave a controller; `filled` computes them anew.

    All numbers stay if one of them differs from what the rule gives.
    """
    law, source = study.controller[name], study.source
    controllers = source.tables["controller"]
    of_rule = law.AUTOMATIC.keys() & controllers[name].keys() if law.is_auto else set()
    if not of_rule:
        return study
    table = {key: value for key, value in controllers[name].items() if key not in of_rule}
    bare = changed(study, {"controller": {**controllers, name: table}})
    values = automatic(bare, name)
    return bare if all(values[key] == controllers[name][key] for key in of_rule) else study


def missing(study: StudyBase) -> list[str]:
    """Names of the controllers to which the rule auto must still give numbers."""
    tables = study.source.tables["controller"]
    return [
        name
        for name, law in study.controller.items()
        if law.is_auto and not law.AUTOMATIC.keys() <= tables[name].keys()
    ]


def automatic(study: Study, name: str) -> Values:
    """The numbers of a controller's keys, SI, by the rule auto. StudyError: learning settles with none."""
    return rules_of(study, name).auto()


def gain_and_filter(
    study: Study, name: str, kind: type[LearningLoop], gain: float, keys: Callable[[float], Values]
) -> Values:
    """The law's numbers with a gain and a Q filter with which learning settles.

    The gain is halved until a filter lets learning settle, and on while half of it leaves less ripple. Each
    gain has the narrowest such filter, or a wider one if that leaves less. The ripple is the one that the
    design foresees after `LEARNING_TURNS` turns: what is not learned yet or is filtered away, and the noise
    of a sensor's counts. Numbers set by hand count, unless nothing settles with them.
    """
    by_hand = numbers_by_hand(study, name)
    for fixed in [by_hand, {}] if by_hand else [{}]:
        tries: list[tuple[float, Values]] = []
        for n in range(GAIN_HALVINGS):
            best = _filter(study, name, kind, keys(gain / 2**n) | fixed, fixed)
            if best is not None:
                tries.append(best)
            if len(tries) > 1 and tries[-1][0] >= tries[-2][0]:
                break
        if tries:
            return min(tries, key=lambda pair: pair[0])[1]
    raise no_gain_error(study, name)


def _filter(
    study: Study, name: str, kind: type[LearningLoop], values: Values, fixed: Values
) -> tuple[float, Values] | None:
    """The least ripple, and the law's numbers with the Q filter that leaves it.

    The search begins with the narrowest filter and widens it as long as the ripple falls. None: learning
    settles with no filter.
    """
    best = None
    for width in _widths(list(loops_in_corners(kind, with_numbers(study, name, values), name)), fixed):
        tried = values | {"q_half_width": width}
        share = _ripple_share(study, name, kind, tried)
        if best is not None and share >= best[0]:
            break
        best = (share, tried)
    return best


def _ripple_share(study: Study, name: str, kind: type[LearningLoop], values: Values) -> float:
    """Predicted ripple after LEARNING_TURNS turns / the feedback's ripple, as the mean over scenarios."""
    tried, ratios = with_numbers(study, name, values), []
    for key in scenarios_tuned_for(study, name):
        speed = study.scenario[key].top_reference
        if speed:
            loop = kind(tried, name, speed, scenario=key)
            ratios.append(ripple(loop, LEARNING_TURNS * math.tau / speed, settled=False).ratio)
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
    widest = min(FILTER_WIDTH_MOST, *(loop.widest_filter for loop in loops))
    for n in (fixed["q_half_width"],) if "q_half_width" in fixed else range(widest + 1):
        if all(np.all(loop.q(f, n) * without <= FACTOR_MOST) for loop, f, without in grow):
            yield n


def loops_in_corners(kind: type[LearningLoop], study: Study, name: str) -> Iterator[LearningLoop]:
    """The law's learning loops at its scenarios' slowest and fastest speeds, in every corner.

    A corner in which the feedback alone is unstable is left out: no learning gain would help there.
    """
    scenarios = [study.scenario[key] for key in scenarios_tuned_for(study, name)]
    speeds, least = (
        {speed for s in scenarios for speed in (s.slowest, s.top_reference)},
        study.controller[name].rests_below,
    )
    if (
        kind.RISES_AT_REST and least is not None and 0.0 in speeds
    ):  # the reference stops or reverses, and the law learns above `least`
        speeds |= {min(least, max(speeds))}
    speeds -= {0.0}
    if not speeds:
        where = f"{study.source.path}: controller.{name}.tuning"
        raise StudyError(f"{where}: expected a scenario of this controller in which the rotor turns")
    T = speed_loop(study).period
    for speed, corner in product(sorted(speeds), CORNERS):
        loop = kind(study, name, speed, torque=corner[0], late=corner[1] * T)
        if corner == AS_TOLD or oscillation(loop.plant, loop.feedback) is None:
            yield loop


def scenarios_tuned_for(study: Study, name: str) -> list[str]:
    """Names of the scenarios that a controller is tuned for: its own, or all if it runs in none."""
    return study.scenarios_of(name) or list(study.scenario)


def with_numbers(study: Study, name: str, values: Values) -> Study:
    """The study in which one controller has these numbers."""
    law = study.controller[name].model_copy(update=values)
    return study.model_copy(update={"controller": {**study.controller, name: law}})


def numbers_by_hand(study: Study, name: str) -> Values:
    """The study's own numbers, SI, for keys whose numbers the rule would give otherwise."""
    law, own_keys = study.controller[name], study.source.tables["controller"][name]
    return {key: getattr(law, key) for key in law.AUTOMATIC if key in own_keys}


def frequency_grid(loops: Iterable[LearningLoop]) -> Real:
    """Frequencies from the slowest learning period's to half of the sampling rate, Hz."""
    loops = list(loops)
    low = min(loop.periods_per_second for loop in loops)
    return np.geomspace(low, 0.499 / loops[0].plant.period, LOOP_FREQUENCIES)


def phase_cosine(loop: LearningLoop, f: Real, lead: int) -> Real:
    """cos arg of the closed loop from the learned current to the error, `lead` samples ahead."""
    x = loop.closed(f) * np.exp(2j * np.pi * f * lead * loop.plant.period)
    return np.asarray(np.real(x) / np.maximum(np.abs(x), 1e-300))


def settling_reach(x: Complex, f: Real) -> float:
    """The frequency up to which learning by X settles, Hz."""
    grows = np.flatnonzero(np.abs(1 - x) > FACTOR_MOST)
    return float(f[grows[0]]) if len(grows) else float(f[-1])


def known_orders(study: Study, name: str) -> list[int]:
    """Whole mechanical orders that are known of motor and load, those of the largest current first.

    Behind them come the electrical orders that every drive may have. Offsets of the current sensors make
    order 1, their gains order 2, dead time and the winding order 6.
    """
    current: dict[int, float] = {}
    for key in scenarios_tuned_for(study, name):
        for n, wave in enumerate(functions_in(study, key).waves(study.scenario[key].top_reference)):
            current[n] = max(current.get(n, 0.0), float(wave))
    largest = max((wave for n, wave in current.items() if n), default=0.0)
    orders = [n for n, wave in current.items() if n and wave > 1e-3 * largest and largest > 0]
    usual = [n * study.motor.pole_pairs for n in (1, 2, 6)]
    return list(dict.fromkeys([*sorted(orders, key=lambda n: -current[n]), *usual]))


def shared_period(study: Study, name: str) -> str:
    """The shortest period that contains all known orders.

    It is the electrical one, unless an order is not a multiple of the pole pairs, or a load has a shaft.
    """
    fits = all(n % study.motor.pole_pairs == 0 for n in known_orders(study, name))
    return "electrical" if fits and study.mechanics.load_side is None else "mechanical"


def map_cells(study: Study, name: str, period: str = "mechanical") -> int:
    """Cells of a map over a period: a power of two, or set by hand."""
    by_hand = numbers_by_hand(study, name)
    if "cells" in by_hand:
        return int(by_hand["cells"])
    periods = study.motor.pole_pairs if period == "electrical" else 1  # a revolution
    cells = math.ceil(WAVE_CELLS * max([*known_orders(study, name), 1]) / periods)
    return min(AUTO_CELLS_MOST, max(AUTO_CELLS_LEAST, 1 << (cells - 1).bit_length()))


def phase_margin_gains(study: Study, name: str) -> tuple[float, float]:
    """kp and ki that a PI in the law's place would have."""
    design = tuned(
        study, name, lambda study: phase_margin_pi(speed_loop(study).rigid, tuning_of(study, name))
    )
    return design.kp, design.ki


def no_gain_error(study: Study, name: str) -> StudyError:
    where = f"{study.source.path}: controller.{name}.tuning"
    return StudyError(
        f"{where}: learning settles with no gain that this rule tried: expected another loop, such as one "
        "with less delay"
    )
