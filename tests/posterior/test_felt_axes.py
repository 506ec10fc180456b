"""Flights with parameters of their own: looked at by the coordinates that move them, and by all of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.fitting import FeltFlight, simulate

from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.kalman import Seen
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.beyond_linear import comparison, laplace, linear_errors, polynomials
from bayeschute.posterior.felt_axes import Group, apart, groups, together
from bayeschute.posterior.fit import correction_fit
from bayeschute.posterior.joint_mode import conditional, fit
from bayeschute.posterior.marginal import Quadratic, log_density, marginalise
from bayeschute.posterior.noise_evidence import NoisePrior

FLIGHTS, SIZE = 3, 5  # one parameter that all feel, an error of each flight's record, and one that no flight feels


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class OwnFlight(FeltFlight):
    """A flight that all fitted parameters but two leave as it is: what drives it, and a constant error of its record."""

    own: int = field(default=1, metadata={"static": True})

    def with_own_parameters(self):
        return replace(self, own=1), (0, self.own)

    def numbers(self, theta):
        return jnp.stack([theta[0], theta[self.own]])

    def advance(self, x, numbers, now, then, error_now, error_then):
        return super().advance(x, numbers[0], now, then, error_now, error_then)

    def observe(self, x, numbers, now):
        return x + numbers[1] + 0.05 * numbers[1] ** 2


@pytest.fixture(scope="module")
def made(descent):
    """The posterior of three flights, without corrections."""
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.2, 0.2, 2.0))), (np.array([0.5, 3.0]),))
    nothing, rng = np.zeros((60, 1)), np.random.default_rng(4)
    empty = replace(descent.flights[0], observed=nothing, present=nothing == 0.0, start_scale=np.array([0.2]))
    theta = np.array([1.0, *(0.3 * rng.standard_normal(FLIGHTS)), 0.0])
    flights = [
        simulate(replace(empty, model=OwnFlight(nothing[:, 0], own=1 + k)), hyper, theta, k)[0] for k in range(FLIGHTS)
    ]
    priors = [Prior(f"p{k}", 1.0 if k == 0 else 0.0, 0.5, False, "1", "test") for k in range(SIZE)]
    return marginalise(flights, hyper, priors, fit(flights, hyper, priors, theta, tolerance=1e-6))


def _as_one(marginal):
    """The same posterior, whose flights are said to be moved by all coordinates."""
    whole = replace(marginal)
    whole.__dict__["felt"] = np.ones((FLIGHTS, SIZE), bool)
    return whole


def test_coordinates_of_a_flights_own_parameters_move_it_alone(made):
    own = np.eye(FLIGHTS, dtype=bool)
    wanted = np.column_stack([np.ones(FLIGHTS, bool), own, np.zeros(FLIGHTS, bool)])
    np.testing.assert_array_equal(made.felt, wanted)
    assert [(g.flights, g.axes.tolist()) for g in groups(made)] == [((0,), [0, 1]), ((1,), [0, 2]), ((2,), [0, 3])]
    (one,) = groups(_as_one(made))
    assert one.flights == (0, 1, 2) and one.axes.tolist() == [*range(SIZE)]


def test_a_flight_keeps_derivatives_by_the_parameters_that_move_it(made):
    """Of all the others they are zero: no memory in proportion to all flights' errors for each of them."""
    for k, along in enumerate(made.along):
        assert along.parameters.tolist() == [0, 1 + k]
        sizes = {np.shape(part)[-1] for part in jax.tree.leaves((along.slope, along.aside, along.known_slope))}
        assert sizes == {2} and np.shape(along.unit)[-1] == 3


def test_law_the_density_is_that_of_all_flights_looked_at_along_all_axes(made, monkeypatch):
    """Slopes, polynomials, expansion, followed paths; at a share of the places."""
    usual, looked = laplace.approached, []

    def approached(flights, *given):
        looked.append(len(flights))
        return usual(flights, *given)

    monkeypatch.setattr(laplace, "approached", approached)
    found = []
    for marginal in (made, _as_one(made)):
        looked.clear()
        errors = linear_errors.linear_errors(marginal)
        corrected, expansion = polynomials.corrected(marginal)
        found.append(((*errors, *corrected.determinant, *corrected.bend, *expansion), corrected, sum(looked)))
    (ours, by_groups, few), (whole, at_once, many) = found
    for a, b in zip(ours, whole, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)
    assert np.abs(by_groups.bend.curvature).max() > 0.01  # there is something to be the same
    for one, other in zip(by_groups.along, at_once.along, strict=True):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-4), one.aside, other.aside)
    xi = np.random.default_rng(0).standard_normal((SIZE, 50))
    np.testing.assert_allclose(log_density(by_groups, xi), log_density(at_once, xi), atol=1e-3)
    assert few < 0.5 * many


