"""Draws and their density: errors that Laplace's approximation shows at the draws are judged, and mended by drawing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from bayeschute.posterior.beyond_linear.comparison import Compared
from bayeschute.posterior.beyond_linear.expansion import Expansion
from bayeschute.posterior.fit import drawn_density
from bayeschute.posterior.fit.correction_fit import MOST_SHIFT
from bayeschute.posterior.fit.drawn_density import Sampled, judged, sampled
from bayeschute.posterior.marginal import Quadratic
from bayeschute.posterior.sampling.protocol import Draws

SIZE = 3


@dataclass(frozen=True)
class Gaussian:
    """A density whose linear models are standard normal, and are short of `bend` that is known."""

    bend: Quadratic

    felt = np.ones((1, SIZE), bool)

    @property
    def correction(self) -> Quadratic:
        return self.bend


@dataclass(frozen=True)
class Found:
    marginal: Gaussian
    determinant_error: float = 0.01


def polynomial(slope: float, curvature: float) -> Quadratic:
    """Along the second axis."""
    axis = np.eye(SIZE)[1]
    return Quadratic(slope * axis, curvature * np.outer(axis, axis))


def draws(marginal: Gaussian, seed: int = 0) -> Draws:
    """Independent draws of the density."""
    inverse = np.linalg.inv(np.eye(SIZE) + np.asarray(marginal.bend.curvature))
    root = np.linalg.cholesky(inverse)
    unit = np.random.default_rng(seed).standard_normal((4, 1000, SIZE))
    xi = -inverse @ np.asarray(marginal.bend.slope) + unit @ root.T
    return Draws(xi, np.zeros((4, 1000)), {}, 0, 0)


@pytest.fixture
def told(monkeypatch):
    """Laplace's approximation is what `right` says, with noise; returns where it was asked."""
    asked, rng = [], np.random.default_rng(3)

    def set_to(right, noise=0.02, lost=0.0):
        def compared(marginal, points, progress=None):
            asked.append(points)
            own = 0.5 * np.sum(points**2, axis=1) + np.asarray(marginal.correction.at(points.T))
            laplace = 0.5 * np.sum(points**2, axis=1) + np.asarray(right.at(points.T))
            laplace += noise * rng.standard_normal(len(points)) + 7.0  # of a constant the density does not depend
            laplace[rng.random(len(points)) < lost] = np.nan
            return Compared(own, laplace, np.ones(len(points), bool), (laplace - own)[None])

        monkeypatch.setattr(drawn_density.comparison, "compared", compared)
        monkeypatch.setattr(
            drawn_density,
            "expansion_of",
            lambda marginal: Expansion(np.zeros(SIZE), np.eye(SIZE) + np.asarray(marginal.bend.curvature)),
        )
        return asked

    return set_to


def test_a_right_density_is_judged_by_few_draws(told):
    asked = told(Quadratic.none(SIZE))
    found = Found(Gaussian(Quadratic.none(SIZE)))
    made = sampled(found, draws)
    assert sum(map(len, asked)) == 2 * SIZE and made.shift < 0.03
    assert made.bend is found.marginal.bend
    assert sampled(replace(found, determinant_error=0.15), draws).shift == 0.15  # the larger one counts
    assert np.isnan(sampled(replace(found, determinant_error=np.nan), draws).shift)


def test_a_density_wrong_at_normal_points_is_corrected_by_its_draws(told):
    """Though it would do there: what normal points say no longer holds once it is another density."""
    told(polynomial(0.1, 0.1))
    said = []
    found = Found(Gaussian(Quadratic.none(SIZE)), MOST_SHIFT + 0.01)
    made = sampled(found, draws, lambda share, words: said.append(words))
    assert len(said) == 2 and made.shift < 0.05
    assert made.bend.slope[1] == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize(("slope", "curvature"), [(0.0, 1.0), (0.4, 0.0), (0.5, 0.6)])
def test_what_an_error_does_is_told_in_closed_form(told, slope, curvature):
    told(polynomial(slope, curvature))
    seen = judged(Gaussian(Quadratic.none(SIZE)), draws(Gaussian(Quadratic.none(SIZE))).xi)
    sd = 1.0 / np.sqrt(1.0 + curvature)
    assert seen.shift == pytest.approx(max(slope * sd, 1.0 / sd - 1.0), abs=0.08)
    assert seen.points == drawn_density._MOST * SIZE


def test_a_density_too_wide_is_narrowed_and_drawn_again(told):
    told(polynomial(0.3, 1.0))
    said = []
    made = sampled(Found(Gaussian(Quadratic.none(SIZE))), draws, lambda share, words: said.append((share, words)))
    assert made.shift < MOST_SHIFT and 2 <= len(said) <= 3
    np.testing.assert_allclose(made.draws.xi[..., 1].std(), np.sqrt(0.5), rtol=0.06)
    np.testing.assert_allclose(made.draws.xi[..., 0].std(), 1.0, rtol=0.06)
    assert [share for share, _ in said] == sorted(share for share, _ in said)
    assert "shifts means by 0." in said[0][1]


def test_flights_that_fail_leave_the_density_unjudged(told):
    asked = told(polynomial(0.0, 2.0), lost=0.6)
    made = sampled(Found(Gaussian(Quadratic.none(SIZE))), draws)
    assert np.isnan(made.shift) and len(asked) == 1
    told(polynomial(0.0, 1.0), lost=0.1)
    assert np.isfinite(sampled(Found(Gaussian(Quadratic.none(SIZE))), draws).shift)


def test_a_correction_that_takes_the_mode_away_is_not_taken(told):
    told(polynomial(0.0, -1.2))
    found = Found(Gaussian(Quadratic.none(SIZE)))
    made = sampled(found, draws)
    assert made.bend is found.marginal.bend and made.shift > MOST_SHIFT


def test_the_fit_has_the_density_that_was_drawn_from(found, descent):
    bend = Quadratic(np.array([0.1]), np.array([[0.3]]))
    made = Sampled(draws(Gaussian(Quadratic.none(SIZE))), bend, 0.12).of(found)
    assert made.marginal.bend is bend and made.determinant_error == 0.12 and made.optimum is found.optimum


def test_the_density_of_a_body_alone_is_right_at_its_draws(found, descent):
    """Laplace's approximation itself, at draws about as the posterior has them."""
    xi = np.random.default_rng(1).standard_normal((2, 100, 1))
    seen = judged(found.marginal, xi)
    assert 0.0 < seen.error < 0.1 and seen.shift < 0.05
