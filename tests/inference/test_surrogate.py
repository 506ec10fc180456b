"""The quadratic surrogate: exact for quadratics, and it counts failures."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.inference.surrogate import Surrogate, build, monomials


def _quadratic(rng, p, rows=40):
    c = rng.standard_normal((rows, 1 + p + p * (p + 1) // 2))
    return lambda xi: c @ np.asarray(monomials(jnp.asarray(xi)))


def test_monomials():
    np.testing.assert_array_equal(monomials(jnp.array([2.0, 3.0])), [1.0, 2.0, 3.0, 4.0, 6.0, 9.0])


@pytest.mark.parametrize("p", [1, 3])
def test_exact_for_quadratic_residuals(p):
    rng = np.random.default_rng(p)
    residuals = _quadratic(rng, p)
    made, failed = build(residuals, p, rng)
    xi = 2.0 * rng.standard_normal((p, 20))
    assert failed == 0
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), -0.5 * np.sum(residuals(xi) ** 2, axis=0), rtol=1e-9)
    gradient = jax.grad(lambda x: made.log_density(x))(jnp.asarray(xi[:, 0]))
    assert gradient.shape == (p,) and np.isfinite(gradient).all()


def test_failed_simulations_are_counted_and_left_out():
    rng = np.random.default_rng(3)
    residuals = _quadratic(rng, 2)
    made, failed = build(lambda xi: np.where(xi[0] > 1.5, np.nan, residuals(xi)), 2, rng)
    assert failed > 0 and isinstance(made, Surrogate)
    xi = np.array([[0.3], [-1.0]])
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), -0.5 * np.sum(residuals(xi) ** 2, axis=0), rtol=1e-9)


def test_too_many_failures_are_refused():
    with pytest.raises(FloatingPointError, match="simulations around the optimum failed"):
        build(lambda xi: np.full((5, xi.shape[1]), np.nan), 2, np.random.default_rng(4))
