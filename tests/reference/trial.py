"""Position control that learns from trial to trial: mandra2019 Fig. 1, (4), (5), (16), (17), (41), (42), and
the rules for saturation and faults of the library."""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import filtfilt

from .limits import clip


def feedforward(num, den, preview: int, y_ref: np.ndarray, count: int) -> np.ndarray:
    """(41), f(p) for p = 0 .. count-1. The reference rests before its first and after its last sample."""
    last = len(y_ref) - 1
    f = np.zeros(count)

    def at(p: int) -> float:
        return f[p] if p >= 0 else sum(num) / sum(den) * y_ref[0]

    for p in range(count):
        f[p] = sum(b * y_ref[min(max(p + preview - i, 0), last)] for i, b in enumerate(num))
        f[p] -= sum(den[j] * at(p - j) for j in range(1, len(den)))
    return f


def zero_phase(b, a, x: np.ndarray, odd: bool = False) -> np.ndarray:
    """The columns of x, filtered in both directions; x is continued by an even or odd reflection."""
    if odd:
        return np.asarray(filtfilt(b, a, x, axis=0))
    whole = np.concatenate([x[::-1], x, x[::-1]])
    return np.asarray(filtfilt(b, a, whole, axis=0, padlen=0))[len(x) : -len(x)]


class TrialObserver:
    """The header's equations as matrices, on whole lists of errors and of the feedback that acted."""

    def __init__(self, g: float, p: float, limit: float) -> None:
        self.most = g * limit * (3 + p) ** 2 / 4
        self.g, self.L = g, np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3])
        self.K = np.array([(1 - p) ** 2, (1 - p) * (3 + p) / 2])
        self.e: list[float] = []
        self.u: list[float] = []
        self.x = np.zeros(3)

    def step(self, e: float) -> tuple[float, float]:
        """The feedback's share of the error and its change, and the disturbance's."""
        if not self.e:
            self.e, self.u, self.x = [e] * 3, [0.0] * 2, np.array([e, 0.0, 0.0])
        self.e.append(e)
        self.x = self.x + self.L * (e - self.x[0])
        braked = clip(self.K[0] * self.x[0], self.most)
        return float(braked + self.K[1] * self.x[1]) / self.g, self.x[2] / self.g

    def act(self, u_fb: float) -> None:
        self.u.append(u_fb)
        F, G = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]]), np.array([0.5, 1, 0])
        self.x = F @ self.x - G * self.g * u_fb

    @property
    def missing(self) -> float:
        """r(p - 2), after step and act."""
        return self.u[-3] + (self.e[-1] - self.e[-2] - self.e[-3] + self.e[-4]) / (2 * self.g)


class TrialGuard:
    """The header's rules on the sums of e^2 over trials. `decide` says what becomes of v and the best v."""

    def __init__(self) -> None:
        self.phase, self.best, self.feedback = "LEARN", math.inf, math.nan
        self.strikes = self.above = self.wait = self.returns = 0
        self.last = self.jump = math.nan
        self.first = True

    def is_too_much(self, J: float, growth: float = 1.21) -> bool:
        return growth * self.best < J or 1.1025 * self.feedback < J

    def strike(self) -> None:
        self.strikes = min(self.strikes + 1, 6)
        self.phase, self.wait, self.mark = "HOLD", 4**self.strikes - 1, self.best

    def accept(self, J: float) -> None:
        old, self.best, self.above = self.best, J, 0
        less, more = sorted((self.feedback, self.jump)) if self.feedback >= 0 else (math.inf, 0.0)
        if self.feedback >= J and 4 * less <= more and 8 * (J + old) <= more:
            self.feedback, self.strikes, self.phase = more, 0, "LEARN"
        else:
            self.phase = "COMPARE"

    def decide(self, J: float, none: bool, limited: bool) -> set[str]:
        """J: of the trial; none: v was zero; limited: u was at its limit. What is to be done with v."""
        self.growth = 1.1025 if limited else 2.25
        verdict = getattr(self, self.phase.lower())(J, none)
        if none:
            self.feedback = J
        self.last, self.first = J, False
        return verdict

    def learn(self, J: float, _none: bool) -> set[str]:
        if self.first or not self.is_too_much(J, self.growth):
            self.above = 0
            if self.best <= J:
                return {"learn"}
            if self.strikes and self.mark >= 4 * J:
                self.strikes, self.mark = self.strikes - 1, J
            self.best = J
            return {"store", "learn"}
        self.above += 1
        if self.above == 1:
            self.jump = J
        goes_on = self.strikes == 0 if self.above == 1 else self.last >= 1.1025 * J
        if self.above == 5 or (not goes_on and self.jump >= 4 * J):
            self.accept(J)
            return {"store", "learn"}
        if goes_on:
            return {"learn"}
        self.above, self.phase = 0, "REPLAY"
        self.returns += 1
        return {"back"}

    def replay(self, J: float, none: bool) -> set[str]:
        if self.is_too_much(J) or self.best > 1.21 * J:
            self.jump = J
            self.accept(J)
            if none:
                self.strikes, self.phase = 0, "LEARN"
            return {"learn"}
        if self.phase == "REPLAY":
            self.best = J
            self.strike()
            return set()
        if self.wait > 1:
            self.wait -= 1
            return set()
        self.phase = "LEARN"
        return {"learn"}

    hold = replay

    def compare(self, J: float, _none: bool) -> set[str]:
        same = 1.1025 * self.feedback >= J and self.feedback <= 1.1025 * J
        self.feedback, self.phase = J, "LEARN"
        if not same:
            self.strikes = 0
        if self.best <= J:
            return set()
        self.returns += 1
        self.best = J
        if same:
            self.strike()
            return {"clear"}
        return {"clear", "learn"}


