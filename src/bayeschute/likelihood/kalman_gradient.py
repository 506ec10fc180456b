"""Gradient of the Kalman-filter deviance with respect to the noise parameters, by a smoother (adjoint recursion).

The deviance is ``1/2 sum_c |innovations of series c|^2 + log det``. Backwards in the filter run the adjoints of its
predicted means, -r, and of its predicted covariances, ``1/2 (N - sum_c r_c r_c')``, with the r and N of Durbin and
Koopman (2012, section 4.4); from them follow the derivatives by transition, process noise and measurement noise
(Koopman and Shephard 1992, for the process noise). That is one pass over the record, whatever the number of noise
parameters.

The noise parameters enter through a few small matrices only (`Parts`): the derivatives with respect to those are summed
along the flight, and multiplied by the Jacobian of the map from the parameters to them (vector-Jacobian product).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular

from bayeschute.compiler.machine import takes
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component
from bayeschute.likelihood.filter_code import passes
from bayeschute.likelihood.joint import FlightData, Linear, NoiseParameters
from bayeschute.likelihood.kalman import Gains, Seen, covariances, forward

Array = NDArray[np.float64]


class Parts(NamedTuple):
    """Matrices of a flight's state-space model that depend on the noise parameters; L latent states, C outputs.

    Attributes:
        transition: Of the latent processes (L, L).
        noise_gain: Factor of their process noise (L, L).
        first: The first ones (L, L).
        kept: AR(1) coefficients of the residual noise (C,).
        stationary: Its stationary variances (C,).
        white: Variances of its white part (C,).
    """

    transition: Component
    noise_gain: Component
    first: Component
    kept: Component
    stationary: Component
    white: Component


class Pass(NamedTuple):
    """A flight's filter run over series (T, C, M).

    Attributes:
        gains: The filter.
        latents: From `kalman.covariances`.
        noises: Likewise.
        unit: Standardised innovations (T, C, M).
        weighted: ``S^-1`` times the innovations (T, C, M).
        predicted: Predicted means (T, S, M).
    """

    gains: Gains
    latents: Component
    noises: Component
    unit: Component
    weighted: Component
    predicted: Component


def to_vector(hyper: NoiseParameters) -> Array:
    """Logarithms of all noise parameters in one vector (V,)."""
    return np.log(np.concatenate([np.ravel(np.asarray(a, float)) for a in jax.tree.leaves(hyper)]))


def from_vector(vector: Component, like: NoiseParameters) -> NoiseParameters:
    """The inverse of `to_vector`, in the form of another set of noise parameters."""
    leaves, form = jax.tree.flatten(like)
    ends = np.cumsum([np.size(leaf) for leaf in leaves])
    parts = zip(ends - [np.size(leaf) for leaf in leaves], ends, leaves, strict=True)
    exp = library_of(vector).exp
    return jax.tree.unflatten(form, [exp(vector[first:end]).reshape(np.shape(leaf)) for first, end, leaf in parts])


def parts(flight: FlightData, hyper: NoiseParameters) -> Parts:
    """Matrices of a flight's state-space model for given noise parameters."""
    made, noise = hyper.dynamics(flight), hyper.outputs(flight)
    kept = library_of(noise).exp(-flight.dt / noise.time_constant)
    return Parts(made.transition, made.noise_gain, made.first, kept, noise.correlated**2, noise.white**2)


def run(flight: FlightData, hyper: NoiseParameters, linear: Linear, seen: Seen) -> Pass:
    """Run a linearised flight's filter."""
    steps, latent, noise = linear.without_theta().steps, hyper.dynamics(flight), hyper.outputs(flight)
    present = flight.present
    made, latents, noises = covariances(steps, flight.start_scale, latent, noise, flight.dt, present, score=True)
    return Pass(made, latents, noises, *forward(made, *seen))


class Sums(NamedTuple):
    """Derivatives by matrices of the steps, summed along a flight, and the adjoint of the first covariance (S, S)."""

    transition: Component
    noise_gain: Component
    kept: Component
    drift: Component
    white: Component
    adjoint: Component


class _Series(NamedTuple):
    """What the adjoint recursion runs along.

    Attributes:
        inner: ``S^-1`` less the squares of the weighted innovations (T, C, C).
        weighted: These (T, C, K).
        means: Filtered means of latent states and residual noise (T, K, L + C).
        way: By which processes enter the simulation's states: the transition has ``.. + way @ transition``, the noise
            ``way @ shock`` (T - 1, X, L).
    """

    inner: Component
    weighted: Component
    means: Component
    way: Component


