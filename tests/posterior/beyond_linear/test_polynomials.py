"""Polynomials that correct the linear models: against exact optima, differences and planted products."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.fitting import limited, minus_log_density, plain

from bayeschute.likelihood.joint import cost
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.beyond_linear import laplace, polynomials
from bayeschute.posterior.beyond_linear.comparison import compared
from bayeschute.posterior.beyond_linear.expansion import Expansion
from bayeschute.posterior.beyond_linear.laplace import at
from bayeschute.posterior.beyond_linear.linear_errors import linear_errors
from bayeschute.posterior.beyond_linear.polynomials import corrected, expanded, flattened, sides
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import Quadratic, draw_flights, log_density, place_at
from bayeschute.posterior.numpyro_model import log_likelihood


def test_no_error_is_found_where_all_is_linear(straight):
    np.testing.assert_allclose(linear_errors(straight).slope, 0.0, atol=1e-6)
    made, ahead = corrected(straight)
    np.testing.assert_allclose(ahead.step(), 0.0, atol=1e-6)
    assert ahead.has_mode
    for part in (*made.determinant, *made.bend):
        np.testing.assert_allclose(part, 0.0, atol=1e-6)
    for part in jax.tree.leaves(made.along[0].aside):
        np.testing.assert_allclose(part, 0.0, atol=1e-7)
    np.testing.assert_allclose(compared(made, np.array([[1.3, -0.4], [-1.3, 0.4]])).errors, 0.0, atol=1e-5)
    xi = np.random.default_rng(0).standard_normal((2, 6))
    np.testing.assert_allclose(log_density(made, xi), log_density(straight, xi), atol=1e-5)


@pytest.mark.parametrize("which", ["falling", "gusty"])
def test_corrected_agrees_to_second_order(which, request):
    """Slope and curvature of the log density by differences over a small step; without corrections they are others."""
    made = request.getfixturevalue(which)
    h = 0.25
    made, _ = corrected(made[-1] if which == "gusty" else made, step=h)
    exact = {x: -minus_log_density(made, np.array([x])) for x in (-h, 0.0, h)}
    off = []
    for one in (made, plain(made)):
        ours = np.asarray(log_density(one, np.array([[-h, 0.0, h]])))
        slope = ours[2] - ours[0] - exact[h] + exact[-h]
        curvature = ours[2] + ours[0] - 2.0 * ours[1] - exact[h] - exact[-h] + 2.0 * exact[0.0]
        off.append((abs(slope) / (2.0 * h), abs(curvature) / h**2))
    assert off[0][0] < 0.01 and off[0][1] < 0.02, off
    assert max(off[1]) > 0.05, off


def test_the_determinant_is_a_parabola_through_exact_values(falling):
    exact = {x: at(falling, np.array([x])).determinant for x in (-1.0, 0.0, 1.0)}
    for x in (-1.0, 1.0):
        assert float(falling.determinant.at(np.array([x]))) == pytest.approx(exact[x] - exact[0.0], rel=1e-5)
    assert np.abs(falling.determinant.slope).max() > 0.01


def test_the_way_ahead_leads_to_the_mode(falling):
    made, ahead = corrected(falling)
    grid = np.linspace(-2.0, 2.0, 401)
    best = grid[np.argmax(np.asarray(log_density(made, grid[None])))]
    assert ahead.step()[0] == pytest.approx(best, abs=0.01 + 0.1 * abs(best)) and abs(best) > 0.04


def test_a_density_without_mode_keeps_the_corrections_that_leave_one(straight):
    """What outweighs the density along an axis is reduced until a fifth of a Gaussian's curvature is left there."""
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((2, 2)))[0]
    bent = (axes * [-1.7, 0.4]) @ axes.T
    made, about = corrected(straight)
    made = replace(made, bend=Quadratic(np.array([0.1, 0.2]), bent))
    about = Expansion(about.slope + made.bend.slope, about.curvature + bent)
    assert not about.has_mode
    tame, there = flattened(made, about)
    assert there.has_mode
    np.testing.assert_allclose(axes.T @ tame.bend.curvature @ axes, np.diag([-0.8, 0.4]), atol=1e-4)
    np.testing.assert_allclose(tame.bend.slope, [0.1, 0.2])
    same, again = flattened(tame, there)
    np.testing.assert_allclose(same.bend.curvature, tame.bend.curvature, atol=1e-9)
    step = np.array([0.5, -1.0])
    by_density = np.diff(np.asarray(log_density(tame, np.stack([0.0 * step, step], axis=1))))[0]
    assert again.change(step) == pytest.approx(-by_density, abs=1e-4)


