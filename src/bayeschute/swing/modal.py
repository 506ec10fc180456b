"""Period, amplitude and damping of a swing from its record, with intervals for colored noise and random forcing.

The swing is a damped oscillation (report, 6.3.1-22..28) in any number of channels that share frequency and damping (the
two directions of a pendulum), excited by unknown random forcing and measured in colored noise. The forcing dominates
the uncertainty: gusts sustain a swing and disturb its phase, so that intervals of frequency and damping from a free
damped sinusoid are several times too narrow.

Amplitude: a gravity pendulum's frequency falls by 1/16 of the square of its amplitude; `amplitude_effect` says how much
that is, `compare_halves` whether the record shows such a change or any other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.random import seed_of, stream
from bayeschute.swing.oscillator import Observed
from bayeschute.swing.swing_draws import Optimum, importance, optimum
from bayeschute.swing.swing_posterior import SwingProblem, solve, whitened
from bayeschute.swing.swing_record import averaged, read_swing, settled, strongest, trimmed

SAMPLES_PER_CYCLE = 6.0  # the fit sees no more: beyond some harmonics the noise is not what the model says
LEAST_CYCLES = 3.0
LEVEL = 0.9
_NYQUIST_SHARE = 0.4  # highest frequency looked for, over the sampling rate
_DRAWS = 1000
_TRUSTED_ESS = 50.0


class Interval(NamedTuple):
    """A quantity with its uncertainty.

    Attributes:
        mean: Posterior mean.
        sd: Posterior standard deviation.
        low: Lower limit of the central 90 % interval.
        high: Upper limit.
    """

    mean: float
    sd: float
    low: float
    high: float


def interval(draws: Float[np.ndarray, " n"], level: float = LEVEL) -> Interval:
    """Mean, standard deviation and central interval of draws."""
    low, high = np.quantile(draws, [0.5 - level / 2.0, 0.5 + level / 2.0])
    return Interval(float(np.mean(draws)), float(np.std(draws)), float(low), float(high))


@dataclass(frozen=True)
class SwingFit:
    """Modal parameters of a swing from its record.

    Attributes:
        frequency: Damped frequency omega_d/(2 pi) [Hz].
        damping_ratio: b over natural frequency; negative for a growing swing.
        period: [s].
        decay_rate: b [1/s].
        amplitude: Semi-major axis at the start of the fit, as an angle [rad if the data are in rad or rad/s].
        size: Root mean square over the fit, all channels together, as an angle.
        noise: Medians of the forcing [rad/s^1.5], of the standard deviations ``colored`` and ``white`` [unit of the
            data] and of the time constant ``tau`` [s].
        draws: Equally likely draws of ``frequency``, ``damping_ratio``, ``decay_rate``, ``amplitude`` (n,).
        ess: Effective number of draws behind them.
        trusted: Whether that is enough.
        start: Time left out at the beginning [s].
        time: Times of the samples fitted, from the record's first [s] (N,).
        innovations: Standardised one-step errors at the optimum (N, C), NaN where missing.
        cycles: Periods in the fit.
        problem: The data that were fitted.
    """

    frequency: Interval
    damping_ratio: Interval
    period: Interval
    decay_rate: Interval
    amplitude: Interval
    size: float
    noise: Mapping[str, float]
    draws: Mapping[str, Float[np.ndarray, " n"]]
    ess: float
    trusted: bool
    start: float
    time: Float[np.ndarray, " N"]
    innovations: Float[np.ndarray, "N C"]
    cycles: float
    problem: SwingProblem


def fit_swing(
    data: Float[np.ndarray, "T ..."],
    dt: float,
    *,
    observed: Observed = "rate",
    nuisance: Float[np.ndarray, "T C k"] | None = None,
    band: tuple[float, float] | None = None,
    forcing: bool = True,
    settle: bool = True,
    seed: int = 0,
) -> SwingFit:
    """Fit a damped, forced swing to a record.

    Args:
        data: Angle or rate along time, one column per direction; NaN where missing. Offsets are fitted.
        dt: Sample interval [s]; samples are averaged down to about six per cycle.
        observed: ``"angle"`` or ``"rate"``.
        nuisance: Regressors whose coefficient all columns share (`bayeschute.swing.hanging`).
        band: Where to look for the swing [Hz]; from three cycles per record to a sixth of the sampling rate where none
            is given.
        forcing: Whether gusts may force the swing. Without, intervals are those of a free decay: several times too
            narrow in air that moves.
        settle: Leave out a beginning (an opening, a release) whose disturbances are larger than later ones.
        seed: Of the draws.

    Returns:
        The fit.

    Raises:
        InputError: For a record that is too short, constant, or of the wrong shape.
    """
    record = read_swing(data, nuisance, dt)
    low, high = band or (3.0 / (dt * record.data.shape[0]), 1.0 / (SAMPLES_PER_CYCLE * dt))
    high = min(high, _NYQUIST_SHARE / dt)
    if not 0.0 < low < high:
        raise InputError(Fault("swing, band", f"{low:g} to {high:g} Hz", "0 < low < high", "Take a longer record."))
    frequency = strongest(record, dt, low, high)
    every = max(int(1.0 / (SAMPLES_PER_CYCLE * frequency * dt)), 1)
    coarse, step = averaged(record, every), every * dt
    dropped = 0
    while True:
        here = trimmed(coarse, dropped)
        cycles = here.data.shape[0] * step * frequency
        if cycles < LEAST_CYCLES:
            got = f"{cycles:.1f} cycles of {frequency:.3g} Hz"
            raise InputError(Fault("swing", got, f"at least {LEAST_CYCLES:g}", "Take a longer record or set the band."))
        scale = float(np.nanstd(here.data))
        if not scale > 0.0:
            raise InputError(Fault("swing", "a constant record", "one that swings"))
        problem = SwingProblem(here.data, here.nuisance, step, observed, forcing, frequency, (low, high), scale)
        at = optimum(problem)
        innovations = _innovations(problem, at.psi)
        half = max(int(round(0.5 / (frequency * step))), 1)
        enough = cycles - 0.5 >= max(LEAST_CYCLES, 0.5 * coarse.data.shape[0] * step * frequency)
        if not (settle and enough) or settled(innovations, 2 * half):
            break
        dropped += half
    return _report(problem, at, innovations, dropped * step, 0.5 * (every - 1) * dt, every, seed)


def _innovations(problem: SwingProblem, psi: np.ndarray) -> np.ndarray:
    """One-step errors of the channels at a parameter set, what is linear fitted."""
    white, linear = whitened(problem, psi[None])
    errors = [z[0] - X[0] @ linear[0] for X, z in white]
    seen = np.isfinite(problem.data[:, :1])
    return np.where(seen, np.stack(errors, axis=1), np.nan)


def _amplitudes(problem: SwingProblem, psi: np.ndarray, attenuation: float, rng: np.random.Generator) -> np.ndarray:
    """Draws of the semi-major axis at the start, as an angle, for draws of the parameters (n,)."""
    C = problem.data.shape[1]
    made = solve(problem, psi)
    noise = rng.standard_normal(made.linear.shape)
    root = np.linalg.cholesky(made.precision)
    linear = made.linear + np.linalg.solve(np.swapaxes(root, 1, 2), noise[:, :, None])[:, :, 0]
    waves = np.stack([linear[:, 2 * c : 2 * c + 2] for c in range(C)], axis=1)  # (n, C, 2)
    axes = np.linalg.svd(waves, compute_uv=False)[:, 0] / attenuation
    return np.asarray(axes / _natural(psi) if problem.observed == "rate" else axes)


def _natural(psi: np.ndarray) -> np.ndarray:
    """omega_n [rad/s]."""
    return np.asarray(np.hypot(np.exp(psi[:, 0]), psi[:, 1]))


def _report(
    problem: SwingProblem, at: Optimum, innovations: np.ndarray, start: float, offset: float, every: int, seed: int
) -> SwingFit:
    """Draws and their statistics."""
    rng = stream(seed, "posterior of a swing")
    posterior = importance(problem, at, rng)
    place = np.minimum(
        np.searchsorted(np.cumsum(posterior.weight), (rng.random() + np.arange(_DRAWS)) / _DRAWS),
        len(posterior.weight) - 1,
    )
    psi = posterior.psi[place]
    frequency, decay = np.exp(psi[:, 0]) / (2.0 * np.pi), psi[:, 1]
    attenuation = float(np.sinc(np.mean(frequency) * problem.dt)) if every > 1 else 1.0
    draws = {
        "frequency": frequency,
        "damping_ratio": decay / _natural(psi),
        "decay_rate": decay,
        "amplitude": _amplitudes(problem, psi, attenuation, rng),
    }
    fluctuation = problem.data - np.nanmean(problem.data, axis=0)
    size = float(np.sqrt(np.nansum(np.nanmean(fluctuation**2, axis=0)))) / attenuation
    middle = np.median(psi, axis=0)
    return SwingFit(
        frequency=interval(frequency),
        damping_ratio=interval(draws["damping_ratio"]),
        period=interval(1.0 / frequency),
        decay_rate=interval(decay),
        amplitude=interval(draws["amplitude"]),
        size=size / float(_natural(middle[None])[0]) if problem.observed == "rate" else size,
        noise=dict(zip(("forcing", "colored", "tau", "white"), np.exp(middle[2:]).tolist(), strict=True)),
        draws=draws,
        ess=posterior.ess,
        trusted=posterior.ess >= _TRUSTED_ESS,
        start=start,
        time=start + offset + np.arange(problem.data.shape[0]) * problem.dt,
        innovations=innovations,
        cycles=float(problem.data.shape[0] * problem.dt * np.mean(frequency)),
        problem=problem,
    )  # fmt: skip


class Halves(NamedTuple):
    """A swing's two halves.

    Attributes:
        first: Fit of the first half.
        second: Fit of the second half.
        frequency_change: Second minus first [Hz].
        damping_change: Second minus first damping ratio.
    """

    first: SwingFit
    second: SwingFit
    frequency_change: Interval
    damping_change: Interval


def compare_halves(fit: SwingFit, seed: int = 0) -> Halves:
    """Fit the halves of a record apart: does the frequency change, with amplitude or for any other reason?

    Args:
        fit: Of the whole record.
        seed: Of the draws.

    Returns:
        Both fits and the change.

    Raises:
        InputError: If a half is too short.
    """
    p = fit.problem
    half = p.data.shape[0] // 2
    near = max(0.25 * p.frequency, 1.0 / (half * p.dt))
    band = (max(p.frequency - near, 0.1 * p.frequency), p.frequency + near)

    def part(where: slice, name: str) -> SwingFit:
        return fit_swing(
            p.data[where], p.dt, nuisance=p.nuisance[where], observed=p.observed, band=band, forcing=p.forcing,
            settle=False, seed=seed_of(seed, "half of a record", name),
        )  # fmt: skip

    first, second = part(slice(half), "first"), part(slice(half, None), "second")
    change = interval(second.draws["frequency"] - first.draws["frequency"])
    damping = interval(second.draws["damping_ratio"] - first.draws["damping_ratio"])
    return Halves(first, second, change, damping)


def amplitude_effect(semi_major: float, semi_minor: float = 0.0) -> tuple[float, float]:
    """Change of a gravity pendulum's frequency by its amplitude, and the turning of its ellipse, to second order.

    Args:
        semi_major: Semi-axis of the swing [rad].
        semi_minor: The other one [rad]; 0 in a plane.

    Returns:
        Relative change of frequency, -(a^2 + b^2)/16, and rate of turn over frequency, 3 a b/8.
    """
    return -(semi_major**2 + semi_minor**2) / 16.0, 3.0 * semi_major * semi_minor / 8.0
