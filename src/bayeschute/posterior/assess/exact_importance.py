"""Exact joint posterior by importance sampling: the reference for all approximations of the default inference.

Parameters and noise parameters are drawn together from a wide t distribution about the posterior that was found. For
every draw the flight is linearised anew at its conditional optimum, and a few starts and process noise u are drawn by
randomise-then-optimise (Bardsley et al. 2014): data and prior are perturbed by their noise, and u is where the full
simulation fits them along the range of the linear model A_0. The density of such draws is known,

    q(u) = |det Q' A(u)| exp(-1/2 |Q' F(u)|^2) (2 pi)^(-m/2),    Q R = A_0,

with F the whitened residuals of data and prior at u, and A their derivatives there. So p(y, u | theta, eta) / q(u) is
an unbiased estimate of the likelihood, and draws of (theta, eta) weighed by it are those of the exact posterior (Tran
et al. 2013, "importance sampling squared"). The approximations of the default inference (marginal mode, polynomial log
determinant, mean correction, surrogate, fixed noise parameters) enter the proposal only. The variance of the weights
shows how efficient it is.

Of the ratio are left, by Sylvester's identity, ``-1/2 |innovations of F|^2 - log|det M| + 1/2 log det S``: S is the
covariance of the data by the linear model, and ``M = R + J(u) J_0'`` that of one linear model's data with the other's,
driven by the same process noise. A filter that is not symmetric finds its determinant (`cross_determinant`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from bayeschute.core.numerics import processors
from bayeschute.core.random import stream
from bayeschute.likelihood.joint import (
    FlightData,
    LatentPath,
    Linear,
    NoiseParameters,
    Unknowns,
    as_seen,
    disturbed,
    filter_gains,
    latent_path_of,
    linearise,
    residuals,
)
from bayeschute.likelihood.kalman import Seen, innovations
from bayeschute.likelihood.priors import Prior, standard
from bayeschute.likelihood.simulation_smoother import Normals, drawn, normals
from bayeschute.posterior.fit.laplace_fit import LaplaceFit
from bayeschute.posterior.joint_mode import conditional
from bayeschute.posterior.marginal import latent_path_at
from bayeschute.posterior.noise_evidence import NoisePrior, from_vector, to_vector
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.posterior.sampling.independence import Proposal, effective, fitted
from bayeschute.posterior.sampling.sampler_checks import pareto_k

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
_FREEDOM = 30.0  # degrees of freedom of the proposal
_SPREAD = 1.05  # its scale over that of the posterior found
_MOVES, _REST = 8, 1e-4  # most moves of draws onto their perturbed data; root mean square of the last
_GROUP = 50  # draws between two reports of progress


@dataclass(frozen=True)
class Weighed:
    """Draws with their weights.

    Attributes:
        theta: Parameters, working coordinates (N, P).
        log_noise: Logarithms of the noise parameters (N, V).
        log_weight: Minus infinity where no simulation flew (N,).
        scatter: Standard deviation of the logarithms of a draw's estimates of the likelihood (N,).
        moved: Largest last move of a draw's starts and process noise (N,).
        failed: Simulations that failed.
        folded: Draws of start and process noise where the map that made them is not one to one.
    """

    theta: Array
    log_noise: Array
    log_weight: Array
    scatter: Array
    moved: Array
    failed: int
    folded: int

    @property
    def weight(self) -> Array:
        """Normalised (N,)."""
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return effective(self.log_weight)

    @property
    def pareto_k(self) -> float:
        """Tail index of the weights: below 0.7 they can be trusted (Vehtari et al. 2024)."""
        return pareto_k(self.log_weight)


class Following(NamedTuple):
    """Parameters that follow noise parameters as `noise_effect` has them: a t distribution, carried along.

    Attributes:
        base: Of what is carried: standard coordinates as for noise parameters held at `log_noise`, and standard
            coordinates of the noise parameters (P + V).
        log_noise: Logarithms of the noise parameters about which the parameters follow them (V,).
        factor: Lower Cholesky factor of their covariance (V, V).
        effect: How the parameters follow.
    """

    base: Proposal
    log_noise: Array
    factor: Array
    effect: NoiseEffect

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Standard coordinates and logarithms of the noise parameters (count, P + V)."""
        xi, z = np.split(self.base.draw(count, rng), [len(self.effect.slope)], axis=1)
        moved = z @ self.factor.T
        return np.concatenate([self.effect.carried(xi, moved), self.log_noise + moved], axis=1)

    def unfolded(self, points: Array) -> tuple[Array, Array]:
        """What is carried to points (N, P + V), and the logarithm of how much volumes grow on the way there (N,)."""
        here, log_noise = np.split(points, [len(self.effect.slope)], axis=1)
        moved = log_noise - self.log_noise
        xi = self.effect.taken_back(here, moved)
        grown = 0.5 * (np.trace(self.effect.excess) + moved @ np.trace(self.effect.spread, axis1=1, axis2=2))
        z = solve_triangular(self.factor, moved.T, lower=True).T
        return np.concatenate([xi, z], axis=1), grown

    def log_density(self, points: Array) -> Array:
        """Log density (N,) of points (N, P + V), a constant aside."""
        held, grown = self.unfolded(points)
        return np.asarray(self.base.log_density(held) - grown)


