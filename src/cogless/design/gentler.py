"""Changes that make a loop gentler: a finer or younger sensor, a slower feedback, weaker learning."""

from __future__ import annotations

import math
from typing import Any

from cogless.design.changes import text
from cogless.design.closed_loop import harmonic_gains, position_gains
from cogless.design.speed_loop import gains
from cogless.study import Study
from cogless.study.laws import AnyController
from cogless.study.laws.harmonic import Harmonic
from cogless.study.laws.law import Feedback
from cogless.study.laws.periodic import PiIlc, RobustIlc
from cogless.study.laws.pi_afc import PiAfc
from cogless.study.laws.space import SpacePosition, SpaceSpeed
from cogless.study.messages import dotted
from cogless.study.position_sensor import Absolute, Encoder, Hall, Resolver
from cogless.study.reading import Changes

HALVINGS = 12  # of gains that are tried
CORNER_SHARES = (0.25, 0.5)  # of the crossover: where a PI's integral takes over, 14 and 27 deg of its phase


def finer_sensor(study: Study, factor: float) -> Changes | None:
    """The change to a position sensor with at least `factor` times the counts.

    None: the study has no key for the sensor's counts.
    """
    sensor, key = study.drive.position_sensor, "drive.position_sensor"
    if isinstance(sensor, Encoder):
        return {f"{key}.lines": math.ceil(sensor.lines * factor)}
    if isinstance(sensor, Absolute) and sensor.positions is not None:
        return {f"{key}.positions": math.ceil(sensor.positions * factor)}
    if isinstance(sensor, Absolute | Resolver):
        return {f"{key}.bits": (sensor.counts - 1).bit_length() + math.ceil(math.log2(factor))}
    return None


def timed_edges(study: Study) -> Changes | None:
    """The change to a speed from the time between edges; None: the sensor has none, or they are timed."""
    sensor, key = study.drive.position_sensor, "drive.position_sensor"
    if not isinstance(sensor, Encoder) or sensor.timed or sensor.latency:
        return None
    table = study.source.tables["drive"]["position_sensor"]
    own = {part: value for part, value in table.items() if part not in ("window", "observer_bandwidth")}
    if len(own) == len(table):
        return {f"{key}.speed_method": "MT"}
    return {key: {**own, "speed_method": "MT"}}  # only other methods may have these keys


def younger_speeds(study: Study) -> list[Changes]:
    """Speeds of Hall sensors as the mean over fewer edges, the most first; none where the sensors aren't
    evenly placed, which such a speed would show."""
    sensor = study.drive.position_sensor
    if not isinstance(sensor, Hall) or any(sensor.placement):
        return []
    return [{"drive.position_sensor.edges": edges} for edges in range(sensor.edges - 1, 0, -1)]


def slower_feedback(study: Study, name: str, factor: float) -> Changes | None:
    """The change to a feedback `factor` times slower, equally damped; None: the law has no such gains."""
    law, key = study.controller[name], dotted(("controller", name))
    if isinstance(law, Harmonic) and law.position:
        k_theta, kp, ki = harmonic_gains(study, name)
        own = _pi(kp / factor, ki / factor**2) | {"k_theta": text(k_theta / factor, "1/s")}
        return _by_hand(study, name, own)
    if isinstance(law, Feedback):
        kp, ki = gains(study, name)
        return _by_hand(study, name, _pi(kp / factor, ki / factor**2))
    if isinstance(law, SpacePosition):
        k_theta, k_omega, k_i = position_gains(study, name)
        if law.tuning is not None:
            return None
        slower = {"k_theta": text(k_theta / factor, "1/s"), "k_omega": text(k_omega / factor, "A*s/rad")}
        slower |= {"k_i": text(k_i / factor**2, "A/rad")} if k_i else {}
        return {f"{key}.{each}": value for each, value in slower.items()}
    if isinstance(law, RobustIlc):
        return {f"{key}.{of}": text(getattr(law, of) / factor, "1/s") for of in ("c", "eta")}
    return {f"{key}.k": text(law.k / factor, "A*s/rad")} if isinstance(law, SpaceSpeed) else None


def slower_proportional(study: Study, name: str, factor: float, crossover: float) -> list[Changes]:
    """A PI whose gain is divided by a factor and whose integral is as quick as the new crossover bears.

    `crossover`: of the feedback as it is, rad/s. Empty: the law is none for the speed with a PI.
    """
    law = study.controller[name]
    if not isinstance(law, Feedback) or (isinstance(law, Harmonic) and law.position):
        return []
    kp, ki = gains(study, name)
    quick = [min(ki, share * crossover / factor * kp / factor) for share in CORNER_SHARES]
    return [_by_hand(study, name, _pi(kp / factor, each)) for each in quick]


def _pi(kp: float, ki: float) -> dict[str, Any]:
    return {"kp": text(kp, "A*s/rad"), "ki": text(ki, "A/rad")}


def _by_hand(study: Study, name: str, own: dict[str, Any]) -> Changes:
    """The change to gains by hand. It removes any rule but auto, which may stand beside such gains."""
    key, law = dotted(("controller", name)), study.controller[name]
    tuning = getattr(law, "tuning", None)
    if tuning is None or tuning.is_auto:
        return {f"{key}.{each}": value for each, value in own.items()}
    table = study.source.tables["controller"][name]
    return {key: {**{each: value for each, value in table.items() if each != "tuning"}, **own}}


def weaker_learning(study: Study, name: str, factor: float) -> Changes | None:
    """The change that divides the learning gains by a factor; None: the law has no such gains."""
    law, key = study.controller[name], dotted(("controller", name))
    values = {of: text(getattr(law, of) / factor, unit) for of, unit in _learning(law) if getattr(law, of)}
    return {f"{key}.{of}": value for of, value in values.items()} or None


def _learning(law: AnyController) -> tuple[tuple[str, str], ...]:
    """Key and unit of each learning gain of a law."""
    if isinstance(law, PiIlc):
        return (("gain", "A*s/rad"),)
    if isinstance(law, PiAfc):
        return (("gain", "A/rad"),)
    if isinstance(law, RobustIlc):
        return (("beta_1", "rad/s^2"), ("beta_2", "1/s"))
    if isinstance(law, SpacePosition | SpaceSpeed):
        return (("mu_alpha", "A"), ("mu_beta", "A*s^2/rad^2"), ("mu_h", "A*s^4/rad^2"))
    return ()
