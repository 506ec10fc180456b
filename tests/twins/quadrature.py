"""Integrals over start and process noise of flights of few samples, by brute force."""

from __future__ import annotations

import jax
import numpy as np

from bayeschute.likelihood.joint import Unknowns, cost


@jax.jit
def _bent(x, flight, hyper, theta):
    """Gradient and Hessian of the cost by start and process noise (6,)."""

    def slope(x):
        return jax.grad(lambda x: cost(flight, hyper, theta, Unknowns(x[:1], x[1:, None])))(x)

    return slope(x), jax.jacfwd(slope)(x)


def exact_optimum(flight, hyper, theta):
    """Start and shocks (6,) of least cost, by Newton's method, and the Hessian there."""
    at = np.zeros(6)
    for _ in range(20):
        gradient, hessian = _bent(at, flight, hyper, theta)
        at = at - np.linalg.solve(hessian, gradient)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-8)
    return at, hessian


def integrated(flight, hyper, theta, nodes=5):
    """Integrals of exp(-cost) over start and process noise by Gauss-Hermite rules about the exact optimum.

    Returns the logarithm of the integral, and mean and covariance of (start, process noise).
    """
    at, hessian = exact_optimum(flight, hyper, theta)
    lower = np.linalg.cholesky(hessian)
    x, w = np.polynomial.hermite_e.hermegauss(nodes)
    z = np.stack(np.meshgrid(*[x] * 6, indexing="ij")).reshape(6, -1)
    weight = np.prod(np.stack(np.meshgrid(*[w] * 6, indexing="ij")), axis=0).ravel()
    points = at[:, None] + np.linalg.solve(lower.T, z)
    many = Unknowns(points[:1], points[1:, None])
    minus = np.asarray(cost(flight, hyper, np.broadcast_to(theta[:, None], (1, z.shape[1])), many))
    logs = np.log(weight) + 0.5 * np.sum(z**2, axis=0) - minus
    total = np.logaddexp.reduce(logs)
    share = np.exp(logs - total)
    mean = points @ share
    covariance = (points - mean[:, None]) * share @ (points - mean[:, None]).T
    return total - np.log(np.diag(lower)).sum(), mean, covariance