@dataclass
class Trial:
    samples: int
    k_1: list[float]
    k_2: float
    n: float
    c: list[float]
    through_integrator: bool
    k_3: float
    shift: int
    limit: float
    learned_limit: float
    num: list[float] = field(default_factory=list)
    den: list[float] = field(default_factory=lambda: [1.0])
    preview: int = 0
    b: list[float] = field(default_factory=lambda: [1.0])
    a: list[float] = field(default_factory=lambda: [1.0])
    odd: bool = False
    filter_signal: bool = False
    learning_matrix: np.ndarray | None = None
    response: float = 0.0
    pole: float = 0.0
    unguarded: bool = False

    def __post_init__(self) -> None:
        self.v = np.zeros(self.samples)
        self.best_v = np.zeros(self.samples)
        self.guard = TrialGuard()

    @property
    def guarded(self) -> bool:
        return not self.unguarded and (self.k_3 != 0 or self.learning_matrix is not None)

    def begin(self, y_ref: np.ndarray) -> None:
        self.y_ref = np.asarray(y_ref, dtype=float)
        self.f = feedforward(self.num, self.den, self.preview, self.y_ref, self.samples + 50)
        self.psi, self.p, self.spoilt = 0.0, 0, False
        self.e = np.zeros(self.samples)
        self.J = 0.0
        self.acting = np.zeros(self.samples) if self.guard.phase == "COMPARE" else self.v
        self.limited = np.zeros(self.samples, dtype=bool)
        self.saturated = self.fault = False
        self.observer = TrialObserver(self.response, self.pole, self.limit) if self.response else None

    def step(self, x: np.ndarray, learn: bool = True) -> float:
        p, held = self.p, min(self.p, self.samples - 1)
        self.p += 1
        self.within = p < self.samples
        x = np.asarray(x, dtype=float)
        self.saturated, self.fault = False, not np.isfinite(x).all()
        if self.fault:
            self.spoilt |= self.within
            if self.observer:
                self.observer.act(-float(self.f[min(p, len(self.f) - 1)]) - self.n * self.acting[held])
            self.terms = dict.fromkeys(("feedback", "integral", "feedforward", "learned"), 0.0)
            return 0.0
        y = float(np.dot(self.c, x))
        self.terms = {
            "feedback": float(np.dot(self.k_1, x)),
            "integral": self.k_2 * self.psi,
            "feedforward": float(self.f[min(p, len(self.f) - 1)]),
            "learned": self.n * self.acting[held],
        }
        e = self.y_ref[held] - y
        if self.observer:
            self.terms["feedback"], self.terms["integral"] = self.observer.step(e)
        self.wanted = math.fsum(self.terms.values())  # Fig. 1
        u = clip(self.wanted, self.limit)
        self.saturated = abs(self.wanted) >= self.limit
        if self.observer:
            self.observer.act(u - self.terms["feedforward"] - self.terms["learned"])
        epsilon = e + self.acting[held] * self.through_integrator
        if not self.saturated or self.k_2 * epsilon * u < 0:
            self.psi += epsilon  # (4)
        if self.within:
            self.e[p] = self.observer.missing if self.observer else e
            self.J += e * e
            self.limited[p] = self.saturated
            self.spoilt |= not learn
        return u

    def end(self) -> bool:
        if self.p < self.samples or self.spoilt:
            return False
        self.spoilt = True
        if not self.guarded:
            self.learn()
            return True
        verdict = self.guard.decide(self.J, not self.v.any(), bool(self.limited.any()))
        if "store" in verdict:
            self.best_v = self.v.copy()
        if "clear" in verdict:
            self.best_v = np.zeros(self.samples)
        if verdict & {"back", "clear"}:
            self.v = self.best_v.copy()
        if "learn" in verdict:
            self.learn()
            share = 8.0**-self.guard.strikes
            self.v = (1 - share) * self.best_v + share * self.v if self.guard.strikes else self.v
        return True

    def learn(self) -> None:
        r, last = self.shift, self.samples - 1
        e = self.e
        e[r:][self.limited[:-r]] = 0  # what u(p) could not do shows in e(p + r)
        e[:r] = 0
        if self.learning_matrix is not None:
            correction = self.learning_matrix @ e
        else:
            e = e if self.filter_signal else self.filtered(e)
            correction = self.k_3 * e[np.minimum(np.arange(self.samples) + r, last)]  # (17), (42)
        v = np.clip(self.v + correction, -self.learned_limit, self.learned_limit)  # (16)
        if self.filter_signal:
            v = np.clip(self.filtered(v), -self.learned_limit, self.learned_limit)
        self.v = v

    def filtered(self, x: np.ndarray) -> np.ndarray:
        return zero_phase(self.b, self.a, x, self.odd) if len(self.b) > 1 else x
