"""Swings made independently of the filter that fits them: free motion plus kicks at many random instants, plus noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Swing:
    """A swing; one amplitude per channel.

    Attributes:
        frequency: Undamped [Hz].
        damping_ratio: Of the critical damping.
        amplitude: At the start, of what is observed.
        forcing: Intensity of white forcing [unit of the angle / s^1.5].
        colored: Standard deviation of the Ornstein-Uhlenbeck noise.
        tau: Its time constant [s].
        white: Standard deviation of the white noise.
        samples: Their number.
        dt: Their distance [s].
        observed: ``angle`` or ``rate``.
    """

    frequency: float = 1.0
    damping_ratio: float = 0.02
    amplitude: tuple[float, ...] = (1.0, 0.6)
    forcing: float = 0.0
    colored: float = 0.15
    tau: float = 1.0
    white: float = 0.02
    samples: int = 90
    dt: float = 1.0 / 6.0
    observed: str = "rate"

    @property
    def damped_frequency(self) -> float:
        """[Hz]."""
        return self.frequency * float(np.sqrt(1.0 - self.damping_ratio**2))


def make(swing: Swing, rng: np.random.Generator, kicks: int = 20) -> np.ndarray:
    """A record (samples, channels); so many kicks per sample."""
    omega = 2.0 * np.pi * swing.frequency
    b, wd = swing.damping_ratio * omega, omega * np.sqrt(1.0 - swing.damping_ratio**2)
    t = np.arange(swing.samples) * swing.dt
    out = np.empty((swing.samples, len(swing.amplitude)))
    for c, amplitude in enumerate(swing.amplitude):
        free = amplitude * np.exp(-b * t) * np.cos(wd * t + rng.uniform(0.0, 2.0 * np.pi))
        instant = np.sort(rng.uniform(0.0, t[-1], kicks * swing.samples))
        kick = swing.forcing * np.sqrt(t[-1] / instant.size) * rng.standard_normal(instant.size)
        age = t[:, None] - instant
        decay = np.where(age > 0.0, np.exp(-b * np.maximum(age, 0.0)), 0.0)
        if swing.observed == "angle":
            answer = decay * np.sin(wd * age) / wd
        else:
            answer = decay * (np.cos(wd * age) - b / wd * np.sin(wd * age))
        phi = np.exp(-swing.dt / swing.tau)
        noise = np.empty(swing.samples)
        noise[0] = rng.standard_normal()
        for i in range(1, swing.samples):
            noise[i] = phi * noise[i - 1] + np.sqrt(1.0 - phi**2) * rng.standard_normal()
        out[:, c] = free + answer @ kick + swing.colored * noise + swing.white * rng.standard_normal(swing.samples)
    return out


def covariance(swing: Swing) -> np.ndarray:
    """Exact covariance (samples, samples) of one channel without its free motion, by a fine midpoint rule."""
    omega = 2.0 * np.pi * swing.frequency
    b, wd = swing.damping_ratio * omega, omega * np.sqrt(1.0 - swing.damping_ratio**2)
    t = np.arange(swing.samples) * swing.dt
    fine = (np.arange(200 * swing.samples) + 0.5) * swing.dt / 200.0
    age = t[:, None] - fine
    decay = np.where(age > 0.0, np.exp(-b * np.maximum(age, 0.0)), 0.0)
    if swing.observed == "angle":
        answer = decay * np.sin(wd * age) / wd
    else:
        answer = decay * (np.cos(wd * age) - b / wd * np.sin(wd * age))
    forced = swing.forcing**2 * (answer @ answer.T) * swing.dt / 200.0
    colored = swing.colored**2 * np.exp(-np.abs(t[:, None] - t) / swing.tau)
    return forced + colored + swing.white**2 * np.eye(swing.samples)
