"""Polynomial surrogate of the marginal posterior: quadratic response surfaces of the projected residuals.

The marginal log density is ``-1/2 |r(xi)|^2 - rest`` with r nearly linear in xi and the rest a polynomial.
Fit ``r(xi) ~ C m(xi)``, m all monomials up to degree two, to simulations around the optimum: the first part is half the
form ``m(xi)' C'C m(xi)``, which costs microseconds and has a gradient. Far off, where the residuals' second degree
cancels their first, the squares are small again; the density has its price there (`marginal.out_of_range`), and the
surrogate by its own second degree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Component
from bayeschute.posterior.marginal import Quadratic, twice_price

Array = NDArray[np.float64]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surrogate:
    """``log density = -(1/2 |C m(xi)|^2 + price + rest) / temperature``.

    Attributes:
        straight: C'C of the monomials of degrees zero and one (1 + P, 1 + P).
        mixed: C'C of those of degree two by these (M - 1 - P, 1 + P), M = 1 + P + P (P + 1)/2.
        bent: C'C of those of degree two (M - 1 - P, M - 1 - P).
        correction: What the density is besides the squares.
        temperature: Above 1, the density is flatter than the fitted one: what proposes has to have the heavier tails,
            and a quartic polynomial falls faster than a density that flattens out, as along a stiff riser's stiffness.
    """

    straight: Component
    mixed: Component
    bent: Component
    correction: Quadratic
    temperature: Component = 1.0

    def log_density(self, xi: jax.Array) -> jax.Array:
        """Surrogate log density at standard coordinates (P, ...), up to a constant."""
        first, second = jnp.split(monomials(xi), [1 + xi.shape[0]])
        bent = _form(self.bent, second)
        squares = _form(self.straight, first) + 2.0 * jnp.sum(second * (self.mixed @ first), axis=0) + bent
        return -(0.5 * (squares + twice_price(bent, xi)) + self.correction.at(xi)) / self.temperature


def _form(matrix: Component, x: jax.Array) -> jax.Array:
    """``x' matrix x`` of a symmetric matrix; its gradient takes no second product."""
    fixed = jax.lax.stop_gradient(x)
    return jnp.sum((2.0 * x - fixed) * (matrix @ fixed), axis=0)


def monomials(xi: jax.Array) -> jax.Array:
    """All monomials up to degree two of (P, ...): (M, ...)."""
    p = xi.shape[0]
    i, j = np.triu_indices(p)
    return jnp.concatenate([jnp.ones_like(xi[:1]), xi, xi[i] * xi[j]])


_monomials = jax.jit(monomials)


def build(
    residuals: Callable[[Array], Array],
    correction: Quadratic,
    rng: np.random.Generator,
    spread: float = 1.3,
    factor: int = 3,
) -> tuple[Surrogate, int]:
    """Fit the surrogate.

    Args:
        residuals: Projected residuals (N, B) at standard coordinates (P, B).
        correction: What the density is besides them, a polynomial already (`Marginal.correction`).
        rng: Source of the design points.
        spread: Standard deviation of the design points.
        factor: Design points per monomial.

    Returns:
        The surrogate and the number of simulations that failed.

    Raises:
        FloatingPointError: If fewer simulations succeed than there are monomials.
    """
    parameters = int(np.size(correction.slope))
    count = 1 + parameters + parameters * (parameters + 1) // 2
    points = spread * rng.standard_normal((parameters, factor * count))
    points[:, 0] = 0.0
    values = np.concatenate(
        [residuals(part) for part in np.array_split(points, factor * count // 64 + 1, axis=1)], axis=1
    )
    good = np.isfinite(values).all(axis=0)
    if good.sum() < count:
        raise FloatingPointError(f"{(~good).sum()} of {good.size} simulations around the optimum failed")
    design = np.asarray(_monomials(points[:, good]))
    weight = np.exp(-0.25 * np.sum(points[:, good] ** 2, axis=0) * (1.0 - 1.0 / spread**2))
    coefficients = np.linalg.lstsq((design * weight).T, (values[:, good] * weight).T, rcond=None)[0].T
    first, second = np.split(coefficients, [1 + parameters], axis=1)
    made = Surrogate(first.T @ first, second.T @ first, second.T @ second, correction)
    return made, int((~good).sum())
