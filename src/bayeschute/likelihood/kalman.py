"""Kalman filter and smoother along a linearised flight, integrating initial state and disturbances out exactly.

Around a trajectory the flight is linear: states ``x' = A x + B0 e + B1 e'``, outputs ``y = H x``, disturbances e from
their Markov processes, residual noise AR(1) + white. Together that is one linear state-space model with state
(x, l, a): simulation, latent processes, correlated noise. A Kalman filter gives innovations, whose squares and log
determinant are the exact marginal likelihood of the linear model; the backward recursion of Durbin and Koopman (2012,
section 4.5) gives the expected process noise. Cost grows linearly with the record.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from bayeschute.compiler.integrate import Steps
from bayeschute.core.vectors import Component
from bayeschute.likelihood.disturbances import Dynamics
from bayeschute.likelihood.noise import Noise


class Gains(NamedTuple):
    """Covariance pass of the Kalman filter: gains and innovation covariances; S states, C outputs.

    Attributes:
        transition: (T, S, S); the last one is not used.
        output: (T, C, S), zero where data are missing.
        gain: (T, S, C): filtered minus predicted mean per innovation.
        root: Lower Cholesky factors of the innovations' covariances (T, C, C); one where data are missing.
        inverse: Inverses of the roots. Batched triangular solves, in jaxlib 0.10 on CPUs, never return when two run at
            once.
        noise_gain: Effect of the next sample's process noise on the next state (T, S, L).
        start: Effect of the standardised initial deviations on the first state (S, D).
        first: Effect of the first process noise on it (S, L).
        spread: Predicted covariances, rows of the flight's own states (T, X, S).
    """

    transition: Component
    output: Component
    gain: Component
    root: Component
    inverse: Component
    noise_gain: Component
    start: Component
    first: Component
    spread: Component

    @property
    def log_determinant(self) -> jax.Array:
        """Half the log determinant of the data's covariance, up to a constant."""
        return jnp.sum(jnp.log(jnp.diagonal(self.root, axis1=1, axis2=2)))


def gains(
    steps: Steps,
    start_scale: Component,
    latent: Dynamics,
    noise: Noise,
    dt: Component,
    here: Component,
    slack: Component | None = None,
) -> Gains:
    """Run the covariances of the filter.

    Args:
        steps: The linearised flight.
        start_scale: Prior standard deviations of the initial deviations (D,).
        latent: Processes.
        noise: Residual noise per output.
        dt: Sample interval [s].
        here: Which data exist (T, C).
        slack: Standard deviations of additional white process noise of the states (X,), appended to that
            of the latent processes (weak constraint); None: the states obey the equations of motion.
    """
    return covariances(steps, start_scale, latent, noise, dt, here, slack)[0]


