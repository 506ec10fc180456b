"""Contribution of uncertain noise hyperparameters to the posterior of the parameters.

Parameters are drawn conditionally on fixed noise parameters. With ``xi`` the parameters' standard coordinates and
``eta`` the logarithms of the noise parameters, minus the log of their joint density is about
``1/2 |xi|^2 + xi' C (eta - eta_0) + ..``: given eta, xi is normal about ``-C (eta - eta_0)``. Its covariance there is
not that for eta_0 either: stronger gusts make parameters less certain. Its logarithm (a symmetric matrix, zero at
eta_0) is taken as linear in eta, plus the mean of its second-order term. So a conditional draw, scaled and shifted with
a draw of eta, is a draw of the joint posterior (the mean of the conditional covariances and the covariance of the
conditional means of Kass and Steffey 1989, section 2).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.core.numerics import processors
from bayeschute.core.random import stream
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters, as_seen, filter_gains, linearise
from bayeschute.likelihood.kalman import innovations
from bayeschute.likelihood.kalman_gradient import conditional_score, from_vector, to_vector
from bayeschute.posterior.differences import beside
from bayeschute.posterior.marginal import Marginal, latent_path_at, shifted

Array = NDArray[np.float64]


class NoiseEffect(NamedTuple):
    """How the parameters' conditional posterior follows the logarithms of V noise parameters, standard coordinates.

    Attributes:
        slope: Derivatives of its mode (P, V), from `noise_parameter_slope`.
        spread: Derivatives of the logarithm of its covariance, symmetric matrices (V, P, P), from
            `noise_parameter_spread`.
        excess: Mean of that logarithm over the noise parameters (P, P), likewise; in a fit also what misfit adds.
        misfit: That part of it (`score_dispersion`); None: none, or not known apart.
    """

    slope: Array
    spread: Array
    excess: Array
    misfit: Array | None = None

    @classmethod
    def none(cls, parameters: int, noise_parameters: int) -> NoiseEffect:
        """Parameters that don't follow the noise parameters."""
        size = (parameters, parameters)
        return cls(np.zeros((parameters, noise_parameters)), np.zeros((noise_parameters, *size)), np.zeros(size))

    def carried(self, xi: Array, moved: Array) -> Array:
        """Conditional draws for fixed noise parameters, moved to others.

        Args:
            xi: Standard coordinates (..., P).
            moved: By how much the logarithms of the noise parameters differ (..., V); leading axes broadcast.
        """
        return np.asarray(self._stretched(xi, moved, 0.5) + moved @ self.slope.T)

    def taken_back(self, xi: Array, moved: Array) -> Array:
        """The draws that `carried` brings to `xi`; arguments as there."""
        return self._stretched(xi - moved @ self.slope.T, moved, -0.5)

    def _stretched(self, xi: Array, moved: Array, power: float) -> Array:
        """`xi` times a power of the covariance for noise parameters moved so far."""
        values, axes = np.linalg.eigh(self.excess + np.einsum("...v,vij->...ij", moved, self.spread))
        made = axes @ (np.exp(power * values)[..., None] * (np.swapaxes(axes, -1, -2) @ xi[..., None]))
        return np.asarray(made[..., 0])


def noise_parameter_slope(marginal: Marginal, step: float = 0.5) -> Array:
    """Derivatives ``-C`` of the parameters' conditional mode by the noise parameters, in standard coordinates.

    C is the change along every axis of the gradient by eta of ``1/2 |innovations|^2 + log det``, the flights linearised
    anew along the conditional paths there: so the change of the log determinant is in it.

    Args:
        marginal: The posterior for fixed noise parameters.
        step: How far to either side to go along every axis; less far where a flight fails there.

    Returns:
        (P, V), noise parameters in the order of `score.to_vector`.

    Raises:
        FloatingPointError: If flights fail along an axis, however short a way is gone.
    """
    at = to_vector(marginal.hyper)
    like = jax.tree.map(lambda a: np.asarray(a, float), marginal.hyper)

    def gradient(xi: Array) -> Array:
        theta, shift = shifted(marginal, xi)
        total: Array = np.zeros(at.size)
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            linear = linearise(flight, theta, latent_path_at(flight, along, shift))
            seen = as_seen(linear).column(0).less(along.mean_correction)
            total = total + np.asarray(conditional_score(at, like, flight, linear, seen))
        return total

    with ThreadPoolExecutor(processors()) as pool:
        up, down, h = beside(
            lambda points: np.array(list(pool.map(gradient, points))), np.size(marginal.centre), step, "the gradient"
        )
    return np.asarray((down - up) / (2.0 * h))


