"""Filter error method: likelihood of the innovations of an extended Kalman filter (Jategaonkar 2015, chapter 5).

The default fit linearises a flight about its most probable trajectory (iterated smoother). Here the flight is
linearised again at every filtered state, with latent disturbances and correlated measurement noise in the state of the
filter: there is no smoothing, so the simulation of an unstable flight can't diverge from its record. For a linear
flight both are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from bayeschute.core.vectors import Component
from bayeschute.likelihood.joint import FlightData, NoiseParameters
from bayeschute.likelihood.priors import Prior, precision, standard, working

Array = NDArray[np.float64]


class Filtered(NamedTuple):
    """Result of the filter.

    Attributes:
        terms: Log density of every sample given all earlier ones (T,).
        innovations: Standardised, zero where no datum exists (T, C).
        states: Filtered states of the flight model (T, X).
        latent: Filtered latent processes (T, L).
    """

    terms: jax.Array
    innovations: jax.Array
    states: jax.Array
    latent: jax.Array


@jax.jit
def extended_filter(data: FlightData, hyper: NoiseParameters, theta: Component) -> Filtered:
    """Run an extended Kalman filter over a flight.

    The state is (x, l, a): flight, latent processes, correlated residual noise.

    Args:
        data: The record.
        hyper: Noise parameters.
        theta: Parameters (P,).
    """
    model, made, noise = data.model, hyper.dynamics(data), hyper.outputs(data)
    numbers, inputs = model.numbers(jnp.asarray(theta)), model.inputs()
    observed, present = jnp.asarray(data.observed), jnp.asarray(data.present)
    phi = jnp.exp(-data.dt / jnp.asarray(noise.time_constant))
    stationary, white = jnp.asarray(noise.correlated) ** 2, jnp.asarray(noise.white) ** 2
    size, c = data.latent.size, observed.shape[1]
    still = jnp.zeros(data.starts)
    by_start = jax.jacfwd(lambda d: model.initial(numbers, d))(still) * jnp.asarray(data.start_scale)
    x = model.initial(numbers, still)
    spread = jax.scipy.linalg.block_diag(by_start @ by_start.T, made.first @ made.first.T, jnp.diag(stationary))

    def correct(mean: tuple, p: jax.Array, row: tuple) -> tuple[tuple, jax.Array, tuple]:
        z, here, now = row
        x, e, a = mean
        y = model.observe(x, numbers, now)
        by_state = jax.jacfwd(lambda s: model.observe(s, numbers, now))(x)
        h = jnp.concatenate([by_state, jnp.zeros((c, size)), jnp.eye(c)], axis=1)
        h = jnp.where(here[:, None], h, 0.0)
        error = jnp.where(here, z - y - a, 0.0)
        hp = h @ p
        root = jnp.linalg.cholesky(hp @ h.T + jnp.diag(jnp.where(here, white, 1.0)))
        unit = jax.scipy.linalg.solve_triangular(root, error, lower=True)
        half = jax.scipy.linalg.solve_triangular(root, hp, lower=True)
        move = half.T @ unit
        logs = jnp.log(jnp.diagonal(root)) + 0.5 * jnp.log(2.0 * jnp.pi)
        term = -0.5 * unit @ unit - jnp.sum(jnp.where(here, logs, 0.0))
        n = x.shape[0]
        moved = (x + move[:n], e + move[n : n + size], a + move[n + size :])
        return moved, p - half.T @ half, (term, unit, *moved[:2])

    def forecast_flights(mean: tuple, p: jax.Array, now: Component, then: Component) -> tuple[tuple, jax.Array]:
        x, e, a = mean
        e0, e1 = made.output @ e, made.output @ (made.transition @ e)

        def advance(x: Component, e0: Component, e1: Component) -> Component:
            return model.advance(x, numbers, now, then, e0, e1)

        by_x, by_now, by_then = jax.jacfwd(advance, argnums=(0, 1, 2))(x, e0, e1)
        by_latent = by_now @ made.output + by_then @ (made.output @ made.transition)
        top = jnp.concatenate([by_x, by_latent, jnp.zeros((x.shape[0], c))], axis=1)
        below = jax.scipy.linalg.block_diag(made.transition, jnp.diag(phi))
        f = jnp.concatenate([top, jnp.concatenate([jnp.zeros((size + c, x.shape[0])), below], axis=1)])
        g = jnp.concatenate([by_then @ (made.output @ made.noise_gain), made.noise_gain, jnp.zeros((c, size))])
        drift = jnp.concatenate([jnp.zeros(x.shape[0] + size), (1.0 - phi**2) * stationary])
        p = f @ (0.5 * (p + p.T)) @ f.T + g @ g.T + jnp.diag(drift)
        return (advance(x, e0, e1), made.transition @ e, phi * a), p

    def step(state: tuple, row: tuple) -> tuple[tuple, tuple]:
        mean, p, before = state
        mean, p = forecast_flights(mean, p, before, row[2])
        mean, p, seen = correct(mean, p, row)
        return (mean, p, row[2]), seen

    first = jax.tree.map(lambda a: jnp.asarray(a)[0], inputs)
    rest = jax.tree.map(lambda a: jnp.asarray(a)[1:], inputs)
    mean, p, seen = correct((x, jnp.zeros(size), jnp.zeros(c)), spread, (observed[0], present[0], first))
    _, later = jax.lax.scan(jax.checkpoint(step), (mean, p, first), (observed[1:], present[1:], rest))
    return Filtered(*(jnp.concatenate([a[None], b]) for a, b in zip(seen, later, strict=True)))


def log_density(data: FlightData, hyper: NoiseParameters, theta: Component) -> jax.Array:
    """Log density of a record's innovations."""
    return jnp.sum(extended_filter(data, hyper, theta).terms)


