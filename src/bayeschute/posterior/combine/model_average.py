"""Model averaging of structures: leave-future-out log scores and pseudo-BMA+ weights.

A structure is scored by the log density of every sample given all earlier ones, parameters, start and disturbances
integrated out. The sum over the whole record is the log evidence, which depends on the priors of the terms that
structures don't share: with wider priors it decreases without bound. So the first part of a record is used for training
only, and the samples after it are scored (leave-future-out, one step ahead: Buerkner, Gabry & Vehtari 2020). The
weights are averages over Bayesian bootstraps of the scores, so that structures whose difference is not significant
share the weight (pseudo-BMA+: Yao, Vehtari, Simpson & Gelman 2018). Scores are correlated over seconds, so whole blocks
of time are resampled.

The parameters are integrated out with the marginal posterior's expansion about its mode, to second order: innovations
and log determinants are linear in the parameters, sample by sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.numerics import processors
from bayeschute.likelihood.joint import FlightData, filter_gains, linearise
from bayeschute.likelihood.kalman import Gains
from bayeschute.posterior.differences import beside
from bayeschute.posterior.marginal import Marginal, latent_path_at, shifted

Array = NDArray[np.float64]
TRAINING = 0.25  # share of every record that is used for training and not scored
BLOCKS = 40  # of the Bayesian bootstrap
_BOOTSTRAPS = 4000


class Terms(NamedTuple):
    """Contribution of every sample of a flight to the log density, in standard coordinates xi about the mode.

    The log density of a sample given earlier ones and xi is ``-1/2 |unit - by xi|^2 - constant - tilt xi``.

    Attributes:
        unit: Standardised innovations at the mode (T, C).
        by: Minus their derivatives (T, C, P).
        constant: Log determinants and powers of 2 pi (T,).
        tilt: Derivatives of the log determinants (T, P).
    """

    unit: Array
    by: Array
    constant: Array
    tilt: Array


def _by_sample(flight: FlightData, made: Gains) -> Array:
    """Log determinant of every sample given earlier ones (T,)."""
    scale = np.log(np.diagonal(made.root, axis1=1, axis2=2))
    return np.asarray(np.sum(np.where(flight.present, scale, 0.0), axis=1))


def terms(marginal: Marginal, step: float = 1.0) -> list[Terms]:
    """Contributions of the samples of every flight to the log density.

    Args:
        marginal: The marginal posterior about its mode.
        step: Of the differences of the log determinants [posterior standard deviations]; less where a flight fails.

    Raises:
        FloatingPointError: If flights fail along an axis, however short the step.
    """
    scale = np.asarray(marginal.scale)

    def determinants(xi: Array) -> Array:
        theta, shift = shifted(marginal, xi)
        found = []
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            linear = linearise(flight, theta, latent_path_at(flight, along, shift))
            found.append(_by_sample(flight, filter_gains(flight, marginal.hyper, linear)))
        return np.concatenate(found)

    with ThreadPoolExecutor(processors()) as pool:
        up, down, h = beside(
            lambda points: np.array(list(pool.map(determinants, points))), len(scale), step, "the log determinant"
        )
    ends = np.cumsum([len(np.asarray(flight.present)) for flight in marginal.flights])
    tilts, made = np.split(((up - down) / (2.0 * h)).T, ends[:-1]), []
    for flight, along, tilt in zip(marginal.flights, marginal.along, tilts, strict=True):
        unit = np.asarray(along.unit)
        constant = _by_sample(flight, along.gains) + 0.5 * np.log(2.0 * np.pi) * np.asarray(flight.present).sum(axis=1)
        made.append(Terms(unit[:, :, 0], unit[:, :, 1:] @ scale[along.parameters], constant, tilt))
    return made


def sequential_scores(marginal: Marginal, training: float = TRAINING) -> tuple[Array, Array]:
    """Log density of every sample given all that came before, the parameters integrated out.

    Flights are independent given the parameters, so the openings of all of them come first, then the rests in turn.

    Args:
        marginal: The marginal posterior about its mode.
        training: Share of every flight that is used for training only.

    Returns:
        Scores of the openings and of the rests, flight after flight. The sum of both is the log evidence of the record
        given the noise parameters.
    """
    scale, centre = np.asarray(marginal.scale), np.asarray(marginal.centre)
    mean = np.linalg.solve(scale, np.asarray(marginal.prior_centre) - centre)
    root = np.linalg.solve(scale, np.asarray(marginal.prior_factor))
    flights = terms(marginal)
    cuts = [int(np.ceil(training * len(f.constant))) for f in flights]
    state = (mean, root @ root.T)
    first, state = _scored([Terms(*(a[:n] for a in f)) for f, n in zip(flights, cuts, strict=True)], state)
    later, _ = _scored([Terms(*(a[n:] for a in f)) for f, n in zip(flights, cuts, strict=True)], state)
    return first, later


def _scored(flights: Sequence[Terms], state: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
    """Scores of samples in turn, from a Gaussian (mean, covariance) of xi, and the updated Gaussian."""
    mean, covariance = state
    scores = []
    for flight in flights:
        for unit, by, constant, tilt in zip(*flight, strict=True):
            score = -tilt @ mean + 0.5 * tilt @ covariance @ tilt - constant
            mean = mean - covariance @ tilt
            half = by @ covariance
            lower = np.linalg.cholesky(np.eye(len(unit)) + half @ by.T)
            off, gain = np.linalg.solve(lower, unit - by @ mean), np.linalg.solve(lower, half)
            scores.append(score - 0.5 * off @ off - np.log(np.diag(lower)).sum())
            mean, covariance = mean + gain.T @ off, covariance - gain.T @ gain
    return np.array(scores), (mean, covariance)


class Weights(NamedTuple):
    """Weights of structures.

    Attributes:
        weight: Pseudo-BMA+ weights (K,), which sum to 1.
        score: Sum of the scores (K,).
        behind: Score less that of the best (K,).
        behind_se: Standard error of that over blocks of time (K,).
    """

    weight: Array
    score: Array
    behind: Array
    behind_se: Array


def weights(scores: Array, rng: np.random.Generator, blocks: int = BLOCKS) -> Weights:
    """Pseudo-BMA+ weights from scores by sample.

    Args:
        scores: Log densities (K, N), of the same samples.
        rng: Of the Bayesian bootstrap.
        blocks: Blocks of time that are redrawn together, as equal as can be.

    Raises:
        ValueError: If scores are not finite, or there are fewer samples than two.
    """
    scores = np.atleast_2d(scores)
    if scores.shape[1] < 2 or not np.isfinite(scores).all():
        raise ValueError("scores of structures must be finite, of two samples at least")
    parts = np.array_split(scores, min(blocks, scores.shape[1]), axis=1)
    sums, sizes = np.array([part.sum(axis=1) for part in parts]), np.array([part.shape[1] for part in parts])
    total, samples = sums.sum(axis=0), scores.shape[1]
    best = int(np.argmax(total))
    off = sums - sums[:, [best]]
    drawn = rng.dirichlet(np.ones(len(parts)), _BOOTSTRAPS)
    redrawn = samples * (drawn @ off) / (drawn @ sizes)[:, None]  # blocks may differ in length by a sample
    share = np.exp(redrawn - redrawn.max(axis=1, keepdims=True))
    weight = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    even = np.outer(sizes, off.sum(axis=0)) / samples
    spread = np.sqrt(len(parts)) * np.std(off - even, axis=0, ddof=1)
    return Weights(weight, total, total - total[best], spread)


def counts(weight: Array, draws: int) -> NDArray[np.int64]:
    """Draws of every structure in proportion to the weights (K,), by largest remainder; they sum to `draws`."""
    share = draws * np.asarray(weight) / np.sum(weight)
    whole = np.floor(share).astype(np.int64)
    order = np.argsort(whole - share, kind="stable")
    whole[order[: draws - int(whole.sum())]] += 1
    return whole