def covariances(
    steps: Steps,
    start_scale: Component,
    latent: Dynamics,
    noise: Noise,
    dt: Component,
    here: Component,
    slack: Component | None = None,
) -> tuple[Gains, jax.Array, jax.Array]:
    """`gains`, and the filtered covariances that the gradient by the noise parameters needs.

    Args:
        steps: The linearised flight.
        start_scale: Prior standard deviations of the initial deviations (D,).
        latent: Processes.
        noise: Residual noise per output.
        dt: Sample interval [s].
        here: Which data exist (T, C).
        slack: As in `gains`.

    Returns:
        The gains; the columns of the latent processes of transition times filtered covariance (T, S, L); and the
        columns of the residual noise of the same (T, S, C).
    """
    x, size, c = steps.first_start.shape[0], latent.transition.shape[0], here.shape[1]
    total = x + size + c
    phi = jnp.exp(-dt / jnp.asarray(noise.time_constant))
    stationary, white = jnp.asarray(noise.correlated) ** 2, jnp.asarray(noise.white) ** 2
    from_latent = steps.by_now @ latent.output + steps.by_then @ (latent.output @ latent.transition)
    count = steps.by_state.shape[0]
    f = jnp.zeros((count, total, total))
    f = f.at[:, :x, :x].set(steps.by_state).at[:, :x, x : x + size].set(from_latent)
    f = f.at[:, x : x + size, x : x + size].set(latent.transition).at[:, x + size :, x + size :].set(jnp.diag(phi))
    g = jnp.zeros((count, total, size)).at[:, :x].set(steps.by_then @ (latent.output @ latent.noise_gain))
    g = g.at[:, x : x + size].set(latent.noise_gain)
    start = jnp.zeros((total, steps.first_start.shape[1])).at[:x].set(steps.first_start * start_scale)
    first = jnp.zeros((total, size)).at[x : x + size].set(latent.first)
    if slack is not None:
        free = jnp.zeros((total, x)).at[:x].set(jnp.diag(jnp.asarray(slack)))
        g = jnp.concatenate([g, jnp.broadcast_to(free, (count, *free.shape))], axis=2)
        first = jnp.concatenate([first, free], axis=1)
    h = jnp.concatenate(
        [steps.out_state, jnp.zeros((here.shape[0], c, size)), jnp.tile(jnp.eye(c), (len(here), 1, 1))], 2
    )
    h = jnp.where(here[:, :, None], h, 0.0)
    r = jnp.where(here, white, 1.0)
    split = x + size
    f, g = (jnp.concatenate([a, a[-1:]]) for a in (f, g))
    p = start[:split] @ start[:split].T + first[:split] @ first[:split].T

    # Noise of the outputs moves on its own: its rows and columns are scaled, and only the rest is multiplied out.
    def step(
        parts: tuple[jax.Array, jax.Array, jax.Array], row: tuple
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], tuple[jax.Array, ...]]:
        (p, cross, own), (f, g, h, r, seen) = parts, row
        spread = jnp.concatenate([p[:x], cross[:x]], axis=1)
        hp = jnp.concatenate([h @ p[:x] + seen * cross.T, h @ cross[:x] + seen * own], axis=1)
        root = jnp.linalg.cholesky(hp[:, :x] @ h.T + hp[:, split:] * seen.T + jnp.diag(r))
        both = jax.scipy.linalg.solve_triangular(root, jnp.concatenate([hp, jnp.eye(c)], axis=1), lower=True)
        half, inverse = both[:, : split + c], both[:, split + c :]
        body, noisy = half[:, :split], half[:, split:]
        p, cross, own = p - body.T @ body, cross - body.T @ noisy, own - noisy.T @ noisy
        moved, mixed, kept = f @ (0.5 * (p + p.T)), f @ cross, phi[:, None] * own
        latents = jnp.concatenate([moved[:, x:], phi[:, None] * cross[x:].T])
        p = moved @ f.T + g @ g.T
        after = (p, mixed * phi, kept * phi + jnp.diag((1.0 - phi**2) * stationary))
        return after, (half.T @ inverse, root, inverse, latents, jnp.concatenate([mixed, kept]), spread)

    rows = (f[:, :split, :split], g[:, :split], h[:, :, :x], r, jnp.asarray(here)[:, :, None] * 1.0)
    parts = (p, jnp.zeros((split, c)), jnp.diag(stationary))
    _, (gain, root, inverse, latents, noises, spread) = jax.lax.scan(step, parts, rows)
    return Gains(f, h, gain, root, inverse, g, start, first, spread), latents, noises


class Seen(NamedTuple):
    """Data, or columns of derivatives by parameters, with known inputs to the states.

    The inputs enter at every step, so that the data correct their effect at once. For an unstable flight the filtered
    response stays bounded, while the open-loop response over the whole record grows without bound.

    Attributes:
        series: (T, C, M).
        inputs: Input to the first state, then to every step (T, X, M).
    """

    series: jax.Array
    inputs: jax.Array

    def column(self, which: int) -> Seen:
        """One of the columns, alone."""
        return Seen(self.series[..., which, None], self.inputs[..., which, None])

    def less(self, mean_correction: MeanCorrection) -> Seen:
        """The first column with the mean correction: subtracted from the data, added to the inputs of the states."""
        outputs, inputs = (jnp.asarray(a) for a in mean_correction)
        return Seen(self.series.at[..., 0].add(-outputs), self.inputs.at[..., 0].add(inputs))