def slope(flight: FlightData, hyper: NoiseParameters, linear: Linear, done: Pass, mix: Component) -> Parts:
    """Derivatives of ``1/2 |innovations of series @ mix|^2 + log det`` of a flight by `Parts`.

    By machine code where nothing is being traced, else by JAX.

    Args:
        flight: The record.
        hyper: Noise parameters.
        linear: The flight linearised.
        done: From `run`.
        mix: Combinations of its series (M, K), held fixed.

    Returns:
        The derivatives, in the form of the parts.
    """
    series = _series(done, linear.steps.by_then, hyper.dynamics(flight).output, mix)
    if takes(done, mix) and done.gains.by_state.shape[0]:
        sums = Sums(*passes.score(done.gains, series, done.latents, done.noises))
    else:
        sums = _sums(done.gains, series, done.latents, done.noises)
    return _by_parts(flight, hyper, sums)


def _series(done: Pass, by_then: Component, output: Component, mix: Component) -> _Series:
    made, x = done.gains, done.gains.output.shape[2]
    filtered = done.predicted[:, x:] + made.gain[:, x:] @ (made.root @ done.unit)
    weighted, means = done.weighted @ mix, filtered @ mix
    inner = np.swapaxes(made.inverse, 1, 2) @ made.inverse - weighted @ np.swapaxes(weighted, 1, 2)
    return _Series(inner, weighted, np.swapaxes(means, 1, 2), by_then @ output)


@jax.jit
def _sums(made: Gains, series: _Series, latents: jax.Array, noises: jax.Array) -> Sums:
    """The adjoint recursion by JAX alone."""
    x, size, c = made.output.shape[2], len(made.transition), made.output.shape[1]
    split, phi = x + size, jnp.asarray(made.kept)

    # The recursion of z = N - r r' itself: with w = S^-1 v, u = L' r, it gains H' (S^-1 - w w') H - H' w u' - u w' H.
    # z is kept exactly symmetric: rounding that is not would grow as the flight does without its data, and an open loop
    # that doubles within a sample makes the gradient worthless.
    def step(later: tuple[jax.Array, jax.Array], row: tuple) -> tuple[tuple[jax.Array, jax.Array], tuple]:
        r, z = later
        by_state, by_latent, way, h, here, gain, inner, w, latents, noises, means = row
        f = jnp.zeros((split, split)).at[:x, :x].set(by_state).at[:x, x:].set(by_latent)
        f = f.at[x:, x:].set(made.transition)
        by_way, way_r = way.T @ z[:x] + z[x:split], way.T @ r[:x] + r[x:split]
        kept = jnp.sum(z[split:] * noises.T, axis=1) - jnp.sum(r[split:] * means[:, size:].T, axis=1)
        latent = by_way @ latents - way_r @ means[:, :size]
        noise_gain = by_way[:, :x] @ way + by_way[:, x:split]
        drift = jnp.diagonal(z)[split:]
        back = jnp.concatenate([f.T @ r[:split], phi[:, None] * r[split:]])
        body, cross = f.T @ z[:split, :split] @ f, (f.T @ z[:split, split:]) * phi
        body = 0.5 * (body + body.T)
        own = z[split:, split:] * (phi[:, None] * phi)
        z = jnp.concatenate([jnp.concatenate([body, cross], 1), jnp.concatenate([cross.T, own], 1)])
        pulled, g = gain.T @ z, gain.T @ back
        mixed = w @ g.T
        d = inner + pulled @ gain
        white = 0.5 * here * (jnp.diagonal(d) + 2.0 * jnp.diagonal(mixed))
        d = 0.5 * d + mixed
        half = jnp.concatenate([d @ h, jnp.zeros((c, size)), d * here], axis=1) - pulled - w @ back.T
        half = jnp.concatenate([h.T @ half, jnp.zeros((size, split + c)), here[:, None] * half])
        e = w - g
        r = back + jnp.concatenate([h.T @ e, jnp.zeros((size, e.shape[1])), here[:, None] * e])
        return (r, z + (half + half.T)), (latent, noise_gain, kept, drift, white)

    held = (jnp.concatenate([a, a[-1:]]) for a in (made.by_state, made.by_latent, series.way))
    rows = (*held, made.output, made.seen, made.gain, series.inner, series.weighted, latents, noises, series.means)
    zero = (jnp.zeros((split + c, series.weighted.shape[2])), jnp.zeros((split + c, split + c)))
    (_, z), made_of = jax.lax.scan(step, zero, rows, reverse=True)
    transition, noise_gain, kept, drift, white = (jnp.sum(a, axis=0) for a in made_of)
    return Sums(transition, noise_gain, kept, drift, white, z)