def test_an_expansion_by_axes_is_the_whole_one_but_for_what_corners_tell(straight, monkeypatch):
    """The squares get a product of both axes, and a bend along one, that the linear models don't have."""

    def bent(usual):
        def made(*given, **rest):
            found, xi = usual(*given, **rest), given[1 if usual is plain else 4]
            return found._replace(squares=found.squares + 0.3 * xi[0] * xi[1] + 0.1 * xi[1] ** 2)

        return made

    plain = laplace.at
    for name in ("at", "at_corner"):
        monkeypatch.setattr(laplace, name, bent(getattr(laplace, name)))
    by_axes, whole = expanded(straight, sides(straight)), corrected(straight)[1]
    np.testing.assert_allclose(by_axes.slope, whole.slope, atol=1e-6)
    np.testing.assert_allclose(whole.curvature, [[1.0, 0.3], [0.3, 1.2]], atol=1e-5)
    np.testing.assert_allclose(by_axes.curvature, [[1.0, 0.0], [0.0, 1.2]], atol=1e-5)


def test_an_axis_that_seems_to_have_no_curvature_is_looked_at_itself(straight, monkeypatch):
    """Polynomials that are wrong along a skew axis are mended there, and kept along the other."""
    axes, wrong = np.linalg.qr(np.random.default_rng(0).standard_normal((2, 2)))[0], np.array([0.3, 0.1])
    bent = Quadratic(wrong, (axes * [-1.7, 0.4]) @ axes.T)
    monkeypatch.setattr(polynomials, "_polynomials", lambda *given: (bent, Quadratic.none(2)))
    made, about = corrected(straight)
    np.testing.assert_allclose(axes.T @ about.curvature @ axes, np.diag([1.0, 1.4]), atol=1e-4)
    np.testing.assert_allclose(about.slope @ axes, [0.0, wrong @ axes[:, 1]], atol=1e-4)
    np.testing.assert_allclose(axes.T @ made.bend.curvature @ axes, np.diag([0.0, 0.4]), atol=1e-4)


def test_the_step_is_shorter_where_flights_fail(falling, monkeypatch):
    near, _ = corrected(falling, 0.25)
    limited(monkeypatch, -0.3, 0.6)
    made, _ = corrected(falling)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9), made.determinant, near.determinant)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9), made.bend, near.bend)
    limited(monkeypatch, -0.1, 0.6)
    with pytest.raises(FloatingPointError, match="beside the optimum"):
        corrected(falling)


def test_only_the_axis_on_which_flights_fail_gets_a_shorter_step(straight, monkeypatch):
    """The second, to one side."""
    real, asked = laplace.at, []

    def some(marginal, xi, **rest):
        asked.append(tuple(xi.tolist()))
        made = real(marginal, xi, **rest)
        return made._replace(determinants=np.nan * made.determinants) if xi[1] > 0.3 else made

    monkeypatch.setattr(laplace, "at", some)
    made, _ = corrected(straight)
    wanted = {(s, 0.0) for s in (1.0, -1.0)} | {(0.0, s * h) for s in (1.0, -1.0) for h in (1.0, 0.5, 0.25)}
    assert set(asked) - {(0.0, 0.0)} == wanted
    for part in (*made.determinant, *made.bend):
        np.testing.assert_allclose(part, 0.0, atol=1e-6)


