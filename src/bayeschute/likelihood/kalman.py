"""Kalman filter and smoother along a linearised flight, integrating initial state and disturbances out exactly.

Around a trajectory the flight is linear: states ``x' = A x + B0 e + B1 e'``, outputs ``y = H x``, disturbances e from
their Markov processes, residual noise AR(1) + white. Together that is one linear state-space model with state
(x, l, a): simulation, latent processes, correlated noise. A Kalman filter gives innovations, whose squares and log
determinant are the exact marginal likelihood of the linear model; the backward recursion of Durbin and Koopman (2012,
section 4.5) gives the expected process noise. Cost grows linearly with the record.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.integrate import Steps
from bayeschute.compiler.machine import takes
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component
from bayeschute.likelihood.disturbances import Dynamics
from bayeschute.likelihood.filter_code import passes
from bayeschute.likelihood.noise import Noise

Array = NDArray[np.float64]


class Gains(NamedTuple):
    """Covariance pass of the Kalman filter; S = X + L + C states: the flight's own, latent ones, and residual noise.

    Attributes:
        by_state: Next own state by own states (T - 1, X, X).
        by_latent: Likewise by latent states (T - 1, X, L).
        transition: Of the latent states (L, L).
        kept: Share of the residual noise that is left at the next sample (C,).
        output: Outputs by own states (T, C, X), zero where data are missing.
        seen: One where a datum exists, else zero (T, C).
        gain: (T, S, C): filtered minus predicted mean per innovation.
        root: Lower Cholesky factors of the innovations' covariances (T, C, C); one where data are missing.
        inverse: Inverses of the roots. Batched triangular solves, in jaxlib 0.10 on CPUs, never return when two run at
            once.
        by_shock: Effect of the next sample's process noise on the next own state (T - 1, X, L).
        noise_gain: Likewise on the latent states (L, L).
        slack: Standard deviations of additional white process noise of the own states (X,), or None.
        start: Effect of the standardised initial deviations on the first state (S, D).
        first: Effect of the first process noise on it (S, W); W = L, and X more where there is slack.
        spread: Predicted covariances, rows of the flight's own states (T, X, S).
    """

    by_state: Component
    by_latent: Component
    transition: Component
    kept: Component
    output: Component
    seen: Component
    gain: Component
    root: Component
    inverse: Component
    by_shock: Component
    noise_gain: Component
    slack: Component | None
    start: Component
    first: Component
    spread: Component

    def whole(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Transition (T, S, S), whose last one is not used, output (T, C, S) and effect of process noise (T, S, W)."""
        (samples, c, x), size, wide = self.output.shape, len(self.transition), self.first.shape[1]
        n, s = x + size, x + size + c
        f = jnp.zeros((samples, s, s)).at[:, :x, :x].set(_held(self.by_state)).at[:, :x, x:n].set(_held(self.by_latent))
        f = f.at[:, x:n, x:n].set(self.transition).at[:, n:, n:].set(jnp.diag(jnp.asarray(self.kept)))
        g = jnp.zeros((samples, s, wide)).at[:, :x, :size].set(_held(self.by_shock))
        g = g.at[:, x:n, :size].set(self.noise_gain)
        if self.slack is not None:
            g = g.at[:, :x, size:].set(jnp.diag(jnp.asarray(self.slack)))
        h = jnp.concatenate([self.output, jnp.zeros((samples, c, size)), self.seen[:, :, None] * jnp.eye(c)], axis=2)
        return f, h, g

    @property
    def log_determinant(self) -> Component:
        """Half the log determinant of the data's covariance, up to a constant."""
        if isinstance(self.root, np.ndarray):
            return np.sum(np.log(np.diagonal(self.root, axis1=1, axis2=2)))
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
    score: bool = False,
) -> tuple[Gains, Component, Component]:
    """`gains`, and the filtered covariances that the gradient by the noise parameters needs.

    By machine code where nothing is being traced, else by JAX.

    Args:
        steps: The linearised flight.
        start_scale: Prior standard deviations of the initial deviations (D,).
        latent: Processes.
        noise: Residual noise per output.
        dt: Sample interval [s].
        here: Which data exist (T, C).
        slack: As in `gains`.
        score: Whether the filtered covariances are wanted, and `Gains.spread` is not: one of them may be empty.

    Returns:
        The gains; the columns of the latent processes of transition times filtered covariance (T, S, L); and the
        columns of the residual noise of the same (T, S, C).
    """
    start, first = _beginning(steps.first_start, start_scale, latent.first, slack, here.shape[1])
    if not takes(steps, start_scale, latent, noise, dt, here, slack) or not steps.by_state.shape[0]:
        return _covariances(steps, start, first, latent, noise, dt, here, slack)
    given = steps, np.asarray(start), np.asarray(first), latent, noise, float(dt), here, slack, score
    made = passes.covariances(*given)
    none = np.zeros((0, *made["gain"].shape[1:]))
    latents, noises, spread = (made.pop(name, none) for name in ("latents", "noises", "spread"))
    fixed = (steps.by_state, latent.transition, latent.noise_gain, slack, start, first, spread)
    names = ("by_state", "transition", "noise_gain", "slack", "start", "first", "spread")
    return Gains(**made, **dict(zip(names, fixed, strict=True))), latents, noises


