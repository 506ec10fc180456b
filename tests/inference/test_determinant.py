"""The log determinant against dense matrices, and its polynomial against exact values."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from bayeschute.inference import determinant

POINT = np.array([1.3, -0.4])  # standard coordinates away from the optimum


def test_determinant_is_the_dense_one_and_has_no_slope_where_all_is_linear(linear, straight):
    _, _, by = linear.matrices.model(linear.flight)
    r, u, _ = linear.matrices.covariances(linear.flight, linear.hyper, linear.priors)
    wanted = 0.5 * np.linalg.slogdet(r + by[:, 2:] @ u @ by[:, 2:].T)[1]
    for xi in (np.zeros(2), POINT):
        assert determinant.exact(straight, xi) == pytest.approx(wanted, rel=1e-9)
    np.testing.assert_allclose(determinant.slope(straight), 0.0, atol=1e-8)
    for part in determinant.around(straight):
        np.testing.assert_allclose(part, 0.0, atol=1e-8)
    assert determinant.error(straight, 3, np.random.default_rng(0)) < 1e-9


def test_determinant_is_a_parabola_through_exact_values(falling):
    exact = {x: determinant.exact(falling, np.array([x])) for x in (-1.0, 0.0, 0.2, 1.0)}
    made = falling.determinant
    assert made.slope[0] == pytest.approx(0.5 * (exact[1.0] - exact[-1.0]), rel=1e-9)
    for x in (-1.0, 1.0):
        assert float(made.at(np.array([x]))) == pytest.approx(exact[x] - exact[0.0], rel=1e-9)
    assert determinant.slope(falling)[0] == pytest.approx((exact[0.2] - exact[0.0]) / 0.2, rel=1e-9)


def limited(monkeypatch, least: float, most: float) -> None:
    """Flights fail outside these standard coordinates."""
    exact = determinant.exact

    def some(marginal, xi):
        return exact(marginal, xi) if (xi >= least).all() and (xi <= most).all() else np.nan

    monkeypatch.setattr(determinant, "exact", some)


def test_the_slope_of_the_determinant_is_taken_to_the_side_on_which_flights_fly(falling, monkeypatch):
    exact = {x: determinant.exact(falling, np.array([x])) for x in (-0.2, 0.0)}
    limited(monkeypatch, -1.0, 0.1)
    assert determinant.slope(falling)[0] == pytest.approx((exact[0.0] - exact[-0.2]) / 0.2, rel=1e-9)
    limited(monkeypatch, -0.1, 0.1)
    with pytest.raises(FloatingPointError, match="both sides"):
        determinant.slope(falling)


def test_the_parabola_of_the_determinant_is_narrower_where_flights_fail(falling, monkeypatch):
    exact = {x: determinant.exact(falling, np.array([x])) for x in (-0.25, 0.0, 0.25)}
    limited(monkeypatch, -0.3, 0.6)
    made = determinant.around(falling)
    for x in (-0.25, 0.25):
        assert made.at(np.array([x])) == pytest.approx(exact[x] - exact[0.0], rel=1e-6)
    limited(monkeypatch, -0.1, 0.6)
    with pytest.raises(FloatingPointError, match="beside the optimum"):
        determinant.around(falling)


@pytest.mark.parametrize(("fails", "product"), [((), 0.3), ((1.0,), 0.3), ((1.0, -1.0), 0.0)])
def test_the_determinant_has_products_of_axes(straight, monkeypatch, fails, product):
    """One corner is enough for a product; where flights fail at both it is left out."""
    slope, curvature = np.array([0.5, -0.2]), np.array([[0.2, 0.3], [0.3, -0.1]])

    def known(_, xi):
        return np.nan if any((xi == corner).all() for corner in fails) else slope @ xi + 0.5 * xi @ curvature @ xi

    monkeypatch.setattr(determinant, "exact", known)
    made = determinant.around(straight)
    np.testing.assert_allclose(made.slope, slope)
    np.testing.assert_allclose(made.curvature, [[0.2, product], [product, -0.1]], atol=1e-12)


def test_determinant_error_is_what_the_polynomial_leaves(falling):
    xi = np.random.default_rng(7).standard_normal((3, 1))
    change = np.array([determinant.exact(falling, x) for x in xi]) - determinant.exact(falling, np.zeros(1))
    found = []
    flat = replace(falling, determinant=jax.tree.map(np.zeros_like, falling.determinant))
    for made in (falling, flat):
        left = change - np.asarray(made.determinant.at(xi.T))
        found.append(determinant.error(made, 3, np.random.default_rng(7)))
        assert found[-1] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
    assert found[0] < 0.01 * found[1]
