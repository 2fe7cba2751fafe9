"""Speed from an encoder's counts and edge times, as docs/theory/sensors.md has it, and by an observer."""

import numpy as np


def counted(counts: np.ndarray, per_revolution: int, window: int, ts: float) -> np.ndarray:
    """Speed by M: the difference over the window. The rotor stands before the first count."""
    before = np.concatenate([np.full(window, counts[0]), counts])[: len(counts)]
    return (counts - before) * 2 * np.pi / per_revolution / (window * ts)


def timed(
    edges: np.ndarray, directions: np.ndarray, samples: np.ndarray, step: float, last_interval: bool
) -> np.ndarray:
    """Speed by MT or T at each sample after the second edge. `edges`, `samples`: s; `directions`: +-1."""
    passed = np.searchsorted(edges, samples, side="right")
    speeds, before = [], passed[0]
    for now, t in zip(passed[1:], samples[1:], strict=True):
        moved = directions[before:now].sum()
        if moved != 0 and not last_interval:
            speeds.append(moved * step / (edges[now - 1] - edges[before - 1]))
        elif directions[now - 1] != directions[now - 2]:
            speeds.append(0.0)
        else:
            longest = max(edges[now - 1] - edges[now - 2], t - edges[now - 1])
            speeds.append(directions[now - 1] * step / longest)
        before = now
    return np.array(speeds)


def observed(theta: np.ndarray, bandwidth: float, ts: float, omega: float) -> np.ndarray:
    """Angle, speed and acceleration of the observer, poles at exp(-bandwidth ts), from an unwrapped angle.

    The gains are not those of the C text: they are found by placing the poles of (I - L C) A.
    """
    A = np.array([[1, ts, ts**2 / 2], [0, 1, ts], [0, 0, 1]])
    C = np.array([1.0, 0.0, 0.0])
    p = np.exp(-bandwidth * ts)
    # Ackermann for the predictor form A (I - L C), which has the same poles
    shifted = np.linalg.matrix_power(A - p * np.eye(3), 3)
    observability = np.vstack([C @ A, C @ A @ A, C @ A @ A @ A])
    L = shifted @ np.linalg.solve(observability, np.array([0.0, 0.0, 1.0]))
    x, states = np.array([theta[0] - omega * ts, omega, 0.0]), []
    for angle in theta:
        x = A @ x
        x = x + L * (angle - x[0])
        states.append(x)
    return np.array(states)