def laplace(found: LaplaceFit) -> Following:
    """The Laplace posterior of parameters and noise parameters together, a little wider."""
    size = np.size(found.marginal.centre) + len(found.noise_parameter_covariance)
    base = Proposal(np.zeros(size), _SPREAD * np.eye(size), _FREEDOM)
    factor = np.asarray(np.linalg.cholesky(found.noise_parameter_covariance), float)
    return Following(base, to_vector(found.hyper), factor, found.noise_effect)


def improved(found: LaplaceFit, before: Following, weighed: Weighed) -> Following:
    """The proposal with mean and covariance of weighed draws; repeated, proposals find their way to the posterior."""
    xi = np.linalg.solve(np.asarray(found.marginal.scale), (weighed.theta - np.asarray(found.marginal.centre)).T).T
    held, _ = before.unfolded(np.concatenate([xi, weighed.log_noise], axis=1))
    made = fitted(held, weighed.log_weight)
    return before._replace(base=Proposal(made.middle, _SPREAD * made.factor, _FREEDOM))


class Model(NamedTuple):
    """What `cross_determinant` needs of a linearised flight: `kalman.Gains` without the filter."""

    transition: jax.Array
    output: jax.Array
    noise_gain: jax.Array
    start: jax.Array
    first: jax.Array


@jax.jit
def _model(flight: FlightData, hyper: NoiseParameters, linear: Linear) -> Model:
    made = filter_gains(flight, hyper, linear)  # its covariances are not used, so XLA leaves them out
    return Model(*made.whole(), made.start, made.first)


