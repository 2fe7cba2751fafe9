"""Plausibility of measurements: docs/laws/monitor.md, period by period, without the C's short way."""

import math
from dataclasses import dataclass

from .limits import clip, is_angle

TURN = 2 * math.pi


def in_turn(theta: float) -> float:
    return theta % TURN


def between(to: float, start: float) -> float:
    """The short way between two angles."""
    d = to - start
    return d - TURN if d > math.pi else d + TURN if d < -math.pi else d


@dataclass
class Monitor:
    omega_max: float = 0.0
    angle_step: float = 0.0
    speed_window: float = 0.0
    stuck_angle: float = 0.0
    stuck_time: float = 0.0
    current_max: float = 0.0
    current_sum: float = 0.0
    bridge: float = 0.0
    hold: float = 0.0
    ts: float = 1e-4
    phases: int = 3

    def __post_init__(self) -> None:
        self.theta = self.omega = self.shift = self.slip = self.still = 0.0
        self.raw: float | None = None  # the last period's measurement, if it was an angle
        self.started = False
        self.was_stuck = self.unsure = False
        self.gap = self.lost = self.blind = self.dark = self.holding = 0
        self.standing = self.pushing = self.attempt = 0

    def periods(self, time: float) -> int:
        return math.ceil(time / self.ts - 1e-3)

    @property
    def reach(self) -> float:
        return self.omega_max * self.ts + self.angle_step if self.omega_max else TURN

    def plausible_speed(self, omega: float) -> bool:
        return math.isfinite(omega) and (not self.omega_max or abs(omega) <= self.omega_max)

    def plausible_currents(self, i: list[float]) -> bool:
        i = i[: self.phases]
        if not all(map(math.isfinite, i)):
            return False
        # three currents that add up to zero have the sum of squares 3/2 length^2, two length^2
        length = math.sqrt(sum(x * x for x in i) / (1.5 if self.phases == 3 else 1.0))
        too_long = self.current_max > 0 and length > self.current_max
        too_much = self.phases == 3 and self.current_sum > 0 and abs(sum(i)) > self.current_sum
        return not (too_long or too_much)

    def step(
        self, i: list[float], theta: float, omega: float, u_dc: float, omega_ref: float, full: bool
    ) -> set[str]:
        """Names of the status bits. Fills theta, omega, safe, trusted. `full`: the output is at its limit."""
        said = self._rotor(theta, omega, omega_ref, full)
        if self.phases:
            said |= set() if self.plausible_currents(i) else {"CURRENT"}
            said |= {"BUS"} if not math.isfinite(u_dc) or u_dc <= 0 else set()
        lost = not self.started or self.unsure or self.gap > self.periods(self.bridge) or self.too_dark
        cause = lost or said & {"ANGLE_STUCK", "CURRENT", "BUS"}
        self.holding = self.periods(self.hold) + 1 if cause else max(self.holding - 1, 0)
        self.safe = self.holding > 0
        said |= {"FAULT"} if self.safe else set()
        at_ease = self.gap == 0 and self.blind == 0 and self.standing == 0
        self.trusted = not said and at_ease and not self.was_stuck
        return said

    def _rotor(self, measured: float, omega: float, omega_ref: float, full: bool) -> set[str]:
        before, self.raw = self.raw, in_turn(measured) if is_angle(measured) else None
        missing, stuck = self.raw is None, False
        moved = between(self.raw, before) if self.raw is not None and before is not None else math.nan
        if not self.started:
            self.started = self.raw is not None
            self.theta = self.raw or 0.0
        elif not abs(moved) <= self.reach:  # NaN, too
            missing = True
            self.theta = in_turn(self.theta + self.omega * self.ts)
            self.blind = self.periods(self.speed_window) + 1
        else:
            assert self.raw is not None
            if self.gap:
                self.shift = self._settled(between(self.raw, in_turn(self.theta + moved)))
            self.theta = in_turn(self.raw - self.shift)
            self.blind = max(self.blind - 1, 0)
            stuck = self._stuck(moved, omega_ref, full)
            self.was_stuck = stuck or (self.was_stuck and not moved)
        if not self.blind:
            missing = missing or not self.plausible_speed(omega)
            self.omega = omega if self.plausible_speed(omega) else self.omega
        self.dark = self.dark + 1 if self.blind else 0
        if missing:
            self.gap, self.lost = min(self.gap + 1, self.periods(self.bridge) + 1), self.lost + 1
        else:
            self.gap = max(self.gap - 1, 0)
            self.lost = self.lost if self.gap else 0
        self.slip = self.slip if self.gap else self.shift
        said = {
            "ANGLE_LOST": missing or self.too_dark,
            "ANGLE_STUCK": stuck,
            "ANGLE_SHIFTED": self.shift != 0,
        }
        return {name for name, holds in said.items() if holds}

    @property
    def too_dark(self) -> bool:
        """The speed has not been believed for too long."""
        return self.dark > self.periods(self.speed_window) + self.periods(self.bridge)

    def _settled(self, shift: float) -> float:
        """How far the sensor is off after a gap: as before, not at all, or as it looks."""
        if self.slip and self.lost > self.periods(self.bridge):
            self.unsure = True
        known = min((0.0, self.slip), key=lambda s: abs(between(shift, s)))
        reach = self.reach * (self.lost + 1)
        if not known and (self.was_stuck or abs(shift) <= reach + self._unseen(shift)):
            return 0.0
        return known if abs(between(shift, known)) <= reach else shift

    def _unseen(self, shift: float) -> float:
        """How much of a shift may come from a rotor that turned while the sensor stood, rad."""
        return 2 * abs(self.still) if self.stuck_angle and shift * self.still > 0 else 0.0

    def _stuck(self, moved: float, omega_ref: float, full: bool) -> bool:
        if not self.stuck_angle:
            return False
        if moved:
            self.still = 0.0
        elif math.isfinite(omega_ref):
            self.still = clip(self.still + omega_ref * self.ts, 11 * self.stuck_angle)
        if abs(self.still) <= self.stuck_angle / 4:
            self.standing = self.pushing = self.attempt = 0
            return False
        self.standing += 1
        if not self.attempt:
            self.pushing = max(0, self.pushing + (1 if full else -1))
            if abs(self.still) > self.stuck_angle and self.pushing >= max(1, self.periods(self.stuck_time)):
                self.attempt, self.pushing = self.standing, 0
        if not self.attempt:
            return False
        again = abs(self.still) >= 11 * self.stuck_angle and self.standing >= 11 * (self.attempt - 1)
        if again:
            self.holding = 0
        if again or not abs(omega_ref) > 0:
            self.still = 0.0
            self.standing = self.attempt = 0
            return False
        return True