def _beginning(
    first_start: Component, scale: Component, first_latent: Component, slack: Component | None, outputs: int
) -> tuple[Component, Component]:
    """Effects of standardised initial deviations and of the first process noise on the first state."""
    library = library_of(first_start, scale, first_latent, slack)
    x, size = first_start.shape[0], first_latent.shape[0]
    start = library.concatenate([first_start * scale, np.zeros((size + outputs, first_start.shape[1]))])
    first = library.concatenate([np.zeros((x, size)), first_latent, np.zeros((outputs, size))])
    if slack is not None:
        free = library.concatenate([library.diag(library.asarray(slack)), np.zeros((size + outputs, x))])
        first = library.concatenate([first, free], axis=1)
    return start, first


@jax.jit
def _covariances(
    steps: Steps,
    start: jax.Array,
    first: jax.Array,
    latent: Dynamics,
    noise: Noise,
    dt: Component,
    here: Component,
    slack: Component | None,
) -> tuple[Gains, jax.Array, jax.Array]:
    """`covariances` by JAX alone, which can be part of a compiled function."""
    x, size, c = steps.first_start.shape[0], latent.transition.shape[0], here.shape[1]
    split = x + size
    kept = jnp.broadcast_to(jnp.exp(-dt / jnp.asarray(noise.time_constant)), (c,))
    stationary = jnp.broadcast_to(jnp.asarray(noise.correlated) ** 2, (c,))
    by_latent = steps.by_now @ latent.output + steps.by_then @ (latent.output @ latent.transition)
    by_shock = steps.by_then @ (latent.output @ latent.noise_gain)
    free = jnp.zeros(x) if slack is None else jnp.asarray(slack) ** 2
    h, seen = jnp.where(here[:, :, None], steps.out_state, 0.0), here * 1.0
    r = jnp.where(here, jnp.asarray(noise.white) ** 2, 1.0)
    p = start[:split] @ start[:split].T + first[:split] @ first[:split].T

    # Noise of the outputs moves on its own: its rows and columns are scaled, and only the rest is multiplied out.
    def step(
        parts: tuple[jax.Array, jax.Array, jax.Array], row: tuple
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], tuple[jax.Array, ...]]:
        (p, cross, own), (by_state, by_latent, by_shock, h, r, seen) = parts, row
        f = jnp.zeros((split, split)).at[:x, :x].set(by_state).at[:x, x:].set(by_latent)
        f = f.at[x:, x:].set(latent.transition)
        g = jnp.concatenate([by_shock, latent.noise_gain])
        spread = jnp.concatenate([p[:x], cross[:x]], axis=1)
        hp = jnp.concatenate([h @ p[:x] + seen * cross.T, h @ cross[:x] + seen * own], axis=1)
        root = jnp.linalg.cholesky(hp[:, :x] @ h.T + hp[:, split:] * seen.T + jnp.diag(r))
        both = jax.scipy.linalg.solve_triangular(root, jnp.concatenate([hp, jnp.eye(c)], axis=1), lower=True)
        half, inverse = both[:, : split + c], both[:, split + c :]
        body, noisy = half[:, :split], half[:, split:]
        p, cross, own = p - body.T @ body, cross - body.T @ noisy, own - noisy.T @ noisy
        moved, mixed, left = f @ (0.5 * (p + p.T)), f @ cross, kept[:, None] * own
        latents = jnp.concatenate([moved[:, x:], kept[:, None] * cross[x:].T])
        p = moved @ f.T + g @ g.T
        p = p.at[:x, :x].add(jnp.diag(free))
        after = (p, mixed * kept, left * kept + jnp.diag((1.0 - kept**2) * stationary))
        return after, (half.T @ inverse, root, inverse, latents, jnp.concatenate([mixed, left]), spread)

    rows = (_held(steps.by_state), _held(by_latent), _held(by_shock), h, r, seen[:, :, None])
    parts = (p, jnp.zeros((split, c)), jnp.diag(stationary))
    _, (gain, root, inverse, latents, noises, spread) = jax.lax.scan(step, parts, rows)
    made = Gains(
        steps.by_state, by_latent, latent.transition, kept, h, seen, gain, root, inverse, by_shock, latent.noise_gain,
        slack, start, first, spread,
    )  # fmt: skip
    return made, latents, noises