@jax.jit
def cross_determinant(
    flight: FlightData, hyper: NoiseParameters, one: Model, other: Model
) -> tuple[jax.Array, jax.Array]:
    """Sign and log of ``|det(R + J J_0')|``, R the measurement noise's covariance, J the outputs by start and u.

    Both models run side by side, driven by the same start, process noise and measurement noise. Their cross
    covariance takes the place of the covariance in a Kalman filter; every step eliminates one sample, so innovations'
    determinants multiply to M's.

    Args:
        flight: The record.
        hyper: Noise parameters.
        one: The flight linearised at one latent path.
        other: At another.
    """
    noise, dt = hyper.outputs(flight), flight.dt
    count, states = one.output.shape[1:]
    phi = jnp.exp(-dt / jnp.asarray(noise.time_constant))
    stationary, white = jnp.asarray(noise.correlated) ** 2, jnp.asarray(noise.white) ** 2
    noisy = jnp.zeros((states, states)).at[states - count :, states - count :]
    p = one.start @ other.start.T + one.first @ other.first.T + noisy.set(jnp.diag(stationary))
    noise_covariance = noisy.set(jnp.diag((1.0 - phi**2) * stationary))
    r = jnp.where(jnp.asarray(flight.present), white, 1.0)

    def step(p: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        f, h, g, f_0, h_0, g_0, r = row
        left, right = h @ p, p @ h_0.T
        s = left @ h_0.T + jnp.diag(r)
        p = f @ (p - right @ jnp.linalg.solve(s, left)) @ f_0.T + g @ g_0.T + noise_covariance
        return p, jnp.linalg.slogdet(s)

    rows = (*one[:3], *other[:3], r)
    _, (sign, value) = jax.lax.scan(step, p, rows)
    return jnp.prod(sign), jnp.sum(value)


def _seen(flight: FlightData, linear: Linear, theta: jax.Array, latent_path: LatentPath) -> Seen:
    """What the linear model sees of simulations."""
    return Seen(residuals(flight, theta, latent_path), -disturbed(linear.steps, latent_path))


def _apart(one: Unknowns, other: Unknowns) -> Array:
    """Root mean square distance of standard unknowns (M,)."""
    both = zip(one, other, strict=True)
    away = np.concatenate([(np.asarray(a) - np.asarray(b)).reshape(-1, np.shape(a)[-1]) for a, b in both])
    return np.asarray(np.sqrt(np.mean(away**2, axis=0)))


class Estimates(NamedTuple):
    """What M draws of start and process noise say of a flight's likelihood.

    Attributes:
        log_likelihood: Log of unbiased estimates of p(y | theta, eta); minus infinity where the simulation failed
            (M,).
        moved: Root mean square of the last move of start and process noise: near 0 where draws rest (M,).
        folded: Whether the determinant is negative there: the map from perturbations to draws is not one to one (M,).
    """

    log_likelihood: Array
    moved: Array
    folded: NDArray[np.bool_]


def estimates(
    flight: FlightData, hyper: NoiseParameters, theta: Array, near: LatentPath, numbers: Normals
) -> Estimates:
    """Draw start and process noise given all else by randomise-then-optimise, and estimate the likelihood by each.

    Args:
        flight: The record.
        hyper: Noise parameters.
        theta: Parameters (P,).
        near: A latent path near the conditional optimum.
        numbers: From `drawing.normals`, M draws.
    """
    centre = conditional(flight, hyper, linearise(flight, theta, near)).optimum
    best = linearise(flight, theta, latent_path_of(flight, hyper, centre))
    made, many = filter_gains(flight, hyper, best), np.shape(numbers.start)[1]
    wide = jnp.repeat(jnp.asarray(theta)[:, None], many, axis=1)
    middle = Seen(*(jnp.repeat(a, many, axis=2) for a in as_seen(best).column(0)))
    unknowns = drawn(flight, hyper, made, middle, numbers).unknowns
    for _ in range(_MOVES):
        seen = _seen(flight, best, wide, latent_path_of(flight, hyper, unknowns))
        before, unknowns = unknowns, drawn(flight, hyper, made, seen, numbers).unknowns
        moved = _apart(unknowns, before)
        if np.max(moved, where=np.isfinite(moved), initial=0.0) < _REST:
            break
    latent_path = latent_path_of(flight, hyper, unknowns)
    seen = _seen(flight, best, wide, latent_path)
    constant = float(made.log_determinant) - 0.5 * np.log(2.0 * np.pi) * np.sum(flight.present)
    value = constant - 0.5 * np.sum(np.asarray(innovations(made, *seen)) ** 2, axis=(0, 1))
    folded, there = np.zeros(many, bool), _model(flight, hyper, best)
    for i in np.flatnonzero(np.isfinite(value)):
        linear = linearise(flight, theta, LatentPath(latent_path.start[:, i], latent_path.error[..., i]))
        sign, size = cross_determinant(flight, hyper, _model(flight, hyper, linear), there)
        value[i], folded[i] = value[i] - float(size), float(sign) < 0.0
    return Estimates(np.where(np.isfinite(value), value, -np.inf), moved, folded)


def _both(numbers: Normals) -> Normals:
    """Numbers and their negatives: what is odd about the linear optimum cancels."""
    return Normals(*(np.concatenate([a, -np.asarray(a)], axis=-1) for a in numbers))


def weigh(
    found: LaplaceFit,
    priors: Sequence[Prior],
    noise: NoisePrior,
    proposal: Following,
    draws: int,
    seed: int,
    pairs: int = 1,
    progress: Progress | None = None,
) -> Weighed:
    """Draw parameters and noise parameters, and weigh them by the exact joint density.

    Args:
        found: The posterior found, whose flights are weighed.
        priors: Priors of the parameters.
        noise: Priors of the noise parameters.
        proposal: From `laplace` or `improved`.
        draws: How many.
        seed: Seed.
        pairs: Antithetic pairs of simulations per draw and flight.
        progress: Called with a share done and words.
    """
    points, count = (
        proposal.draw(draws, stream(seed, "points of the importance sampler")),
        np.size(found.marginal.centre),
    )
    theta = np.asarray(found.marginal.centre) + points[:, :count] @ np.asarray(found.marginal.scale).T
    log_noise = points[:, count:]
    log_prior = -0.5 * np.sum(standard(priors, theta) ** 2, axis=1)
    log_prior -= 0.5 * np.sum(((log_noise - to_vector(noise.median)) / noise.log_sd) ** 2, axis=1)

    def one(i: int) -> tuple[float, float, float, int, int]:
        hyper, of_draw = from_vector(log_noise[i], found.hyper), stream(seed, "disturbances of an importance draw", i)
        shift, total, scatter = jnp.asarray(theta[i]) - jnp.asarray(found.marginal.centre), 0.0, 0.0
        moved, failed, folded = 0.0, 0, 0
        for flight, along in zip(found.marginal.flights, found.marginal.along, strict=True):
            made = estimates(
                flight, hyper, theta[i], latent_path_at(flight, along, shift), _both(normals(flight, pairs, of_draw))
            )
            flown = np.isfinite(made.log_likelihood)
            if not flown.any():
                return -np.inf, np.nan, np.nan, failed + 2 * pairs, folded
            total += float(logsumexp(made.log_likelihood)) - np.log(2 * pairs)
            scatter = np.hypot(scatter, made.log_likelihood[flown].std())
            moved = max(moved, float(made.moved[flown].max()))
            failed, folded = failed + int((~flown).sum()), folded + int(made.folded.sum())
        return total, float(scatter), moved, failed, folded

    rows: list[tuple[float, float, float, int, int]] = []
    with ThreadPoolExecutor(processors()) as pool:
        for start in range(0, draws, _GROUP):
            rows += pool.map(one, range(start, min(start + _GROUP, draws)))
            if progress is not None:
                progress(len(rows) / draws, f"{len(rows)} of {draws} draws weighed")
    values, scatter, moved, failed, folded = (np.array(column) for column in zip(*rows, strict=True))
    return Weighed(
        theta,
        log_noise,
        values + log_prior - proposal.log_density(points),
        scatter,
        moved,
        int(failed.sum()),
        int(folded.sum()),
    )