def noise_parameter_spread(marginal: Marginal, covariance: Array) -> tuple[Array, Array]:
    """How the logarithm of the parameters' covariance follows the noise parameters, in standard coordinates.

    The covariance is that of the flights as they are linearised at theta_0. It is looked at a standard deviation to
    either side along every column of the factor of the noise parameters' own covariance.

    Args:
        marginal: The posterior for fixed noise parameters.
        covariance: Of their logarithms (V, V).

    Returns:
        `spread` and `excess` of `NoiseEffect`, noise parameters in the order of `score.to_vector`.
    """
    at, scale, root = to_vector(marginal.hyper), np.asarray(marginal.scale), np.linalg.cholesky(covariance)
    prior = np.linalg.inv(np.asarray(marginal.prior_factor) @ np.asarray(marginal.prior_factor).T)

    def log_covariance(vector: Array) -> Array:
        hyper, matrix = from_vector(vector, marginal.hyper), prior.copy()
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            matrix[np.ix_(along.parameters, along.parameters)] += _information(flight, hyper, along.linear)
        values, axes = np.linalg.eigh(scale.T @ matrix @ scale)
        return np.asarray(-(axes * np.log(values)) @ axes.T)

    with ThreadPoolExecutor(processors()) as pool:
        here, *beside_it = pool.map(log_covariance, [at, *(at + root.T), *(at - root.T)])
    up, down = np.split(np.array(beside_it) - here, 2)
    by_column = np.linalg.solve(root.T, (0.5 * (up - down)).reshape(len(root), -1))
    return by_column.reshape(up.shape), 0.5 * np.sum(up + down, axis=0)


def _information(flight: FlightData, hyper: NoiseParameters, linear: Linear) -> Array:
    """Gauss-Newton matrix of a flight (K, K), start and process noise eliminated: the filter without the smoother."""
    unit = np.asarray(innovations(filter_gains(flight, hyper, linear), *as_seen(linear)))
    by_theta = unit.reshape(-1, unit.shape[2])[:, 1:]
    return np.asarray(by_theta.T @ by_theta)


def widened(xi: Array, effect: NoiseEffect, covariance: Array, seed: int) -> Array:
    """Unconditional draws from conditional ones, each with its own draw of the noise parameters.

    Args:
        xi: Standard coordinates (..., P).
        effect: Of the noise parameters.
        covariance: Of the logarithms of the noise parameters (V, V).
        seed: Seed.
    """
    z = stream(seed, "noise parameters of the draws").standard_normal((*xi.shape[:-1], len(covariance)))
    return effect.carried(xi, z @ np.linalg.cholesky(covariance).T)


def joint_covariance(scale: Array, effect: NoiseEffect, covariance: Array) -> Array:
    """Covariance of the parameters in the joint posterior (P, P).

    The mean of their covariances is exact for one noise parameter without excess, and to second order beyond that.

    Args:
        scale: Their covariance's factor for fixed noise parameters, as in `Marginal` (P, P).
        effect: Of the noise parameters.
        covariance: Of the logarithms of the noise parameters (V, V).
    """
    square = np.einsum("uv,uij,vjk->ik", covariance, effect.spread, effect.spread)
    mean = scipy.linalg.expm(effect.excess + 0.5 * square)
    return np.asarray(scale @ (mean + effect.slope @ covariance @ effect.slope.T) @ np.asarray(scale).T)
