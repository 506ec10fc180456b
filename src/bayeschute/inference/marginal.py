"""The posterior of the parameters alone, start and latent disturbances integrated out as Gaussian given them.

At a point theta_0 the flight is linearised along its conditional optimum. For another theta follow that optimum
linearly, simulate there once with the full equations, and integrate what is left as a Gaussian: the linear model's
filter turns the simulation's residuals into innovations, ``log density = -1/2 |innovations|^2 - log det`` (METHODS 6).
The determinant depends on theta through the linearisation; leaving that out moves parameters by several standard
errors, so a polynomial stands for it (`inference.determinant`). That the linear model's derivatives are those at
theta_0 is made good by `inference.following`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.air.vector import Component
from bayeschute.inference import gap
from bayeschute.inference.drawing import Normals, about, drawn
from bayeschute.inference.map import Optimum, conditional
from bayeschute.inference.priors import Prior, factor, working
from bayeschute.inference.statespace import Gains, innovations, response
from bayeschute.inference.target import (
    Course,
    FlightData,
    Hyper,
    Linear,
    Unknowns,
    course,
    filter_gains,
    linearise,
    residuals,
)

Array = NDArray[np.float64]
_CORRECTIONS = 1


class Along(NamedTuple):
    """A flight about the conditional optimum of its course.

    Attributes:
        unknowns: The optimum at theta_0.
        unknowns_slope: Its derivatives by theta, last axis.
        pull: Likewise of what draws the unknowns aside, since the linear model's derivatives are not those at theta
            (`inference.following`).
        driven: The course at theta_0.
        slope: Its derivatives by theta, last axis.
        offset: Linear response of the outputs to that course (T, C).
        offset_slope: Its derivatives by theta, less the response to the pull (T, C, P).
        gap: Mean of simulated outputs over start and disturbances given theta_0, less those at their optimum (T, C).
        lost: How many pairs of simulations behind the gap failed.
        linear: The flight linearised there.
        gains: The filter.
    """

    unknowns: Unknowns
    unknowns_slope: Unknowns
    pull: Unknowns
    driven: Course
    slope: Course
    offset: Component
    offset_slope: Component
    gap: Component
    lost: int
    linear: Linear
    gains: Gains


class Quadratic(NamedTuple):
    """``slope xi + 1/2 xi' curvature xi`` of standard coordinates: (P,) and a symmetric matrix (P, P)."""

    slope: Component
    curvature: Component

    @classmethod
    def none(cls, parameters: int) -> Quadratic:
        """Zero."""
        return cls(np.zeros(parameters), np.zeros((parameters, parameters)))

    def at(self, xi: Component) -> jax.Array:
        """Values (...) at (P, ...)."""
        bent = jnp.tensordot(self.curvature, xi, axes=1)
        return jnp.tensordot(self.slope, xi, axes=1) + 0.5 * jnp.sum(xi * bent, axis=0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marginal:
    """The marginal posterior; `scale` maps standard coordinates xi to theta: ``theta = centre + scale @ xi``.

    Attributes:
        flights: Records.
        hyper: Noise parameters, fixed.
        along: Start and disturbances given theta, one entry per flight.
        centre: Where the flights were linearised (P,).
        scale: Lower Cholesky factor of the Laplace covariance of theta (P, P).
        prior_centre: Prior means of theta (P,).
        prior_factor: Lower Cholesky factor of its prior covariance (P, P).
        determinant: Log determinant of all flights together, less its value at theta_0.
        pull: What the pull of all flights adds to minus the log density.
    """

    flights: tuple[FlightData, ...]
    hyper: Hyper
    along: tuple[Along, ...]
    centre: Component
    scale: Component
    prior_centre: Component
    prior_factor: Component
    determinant: Quadratic
    pull: Quadratic

    @property
    def rest(self) -> Quadratic:
        """Minus the log density less the squares of `projected_residuals`."""
        return Quadratic(*(a + b for a, b in zip(self.determinant, self.pull, strict=True)))

    def theta(self, xi: Component) -> Component:
        """Parameters (P, ...) of standard coordinates (P, ...)."""
        rank = jnp.ndim(xi) - 1
        return self.centre.reshape(-1, *(1,) * rank) + jnp.tensordot(self.scale, xi, axes=1)


@jax.jit
def _conditional(flight: FlightData, hyper: Hyper, linear: Linear) -> tuple[Unknowns, Unknowns, Gains]:
    """The conditional optimum of a linearised flight, its derivatives by theta, and the filter."""
    given = conditional(flight, hyper, linear)
    return given.optimum, jax.tree.map(jnp.negative, given.slope), filter_gains(flight, hyper, linear)


@jax.jit
def _responses(
    flight: FlightData, hyper: Hyper, linear: Linear, unknowns: Unknowns, slope: Unknowns, pull: Unknowns
) -> tuple[Course, Course, jax.Array, jax.Array]:
    """The course of these unknowns, its derivatives, and the linear responses of `Along`."""
    driven, by_theta = course(flight, hyper, unknowns), course(flight, hyper, slope)
    seen = course(flight, hyper, jax.tree.map(jnp.subtract, slope, pull))
    p = by_theta.start.shape[1]
    both = response(
        linear.steps,
        jnp.concatenate([driven.start[:, None], seen.start], axis=1),
        jnp.concatenate([driven.error[..., None], seen.error], axis=2),
        jnp.zeros((p, 1 + p)),
    )
    return driven, by_theta, both[..., 0], both[..., 1:]


def _along(flight: FlightData, hyper: Hyper, theta: Array, unknowns: Unknowns) -> Along:
    """A flight about the conditional optimum next to these unknowns."""
    linear = linearise(flight, theta, course(flight, hyper, unknowns))
    best, slope, made = _conditional(flight, hyper, linear)
    pull = jax.tree.map(jnp.zeros_like, slope)
    driven, by_theta, offset, offset_slope = _responses(flight, hyper, linear, best, slope, pull)
    mean, lost = gap.mean(flight, hyper, made, theta, driven)
    return Along(best, slope, pull, driven, by_theta, offset, offset_slope, mean, lost, linear, made)


def with_slopes(marginal: Marginal, slopes: Sequence[Unknowns], pulls: Sequence[Unknowns]) -> Marginal:
    """The posterior whose starts and shocks follow theta by these slopes, against these pulls.

    Args:
        marginal: The posterior.
        slopes: Of every flight, as `Along.unknowns_slope`.
        pulls: Likewise, as `Along.pull`.
    """
    scale, along, total = np.asarray(marginal.scale), [], Quadratic.none(np.size(marginal.centre))
    for flight, before, slope, pull in zip(marginal.flights, marginal.along, slopes, pulls, strict=True):
        made = _responses(flight, marginal.hyper, before.linear, before.unknowns, slope, pull)
        names = ("driven", "slope", "offset", "offset_slope")
        along.append(before._replace(unknowns_slope=slope, pull=pull, **dict(zip(names, made, strict=True))))
        for at, by, pulled in zip(before.unknowns, slope, pull, strict=True):
            u = np.asarray(by).reshape(-1, len(scale)) @ scale
            c = np.asarray(pulled).reshape(-1, len(scale)) @ scale
            both = c.T @ u
            total = Quadratic(total.slope + np.ravel(at) @ c, total.curvature + both + both.T - c.T @ c)
    return replace(marginal, along=tuple(along), pull=total)


def marginalise(flights: Sequence[FlightData], hyper: Hyper, priors: Sequence[Prior], optimum: Optimum) -> Marginal:
    """Set the marginal posterior up at an optimum, its determinant still held constant."""
    pairs = zip(flights, optimum.unknowns, strict=True)
    along = tuple(_along(flight, hyper, optimum.theta, unknowns) for flight, unknowns in pairs)
    flat, root = Quadratic.none(len(priors)), np.linalg.cholesky(optimum.covariance)
    return Marginal(tuple(flights), hyper, along, optimum.theta, root, working(priors)[0], factor(priors), flat, flat)


def gap_slope(marginal: Marginal) -> Array:
    """What the gap adds to the slope of minus the log density at theta_0, by theta (P,)."""
    total: Array = np.zeros(np.size(marginal.centre))
    for along in marginal.along:
        total = total + np.asarray(gap.slope(along.linear, along.gains, along.gap))
    return total


@jax.jit
def course_at(along: Along, shift: jax.Array) -> Course:
    """Courses at ``theta_0 + shift`` (P, ...)."""
    rank = jnp.ndim(shift) - 1
    return Course(
        jnp.reshape(along.driven.start, (-1, *(1,) * rank)) + along.slope.start @ shift,
        jnp.reshape(along.driven.error, (*jnp.shape(along.driven.error), *(1,) * rank)) + along.slope.error @ shift,
    )


def shifted(marginal: Marginal, xi: Component) -> tuple[jax.Array, jax.Array]:
    """Parameters at standard coordinates (P, ...), and how far they lie from the centre."""
    theta = marginal.theta(jnp.asarray(xi))
    return theta, theta - jnp.reshape(marginal.centre, (-1, *(1,) * (theta.ndim - 1)))


@jax.jit
def _seen(along: Along, residual: jax.Array, shift: jax.Array) -> jax.Array:
    """What the linear model sees (T, C, B): residuals of the full simulation less its gap, plus the linear response."""
    return residual + (along.offset - along.gap)[..., None] + along.offset_slope @ shift


def _series(flight: FlightData, along: Along, theta: jax.Array, shift: jax.Array) -> jax.Array:
    return _seen(along, residuals(flight, theta, course_at(along, shift)), shift)


_innovations = jax.jit(innovations)
_gains = jax.jit(filter_gains)


def projected_residuals(marginal: Marginal, xi: Component) -> jax.Array:
    """The vector whose ``-1/2 |.|^2`` is the marginal log density without its `rest`, up to a constant.

    Args:
        marginal: The posterior.
        xi: Standard coordinates (P, B).

    Returns:
        (N, B): innovations of every flight, then theta under its prior.
    """
    theta, shift = shifted(marginal, xi)
    parts = [
        _innovations(along.gains, _series(flight, along, theta, shift)).reshape(-1, xi.shape[1])
        for flight, along in zip(marginal.flights, marginal.along, strict=True)
    ]
    away = theta - jnp.asarray(marginal.prior_centre)[:, None]
    prior = jax.scipy.linalg.solve_triangular(jnp.asarray(marginal.prior_factor), away, lower=True)
    return jnp.concatenate([*parts, prior])


def log_density(marginal: Marginal, xi: Component) -> jax.Array:
    """Marginal log density (B,) up to a constant at standard coordinates (P, B); NaN where a simulation fails."""
    return -0.5 * jnp.sum(projected_residuals(marginal, xi) ** 2, axis=0) - marginal.rest.at(jnp.asarray(xi))


def sample_log_likelihoods(marginal: Marginal, xi: jax.Array) -> tuple[jax.Array, ...]:
    """Log density of every sample given all earlier ones and the parameters, start and disturbances integrated out.

    Args:
        marginal: The posterior.
        xi: Standard coordinates (P, B).

    Returns:
        (T, B) per flight, zero where nothing was recorded; determinants are those at theta_0.
    """
    theta, shift = shifted(marginal, xi)
    pairs = zip(marginal.flights, marginal.along, strict=True)
    return tuple(_log_likelihoods(f, a.gains, _series(f, a, theta, shift)) for f, a in pairs)


@jax.jit
def _log_likelihoods(flight: FlightData, made: Gains, series: jax.Array) -> jax.Array:
    scale = jnp.log(jnp.diagonal(made.root, axis1=1, axis2=2)) + 0.5 * jnp.log(2.0 * jnp.pi)
    constant = jnp.sum(jnp.where(flight.present, scale, 0.0), axis=1)
    return -0.5 * jnp.sum(innovations(made, series) ** 2, axis=1) - constant[:, None]


def draw_unknowns(
    marginal: Marginal, xi: Component, numbers: tuple[Normals, ...], hyper: Hyper | None = None
) -> tuple[Unknowns, ...]:
    """Draws of every flight's unknowns given theta, by simulation smoothing (Durbin and Koopman 2002).

    A draw of the linear model is moved onto the data by the smoother. The full simulation then departs from the linear
    one by more than the posterior's width, so the move is repeated with residuals simulated at the draw itself
    (randomised optimisation, Bardsley et al. 2014, with fixed Jacobians).

    Args:
        marginal: The posterior.
        xi: Standard coordinates of the parameters (P, B).
        numbers: From `normals`, per flight; zeros give the conditional modes.
        hyper: Noise parameters of this draw; the marginal's where None.

    Returns:
        Start (D, B) and shocks (T, L, B) per flight.
    """
    theta, shift = shifted(marginal, xi)
    law, found = hyper or marginal.hyper, []
    for flight, along, z in zip(marginal.flights, marginal.along, numbers, strict=True):
        made = along.gains if hyper is None else _gains(flight, hyper, along.linear)
        pull = Unknowns(*(jnp.tensordot(a, shift, axes=1) for a in along.pull))
        free = drawn(flight, law, made, _series(flight, along, theta, shift), z)
        for _ in range(_CORRECTIONS):
            residual = residuals(flight, theta, course(flight, law, _sum(free, pull)))
            free = drawn(flight, law, made, about(made, residual, free), z)
        found.append(_sum(free, pull))
    return tuple(found)


def _sum(one: Unknowns, other: Unknowns) -> Unknowns:
    return jax.tree.map(jnp.add, one, other)
