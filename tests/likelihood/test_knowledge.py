"""Knowledge from outside: conditioning against a dense solution, taking it out again, and conflict against its law."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.knowledge import Observed, conditioned, conflict, without
from bayeschute.likelihood.priors import Prior, correlated, covariance, working


@pytest.fixture
def priors():
    law = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, -0.02], [0.0, -0.02, 0.25]])
    blank = [Prior(name, 0.0, 1.0, False, "1", "test") for name in ("a", "b", "c")]
    return correlated(blank, np.array([0.5, -0.2, 1.0]), law)


@pytest.fixture
def known():
    x = np.linspace(0.0, 0.5, 5)
    return Observed(np.stack([np.ones(5), x**2, np.zeros(5)], axis=1), 0.6 - 0.5 * x**2, np.diag(np.full(5, 0.03**2)))


def test_a_coefficient_known_by_itself_is_multiplied_into_its_prior():
    """Precisions add, means are weighted by them (product of two Gaussians)."""
    (made,) = conditioned(
        [Prior("a", 1.0, 0.5, False, "1", "")], Observed(np.eye(1), np.array([2.0]), np.array([[0.25]]))
    )
    assert made.centre == pytest.approx(1.5) and made.scale == pytest.approx(np.sqrt(0.125))


def test_a_curve_conditions_the_whole_prior(priors, known):
    made = conditioned(priors, known)
    weight = np.linalg.inv(known.covariance)
    precision = np.linalg.inv(covariance(priors)) + known.design.T @ weight @ known.design
    shift = np.linalg.inv(covariance(priors)) @ working(priors)[0] + known.design.T @ weight @ known.values
    np.testing.assert_allclose(covariance(made), np.linalg.inv(precision), rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(working(made)[0], np.linalg.solve(precision, shift), rtol=1e-10)
    assert made[2].scale < priors[2].scale  # told by its correlation alone


def test_what_is_known_twice_counts_twice(priors, known):
    both = Observed(np.vstack([known.design] * 2), np.tile(known.values, 2), np.kron(np.eye(2), known.covariance))
    one_by_one, together = conditioned(conditioned(priors, known), known), conditioned(priors, both)
    np.testing.assert_allclose(covariance(one_by_one), covariance(together), atol=1e-12)


def test_knowledge_can_be_taken_out_again(priors, known):
    made = conditioned(priors, known)
    mean, law = without(working(made)[0], covariance(made), known)
    np.testing.assert_allclose(mean, working(priors)[0], rtol=1e-8)
    np.testing.assert_allclose(law, covariance(priors), rtol=1e-8, atol=1e-12)


def test_what_only_the_knowledge_tells_is_nothing_without_it(known):
    assert without(np.zeros(3), np.diag([1e-5, 1e-2, 1.0]) + 0.0, known) is not None
    wide = [Prior(name, 0.0, 1e3, False, "1", "") for name in ("a", "b", "c")]
    made = conditioned(wide, known)
    assert without(working(made)[0], covariance(made), known) is None


def test_conflict_is_a_chi_square_where_both_are_right(priors, known):
    rng = np.random.default_rng(5)
    law, centre = covariance(priors), working(priors)[0]
    p, z = [], []
    for _ in range(2000):
        truth = rng.multivariate_normal(centre, law)
        values = rng.multivariate_normal(known.design @ truth, known.covariance)
        found = conflict(centre, law, known._replace(values=values))
        p.append(found.p_value)
        z.append(found.z)
    assert found.freedom == 5
    share = np.mean(np.array(p)[:, None] < np.array([0.05, 0.25, 0.5, 0.75]), axis=0)
    np.testing.assert_allclose(share, [0.05, 0.25, 0.5, 0.75], atol=0.04)
    assert np.std(z) == pytest.approx(1.0, abs=0.05)


def test_what_lies_ten_deviations_off_is_in_conflict(priors, known):
    off = known._replace(values=known.values + 3.0)
    assert conflict(working(priors)[0], covariance(priors), off).p_value < 1e-10


def test_a_covariance_of_lower_rank_counts_what_it_tells():
    """A curve of one uncertain number, at three points, differs from nothing known in one number."""
    slope = np.array([1.0, 2.0, 3.0])
    known = Observed(np.zeros((3, 1)), 2.0 * slope, np.outer(slope, slope))
    found = conflict(np.zeros(1), np.eye(1), known)
    assert found.freedom == 1 and found.chi_square == pytest.approx(4.0)
