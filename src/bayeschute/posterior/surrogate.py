"""Polynomial surrogate of the marginal posterior: quadratic response surfaces of the flights' residuals.

The marginal log density is ``-1/2 |r(xi)|^2 - rest`` with r nearly linear in xi and the rest a polynomial.
Fit ``r(xi) ~ C m(xi)``, m all monomials up to degree two, to simulations around the optimum: the first part is half the
form ``m(xi)' C'C m(xi)``, which costs microseconds and has a gradient. Far off, where the residuals' second degree
cancels their first, the squares are small again; the density has its price there (`marginal.out_of_range`), and the
surrogate by its own second degree. Monomials are those of the coordinates that move a flight, and flights are fitted
one by one: neither the forms nor the memory that they take grow faster than the number of flights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Component
from bayeschute.posterior.felt_axes import Group
from bayeschute.posterior.marginal import Quadratic, twice_price

Array = NDArray[np.float64]


class Squares(NamedTuple):
    """``|C m(xi)|^2`` of the flights of a group, M = 1 + A + A (A + 1)/2 monomials of the coordinates that move them.

    Attributes:
        axes: These coordinates (A,).
        straight: C'C of the monomials of degrees zero and one (1 + A, 1 + A).
        mixed: C'C of those of degree two by these (M - 1 - A, 1 + A).
        bent: C'C of those of degree two (M - 1 - A, M - 1 - A).
    """

    axes: Component
    straight: Component
    mixed: Component
    bent: Component

    def with_price(self, xi: jax.Array) -> jax.Array:
        """The squares and twice their price (...) at standard coordinates (P, ...)."""
        own = xi[self.axes]
        first, second = jnp.split(monomials(own), [1 + own.shape[0]])
        bent = _form(self.bent, second)
        squares = _form(self.straight, first) + 2.0 * jnp.sum(second * (self.mixed @ first), axis=0) + bent
        return squares + twice_price(bent, own)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surrogate:
    """``log density = -(1/2 (prior + sum of |C m(xi)|^2 + price) + rest) / temperature``.

    Attributes:
        flights: Of every group of flights.
        prior: Of the parameters under their prior: form of ``(1, xi)`` (1 + P, 1 + P).
        correction: What the density is besides the squares.
        temperature: Above 1, the density is flatter than the fitted one: what proposes has to have the heavier tails,
            and a quartic polynomial falls faster than a density that flattens out, as along a stiff riser's stiffness.
    """

    flights: tuple[Squares, ...]
    prior: Component
    correction: Quadratic
    temperature: Component = 1.0

    def log_density(self, xi: jax.Array) -> jax.Array:
        """Surrogate log density at standard coordinates (P, ...), up to a constant."""
        total = _form(self.prior, jnp.concatenate([jnp.ones_like(xi[:1]), xi]))
        for one in self.flights:
            total = total + one.with_price(xi)
        return -(0.5 * total + self.correction.at(xi)) / self.temperature


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
    residuals: Callable[[int, Array], Array],
    parts: Sequence[Group],
    prior: Array,
    correction: Quadratic,
    rng: np.random.Generator,
    spread: float = 1.3,
    factor: int = 3,
) -> tuple[Surrogate, int]:
    """Fit the surrogate.

    Args:
        residuals: Of a flight's linear model (N, B) by its number, at standard coordinates (P, B); not finite where it
            fails.
        parts: Groups of flights that the same coordinates move.
        prior: Residuals of the parameters under their prior as linear functions ``prior @ (1, xi)`` (R, 1 + P).
        correction: What the density is besides them, a polynomial already (`Marginal.correction`).
        rng: Source of the design points.
        spread: Standard deviation of the design points.
        factor: Design points per monomial.

    Returns:
        The surrogate and the number of simulations that failed.

    Raises:
        FloatingPointError: If fewer simulations of a flight succeed than there are monomials.
    """
    made, failed = list[Squares](), 0
    for group in parts:
        own = len(group.axes)
        points = np.zeros((int(np.size(correction.slope)), factor * (1 + own + own * (own + 1) // 2)))
        points[group.axes] = spread * rng.standard_normal((own, points.shape[1]))
        points[:, 0] = 0.0
        total: list[Array] = []
        for number in group.flights:
            forms, lost = _fitted(partial(residuals, number), points, group.axes, spread)
            total = [a + b for a, b in zip(total, forms, strict=True)] if total else forms
            failed += lost
        made.append(Squares(group.axes, *total))
    return Surrogate(tuple(made), prior.T @ prior, correction), failed


def _fitted(
    residuals: Callable[[Array], Array], points: Array, axes: NDArray[np.intp], spread: float
) -> tuple[list[Array], int]:
    """Forms of one flight (see `Squares`), and at how many of the points (P, B) its simulations failed."""
    parts = np.array_split(points, points.shape[1] // 64 + 1, axis=1)
    values = np.concatenate([residuals(part) for part in parts], axis=1)
    good = np.isfinite(values).all(axis=0)
    own = points[axes][:, good]
    design = np.asarray(_monomials(own))
    if good.sum() < len(design):
        raise FloatingPointError(f"{(~good).sum()} of {good.size} simulations around the optimum failed")
    weight = np.exp(-0.25 * np.sum(own**2, axis=0) * (1.0 - 1.0 / spread**2))
    coefficients = np.linalg.lstsq((design * weight).T, (values[:, good] * weight).T, rcond=None)[0].T
    first, second = np.split(coefficients, [1 + len(axes)], axis=1)
    return [first.T @ first, second.T @ first, second.T @ second], int((~good).sum())
