"""The quadratic surrogate: exact for quadratics, and it counts failures."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.posterior.marginal import Quadratic
from bayeschute.posterior.surrogate import Surrogate, build, monomials

FLAT = Quadratic.none(2)


def _quadratic(rng, p, rows=40):
    c = rng.standard_normal((rows, 1 + p + p * (p + 1) // 2))
    return lambda xi: c @ np.asarray(monomials(jnp.asarray(xi)))


def test_monomials():
    np.testing.assert_array_equal(monomials(jnp.array([2.0, 3.0])), [1.0, 2.0, 3.0, 4.0, 6.0, 9.0])


@pytest.mark.parametrize("p", [1, 3])
def test_exact_for_quadratic_residuals(p):
    rng = np.random.default_rng(p)
    residuals = _quadratic(rng, p)
    determinant = Quadratic(rng.standard_normal(p), np.diag(rng.standard_normal(p)))
    made, failed = build(residuals, determinant, rng)
    xi = 2.0 * rng.standard_normal((p, 20))
    assert failed == 0
    wanted = (
        -0.5 * np.sum(residuals(xi) ** 2, axis=0)
        - determinant.slope @ xi
        - 0.5 * np.diag(determinant.curvature) @ xi**2
    )
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), wanted, rtol=1e-9)
    assert float(made.log_density(jnp.asarray(xi[:, 3]))) == pytest.approx(wanted[3], rel=1e-9)
    gradient = jax.grad(lambda x: made.log_density(x))(jnp.asarray(xi[:, 0]))
    h = 1e-6 * np.eye(p)
    ends = [np.asarray(made.log_density(jnp.asarray(xi[:, :1] + s * h))) for s in (1.0, -1.0)]
    np.testing.assert_allclose(gradient, (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-4)


def test_failed_simulations_are_counted_and_left_out():
    rng = np.random.default_rng(3)
    residuals = _quadratic(rng, 2)
    made, failed = build(lambda xi: np.where(xi[0] > 1.5, np.nan, residuals(xi)), FLAT, rng)
    assert failed > 0 and isinstance(made, Surrogate)
    xi = np.array([[0.3], [-1.0]])
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), -0.5 * np.sum(residuals(xi) ** 2, axis=0), rtol=1e-9)


def test_too_many_failures_are_refused():
    with pytest.raises(FloatingPointError, match="simulations around the optimum failed"):
        build(lambda xi: np.full((5, xi.shape[1]), np.nan), FLAT, np.random.default_rng(4))