@pytest.mark.parametrize(("fails", "known"), [((), True), ((1.0,), True), ((1.0, -1.0), False)])
def test_the_polynomials_have_products_of_axes(straight, monkeypatch, fails, known):
    """One corner is enough for a product; where flights fail at both it is left out."""
    slope, curvature = np.array([0.5, -0.2]), np.array([[0.2, 0.3], [0.3, -0.1]])
    real, at_corner, begun = laplace.at, laplace.at_corner, []

    def value(xi):
        failed = any((xi == corner).all() for corner in fails)
        return np.nan if failed else slope @ xi + 0.5 * xi @ curvature @ xi

    def bent(exact, xi):
        return exact._replace(squares=exact.squares - 2.0 * value(xi), determinants=np.array([7.0 + value(xi)]))

    def bent_corner(marginal, here, one, other, xi, both):
        begun.append(tuple(xi.tolist()))
        found, exact = at_corner(marginal, here, one, other, xi, both), real(marginal, xi)
        for ours, wanted in zip(found[:3], exact[:3], strict=True):
            assert ours == pytest.approx(wanted, abs=1e-6)  # linear: two steps together are exact
        return bent(found, xi)

    monkeypatch.setattr(laplace, "at", lambda marginal, xi, **rest: bent(real(marginal, xi, **rest), xi))
    monkeypatch.setattr(laplace, "at_corner", bent_corner)
    made, product = corrected(straight)[0], 0.3 * known
    assert begun == [(1.0, 1.0), (-1.0, -1.0)][: 1 + bool(fails)]
    for part, factor in ((made.determinant, 1.0), (made.bend, -2.0)):
        np.testing.assert_allclose(part.slope, factor * slope, atol=1e-6)
        np.testing.assert_allclose(part.curvature, factor * np.array([[0.2, product], [product, -0.1]]), atol=1e-6)


def _exact(gusty, xi):
    """Least costs and process noise of fits with the parameter held at standard coordinates."""
    flight, hyper, _, made, _ = gusty
    found = []
    for theta in np.asarray(made.theta(np.asarray(xi)[None]))[0]:
        held = [Prior("felt", float(theta), 1e-7, False, "1", "held")]
        found.append(fit([flight], hyper, held, np.array([theta]), tolerance=1e-4))
    return found


def test_the_exact_profile_is_followed(gusty):
    """The density without its determinant is that of the exact optimum, whose curvature Gauss-Newton's is not."""
    _, _, priors, made, right = gusty
    xi = np.array([-1.0, 0.0, 1.0])
    off, theta = [], np.asarray(made.theta(xi[None]))[0]
    wanted = -np.array([one.cost for one in _exact(gusty, xi)])
    wanted = wanted - 0.5 * ((theta - priors[0].centre) / priors[0].scale) ** 2
    for one in (made, right):
        ours = np.asarray(log_density(replace(one, determinant=Quadratic.none(1)), xi[None]))
        off.append(np.abs(ours - ours[1] - wanted + wanted[1]).max())
    assert off[0] > 0.08 and off[1] < 0.02, off


def test_draws_without_random_numbers_lie_at_the_exact_optimum(gusty):
    """Their cost, simulated, is the least; it is not where draws follow the linear model alone."""
    flight, hyper, _, made, right = gusty
    xi, still = np.array([-1.0, 1.0]), (jax.tree.map(np.zeros_like, normals(flight, 2, np.random.default_rng(0))),)
    least, theta = np.array([one.cost for one in _exact(gusty, xi)]), np.asarray(made.theta(xi[None]))
    above = [
        np.asarray(cost(flight, hyper, theta, draw_flights(one, xi[None], still)[0].unknowns)) - least
        for one in (made, right)
    ]
    assert (above[0] > 0.05).all() and (np.abs(above[1]) < 0.015).all(), above


def test_asides_are_what_linear_slopes_lack(gusty):
    """With both a flight is where Laplace's approximation finds it, to second order."""
    flight, *_, right = gusty
    (along,) = right.along
    ends = [at(right, np.array([sign])).flights[0] for sign in (1.0, -1.0)]
    exact = jax.tree.map(lambda a, b: (np.asarray(a) - np.asarray(b)) / (2.0 * float(right.scale[0, 0])), *ends)
    both = jax.tree.map(lambda a, b: np.asarray(a + b)[..., 0], along.slope, along.aside)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max()), both, exact)
    there = place_at(flight, along, jnp.asarray(right.scale)[:, 0])
    lacking = np.abs(np.asarray(there.path) - ends[0].path).max()
    assert lacking > 3.0 * np.abs(there.path + np.asarray(along.aside.path) @ right.scale[:, 0] - ends[0].path).max()


def test_numpyro_is_told_the_same(gusty):
    *_, right = gusty
    xi = np.array([[-1.0, 0.0, 1.0]])
    whole = np.asarray(log_density(right, xi))
    z = (np.asarray(right.theta(xi))[0] - 1.0) / 1.0
    ours = np.array([float(log_likelihood(right)(jnp.asarray(t))) for t in np.asarray(right.theta(xi)).T])
    np.testing.assert_allclose(ours - 0.5 * z**2 - (ours[1] - 0.5 * z[1] ** 2), whole - whole[1], atol=1e-8)
