"""Aerodynamic coefficients from modes of motion, with uncertainty (report 6.3.1-24, -23, 6.3.2-9, -22).

The closed forms are those of `bayeschute.reduced.cluster_mode_laws` and `bayeschute.reduced.pendulum`; the quantities
measured in a record (period, rate of rotation, load) enter as draws, and coefficients are returned as draws. Masses,
lengths and weights are assumed to be known.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.random import stream
from bayeschute.reduced.cluster_mode_laws import Canopy, flyout_slope, maypole_normal
from bayeschute.reduced.pendulum import Pendulum, normal_slope, pivot_distance, total_damping
from bayeschute.regression.equation_error import fit
from bayeschute.swing.modal import Interval, SwingFit, fit_swing, interval
from bayeschute.swing.spectrum import Peak, multitaper, spectral_peak

_DRAWS = 2000


class ModeCoefficients(NamedTuple):
    """Coefficients from a mode.

    Attributes:
        intervals: By quantity; coefficients without unit or per rad, times [s], lengths [m], rates [rad/s].
        draws: The same as draws.
        swing: The fit behind it, where there is one.
    """

    intervals: Mapping[str, Interval]
    draws: Mapping[str, Float[np.ndarray, " n"]]
    swing: SwingFit | None


def _made(draws: dict[str, np.ndarray], swing: SwingFit | None) -> ModeCoefficients:
    return ModeCoefficients({name: interval(values) for name, values in draws.items()}, draws, swing)


def mean_draws(values: Float[np.ndarray, " N"], rng: np.random.Generator, count: int = _DRAWS) -> np.ndarray:
    """Draws of a series' mean, its samples correlated in time.

    Args:
        values: Samples at a uniform rate, NaN where missing.
        rng: Source of randomness.
        count: Number of draws.

    Returns:
        (count,), unit of the values.

    Raises:
        InputError: If there are fewer than ten samples.
    """
    seen = np.isfinite(values)
    if seen.sum() < 10:
        raise InputError(Fault("mode coefficients", f"{int(seen.sum())} samples", "at least 10"))
    made = fit(np.ones((values.size, 1)), values, ["mean"])
    return np.asarray(made.estimate[0] + made.se[0] * rng.standard_normal(count))


def flyout_coefficients(
    flyout_angle: Float[np.ndarray, " N"],
    q_area: Float[np.ndarray, " N"],
    dt: float,
    canopy: Canopy,
    *,
    band: tuple[float, float] | None = None,
    seed: int = 0,
) -> ModeCoefficients:
    """Total slope of C_N from the period of the flyout (6.3.2-9, linearised about the mean angle).

    Args:
        flyout_angle: Along the window [rad], NaN where missing.
        q_area: q S of one canopy along it [N].
        dt: Sample interval [s].
        canopy: One canopy, with its enclosed air.
        band: Where to look for the mode [Hz]; see `fit_swing`.
        seed: Of the draws.

    Returns:
        ``period`` [s], ``damping_ratio``, ``q_area`` [N], ``normal_slope`` [1/rad].

    Raises:
        InputError: As `fit_swing`.
    """
    rng = stream(seed, "flyout")
    swing = fit_swing(flyout_angle, dt, observed="angle", band=band, settle=False, seed=seed)
    natural = swing.draws["frequency"] / np.sqrt(np.maximum(1.0 - swing.draws["damping_ratio"] ** 2, 1e-6))
    period = 1.0 / natural
    load = mean_draws(np.asarray(q_area, dtype=float), rng, period.size)
    cosine = float(np.cos(np.nanmean(flyout_angle)))
    slope = np.asarray(flyout_slope(canopy, load, period, cosine))
    return _made(
        {"period": period, "damping_ratio": swing.draws["damping_ratio"], "q_area": load, "normal_slope": slope}, swing
    )


def maypole_coefficients(
    azimuth: Float[np.ndarray, " N"],
    radius: Float[np.ndarray, " N"],
    q_area: Float[np.ndarray, " N"],
    dt: float,
    canopy: Canopy,
    *,
    seed: int = 0,
) -> ModeCoefficients:
    """Total C_N at the trim of a maypole from its radius and rate of turn (6.3.2-22).

    Args:
        azimuth: Of one canopy about the middle of the cluster [rad], wrapped or not, NaN where missing.
        radius: Of the canopies' circle [m].
        q_area: q S of one canopy [N].
        dt: Sample interval [s].
        canopy: One canopy, with its enclosed air.
        seed: Of the draws.

    Returns:
        ``turning`` [rad/s], ``period`` [s], ``radius`` [m], ``q_area`` [N], ``normal``.

    Raises:
        InputError: If there are fewer than ten samples or the radius exceeds the length of the lines.
    """
    rng = stream(seed, "maypole")
    turn = unwrapped(np.asarray(azimuth, dtype=float))
    time = np.arange(turn.size) * dt
    line = fit(np.column_stack([np.ones_like(time), time - time.mean()]), turn, ["azimuth", "turning"])
    turning = np.abs(line.estimate[1] + line.se[1] * rng.standard_normal(_DRAWS))
    circle = mean_draws(np.asarray(radius, dtype=float), rng)
    if not (circle < canopy.length).all():
        got = f"a radius of {np.nanmean(radius):.1f} m"
        raise InputError(Fault("maypole", got, f"less than the lines' {float(canopy.length):.1f} m"))
    load = mean_draws(np.asarray(q_area, dtype=float), rng)
    normal = np.asarray(maypole_normal(canopy, load, circle, turning))
    period = 2.0 * np.pi / np.maximum(turning, 1e-12)
    return _made({"turning": turning, "period": period, "radius": circle, "q_area": load, "normal": normal}, None)


def unwrapped(angle: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """An angle without jumps of a turn, across gaps too; NaN stays."""
    out, seen = angle.copy(), np.isfinite(angle)
    out[seen] = np.unwrap(angle[seen])
    return out


def breathing_peak(
    signal: Float[np.ndarray, " N"],
    dt: float,
    band: tuple[float, float],
    *,
    nuisance: Float[np.ndarray, "N k"] | None = None,
    seed: int = 0,
) -> tuple[ModeCoefficients, Peak]:
    """Frequency and damping of the breathing (6.3.2-27) from a signal that it excites, and its spectral peak.

    Riser tensions show breathing more clearly than the descent rate, which follows it late [measured on virtual drops].

    Args:
        signal: Tension or descent rate along the window, NaN where missing; its trend is fitted along.
        dt: Sample interval [s].
        band: Where to look [Hz].
        nuisance: Other causes of the signal's motion, e.g. squares of the swing.
        seed: Of the draws.

    Returns:
        ``frequency`` [Hz], ``damping_ratio``, ``amplitude`` at the start [unit of the signal]; and the peak. Gaps are
        bridged for the spectrum only. Where the damping ratio reaches some tenths there is no mode in the band, only
        broad noise.

    Raises:
        InputError: As `fit_swing` and `spectral_peak`.
    """
    values, known = np.asarray(signal, dtype=float), [np.linspace(-1.0, 1.0, len(signal))]
    if nuisance is not None:
        known += [c - np.mean(c) for c in np.asarray(nuisance, dtype=float).T]
    columns = np.stack([c / max(float(np.std(c)), 1e-300) for c in known], axis=1)
    swing = fit_swing(values, dt, observed="angle", nuisance=columns[:, None], band=band, settle=False, seed=seed)
    seen = np.isfinite(values)
    filled = np.interp(np.arange(values.size), np.flatnonzero(seen), values[seen])
    base = np.column_stack([np.ones(values.size), columns])
    rest = filled - base @ np.linalg.lstsq(base, filled, rcond=None)[0]
    names = ("frequency", "damping_ratio", "amplitude")
    return _made({name: swing.draws[name] for name in names}, swing), spectral_peak(multitaper(rest, dt), *band)


def pendulum_coefficients(swing: SwingFit, pendulum: Pendulum) -> ModeCoefficients:
    """Slope and damping of C_N and the pivot point from a swing (6.3.1-23, -24, -26, -33).

    Args:
        swing: Of the cluster as a whole.
        pendulum: The system, C_A at trim included.

    Returns:
        ``natural_frequency`` [rad/s], ``decay_rate`` [1/s], ``normal_slope`` [1/rad], ``damping`` [s/rad] and
        ``pivot`` [m].
    """
    decay = swing.draws["decay_rate"]
    natural = np.hypot(2.0 * np.pi * swing.draws["frequency"], decay)
    slope = np.asarray(normal_slope(pendulum, natural))
    return _made(
        {
            "natural_frequency": natural,
            "decay_rate": decay,
            "normal_slope": slope,
            "damping": np.asarray(total_damping(pendulum, decay)),
            "pivot": np.asarray(pivot_distance(pendulum, slope)),
        },
        swing,
    )