def _held(steps: jax.Array) -> jax.Array:
    """Matrices by step (T - 1, ...), the last repeated, which is not used, so that there is one to every sample."""
    return jnp.concatenate([steps, steps[-1:]])


class Seen(NamedTuple):
    """Data, or columns of derivatives by parameters, with known inputs to the states.

    The inputs enter at every step, so that the data correct their effect at once. For an unstable flight the filtered
    response stays bounded, while the open-loop response over the whole record grows without bound.

    Attributes:
        series: (T, C, M).
        inputs: Input to the first state, then to every step (T, X, M).
    """

    series: Component
    inputs: Component

    def column(self, which: int) -> Seen:
        """One of the columns, alone."""
        return self.some(np.array([which]))

    def some(self, columns: NDArray[np.intp]) -> Seen:
        """Some of the columns."""
        return Seen(self.series[..., columns], self.inputs[..., columns])

    def told(self) -> NDArray[np.intp]:
        """Numbers of the columns that are not zero all along: others are derivatives by other flights' parameters."""
        parts = (np.asarray(self.series), np.asarray(self.inputs))
        return np.flatnonzero(np.any([np.any(part, axis=(0, 1)) for part in parts], axis=0))

    def less(self, mean_correction: MeanCorrection) -> Seen:
        """The first column with the mean correction: subtracted from the data, added to the inputs of the states."""
        outputs, inputs = mean_correction
        series, states = np.array(self.series), np.array(self.inputs)
        series[..., 0] -= outputs
        states[..., 0] += inputs
        return Seen(series, states)


class MeanCorrection(NamedTuple):
    """Second-order correction of the predicted mean: outputs (T, C), and the ends of all steps (T, X).

    As in `Seen` the first of the latter is the first state.
    """

    outputs: Component
    inputs: Component


def innovations(made: Gains, series: Component, inputs: Component | None = None) -> Component:
    """Standardised innovations (T, C, ...) of series (T, C, ...): data, or columns of derivatives; see `Seen`."""
    return forward(made, series, inputs, 0)[0]


def forward(
    made: Gains, series: Component, inputs: Component | None = None, told: int | None = None
) -> tuple[Component, Component, Component]:
    """The filter's means along series (T, C, ...), whose trailing axes become one, M.

    By machine code where nothing is being traced, else by JAX; so does `backward`.

    Args:
        made: The filter.
        series: Data, or columns of derivatives.
        inputs: Known inputs to the first states, the flight's own or all of them (T, K, M): to the first state, then to
            every step. None: no inputs.
        told: Of how many states the predicted means are returned, from the first on; None: of all.

    Returns:
        Standardised innovations (T, C, ...), ``S^-1`` times the innovations (T, C, M), predicted means (T, told, M).
    """
    count = made.first.shape[0] if told is None else told
    wide = series.reshape(*series.shape[:2], -1)
    if takes(made, series, inputs) and made.by_state.shape[0]:
        unit, weighted, predicted = passes.forward(made, wide, inputs, count)
    else:
        unit, weighted, predicted = _forward(made, wide, inputs, count)
    return unit.reshape(series.shape), weighted, predicted