_slope = jax.jit(jax.value_and_grad(log_density, argnums=2))


class Estimate(NamedTuple):
    """Most probable parameters (P,), their Laplace covariance (P, P), the cost there, and whether the search ended."""

    theta: Array
    covariance: Array
    cost: float
    converged: bool


def minimise(cost: Callable[[Array], tuple[float, Array]], theta: Array, scale: Array, step: float = 0.02) -> Estimate:
    """Minimum of a cost with gradient by quasi-Newton steps, and its curvature by differences of the gradient.

    Args:
        cost: Value and gradient (P,) at (P,).
        theta: Where to start (P,).
        scale: Rough standard deviations, the units of the search (P,).
        step: Length of the differences, over the standard deviation that the search finds.
    """

    def scaled(xi: Array) -> tuple[float, Array]:
        value, gradient = cost(theta + scale * xi)
        bad = not np.isfinite(value) or not np.isfinite(gradient).all()
        return (1e30, np.zeros_like(xi)) if bad else (float(value), scale * gradient)

    found = scipy.optimize.minimize(scaled, np.zeros_like(theta), jac=True, method="BFGS", options={"gtol": 1e-3})
    sd = np.sqrt(np.diag(found.hess_inv))
    rows = []
    for i, s in enumerate(sd):
        move = step * s * np.eye(theta.size)[i]
        rows.append((scaled(found.x + move)[1] - scaled(found.x - move)[1]) / (2.0 * step * s))
    curvature: Array = np.array(rows)
    covariance = scipy.linalg.inv(0.5 * (curvature + curvature.T)) * np.outer(scale, scale)
    # the gradient's length in standard deviations: expected decrease
    left = float(np.abs(found.jac @ (covariance / np.outer(scale, scale)) @ found.jac))
    return Estimate(theta + scale * found.x, covariance, float(found.fun), left < 1e-4)


def fit(
    flights: Sequence[FlightData],
    hyper: NoiseParameters,
    priors: Sequence[Prior],
    theta: Array,
    scale: Array | None = None,
) -> Estimate:
    """Most probable parameters under the innovations' likelihood.

    Args:
        flights: Records.
        hyper: Noise parameters, fixed.
        priors: Priors of the parameters.
        theta: Where to start (P,).
        scale: Rough standard deviations of the result (P,); the priors' where None.
    """
    (centre, sd), before = working(priors), precision(priors)

    def cost(at: Array) -> tuple[float, Array]:
        value, gradient = 0.5 * float(np.sum(standard(priors, at) ** 2)), before @ (at - centre)
        for flight in flights:
            v, g = _slope(flight, hyper, jnp.asarray(at))
            value, gradient = value - float(v), gradient - np.asarray(g)
        return value, gradient

    return minimise(cost, np.asarray(theta, float), sd if scale is None else scale)
