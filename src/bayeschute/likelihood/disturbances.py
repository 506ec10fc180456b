"""Latent disturbances (process noise): stationary Gauss-Markov processes for wind error, force and breathing.

Errors of the wind are Ornstein-Uhlenbeck ("drift"); the axial force of each canopy fluctuates by a drift and by
breathing, a randomly excited oscillator (6.3.2-27). Every process is a small linear state-space model, discretised
exactly at the samples of a record, driven by standard normal white noise (`process_noise` in the code), the unknown of
a fit. A disturbance may be the sum of several processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy.linalg

from bayeschute.compiler.machine import takes
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component
from bayeschute.likelihood.filter_code.latent_pass import latent_states

KINDS = {"drift": 2, "oscillator": 3}
"""Parameters of each kind: drift (sd, e-folding time [s]); oscillator (sd, frequency [Hz], damping ratio)."""
STATES = {"drift": 1, "oscillator": 2}


class Latent(NamedTuple):
    """The latent processes of a flight.

    Attributes:
        kinds: Kind of every group of processes that share their parameters (G entries).
        processes: Disturbance (its row) and group of every process.
        least: Least number of disturbances; those without a process are zero. A flight model needs as many even where
            there are no processes.
    """

    kinds: tuple[str, ...]
    processes: tuple[tuple[int, int], ...]
    least: int = 0

    @property
    def rows(self) -> int:
        """Number of disturbances A."""
        return max(self.least, *(1 + row for row, _ in self.processes), 0)

    @property
    def size(self) -> int:
        """Number of states L."""
        return sum(STATES[self.kinds[group]] for _, group in self.processes)


class Dynamics(NamedTuple):
    """State-space model ``l' = transition l + shock z``, ``l_0 = first z_0``, disturbances ``output l``; z ~ N(0, 1).

    Attributes:
        transition: (L, L).
        noise_gain: (L, L), lower.
        first: (L, L), lower.
        output: (A, L).
    """

    transition: Component
    noise_gain: Component
    first: Component
    output: Component


def _block(kind: str, parameters: Component, dt: Component) -> tuple[Component, Component, Component]:
    """Transition, and Cholesky factors of the process noise's and the stationary covariance, of one process."""
    library = library_of(parameters, dt)
    if kind == "drift":
        sd, tau = parameters[0], parameters[1]
        return (
            library.exp(-dt / tau).reshape(1, 1),
            (sd * library.sqrt(-library.expm1(-2.0 * dt / tau))).reshape(1, 1),
            sd.reshape(1, 1),
        )
    sd, omega, zeta = parameters[0], 2.0 * np.pi * parameters[1], parameters[2]
    # States (x, x'/omega) have the stationary covariance sd^2 I.
    generator = np.array([[0.0, 1.0], [-1.0, 0.0]]) * omega + np.array([[0.0, 0.0], [0.0, -2.0]]) * omega * zeta
    transition = (scipy.linalg.expm if library is np else jax.scipy.linalg.expm)(generator * dt)
    covariance = np.eye(2) * (1.0 + 1e-13) - transition @ transition.T
    driven = library.linalg.cholesky(covariance)
    return transition, sd * driven, sd * np.eye(2)


def _diagonal(*blocks: Component) -> Component:
    """A matrix of square blocks along its diagonal: SciPy's, for blocks of any shape, takes nine times as long."""
    ends = np.cumsum([len(block) for block in blocks])
    made = np.zeros((ends[-1], ends[-1]))
    for end, block in zip(ends, blocks, strict=True):
        made[end - len(block) : end, end - len(block) : end] = block
    return made


def dynamics(latent: Latent, disturbance_parameters: Sequence[Component], dt: Component) -> Dynamics:
    """State-space model of all processes.

    Args:
        latent: The processes.
        disturbance_parameters: Parameters of every group, in the order of `KINDS`.
        dt: Sample interval [s].
    """
    if not latent.processes:
        none = np.zeros((0, 0))
        return Dynamics(none, none, none, np.zeros((latent.rows, 0)))
    library = library_of(disturbance_parameters, dt)
    groups = list(zip(latent.kinds, disturbance_parameters, strict=True))
    blocks = [_block(kind, library.asarray(parameters, float), dt) for kind, parameters in groups]
    chosen = [blocks[group] for _, group in latent.processes]
    diagonal = _diagonal if library is np else jax.scipy.linalg.block_diag
    transition, noise_gain, first = (diagonal(*(b[i] for b in chosen)) for i in range(3))
    columns = []
    for row, group in latent.processes:
        columns += [[1.0 if a == row else 0.0 for a in range(latent.rows)]]
        columns += [[0.0] * latent.rows] * (STATES[latent.kinds[group]] - 1)
    return Dynamics(transition, noise_gain, first, np.array(columns).T)


def path(made: Dynamics, process_noise: Component) -> Component:
    """Latent states (T, L, ...) from standard normal process noise (T, L, ...), the first for the initial state.

    By machine code where nothing is being traced, else by JAX.
    """
    if takes(made, process_noise):
        shape = np.shape(process_noise)
        wide = np.asarray(process_noise).reshape(*shape[:2], int(np.prod(shape[2:])))
        driven = np.asarray(made.noise_gain) @ wide
        driven[0] = np.asarray(made.first) @ wide[0]
        return latent_states(np.asarray(made.transition), driven).reshape(shape)
    return _path(made, process_noise)


@jax.jit
def _path(made: Dynamics, process_noise: jax.Array) -> jax.Array:
    """`path` by JAX alone."""

    def step(state: jax.Array, z: jax.Array) -> tuple[jax.Array, jax.Array]:
        state = jnp.tensordot(made.transition, state, axes=1) + jnp.tensordot(made.noise_gain, z, axes=1)
        return state, state

    first = jnp.tensordot(made.first, process_noise[0], axes=1)
    _, rest = jax.lax.scan(step, first, process_noise[1:])
    return jnp.concatenate([first[None], rest])


def disturbances(made: Dynamics, process_noise: Component) -> Component:
    """Disturbances (T, A, ...) from standard normal process noise (T, L, ...)."""
    library = library_of(made, process_noise)
    return library.moveaxis(library.tensordot(made.output, path(made, process_noise), axes=(1, 1)), 0, 1)