class MeanCorrection(NamedTuple):
    """Second-order correction of the predicted mean: outputs (T, C), and the ends of all steps (T, X).

    As in `Seen` the first of the latter is the first state.
    """

    outputs: Component
    inputs: Component


def innovations(made: Gains, series: jax.Array, inputs: jax.Array | None = None) -> jax.Array:
    """Standardised innovations (T, C, ...) of series (T, C, ...): data, or columns of derivatives; see `Seen`."""
    return forward(made, series, inputs)[0]


def forward(made: Gains, series: jax.Array, inputs: jax.Array | None = None) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The filter's means along series (T, C, ...), whose trailing axes become one, M.

    Args:
        made: The filter.
        series: Data, or columns of derivatives.
        inputs: Known inputs to the flight's states (T, X, M): to the first state, then to every
            step. None: no inputs.

    Returns:
        Standardised innovations (T, C, ...), ``S^-1`` times the innovations (T, C, M), filtered means (T, S, M).
    """
    wide = series.reshape(*series.shape[:2], -1)

    def step(mean: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        f, h, gain, z, by = row
        if by is not None:
            mean = mean.at[: by.shape[0]].add(by)
        v = z - h @ mean
        filtered = mean + gain @ v
        return f @ filtered, (v, filtered)

    here = jnp.any(made.output != 0.0, axis=2)[:, :, None]
    rows = (made.transition, made.output, made.gain, jnp.where(here, wide, 0.0), inputs)
    _, (v, filtered) = jax.lax.scan(step, jnp.zeros((made.first.shape[0], wide.shape[2])), rows)
    unit = made.inverse @ v
    weighted = jnp.swapaxes(made.inverse, 1, 2) @ unit
    return unit.reshape(series.shape), weighted, filtered


def backward(made: Gains, weighted: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Smoothed initial deviations (D, M), process noise (T, L, M), and the smoother's adjoint vectors (T, S, M)."""

    def step(r: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        f, h, gain, g, v = row
        back = f.T @ r
        before = back + h.T @ (v - gain.T @ back)
        return before, (g.T @ r, before)

    rows = (made.transition, made.output, made.gain, made.noise_gain, weighted)
    zero = jnp.zeros((made.first.shape[0], weighted.shape[2]))
    r, (process_noise, vectors) = jax.lax.scan(step, zero, rows, reverse=True)
    return made.start.T @ r, jnp.concatenate([(made.first.T @ r)[None], process_noise[:-1]]), vectors


class Smoothed(NamedTuple):
    """Smoothed unknowns of a flight given its data.

    Attributes:
        innovations: Standardised (T, C, M).
        start: Expected standardised initial deviations (D, M).
        process_noise: Likewise of the process noise (T, L, M).
        states: Likewise of the flight's own states (T, X, M).
    """

    innovations: jax.Array
    start: jax.Array
    process_noise: jax.Array
    states: jax.Array


def smooth_driven(made: Gains, seen: Seen) -> Smoothed:
    """Filter and smoother of a flight with known inputs to its states."""
    unit, weighted, filtered = forward(made, *seen)
    start, process_noise, vectors = backward(made, weighted)
    predicted = filtered - made.gain @ (made.root @ unit)
    return Smoothed(unit, start, process_noise, predicted[:, : seen.inputs.shape[1]] + made.spread @ vectors)


def response(steps: Steps, start: jax.Array, disturbance: jax.Array, theta: jax.Array) -> jax.Array:
    """Linear response of the outputs (T, C, M) to initial deviations, disturbances and parameters.

    Args:
        steps: The linearised flight.
        start: (D, M).
        disturbance: (T, A, M).
        theta: (P, M).
    """

    def step(x: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        a, b, c0, c1, e0, e1 = row
        x = a @ x + b @ theta + c0 @ e0 + c1 @ e1
        return x, x

    first = steps.first_start @ start + steps.first_theta @ theta
    rows = (steps.by_state, steps.by_theta, steps.by_now, steps.by_then, disturbance[:-1], disturbance[1:])
    _, rest = jax.lax.scan(step, first, rows)
    x = jnp.concatenate([first[None], rest])
    return steps.out_state @ x + steps.out_theta @ theta