def _by_parts(flight: FlightData, hyper: NoiseParameters, sums: Sums) -> Parts:
    given, size = parts(flight, hyper), sums.transition.shape[0]
    phi, c = given.kept, given.kept.shape[0]
    x = sums.adjoint.shape[0] - size - c
    z = sums.adjoint
    return Parts(
        sums.transition,
        sums.noise_gain @ given.noise_gain,
        z[x : x + size, x : x + size] @ given.first,
        sums.kept - phi * given.stationary * sums.drift,
        0.5 * (1.0 - phi**2) * sums.drift + 0.5 * np.diagonal(z)[x + size :],
        sums.white,
    )


@jax.jit
def pull(flight: FlightData, vector: jax.Array, like: NoiseParameters, by: Parts) -> jax.Array:
    """Derivatives by the logarithms of the noise parameters (V,) from those by a flight's `Parts`."""
    return jax.vjp(lambda v: parts(flight, from_vector(v, like)), vector)[1](by)[0]


def conditional_score(
    vector: Component, like: NoiseParameters, flight: FlightData, linear: Linear, seen: Seen
) -> Component:
    """Gradient (V,) of a flight's ``1/2 |innovations|^2 + log det``, parameters held.

    Args:
        vector: Logarithms of the noise parameters (V,).
        like: Noise parameters of the same form.
        flight: The record.
        linear: It, linearised.
        seen: Data of the linear model there, one column.
    """
    hyper = from_vector(vector, like)
    done = run(flight, hyper, linear, seen)
    return pull(flight.without_model(), vector, like, slope(flight, hyper, linear, done, np.eye(1)))


def evidence_score(
    vector: Component,
    median: NoiseParameters,
    log_sd: float,
    flights: tuple[FlightData, ...],
    linear: tuple[Linear, ...],
    seen: tuple[Seen, ...],
    columns: tuple[NDArray[np.intp], ...],
    prior_precision: Component,
) -> tuple[float, Array]:
    """Minus the log evidence and the log prior, up to a constant, and its gradient.

    With M the matrix of the parameters, ``B B' = M^-1`` held fixed, the gradient of ``1/2 log det M`` is that of half
    the squared innovations of the columns of derivatives times B: one more set of series in the deviance. Of a flight
    that tells of some parameters only, B is a factor of that part of the inverse.

    Args:
        vector: Logarithms of the noise parameters (V,).
        median: Medians of their priors.
        log_sd: Standard deviation of the logarithms.
        flights: Records.
        linear: Their linearisations.
        seen: From `joint.as_seen`, per flight; without derivatives by parameters that it does not tell of.
        columns: Which parameters these are, per flight.
        prior_precision: Of the parameters (P, P).

    Returns:
        The value and its gradient (V,).

    Raises:
        numpy.linalg.LinAlgError: If the matrix of the parameters is not positive definite.
    """
    hyper = from_vector(vector, median)
    runs = [run(flight, hyper, lin, data) for flight, lin, data in zip(flights, linear, seen, strict=True)]
    value, spread, gradient = _collected(vector, median, log_sd, tuple(runs), columns, prior_precision)
    for flight, lin, done, own in zip(flights, linear, runs, columns, strict=True):
        mix = block_diag(np.eye(1), np.asarray(np.linalg.qr(spread[own].T, mode="r")).T)
        by = pull(flight.without_model(), vector, median, slope(flight, hyper, lin, done, mix))
        gradient = gradient + np.asarray(by)
    return value, gradient


def _collected(
    vector: Array,
    median: NoiseParameters,
    log_sd: float,
    runs: tuple[Pass, ...],
    columns: tuple[NDArray[np.intp], ...],
    prior_precision: Array,
) -> tuple[float, Array, Array]:
    """Minus the log evidence, a factor of the parameters' inverse matrix (P, P), and the prior's gradient (V,)."""
    off = (vector - to_vector(median)) / log_sd
    value, matrix = 0.5 * off @ off, np.array(prior_precision)
    for done, own in zip(runs, columns, strict=True):
        unit = done.unit.reshape(-1, done.unit.shape[2])
        value = value + 0.5 * unit[:, 0] @ unit[:, 0] + done.gains.log_determinant
        matrix[np.ix_(own, own)] += unit[:, 1:].T @ unit[:, 1:]
    root = np.linalg.cholesky(matrix)
    value = value + np.sum(np.log(np.diagonal(root)))
    return float(value), solve_triangular(root, np.eye(len(root)), lower=True).T, off / log_sd
