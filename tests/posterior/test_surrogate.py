"""The quadratic surrogate: exact for quadratics, and it counts failures."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.posterior.felt_axes import Group
from bayeschute.posterior.marginal import Quadratic, twice_price
from bayeschute.posterior.surrogate import Surrogate, build, monomials

FLAT = Quadratic.none(2)


def _quadratic(rng, p, rows=40, bend=1.0):
    """Residuals, and minus half their squares and the price of what their second degree makes."""
    c = rng.standard_normal((rows, 1 + p + p * (p + 1) // 2))
    c[:, 1 + p :] *= bend

    def density(xi):
        terms = np.asarray(monomials(jnp.asarray(xi)))
        bent = np.sum((c[:, 1 + p :] @ terms[1 + p :]) ** 2, axis=0)
        return -0.5 * (np.sum((c @ terms) ** 2, axis=0) + np.asarray(twice_price(bent, jnp.asarray(xi))))

    return lambda xi: c @ np.asarray(monomials(jnp.asarray(xi))), density


def _built(residuals, correction, rng):
    """Of one flight that all coordinates move, without a prior."""
    size = np.size(correction.slope)
    return build(lambda _, xi: residuals(xi), [Group((0,), np.arange(size))], np.zeros((1, 1 + size)), correction, rng)


def test_monomials():
    np.testing.assert_array_equal(monomials(jnp.array([2.0, 3.0])), [1.0, 2.0, 3.0, 4.0, 6.0, 9.0])


@pytest.mark.parametrize("p", [1, 3])
def test_exact_for_quadratic_residuals(p):
    rng = np.random.default_rng(p)
    residuals, density = _quadratic(rng, p)
    determinant = Quadratic(rng.standard_normal(p), np.diag(rng.standard_normal(p)))
    made, failed = _built(residuals, determinant, rng)
    xi = 2.0 * rng.standard_normal((p, 20))
    assert failed == 0
    wanted = density(xi) - determinant.slope @ xi - 0.5 * np.diag(determinant.curvature) @ xi**2
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), wanted, rtol=1e-9)
    assert float(made.log_density(jnp.asarray(xi[:, 3]))) == pytest.approx(wanted[3], rel=1e-9)
    gradient = jax.grad(lambda x: made.log_density(x))(jnp.asarray(xi[:, 0]))
    h = 1e-6 * np.eye(p)
    ends = [np.asarray(made.log_density(jnp.asarray(xi[:, :1] + s * h))) for s in (1.0, -1.0)]
    np.testing.assert_allclose(gradient, (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-4)


def test_failed_simulations_are_counted_and_left_out():
    rng = np.random.default_rng(3)
    residuals, density = _quadratic(rng, 2)
    made, failed = _built(lambda xi: np.where(xi[0] > 1.5, np.nan, residuals(xi)), FLAT, rng)
    assert failed > 0 and isinstance(made, Surrogate)
    xi = np.array([[0.3], [-1.0]])
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), density(xi), rtol=1e-9)


def test_law_it_has_no_mode_where_the_second_degree_cancels_the_first():
    """Squares alone are zero at 20 again, four hundred times dearer to reach for a density that is Gaussian nearby."""
    made, _ = _built(lambda xi: xi - 0.05 * xi**2, Quadratic.none(1), np.random.default_rng(6))
    at = np.linspace(-6.0, 24.0, 301)[None]
    value = np.asarray(made.log_density(jnp.asarray(at)))
    assert value[np.isclose(at[0], 20.0)] < -100.0
    assert np.argmax(value) == np.flatnonzero(np.isclose(at[0], 0.0))
    near = np.abs(at[0]) < 3.0  # 0.05 x^2 is less than a fifth of x: no price
    np.testing.assert_allclose(value[near], -0.5 * (at[0, near] - 0.05 * at[0, near] ** 2) ** 2, atol=1e-9)


def test_too_many_failures_are_refused():
    with pytest.raises(FloatingPointError, match="simulations around the optimum failed"):
        _built(lambda xi: np.full((5, xi.shape[1]), np.nan), FLAT, np.random.default_rng(4))


def test_flights_that_other_coordinates_move_have_forms_of_their_own():
    """Two flights that share the first of four coordinates, one of them recorded twice, and a prior on all."""
    rng = np.random.default_rng(9)
    shares = np.array([0, 1]), np.array([0, 2, 3])
    functions = [_quadratic(rng, p, bend=0.01) for p in (2, 3, 3)]
    parts = [Group((0,), shares[0]), Group((1, 2), shares[1])]
    prior, correction = rng.standard_normal((4, 5)), Quadratic(rng.standard_normal(4), np.eye(4))
    of = (0, 1, 1)
    made, failed = build(lambda k, xi: functions[k][0](xi[shares[of[k]]]), parts, prior, correction, rng)
    xi = 0.5 * rng.standard_normal((4, 20))  # bends have no price: that of two flights is not the sum of theirs
    wanted = sum(density(xi[shares[k]]) for (_, density), k in zip(functions, of, strict=True))
    wanted = wanted - 0.5 * np.sum((prior @ np.vstack([np.ones(20), xi])) ** 2, axis=0) - correction.at(xi)
    np.testing.assert_allclose(made.log_density(jnp.asarray(xi)), wanted, rtol=1e-9)
    assert failed == 0 and [one.bent.shape for one in made.flights] == [(3, 3), (6, 6)]
