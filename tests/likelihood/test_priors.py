"""Priors in working coordinates."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from bayeschute.likelihood.priors import (
    Prior,
    conflict_variance_factor,
    correlated,
    covariance,
    factor,
    from_equation_error,
    of_values,
    own_coordinates,
    precision,
    read_priors,
    standard,
    values,
    values_and_sds,
    working,
)

LOG = Prior("a", np.log(2.0), 0.4, True, "kg", "")
PLAIN = Prior("b", -1.0, 0.5, False, "1", "")


def test_values_and_moments():
    theta = np.random.default_rng(0).standard_normal((200_000, 2)) * [0.4, 0.5] + [np.log(2.0), -1.0]
    made = values([LOG, PLAIN], theta)
    for p, column in zip((LOG, PLAIN), made.T, strict=True):
        assert p.moments() == pytest.approx((column.mean(), column.std()), rel=0.02)


def test_working_coordinates():
    centre, scale = working([LOG, PLAIN])
    np.testing.assert_allclose(centre, [np.log(2.0), -1.0])
    np.testing.assert_allclose(scale, [0.4, 0.5])


@pytest.mark.parametrize(("se", "wanted"), [(0.1, 0.3), (0.01, 0.05)])
def test_equation_error_prior_has_a_floor(se, wanted):
    made = from_equation_error("a", 0.7, se, inflation=3.0, floor=0.05, flight="F1")
    assert (made.centre, made.scale, made.logarithmic) == (0.7, pytest.approx(wanted), False)
    assert "F1" in made.source


def _law(count, seed=0):
    root = np.random.default_rng(seed).standard_normal((count, count))
    return root @ root.T + 0.1 * np.eye(count)


@pytest.fixture(scope="module")
def four():
    """Four correlated priors, one of them logarithmic, and their law."""
    blank = [Prior(name, 9.0, 9.0, name == "c", "m", "x") for name in "abcd"]
    centre, law = np.array([0.3, -1.0, 2.0, 0.0]), _law(4)
    return correlated(blank, centre, law), centre, law


def test_correlated_priors_have_the_covariance_that_they_were_given(four):
    made, centre, law = four
    np.testing.assert_array_equal(working(made)[0], centre)
    np.testing.assert_allclose(working(made)[1], np.sqrt(np.diag(law)), rtol=1e-14)
    np.testing.assert_allclose(covariance(made), law, rtol=1e-12)
    np.testing.assert_allclose(factor(made), np.linalg.cholesky(law), rtol=1e-10)
    np.testing.assert_allclose(precision(made), np.linalg.inv(law), rtol=1e-9)
    assert [(p.name, p.logarithmic, p.unit, p.source) for p in made] == [(n, n == "c", "m", "x") for n in "abcd"]
    scale = np.sqrt(np.diag(law))
    assert made[1].correlation == pytest.approx({n: law[1, i] / (scale[1] * scale[i]) for n, i in zip("acd", (0, 2, 3), strict=True)})  # fmt: skip


def test_making_them_again_of_their_covariance_changes_nothing(four):
    made, centre, _ = four
    again = correlated(made, centre, covariance(made))
    for one, other in zip(made, again, strict=True):
        assert one.scale == pytest.approx(other.scale) and one.correlation == pytest.approx(other.correlation)


def test_priors_without_correlation_are_independent():
    made = [Prior("a", 1.0, 0.5, False, "1", ""), Prior("b", 2.0, 3.0, True, "1", "")]
    np.testing.assert_array_equal(covariance(made), np.diag([0.25, 9.0]))
    np.testing.assert_array_equal(factor(made), np.diag([0.5, 3.0]))
    np.testing.assert_allclose(precision(made), np.diag([4.0, 1.0 / 9.0]))
    np.testing.assert_allclose(standard(made, np.array([2.0, -1.0])), [2.0, -1.0])
    diagonal = correlated(made, np.zeros(2), np.diag([4.0, 1.0]))
    assert all(p.correlation == {} for p in diagonal)


@pytest.mark.parametrize("kept", [(0, 1, 2), (3, 1), (2,)])
def test_correlations_with_names_that_are_not_there_do_not_count(four, kept):
    """What is left is the marginal law of those that are, in any order."""
    made, centre, law = four
    some = [made[i] for i in kept]
    np.testing.assert_allclose(covariance(some), law[np.ix_(kept, kept)], rtol=1e-12)
    np.testing.assert_array_equal(working(some)[0], centre[list(kept)])


def test_a_correlation_takes_two(four):
    """One whose other side says nothing of it, as a prior that was given anew, is none."""
    made, _, law = four
    lone = [*made[:3], Prior("d", 0.0, 2.0, False, "1", "")]
    wanted = law.copy()
    wanted[3, :3], wanted[:3, 3], wanted[3, 3] = 0.0, 0.0, 4.0
    np.testing.assert_allclose(covariance(lone), wanted, rtol=1e-12)


def test_standard_coordinates_are_those_of_the_density(four):
    made, centre, law = four
    theta = centre + np.random.default_rng(1).standard_normal((2, 5, 4))
    z = standard(made, theta)
    exact = scipy.stats.multivariate_normal(centre, law)
    wanted = -2.0 * (exact.logpdf(theta) - exact.logpdf(centre))
    assert z.shape == theta.shape
    np.testing.assert_allclose(np.sum(z**2, axis=-1), wanted, rtol=1e-9)
    np.testing.assert_allclose(z[1, 3], standard(made, theta[1, 3]), rtol=1e-12)
    np.testing.assert_allclose(centre + z @ factor(made).T, theta, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(standard(made, centre), 0.0)


def test_what_is_not_finite_stays_so(four):
    """A search that has lost its way is told by its cost, not by an exception."""
    made, centre, _ = four
    for value in (np.nan, np.inf):
        assert not np.isfinite(standard(made, np.where(np.arange(4) == 1, value, centre))).all()


FORCE = Prior("transverse[e]", -0.2, 0.1, False, "1", "", air_share=0.8)
AIR = Prior("enclosed_air_factor", 0.0, 0.5, True, "1", "")


def test_a_coefficient_at_the_vehicles_apparent_mass_grows_with_that_of_the_fit():
    theta = np.array([[-0.2, 0.3, np.log(1.5)], [-0.1, 0.3, 0.0]])
    made = values([FORCE, PLAIN, AIR], theta)
    np.testing.assert_allclose(made, [[-0.2 * (1.0 + 0.8 * 0.5), 0.3, 1.5], [-0.1, 0.3, 1.0]])
    np.testing.assert_allclose(values([FORCE, PLAIN], theta[:, :2]), theta[:, :2])  # the factor is no parameter


def test_values_lead_back_to_working_coordinates():
    priors = [LOG, FORCE, PLAIN, AIR]
    theta = np.random.default_rng(3).standard_normal((2, 5, 4))
    np.testing.assert_allclose(of_values(priors, values(priors, theta)), theta, atol=1e-12)
    own = own_coordinates(priors, theta)
    np.testing.assert_allclose(own[..., [0, 2, 3]], theta[..., [0, 2, 3]], atol=1e-12)
    np.testing.assert_allclose(own[..., 1], values(priors, theta)[..., 1])


def test_standard_deviations_of_values_are_those_of_narrow_draws():
    priors, rng = [LOG, FORCE, PLAIN, AIR], np.random.default_rng(4)
    theta, root = np.array([0.7, -0.2, 1.0, np.log(0.5)]), 1e-4 * np.tril(rng.standard_normal((4, 4)))
    made, sd = values_and_sds(priors, theta, root @ root.T)
    np.testing.assert_allclose(made, values(priors, theta))
    drawn = values(priors, theta + rng.standard_normal((200_000, 4)) @ root.T)
    np.testing.assert_allclose(sd, drawn.std(axis=0), rtol=0.02)


def test_a_prior_in_conflict_is_the_gaussian_that_a_t_distribution_has_there(four):
    """The same slope of the log density, by differences; nothing happens where a Gaussian leads as far."""
    priors, centre, scale = four
    names, law = [p.name for p in priors], scipy.stats.multivariate_t(centre, scale, df=4.0)
    theta = centre + 8.0 * np.sqrt(np.diag(scale)) * np.array([1.0, -0.5, 0.3, 0.8])
    factor = conflict_variance_factor(priors, theta, names)
    step = 1e-5 * np.eye(4)
    slope = np.array([(law.logpdf(theta + h) - law.logpdf(theta - h)) / 2e-5 for h in step])
    np.testing.assert_allclose(slope, -np.linalg.solve(factor * scale, theta - centre), rtol=1e-4)
    assert factor > 3.0 and conflict_variance_factor(priors, centre + 0.1, names) == 1.0 == conflict_variance_factor(
        priors, theta, ["another"]
    )
    assert conflict_variance_factor(priors, theta, names[:2]) != factor


@pytest.mark.parametrize("key", ["saturation", "held", None])
def test_priors_are_read_back_also_under_the_angles_earlier_name(key):
    one = Prior("transverse[e]", 0.1, 0.2, False, "1", "x", {"axial[1]": 0.3}, saturation=0.4 if key else None)
    entry = {name: value for name, value in vars(one).items() if name != "saturation"}
    assert read_priors([entry | ({key: 0.4} if key else {})]) == [one]
