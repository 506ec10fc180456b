"""The posterior of the parameters alone, initial states and latent disturbances integrated out as Gaussian given them.

At the optimum the standardised residuals have Jacobian blocks A_theta, A_u. Follow the conditional optimum ``u(theta) =
u_hat - H_uu^-1 H_utheta (theta - theta_hat)``, simulate there once, and integrate what is left of u as a Gaussian:
``-1/2 |s|^2 + 1/2 b' H_uu^-1 b``, ``b = A_u' s`` (METHODS 6). With ``A_u = Q R`` this is ``-1/2 |s - Q Q' s|^2``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.inference.map import Optimum
from bayeschute.inference.priors import Prior, working
from bayeschute.inference.target import FlightData, Hyper, linearise, residuals, standardised, standardised_linear

Array = NDArray[np.float64]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Conditional:
    """u of one flight given theta.

    Attributes:
        u: Optimum (U,).
        slope: Derivative of the conditional optimum by theta (U, P).
        basis: Q, orthonormal, spanning A_u (N, U).
        upper: R with A_u = Q R (U, U).
    """

    u: Component
    slope: Component
    basis: Component
    upper: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marginal:
    """The marginal posterior; `scale` maps standard coordinates xi to theta: ``theta = centre + scale @ xi``.

    Attributes:
        flights: Records.
        hyper: Noise parameters, fixed.
        conditional: Initial states and latent disturbances given theta, one entry per flight.
        centre: Optimum of theta (P,).
        scale: Lower Cholesky factor of the Laplace covariance of theta (P, P).
        prior_centre: Prior means of theta (P,).
        prior_scale: Prior standard deviations (P,).
    """

    flights: tuple[FlightData, ...]
    hyper: Hyper
    conditional: tuple[Conditional, ...]
    centre: Component
    scale: Component
    prior_centre: Component
    prior_scale: Component

    def theta(self, xi: Component) -> Component:
        """Parameters (P, ...) of standard coordinates (P, ...)."""
        rank = jnp.ndim(xi) - 1
        return self.centre.reshape(-1, *(1,) * rank) + jnp.tensordot(self.scale, xi, axes=1)


def marginalise(flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior], optimum: Optimum) -> Marginal:
    """Set the marginal posterior up at an optimum."""
    p, conditional = optimum.theta.size, []
    for flight, u in zip(flights, optimum.u, strict=True):
        _, by = standardised_linear(flight, hyper, linearise(flight, optimum.theta, u))
        basis, upper = np.linalg.qr(np.asarray(by[:, p:]))
        slope = -scipy.linalg.solve_triangular(upper, basis.T @ np.asarray(by[:, :p]))
        conditional.append(Conditional(u, slope, basis, upper))
    centre, scale = working(priors)
    factor = np.linalg.cholesky(optimum.covariance)
    return Marginal(tuple(flights), hyper, tuple(conditional), optimum.theta, factor, centre, scale)


def _shifted(flight: FlightData, hyper: Hyper, cond: Conditional, theta: jax.Array, shift: jax.Array) -> tuple:
    """u(theta) (U, B), s there (N, B) and Q's (U, B)."""
    u = cond.u[:, None] + cond.slope @ shift
    s = standardised(flight, hyper, residuals(flight, theta, u), u)
    return u, s, cond.basis.T @ s


@jax.jit
def projected_residuals(marginal: Marginal, xi: jax.Array) -> jax.Array:
    """The vector whose ``-1/2 |.|^2`` is the marginal log density up to a constant.

    Args:
        marginal: The posterior.
        xi: Standard coordinates (P, B).

    Returns:
        (N, B): for every flight ``s - Q Q' s``, then theta under its prior.
    """
    theta = marginal.theta(xi)
    shift = theta - marginal.centre[:, None]
    parts = [(theta - marginal.prior_centre[:, None]) / marginal.prior_scale[:, None]]
    for flight, cond in zip(marginal.flights, marginal.conditional, strict=True):
        _, s, t = _shifted(flight, marginal.hyper, cond, theta, shift)
        parts.insert(-1, s - cond.basis @ t)
    return jnp.concatenate(parts)


@jax.jit
def log_density(marginal: Marginal, xi: jax.Array) -> jax.Array:
    """Marginal log density (B,) up to a constant at standard coordinates (P, B); NaN where a simulation fails."""
    theta = marginal.theta(xi)
    shift = theta - marginal.centre[:, None]
    z = (theta - marginal.prior_centre[:, None]) / marginal.prior_scale[:, None]
    value = -0.5 * jnp.sum(z**2, axis=0)
    for flight, cond in zip(marginal.flights, marginal.conditional, strict=True):
        _, s, t = _shifted(flight, marginal.hyper, cond, theta, shift)
        value = value - 0.5 * (jnp.sum(s**2, axis=0) - jnp.sum(t**2, axis=0))
    return value


@jax.jit
def draw_unknowns(marginal: Marginal, xi: jax.Array, z: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Draws of every flight's u given theta.

    Args:
        marginal: The posterior.
        xi: Standard coordinates of the parameters (P, B).
        z: Standard normal numbers per flight (U_f, B).

    Returns:
        u per flight (U_f, B).
    """
    theta = marginal.theta(xi)
    shift = theta - marginal.centre[:, None]
    drawn = []
    for flight, cond, normal in zip(marginal.flights, marginal.conditional, z, strict=True):
        u, _, t = _shifted(flight, marginal.hyper, cond, theta, shift)
        drawn.append(u + jax.scipy.linalg.solve_triangular(cond.upper, normal - t))
    return tuple(drawn)
