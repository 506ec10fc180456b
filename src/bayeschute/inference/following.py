"""How start and disturbances follow the parameters, the change of their effect included.

Given theta, the optimum u of start and shocks holds ``u = J' R^-1 r``, with r the residuals, R the covariance of their
noise and J the derivatives of the outputs by u, all of them at theta. Gauss-Newton's slope of u leaves out that J
changes with theta; so does the linear model that brings a simulation to its optimum with J_0, the derivatives at
theta_0. As r is noise, not small, the optimum is missed by as much as J changes, and the marginal density of parameters
that tell how strongly a gust is felt comes out too narrow, by a fifth and more. Here the slope of u is taken from
linearisations beside theta_0, and what J_0 leaves out, the pull ``c = u - J_0' R^-1 r``, which grows with theta, is put
where it belongs: as the mean of u the linear model begins with. With u_b the unknowns of the simulation at theta and s
what the linear model sees there,

    min over u of  1/2 |u|^2 + 1/2 |r(u)|^2 - c' (u - u_b)  =  1/2 |innovations of s - J_0 c|^2 + c' u_b - 1/2 |c|^2.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.inference.differences import beside
from bayeschute.inference.map import conditional
from bayeschute.inference.marginal import Marginal, course_at, shifted, with_slopes
from bayeschute.inference.noise import whiten
from bayeschute.inference.statespace import response
from bayeschute.inference.target import FlightData, Hyper, Linear, Unknowns, course, linearise, residuals
from bayeschute.numerics import processors

Array = NDArray[np.float64]


@jax.jit
def _optimum(flight: FlightData, hyper: Hyper, linear: Linear) -> Unknowns:
    return conditional(flight, hyper, linear).optimum


@jax.jit
def felt(flight: FlightData, hyper: Hyper, linear: Linear, residual: jax.Array) -> Unknowns:
    """``J' R^-1 r``: how strongly residuals (T, C, M) draw at standard start (D, M) and shocks (T, L, M)."""

    def white(series: jax.Array) -> jax.Array:
        return whiten(hyper.outputs(flight), flight.dt, jnp.asarray(flight.present), series)

    def outputs(unknowns: Unknowns) -> jax.Array:
        driven = course(flight, hyper, unknowns)
        return white(response(linear.steps, driven.start, driven.error, still))

    many = residual.shape[2]
    still = jnp.zeros((linear.steps.out_theta.shape[2], many))
    zero = Unknowns(jnp.zeros((flight.starts, many)), jnp.zeros((flight.samples, flight.latent.size, many)))
    made: Unknowns = jax.vjp(outputs, zero)[1](white(residual))[0]
    return made


def follow(marginal: Marginal, step: float = 1.0) -> Marginal:
    """The posterior whose starts and shocks follow theta with the change of their effect.

    Args:
        marginal: The posterior from `marginalise`.
        step: Of the differences along every axis [posterior standard deviations]; less where a flight fails.

    Raises:
        FloatingPointError: If flights fail along an axis, however short the step.
    """

    def told(xi: Array) -> Array:
        """Optimum and residuals of every flight in one row."""
        theta, shift = shifted(marginal, jnp.asarray(xi))
        row = []
        for flight, along in zip(marginal.flights, marginal.along, strict=True):
            best = _optimum(flight, marginal.hyper, linearise(flight, theta, course_at(along, shift)))
            row += [*best, residuals(flight, theta, course(flight, marginal.hyper, best))]
        return np.concatenate([np.ravel(a) for a in row])

    with ThreadPoolExecutor(processors()) as pool:
        up, down, h = beside(
            lambda points: np.array(list(pool.map(told, points))),
            np.size(marginal.centre),
            step,
            "how start and disturbances follow the parameters",
        )
    by_theta = np.linalg.solve(np.asarray(marginal.scale).T, (up - down) / (2.0 * h)).T
    slopes, pulls, done = [], [], 0
    for flight, along in zip(marginal.flights, marginal.along, strict=True):
        parts = []
        for shape in (*(np.shape(a) for a in along.unknowns), np.shape(flight.observed)):
            size = int(np.prod(shape))
            parts.append(by_theta[done : done + size].reshape(*shape, np.size(marginal.centre)))
            done += size
        slope = Unknowns(*parts[:2])
        drawn = felt(flight, marginal.hyper, along.linear, jnp.asarray(parts[2]))
        slopes.append(slope)
        pulls.append(Unknowns(*(a - np.asarray(b) for a, b in zip(slope, drawn, strict=True))))
    return with_slopes(marginal, slopes, pulls)
