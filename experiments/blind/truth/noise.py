"""Force noise in a band, slow drift, and jitter of the encoder below its count."""

import numpy as np
from scipy import signal

LEVELS = {"low": 0.3, "usual": 1.0, "high": 3.0}


class Noise:
    """Strengths of one machine, rms in N: drawn once; `draw` makes the noise of one run."""

    def __init__(self, rng: np.random.Generator, level: str, dt: float) -> None:
        if level not in LEVELS:
            raise ValueError(f"noise = {level!r}: one of {', '.join(LEVELS)}.")
        scale = LEVELS[level]
        self.motor = scale * np.exp(rng.uniform(np.log(0.5), np.log(1.6)))
        self.load = scale * rng.uniform(0.15, 0.6)
        self.slow = scale * rng.uniform(0.1, 0.5)
        self.corner = rng.uniform(25.0, 90.0)  # Hz
        self.memory = rng.uniform(1.0, 5.0)  # s
        self.jitter = 0.25 * 5e-8  # m
        self.dt = dt

    def draw(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N on the motor side, N on the load side, m at the encoder), n samples each."""
        motor = self.motor * _coloured(rng, n, 1 / (2 * np.pi * self.corner * self.dt))
        slow = self.slow * _coloured(rng, n, self.memory / self.dt)
        load = self.load * _coloured(rng, n, 1 / (2 * np.pi * self.corner * self.dt))
        return motor + slow, load, self.jitter * rng.standard_normal(n)

    def describe(self) -> dict[str, float]:
        """For the answer."""
        return {"motor_N": float(self.motor), "load_N": float(self.load), "slow_N": float(self.slow)}


def _coloured(rng: np.random.Generator, n: int, memory: float) -> np.ndarray:
    """Stationary AR(1) of variance 1, x[k] = a x[k-1] + sqrt(1 - a^2) e[k], a = exp(-1/memory)."""
    a = np.exp(-1 / memory)
    e = rng.standard_normal(n + 1)
    return np.asarray(signal.lfilter([np.sqrt(1 - a * a)], [1, -a], e[1:], zi=[a * e[0]])[0])