def test_comparisons_by_groups_add_up(made):
    marginal = polynomials.corrected(made)[0]
    points = 0.5 * np.random.default_rng(1).standard_normal((6, SIZE))
    ours, whole = comparison.compared(marginal, points), comparison.compared(_as_one(marginal), points)
    assert ours.missing.shape == (FLIGHTS, 6) and whole.missing.shape == (1, 6)
    np.testing.assert_allclose(ours.missing.sum(axis=0), ours.errors, atol=1e-9)
    for name in ("own", "laplace", "errors", "in_range"):
        np.testing.assert_allclose(getattr(ours, name), getattr(whole, name), atol=1e-3)


def test_the_evidence_of_noise_needs_no_derivatives_by_other_flights_parameters(made, monkeypatch):
    """Value and gradient, and the modes of the flights, are those with the columns of zeros."""
    linear, priors = (
        [along.linear for along in made.along],
        [Prior(f"p{k}", 0.0, 0.5, False, "1", "") for k in range(SIZE)],
    )

    def looked():
        evidence = noise_evidence.function_of(made.flights, linear, priors, NoisePrior(made.hyper))
        return (
            *evidence(noise_evidence.to_vector(made.hyper) + 0.1),
            *conditional(made.flights[1], made.hyper, linear[1])[:5],
        )

    few = looked()
    monkeypatch.setattr(Seen, "told", lambda seen: np.arange(seen.series.shape[2]))
    for ours, whole in zip(few, looked(), strict=True):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9), ours, whole)


def test_what_flights_lack_is_found_flight_by_flight(made, monkeypatch):
    """Polynomials of each flight's own coordinates, from fewer points than one of all coordinates has coefficients."""
    rng, parts = np.random.default_rng(2), groups(made)
    wanted = [Quadratic(rng.standard_normal(2), np.diag(0.3 * rng.standard_normal(2))) for _ in parts]
    total = together(wanted, parts, SIZE)

    def compared(marginal, points, progress=None):
        inside = 0.5 * np.sum(points**2, axis=1)
        exact = np.array([one.at(points[:, g.axes].T) for one, g in zip(wanted, parts, strict=True)])
        before = apart(marginal.correction, parts)
        own = np.array([one.at(points[:, g.axes].T) for one, g in zip(before, parts, strict=True)])
        known = np.ones(len(points), bool)
        return comparison.Compared(inside + own.sum(axis=0), inside + exact.sum(axis=0), known, exact - own)

    monkeypatch.setattr(comparison, "compared", compared)
    done = correction_fit.fitted(made, rng)
    assert done.before > 0.1 and done.shift < 0.02 and done.error < 0.05
    np.testing.assert_allclose(done.marginal.correction.slope, total.slope, atol=0.03)
    np.testing.assert_allclose(done.marginal.correction.curvature, total.curvature, atol=0.05)


def test_a_polynomial_is_shared_out_and_put_together_again():
    parts = [Group((0,), np.array([0, 1])), Group((1, 3), np.array([0, 2])), Group((2,), np.array([0, 2, 3]))]
    rng = np.random.default_rng(3)
    each = [Quadratic(rng.standard_normal(len(g.axes)), np.eye(len(g.axes)) + 0.2) for g in parts]
    whole = together(each, parts, 5)
    assert whole.curvature[1, 2] == whole.curvature[1, 3] == 0.0 and not whole.curvature[4].any()
    shared = apart(whole, parts)
    again = together(shared, parts, 5)
    np.testing.assert_allclose(again.slope, whole.slope)
    np.testing.assert_allclose(again.curvature, whole.curvature)
    assert shared[0].slope[1] == each[0].slope[1]  # its own
    assert shared[0].slope[0] == pytest.approx(sum(one.slope[0] for one in each) / 3)  # all three have it