@partial(jax.jit, static_argnums=3)
def _forward(made: Gains, wide: jax.Array, inputs: jax.Array | None, told: int) -> tuple[jax.Array, ...]:
    """`forward` by JAX alone."""
    x, n = made.output.shape[2], made.output.shape[2] + len(made.transition)
    kept, seen = jnp.asarray(made.kept)[:, None], made.seen[:, :, None]

    def step(mean: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        by_state, by_latent, h, seen, gain, z, by = row
        if by is not None:
            mean = mean.at[: by.shape[0]].add(by)
        v = z - h @ mean[:x] - seen * mean[n:]
        filtered = mean + gain @ v
        own, latent, noise = filtered[:x], filtered[x:n], filtered[n:]
        after = jnp.concatenate([by_state @ own + by_latent @ latent, made.transition @ latent, kept * noise])
        return after, (v, mean[:told])

    z = jnp.where(seen > 0.0, wide, 0.0)
    rows = (_held(made.by_state), _held(made.by_latent), made.output, seen, made.gain, z, inputs)
    _, (v, predicted) = jax.lax.scan(step, jnp.zeros((made.first.shape[0], wide.shape[2])), rows)
    unit = made.inverse @ v
    return unit, jnp.swapaxes(made.inverse, 1, 2) @ unit, predicted


def backward(made: Gains, weighted: Component, predicted: Component) -> tuple[Component, Component, Component]:
    """The smoother: expected standardised initial deviations (D, M), process noise (T, W, M), and own states (T, X, M).

    Args:
        made: The filter.
        weighted: ``S^-1`` times the innovations (T, C, M).
        predicted: Predicted means of the flight's own states (T, X, M).
    """
    if takes(made, weighted, predicted) and made.by_state.shape[0]:
        adjoint, process_noise, states = passes.backward(made, weighted, predicted)
        process_noise[0] = np.asarray(made.first).T @ adjoint
        return np.asarray(made.start).T @ adjoint, process_noise, states
    adjoint, process_noise, states = _backward(made, weighted, predicted)
    return made.start.T @ adjoint, process_noise.at[0].set(made.first.T @ adjoint), states


@jax.jit
def _backward(made: Gains, weighted: jax.Array, predicted: jax.Array) -> tuple[jax.Array, ...]:
    """`backward` by JAX alone: adjoint vectors of the first sample, process noise but the first, and states."""
    x, n = made.output.shape[2], made.output.shape[2] + len(made.transition)
    transition, noise_gain = jnp.asarray(made.transition), jnp.asarray(made.noise_gain)
    kept = jnp.asarray(made.kept)[:, None]

    def step(r: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        by_state, by_latent, by_shock, h, seen, gain, spread, v, mean = row
        own, latent, noise = r[:x], r[x:n], r[n:]
        shocks = by_shock.T @ own + noise_gain.T @ latent
        if made.slack is not None:
            shocks = jnp.concatenate([shocks, jnp.asarray(made.slack)[:, None] * own])
        back = jnp.concatenate([by_state.T @ own, by_latent.T @ own + transition.T @ latent, kept * noise])
        e = v - gain.T @ back
        before = back.at[:x].add(h.T @ e).at[n:].add(seen * e)
        return before, (shocks, mean + spread @ before)

    steps = (_held(a) for a in (made.by_state, made.by_latent, made.by_shock))
    rows = (*steps, made.output, made.seen[:, :, None], made.gain, made.spread, weighted, predicted)
    adjoint, (after, states) = jax.lax.scan(
        step, jnp.zeros((made.first.shape[0], weighted.shape[2])), rows, reverse=True
    )
    return adjoint, jnp.concatenate([after[:1], after[:-1]]), states


class Smoothed(NamedTuple):
    """Smoothed unknowns of a flight given its data.

    Attributes:
        innovations: Standardised (T, C, M).
        start: Expected standardised initial deviations (D, M).
        process_noise: Likewise of the process noise (T, W, M).
        states: Likewise of the flight's own states (T, X, M).
    """

    innovations: Component
    start: Component
    process_noise: Component
    states: Component


def smooth_driven(made: Gains, seen: Seen) -> Smoothed:
    """Filter and smoother of a flight with known inputs to its states; columns that are zero stay so, at no cost."""
    count = seen.series.shape[2]
    told = seen.told() if takes(made, *seen) else np.arange(count)
    if len(told) < count:
        return Smoothed(*(_spread(part, told, count) for part in smooth_driven(made, seen.some(told))))
    unit, weighted, predicted = forward(made, seen.series, seen.inputs, made.output.shape[2])
    return Smoothed(unit, *backward(made, weighted, predicted))


def _spread(part: Component, columns: NDArray[np.intp], count: int) -> Array:
    """Columns of an array (..., K) among zeros (..., M)."""
    made = np.zeros((*part.shape[:-1], count))
    made[..., columns] = part
    return made


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
