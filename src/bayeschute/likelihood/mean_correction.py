"""Second-order (curvature) correction of the predicted mean of a linearised flight (second-order filter).

Given the parameters, initial state and disturbances are uncertain over a range in which the flight is not quite linear.
The expected states and outputs over that range differ from those on the most probable trajectory by half the curvature
times the covariance; a marginal density without this correction biases parameters by up to half a standard deviation.
It is the term by which a second-order filter differs from an extended Kalman filter (Jazwinski 1970, section 9.3).
"""

from __future__ import annotations

import numpy as np

from bayeschute.core.vectors import Component
from bayeschute.likelihood.joint import (
    FlightData,
    LatentPath,
    Linear,
    NoiseParameters,
    as_seen,
    latent_path_of,
    moved,
    stepped,
)
from bayeschute.likelihood.kalman import Gains, MeanCorrection, Seen, innovations
from bayeschute.likelihood.simulation_smoother import drawn, same_normals

_PAIRS, _FEW = 32, 8  # pairs of trajectories: for the correction itself, and for its derivative
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of the conditional distribution's width at which pairs are tried


def mean(
    flight: FlightData,
    hyper: NoiseParameters,
    made: Gains,
    theta: Component,
    linear: Linear,
    rough: bool = False,
) -> tuple[MeanCorrection, int]:
    """Mean deviation of steps and outputs over the conditional distribution of trajectory, start and disturbances.

    Draws are antithetic pairs about the optimum, so that linear terms cancel exactly. At a sample at which a step of
    either fails, or deviates more than any state of the draws, as beyond an edge of the range that the model can
    simulate, the pair is left out. Where fewer than half of the pairs remain at a sample, all are drawn closer
    together; the result is of second order, so it is divided by the square of that factor.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter of the flight linearised along the path.
        theta: Parameters (P,).
        linear: The flight linearised there, along the conditional optimum.
        rough: Few pairs, close together: sufficient for derivatives of the correction.

    Returns:
        The correction, and how many pairs are left out at any sample at full width.

    Raises:
        FloatingPointError: If at some sample fewer than half remain at every width.
    """
    return _mean(flight, hyper, made, theta, linear, rough)[:2]


def elsewhere(
    flight: FlightData,
    hyper: NoiseParameters,
    made: Gains,
    theta: Component,
    linear: Linear,
    here: MeanCorrection,
    rough_here: MeanCorrection,
) -> MeanCorrection:
    """The correction at parameters near those where it is known: its change by few pairs.

    They are close together, and the deviation is continued to the full width as its square. Where a riser goes slack
    within it, it grows in proportion, and that says four times too much: of a payload under a light canopy whose riser
    jolts as the record begins, single places had log densities 230 too small. So where the change is larger than a
    state scatters at all, the correction is found with all pairs at the full width (0.5 of the scatter is usual where
    canopies are small, 0.05 under mains).

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter of the flight linearised along the path.
        theta: Parameters (P,).
        linear: The flight linearised there, along the conditional optimum.
        here: The correction where it is known.
        rough_here: The same of few pairs.

    Raises:
        FloatingPointError: As of `mean`.
    """
    few, _, scatter = _mean(flight, hyper, made, theta, linear, True)
    change = [np.asarray(a) - np.asarray(b) for a, b in zip(few, rough_here, strict=True)]
    if (np.abs(change[1]) > scatter + 1e-9).any():
        return mean(flight, hyper, made, theta, linear)[0]
    return MeanCorrection(*(np.asarray(a) + b for a, b in zip(here, change, strict=True)))


def _mean(
    flight: FlightData, hyper: NoiseParameters, made: Gains, theta: Component, linear: Linear, rough: bool
) -> tuple[MeanCorrection, int, Component]:
    """See `mean`; with the root mean square deviation of the states over the draws (T, X)."""
    latent_path = linear.latent_path
    pairs, shares = (_FEW, _SHARES[2:]) if rough else (_PAIRS, _SHARES)
    (samples, states), outputs = np.shape(latent_path.path), np.shape(flight.observed)[1]
    blank = Seen(np.zeros((samples, outputs, pairs)), np.zeros((samples, states, pairs)))
    z = same_normals(flight, pairs)
    off = drawn(flight, hyper, made, blank, z)
    by = latent_path_of(flight, hyper, off.unknowns)
    wide, lost = np.repeat(np.asarray(theta)[:, None], 2 * pairs, axis=1), 0
    path = np.repeat(np.asarray(latent_path.path)[..., None], 2 * pairs, axis=2)
    still = [np.asarray(a)[..., None] for a in (linear.residual, linear.defects)]
    for share in shares:
        start, error = (
            np.concatenate([m[..., None] + share * d, m[..., None] - share * d], axis=-1)
            for m, d in zip(map(np.asarray, latent_path[:2]), map(np.asarray, by[:2]), strict=True)
        )
        away = share * np.concatenate([off.states, -off.states], axis=-1)
        residual, defects = stepped(flight, wide, LatentPath(start, error, moved(flight, path, away, wide, 0.0 * wide)))
        both = [np.asarray(a) - b for a, b in zip((residual, defects), still, strict=True)]
        by_pair = [0.5 * (a[..., :pairs] + a[..., pairs:]) for a in both]
        farthest = np.max(np.abs(away), axis=(0, 2))[:, None]
        good = np.isfinite(by_pair[0]).all(axis=1) & (np.abs(by_pair[1]) <= farthest + 1e-9).all(axis=1)
        lost = lost or int((~good.all(axis=0)).sum())
        if (2 * good.sum(axis=1) >= pairs).all():
            less, more = (np.mean(a, axis=-1, where=good[:, None, :]) / share**2 for a in by_pair)
            return MeanCorrection(-less, more), lost, np.sqrt(np.mean(np.asarray(off.states) ** 2, axis=-1))
    raise FloatingPointError("steps under most drawn disturbances about the optimum fail")


def slope(linear: Linear, made: Gains, mean_correction: MeanCorrection) -> Component:
    """Contribution of the correction to the gradient of minus the log density by theta (P,), at the linearisation."""
    seen = as_seen(linear)
    blank = Seen(*(np.concatenate([0.0 * part[..., :1], part[..., 1:]], axis=-1) for part in seen))
    unit = innovations(made, *blank.less(mean_correction))
    unit = unit.reshape(-1, unit.shape[2])
    return -unit[:, 1:].T @ unit[:, 0]
